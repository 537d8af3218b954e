"""Items of the report on a map: what every cell took, who needs less, from where on, and how sure that is."""

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pandas as pd

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, UNDECIDED, WORSE
from benchmark.analysis.intervals import Estimate, proportion
from benchmark.analysis.looks import NEITHER, Cell, identities
from benchmark.reports.folder import Folder
from benchmark.reports.item import item, no_rows
from benchmark.reports.map.data import Maps, median

POINT: Final = {"grid": "", "point": ""}
LEARNER: Final = {"learner": ""}
_SPENT: Final = {"steps": "steps", "disagreements": "wrong PINGs", "cpu_time_s": "CPU seconds"}
_IN_WORDS: Final = {
    BETTER: "faster",
    WORSE: "slower",
    EQUIVALENT: "equally fast",
    NEITHER: "neither learns",
    UNDECIDED: "undecided",
}


@item(
    "cells",
    "every point and learner: the share of runs that learn, and medians of what they take",
    {
        **POINT,
        **LEARNER,
        "n": "runs",
        "solved": "share that learns",
        "success": "success at the end",
        "steps": "median steps",
        "disagreements": "median wrong PINGs",
        "unseen_success": "success in unseen places",
    },
    best="-steps",
)
def cells(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates all populations. A run that never solves its scenario takes infinitely many steps."""
    for cell, ends in data.ends.items():
        took = ends.took()
        yield {
            **data.key(cell),
            **_learner(cell),
            "n": ends.n,
            "budget": ends.budget,
            "n_solved": int(np.isfinite(took[0]).sum()),
            "solved": proportion(np.isfinite(took[0])),
            "success": proportion(ends.success[:, -1]),
            "steps": median(took[0]),
            "disagreements": median(took[1]),
            "unseen_success": Estimate(np.nan, np.nan, np.nan)
            if np.isnan(ends.unseen).any()
            else proportion(ends.unseen),
        }


@item(
    "cpu",
    "measured: median CPU seconds of training until a run has learned",
    {**POINT, **LEARNER, "n": "runs", "cpu_time_s": "CPU seconds"},
    is_measured=True,
    where=no_rows,
)
def cpu(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates the time of training alone: no evaluation counts."""
    for cell, ends in data.ends.items():
        took = median(ends.took()[2])
        yield {**data.key(cell), **_learner(cell), "n": ends.n, "cpu_time_s": took}


@item(
    "contrasts",
    "which learner needs fewer steps, at the first look that decides it, or at the last",
    {
        **POINT,
        "x": "",
        "y": "",
        "n": "pairs of runs",
        "verdict": "verdict on x",
        "faster": "probability that x is faster",
        "ratio": "median steps of y / of x",
    },
)
def contrasts(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates the declared contrasts. Intervals of `faster` hold for all contrasts and looks at once.

    `ratio` is of medians, with a 95 % interval by resampling runs and what they draw, not adjusted; where one
    of the two never solves, its budget counts in its place, and the ratio is a bound.
    """
    for (x, y), decision in data.decided.items():
        ends = data.ends[x], data.ends[y]
        yield {
            **data.key(x),
            "x": x.learner,
            "y": y.learner,
            "n": decision.n,
            "budget": min(each.budget for each in ends),
            "verdict": _IN_WORDS[decision.verdict],
            "faster": decision.faster,
            "ratio": data.ratio(x, y, "steps"),
            "ratio_disagreements": data.ratio(x, y, "disagreements"),
        }


@item(
    "verdicts",
    "how many verdicts each contrast has, over the points of a grid",
    {"grid": "", "x": "", "y": "", "n": "points", **dict.fromkeys(_IN_WORDS.values(), "")},
)
def verdicts(data: Maps) -> Iterator[dict[str, Any]]:
    """Counts verdicts; a point of two grids counts in both."""
    names = [*_IN_WORDS.values()]
    counts: dict[tuple[str, str, str], list[str]] = {}
    for (x, y), decision in data.decided.items():
        key = str(data.key(x)["grid"]), x.learner, y.learner
        counts.setdefault(key, []).append(_IN_WORDS[decision.verdict])
    for (grid, x_name, y_name), ended in counts.items():
        row = {"grid": grid, "x": x_name, "y": y_name, "n": len(ended)}
        yield row | {name: ended.count(name) for name in names}


@item(
    "looks",
    "how many pairs of runs the contrasts took, and how they ended",
    {"n": "pairs of runs", "contrasts": "", **dict.fromkeys(_IN_WORDS.values(), "")},
)
def looks(data: Maps) -> Iterator[dict[str, Any]]:
    """Counts contrasts by the look that decided them, those of several grids once."""
    report, names = data.experiment.report, identities(data.experiment)
    assert report is not None
    distinct = {names[pair]: decision for pair, decision in data.decided.items()}
    for n in report.looks:
        ended = [_IN_WORDS[each.verdict] for each in distinct.values() if each.n == n]
        yield {"n": n, "contrasts": len(ended), **{name: ended.count(name) for name in _IN_WORDS.values()}}


@looks.sentence
def _(table: pd.DataFrame, _: Folder) -> str:
    """Says how sure verdicts are."""
    return (
        f"Of {table['contrasts'].sum():,} distinct contrasts, {table['undecided'].sum()} are undecided. "
        "The probability of any wrong verdict among all of them is at most 5 %, not counting changes of the "
        "protocol."
    )


@item(
    "crossings",
    "from which value of an axis on x needs less than y, by medians",
    {"grid": "", "x": "", "y": "", "currency": "counted in", "crossing": "from"},
)
def crossings(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates crossings in steps and disagreements, for all pairs of a net and a table along an axis."""
    yield from _crossings(data, ("steps", "disagreements"))


@item(
    "crossings_cpu",
    "measured: from which value of an axis on x needs fewer CPU seconds than y",
    {"grid": "", "x": "", "y": "", "currency": "counted in", "crossing": "from"},
    is_measured=True,
)
def crossings_cpu(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates crossings in CPU time."""
    yield from _crossings(data, ("cpu_time_s",))


def _crossings(data: Maps, currencies: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    for grid, lines in data.lines.items():
        if any(value == 0 for line in lines.values() for value, _ in line):
            continue  # not on a logarithmic axis
        own = {name: line for name, line in lines.items() if not data.is_reference(line[0][1])}
        families = {name: data.family(line[0][1]) for name, line in own.items()}
        for x, y in ((x, y) for x in own for y in own if (families[x], families[y]) == ("deep", "tabular")):
            if len({value for value, _ in own[x]} & {value for value, _ in own[y]}) > 1:
                for currency in currencies:
                    yield {
                        "grid": grid,
                        "x": x,
                        "y": y,
                        "currency": _SPENT[currency],
                        "crossing": data.crossing(sorted(own[x]), sorted(own[y]), currency),
                    }


@item(
    "exponents",
    "exponents of median steps along an axis",
    {"grid": "", **LEARNER, "n": "values", "exponent": ""},
    where=lambda frame: frame[frame["exponent"].notna()],
    best="-exponent",
)
def exponents(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates slopes of straight lines through the logarithms of medians, with intervals over runs."""
    for grid, lines in data.lines.items():
        for line in lines.values():
            if any(value == 0 for value, _ in line):
                continue
            n, exponent = data.exponent(sorted(line))
            yield {"grid": grid, **_learner(line[0][1]), "n": n, "exponent": exponent}


@item(
    "reference",
    "exploratory: DQN and PPO of Stable-Baselines3 compared with the compiled ones",
    {
        **POINT,
        "x": "",
        "y": "reference",
        "n": "runs of x",
        "n_reference": "runs of the reference",
        "steps": "median steps of x",
        "steps_reference": "of the reference",
        "faster": "probability that x is faster",
    },
)
def reference(data: Maps) -> Iterator[dict[str, Any]]:
    """Compares runs of other seeds and other code: by pairs of one run of each, all with all."""
    for cell, ends in data.ends.items():
        of = data.experiment.algorithms[cell.variant].reference_for
        ours = cell._replace(variant=of)
        if of and ours in data.ends:
            x, y = data.ends[ours].took()[0], ends.took()[0]
            yield {
                **data.key(cell),
                "x": ours.learner,
                "y": cell.learner,
                "n": len(x),
                "n_reference": ends.n,
                "steps": median(x),
                "steps_reference": median(y),
                "faster": float(np.where(x[:, None] == y, 0.5, x[:, None] < y).mean()),
            }


@item("runs", "every run: what it took until it had learned", where=no_rows)
def runs(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates all runs, numbered by seed; empty where a run never solves its scenario."""
    for cell, ends in data.ends.items():
        key = data.key(cell)
        for i, (n_steps, n_disagreements, _) in enumerate(ends.took().T):
            yield {
                "grid": key["grid"],
                "point": key["point"],
                "learner": cell.learner,
                "run": i,
                "steps": n_steps if math.isfinite(n_steps) else np.nan,
                "disagreements": n_disagreements if math.isfinite(n_disagreements) else np.nan,
            }


def _learner(cell: Cell) -> dict[str, Any]:
    return {"algorithm": cell.variant, "observation": cell.observation}
