"""Where the faster learner changes, with each of the best settings."""

import math
from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np
import pandas as pd

from benchmark.analysis.looks import rows_of, took
from benchmark.experiments import Experiment
from benchmark.studies.item import COLUMNS, item


def kinds_of(experiment: Experiment) -> dict[str, str]:
    """Returns what every grid with one axis is about: steps, success in unseen places, or a control."""
    seen = {p.condition.axes.get("grid") for p in experiment.populations if not p.scenario.issuer.unseen}
    return {
        name: "control" if "permuted" in grid.axes else "steps" if name in seen else "unseen"
        for name, grid in experiment.declared.grids.items()
        if len(grid.axes) == 1
    }


def leading(experiment: Experiment) -> str:
    """Returns the first grid with one axis that is about steps; empty if there is none."""
    return next(steps_grids(experiment), "")


def steps_grids(experiment: Experiment) -> Iterator[str]:
    """Yields the grids with one axis that are about steps."""
    return (grid for grid, kind in kinds_of(experiment).items() if kind == "steps")


def axis_of(experiment: Experiment, grid: str) -> tuple[str, dict[str, float], list[str]]:
    """Returns the only axis of a grid, its values as numbers, by name (5x6 is 30), and as written, 5×6."""
    ((axis, names),) = experiment.declared.grids[grid].axes.items()
    values = {name: math.prod(float(part) for part in name.split("x")) for name in names}
    values = dict(sorted(values.items(), key=lambda pair: pair[1]))
    return axis, values, [name.replace("x", "×") for name in values]


def ranked(experiment: Experiment) -> dict[str, list[str]]:
    """Returns the learners with the best settings, each with those with the second and third best.

    These have the same algorithm, search and form of observation. Reference implementations are left out.
    """
    ranks, first = dict[str, list[str]](), dict[tuple[str, ...], str]()
    for learner in sorted(experiment.learners.values(), key=lambda learner: learner.declared.rank):
        key = learner.declared.algorithm, learner.declared.tuned_by, learner.observation
        if learner.declared.rank > 1 and key in first:
            ranks[first[key]].append(learner.name)
        elif not learner.reference_for:
            ranks[learner.name] = []
            first.setdefault(key, learner.name)
    return ranks


@item(
    "crossings",
    "exploratory: from which value on x needs fewer steps than y, with each of the best settings of both",
    meanings=COLUMNS["crossings"],
)
def crossings(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Mapping[str, object]]:
    """Tabulates the contrasts whose sides have several settings in the first grid with one axis."""
    report, solved, grid = experiment.report, experiment.declared.solved, leading(experiment)
    assert report is not None
    assert solved is not None
    if not grid:
        return
    (axis, numbers, _), level = axis_of(experiment, grid), solved.success
    rows = {
        (population.learner.name, population.condition.axes[axis]): own
        for population, own in rows_of(experiment, curves).items()
        if population.condition.axes["grid"] == grid
    }
    ran, ranks = {name for name, _ in rows}, ranked(experiment)
    for x, y in report.contrasts:
        sides = [[name for name in (side, *ranks.get(side, ())) if name in ran] for side in (x, y)]
        values = [value for value in numbers if all((name, value) in rows for name in sides[0] + sides[1])]
        combinations = [*product(*sides)]
        if len(combinations) < 2 or not values:
            continue
        fewer = np.array([[_fewer(rows[a, v], rows[b, v], level) for v in values] for a, b in combinations])
        # Of each combination, after how many values x needs fewer at all that follow
        first = [len(values) - int(np.minimum.accumulate(row[::-1] > 0).sum()) for row in fewer]
        crossed = [numbers[values[i]] for i in first if 0 < i < len(values)]
        yield {"grid": grid, "x": x, "y": y} | {
            "combinations": len(fewer),
            "x_always": first.count(0),
            "y_always": int((fewer < 0).all(axis=1).sum()),
            "x_later": len(crossed),
            "earliest": min(crossed, default=math.nan),
            "latest": max(crossed, default=math.nan),
            "agreement": int((abs(fewer.sum(axis=0)) == len(fewer)).sum()),
            "values": len(values),
        }


def _fewer(x: pd.DataFrame, y: pd.DataFrame, level: float) -> int:
    """Returns 1 if the median of x is smaller, -1 if that of y is."""
    of_x, of_y = (np.median(took(curves, level)["steps"]) for curves in (x, y))
    return int(of_x < of_y) - int(of_x > of_y)
