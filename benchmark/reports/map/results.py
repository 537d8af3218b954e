"""Items of the report on a map: what every cell took, who needs less, from where on, and how sure that is."""

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pandas as pd

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, UNDECIDED, WORSE
from benchmark.analysis.intervals import Estimate, median, proportion
from benchmark.analysis.looks import NEITHER, TOO_SHORT, Cell, identities
from benchmark.reports.folder import Folder
from benchmark.reports.item import item, no_rows
from benchmark.reports.map.data import Maps

POINT: Final = {"grid": "", "point": ""}
LEARNER: Final = {"learner": ""}
_IN_WORDS: Final = {
    BETTER: "faster",
    WORSE: "slower",
    EQUIVALENT: "equally fast",
    NEITHER: "neither learns",
    TOO_SHORT: "budget too short",
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


@item("pairs", "what every contrast uses: the steps of its pairs of runs, within one budget", where=no_rows)
def pairs(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates the runs of each contrast; steps are empty where a run does not learn within that budget."""
    for x, y in data.decided:
        key, names = data.key(x), {"x": x.learner, "y": y.learner}
        for i, (ours, theirs) in enumerate(zip(*data.steps_compared(x, y), strict=True)):
            steps = {"steps_x": _finite(ours), "steps_y": _finite(theirs)}
            yield {"grid": key["grid"], "point": key["point"], **names, "run": i, **steps}


@item("runs", "every run: what it took until it had learned, within its own budget", where=no_rows)
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
                "steps": _finite(n_steps),
                "disagreements": _finite(n_disagreements),
            }


@item("unseen", "every run with unseen places: success in them at the end of training", where=no_rows)
def unseen(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates all runs of the points that have unseen places."""
    for cell, ends in data.ends.items():
        key = data.key(cell)
        names = {"grid": key["grid"], "point": key["point"], "learner": cell.learner}
        for i in range(ends.n if key["unseen"] else 0):
            yield {**names, "run": i, "unseen_success": ends.unseen[i]}


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan


def _learner(cell: Cell) -> dict[str, Any]:
    return {"algorithm": cell.variant, "observation": cell.observation}
