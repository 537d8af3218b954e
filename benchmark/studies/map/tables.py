"""The tables of a map: what every population took, and which learner needs fewer steps."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Final

import numpy as np
import pandas as pd

from benchmark.analysis.frames import by_step
from benchmark.analysis.intervals import Estimate, median, proportion
from benchmark.studies.item import COLUMNS, Item, expanded, item, no_rows
from benchmark.studies.map.analysis import MapAnalysis, learner_of, point_of
from benchmark.studies.map.declared import axis_of, curve_grids, name_of
from benchmark.studies.map.looks import FASTER, SLOWER, UNITS, VERDICTS, Runs, by_pick, wins_of

Row = Mapping[str, object]

_LABELS: Final = COLUMNS["map_labels"]
_item: Final = partial(Item[MapAnalysis], labels=_LABELS)
_KEPT: Final = ("at_all_levels", "at_some_levels", "at_no_other_level", "reversed")
_NONE: Final = Estimate(math.nan, math.nan, math.nan)
_SPREAD: Final = 18  # evaluations of `success.csv`


@_item(
    "cells",
    "every point and learner: the share of runs that learn, and medians of what they take",
    "grid point learner n solved success steps steps_fastest steps_slowest disagreements unseen_success "
    "unseen_budget",
    best="-steps",
)
def cells(analysis: MapAnalysis) -> pd.DataFrame:
    """Tabulates all populations."""
    return analysis.cells.reset_index(drop=True)


@item(
    "cpu", "measured: median CPU seconds of training until a run has learned", is_measured=True, where=no_rows
)
def cpu(analysis: MapAnalysis) -> Iterator[Row]:
    """Tabulates the time of training, without evaluations."""
    for population, runs in analysis.learned.items():
        yield learner_of(population) | {"n": len(runs), "cpu_time_s": median(runs["cpu_time_s"])}


@item(
    "contrasts",
    "which learner needs fewer steps, at the first look that decides it, or at the last",
    "grid point x y n verdict faster picks picks_faster ratio wrong_pings_verdict fewer_wrong_pings "
    "failures_verdict fewer_failures",
    labels=_LABELS | {"n": "pairs of runs"},
)
def contrasts(analysis: MapAnalysis) -> Iterator[Row]:
    """Tabulates the declared contrasts."""
    for contrast in analysis.contrasts:
        steps, wrong_pings = (contrast.decisions[unit] for unit in ("steps", "disagreements"))
        failures = contrast.decisions.get("failures")
        yield (
            point_of(contrast.x)
            | contrast.names
            | {
                "n": steps.n,
                "verdict": steps.verdict,
                "why_none": steps.why,
                "faster": steps.faster,
                "picks": len(contrast.shares),
                "picks_faster": sum(share > 0.5 for share in contrast.shares),
                "ratio": contrast.ratios["steps"],
                "ratio_disagreements": contrast.ratios["disagreements"],
                "n_wrong_pings": wrong_pings.n,
                "wrong_pings_verdict": wrong_pings.verdict,
                "fewer_wrong_pings": wrong_pings.faster,
                "failures_verdict": failures.verdict if failures else "",
                "fewer_failures": failures.faster if failures else _NONE,
                **{f"verdict_{level:g}": verdict for level, verdict in contrast.at_level.items()},
            }
        )


@item("verdicts", "how many verdicts each contrast has, over the points of a grid, by unit", where=no_rows)
def verdicts(analysis: MapAnalysis) -> Iterator[Row]:
    """Counts verdicts; a point of two grids counts in both."""
    ended: dict[tuple[str, ...], list[str]] = {}
    for contrast in analysis.contrasts:
        for unit, decision in contrast.decisions.items():
            key = *(contrast.names[name] for name in ("grid", "x", "y")), UNITS[unit]
            ended.setdefault(key, []).append(decision.verdict)
    for (grid, x, y, unit), found in ended.items():
        yield {"grid": grid, "x": x, "y": y, "unit": unit, "n": len(found), **_counted(found)}


@item(
    "levels",
    "exploratory: how many verdicts are the same at lower levels of success, over the points of all grids",
)
def levels(analysis: MapAnalysis) -> Iterator[Row]:
    """Counts how verdicts change with the level of success; a point of two grids counts once."""
    kept: dict[tuple[str, ...], list[str]] = {}
    for contrast in analysis.distinct:
        if contrast.at_level:
            change = _kept(contrast.decisions["steps"].verdict, [*contrast.at_level.values()])
            kept.setdefault((contrast.names["x"], contrast.names["y"]), []).append(change)
    for (x, y), found in kept.items():
        counts = {change: found.count(change) for change in _KEPT}
        yield {"x": x, "y": y, "points": len(found), "decided": sum(counts.values()), **counts}


def _kept(verdict: str, others: Sequence[str]) -> str:
    """Returns how a verdict fares at other levels, one of `_KEPT`; empty if it names no winner."""
    winners, n = {FASTER, SLOWER}, others.count(verdict)
    if verdict not in winners:
        return ""
    if ({*others} & winners) - {verdict}:
        return "reversed"
    return "at_no_other_level" if n == 0 else "at_all_levels" if n == len(others) else "at_some_levels"


@item(
    "looks",
    "how many pairs of runs the contrasts needed, and their verdicts, by unit",
    labels={"n": "pairs of runs"},
)
def looks(analysis: MapAnalysis) -> Iterator[Row]:
    """Counts contrasts by the look that decided them, those of several grids once."""
    decisions = [contrast.decisions for contrast in analysis.distinct]
    for unit, n in product(UNITS, analysis.data.declared.looks):
        ended = [each[unit].verdict for each in decisions if unit in each and each[unit].n == n]
        yield {"unit": UNITS[unit], "n": n, "contrasts": len(ended), **_counted(ended)}


def _counted(ended: Sequence[str]) -> dict[str, int]:
    return {verdict: ended.count(verdict) for verdict in VERDICTS}


@item(
    "crossings",
    "exploratory: from which value on x needs fewer steps than y, for each pick of settings of x and of y",
)
def crossings(analysis: MapAnalysis) -> Iterator[Row]:
    """Tabulates where the faster learner changes in the first grid."""
    grid = curve_grids(analysis.data.experiment)[0]
    axis, numbers = axis_of(analysis.data.experiment, grid)
    medians = {
        (population.learner.name, population.condition.axes[axis]): [
            np.median(steps) for steps in by_pick(runs["steps"], population)
        ]
        for population, runs in analysis.learned.items()
        if population.condition.axes["grid"] == grid and len(runs) >= len(population.firsts)
    }
    for x, y in analysis.data.declared.contrasts:
        values = [value for value in numbers if {(x, value), (y, value)} <= {*medians}]
        if not values:
            continue
        first, second = (np.array([medians[side, value] for value in values]).T for side in (x, y))
        first, second = first[:, None], second[None]  # (picks of x, picks of y, values)
        fewer = ((first < second) * 1 - (first > second) * 1).reshape(-1, len(values))
        # By combination: the index of the first value from which on x always needs fewer
        n_before = [len(values) - int(np.minimum.accumulate(row[::-1] > 0).sum()) for row in fewer]
        crossed = [numbers[values[i]] for i in n_before if 0 < i < len(values)]
        yield {"grid": grid, "x": x, "y": y} | {
            "combinations": len(fewer),
            "x_always": n_before.count(0),
            "y_always": int((fewer < 0).all(axis=1).sum()),
            "x_later": len(crossed),
            "earliest": min(crossed, default=math.nan),
            "latest": max(crossed, default=math.nan),
            "agreement": int((abs(fewer.sum(axis=0)) == len(fewer)).sum()),
            "values": len(values),
        }


@item(
    "reference",
    "exploratory: reference implementations compared with the learners whose settings they share",
    "grid point x y n n_reference steps steps_reference faster",
    labels=_LABELS | {"n": "runs of x", "steps": "median steps of x"},
)
def reference(analysis: MapAnalysis) -> Iterator[Row]:
    """Compares runs with different seeds and code, by all pairs of one run of each."""
    steps = {
        (population.condition.name, population.learner.name): runs["steps"]
        for population, runs in analysis.learned.items()
    }
    for population in analysis.learned:
        condition, learner = population.condition.name, population.learner
        if (condition, learner.reference_for) in steps:
            x, y = steps[condition, learner.reference_for], steps[condition, learner.name]
            yield point_of(population) | {
                "x": learner.reference_for,
                "y": learner.name,
                "n": len(x),
                "n_reference": len(y),
                "steps": median(x),
                "steps_reference": median(y),
                "faster": float(wins_of(x[:, None], y).mean()),
            }


@item("success", "success at up to 18 evaluations of training, mean over runs", where=no_rows)
def success(analysis: MapAnalysis) -> pd.DataFrame:
    """Tabulates success over training; a run that has ended counts with its last evaluation.

    To keep the file small, it has two digits, and where it stays the same, only the ends have a row.
    """
    tables = []
    for population, rows in analysis.curves.items():
        steps, values = by_step(rows, "step")[0], by_step(rows, "success")
        wanted = np.geomspace(steps[1], steps[-1], _SPREAD)
        at = np.unique(abs(np.log(steps[1:, None] / wanted)).argmin(axis=0)) + 1
        learner, means = population.learner, expanded({"success": proportion(values[:, at])})
        names = name_of(population) | {"variant": learner.variant, "observation": learner.observation}
        table = pd.DataFrame({**names, "step": steps[at].astype(int), **means}).round(2)
        numbers = table[[*means]]
        is_inner = (numbers.eq(numbers.shift()) & numbers.eq(numbers.shift(-1))).all(axis=1)
        tables.append(table[~is_inner])
    return pd.concat(tables, ignore_index=True)


@item("pairs", "what every contrast uses: the steps and wrong PINGs of its pairs of runs", where=no_rows)
def pairs(analysis: MapAnalysis) -> pd.DataFrame | None:
    """Tabulates the runs of each contrast; numbers are empty where a run does not learn."""
    tables = []
    for contrast in analysis.contrasts:
        sides = (_units(runs) for runs in contrast.learned)
        x, y = (side.rename(columns={"disagreements": "wrong_pings"}) for side in sides)
        tables.append((contrast.names, x.join(y, lsuffix="_x", rsuffix="_y").sort_index(axis=1)))
    return _numbered(tables)


@item("runs", "every run: what it took until it had learned", where=no_rows)
def runs(analysis: MapAnalysis) -> pd.DataFrame | None:
    """Tabulates all runs, numbered by seed; empty where a run never solves its scenario."""
    return _numbered(
        (name_of(population) | {"learner": population.learner.name}, _units(rows))
        for population, rows in analysis.learned.items()
    )


@item("unseen", "every run with unseen places: success in them by both policies", where=no_rows)
def unseen(analysis: MapAnalysis) -> pd.DataFrame | None:
    """Tabulates all runs of the points that have unseen places."""
    return _numbered(
        (name_of(population) | {"learner": population.learner.name}, rows.filter(like="unseen_"))
        for population, rows in analysis.runs.items()
        if population.scenario.issuer.unseen
    )


def _units(runs: Runs) -> pd.DataFrame:
    return pd.DataFrame({unit: runs[unit] for unit in ("steps", "disagreements")})


def _numbered(tables: Iterable[tuple[Row, pd.DataFrame]]) -> pd.DataFrame | None:
    """Returns the rows of runs as one table, with their names and numbers, and NaN for infinite values."""
    frames = []
    for names, rows in tables:
        numbers = rows.reset_index(drop=True).replace(np.inf, np.nan)
        frames.append(pd.DataFrame({**names, "run": range(len(rows)), **numbers}))
    return pd.concat(frames, ignore_index=True) if frames else None
