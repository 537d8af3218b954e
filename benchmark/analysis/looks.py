"""Contrasts that are tested at several looks and get no more runs once they are decided.

The endpoint of a run is after how many steps it has learned. Two learners are compared by the probability
that the first is faster, with ties counted as a half, over pairs of runs of the same seed, which have the
same draw of the scenario. Pairs are independent, so the mean of these numbers, each 0, 1/2 or 1, has the
interval of a proportion, and what a scenario draws is part of its width.

At each of the declared looks, every contrast has intervals of such a level that the probability of any wrong
verdict, in all contrasts at all looks, is at most 5 % (repeated confidence intervals: Jennison and Turnbull
1989, Journal of the Royal Statistical Society B 51:305-361; here with Bonferroni's correction). So it does
not matter why a contrast gets more runs.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.analysis.frames import Group, by_population, by_step, learned, tables
from benchmark.analysis.intervals import LEVEL, Estimate, proportion_interval
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Population

FASTER, SLOWER, EQUAL, UNDECIDED = "faster", "slower", "equally fast", "undecided"
NEITHER: Final = "neither learns"  # most runs of neither learner learn
VERDICTS: Final = (FASTER, SLOWER, EQUAL, NEITHER, UNDECIDED)
SPENT: Final = {"steps": "step", "disagreements": "training_wrong_pings", "cpu_time_s": "cpu_time_s"}
_ENDS: Final = 3  # if a verdict is wrong, so is one end of an interval: two of a probability, one of a share


class Decision(NamedTuple):
    """What a look at a contrast says."""

    n: int  # pairs of runs
    verdict: str
    faster: Estimate  # the probability that x is faster, with the interval of this look


class Contrast(NamedTuple):
    """Two learners at a point of a map, and what the first look that decides says, or else the last one."""

    x: Population
    y: Population
    took: tuple[pd.DataFrame, pd.DataFrame]  # see `took`: of n pairs
    decision: Decision
    at_level: Mapping[float, str]  # verdicts on the same pairs at further levels of success, exploratory


def tail_of(n_contrasts: int, n_looks: int) -> float:
    """Returns the probability that one end of an interval may leave out."""
    return (1 - LEVEL) / (_ENDS * n_contrasts * n_looks)


def decide(x: NDArray[np.float64], y: NDArray[np.float64], margin: float, tail: float) -> Decision:
    """Compares the steps, (N,) each, after which runs of the same seeds have learned; infinite if never."""
    n = len(x)
    wins = np.where(x == y, 0.5, x < y)
    mean = float(wins.mean())
    low, high = (float(end) for end in proportion_interval(mean, n, tail))
    never = min(float(proportion_interval(np.isinf(steps).mean(), n, tail)[0]) for steps in (x, y))
    if never > 0.5:
        verdict = NEITHER
    elif 0.5 - margin < low <= high < 0.5 + margin:
        verdict = EQUAL
    else:
        verdict = FASTER if low > 0.5 else SLOWER if high < 0.5 else UNDECIDED
    return Decision(n, verdict, Estimate(mean, low, high))


def took(curves: pd.DataFrame, level: float) -> pd.DataFrame:
    """Returns what the runs of a population took until they had learned, a row for each.

    It has the keys of `SPENT`, infinite if the run never learned; `success` at the last evaluation; and, with
    the prefix `spent_`, what the run had spent by then.
    """
    steps, success = by_step(curves, "step")[0], by_step(curves, "success")
    first, last = learned(success, steps, level, until=2), len(steps) - 1
    of_runs = {"success": success[:, last]}
    for name, column in SPENT.items():
        values = by_step(curves, column).astype(float)
        at_first = values[np.arange(len(values)), np.minimum(first, last)]
        of_runs |= {name: np.where(first > last, np.inf, at_first), f"spent_{name}": values[:, last]}
    return pd.DataFrame(of_runs)


def rows_of(experiment: Experiment, frame: pd.DataFrame) -> dict[Population, pd.DataFrame]:
    """Returns the rows of every population of a map that has any, without runs after a missing one."""
    named = {(keys["condition"], keys["learner"]): rows for keys, rows in by_population(frame)}
    rows_by_population = {}
    for population in experiment.populations:
        rows = named.get((population.condition.name, population.learner.name), frame[:0])
        seeds, start = rows["seed"].unique(), population.seeds.start
        n = int((seeds == start + np.arange(len(seeds))).sum())
        if n:
            rows_by_population[population] = rows[rows["seed"] < start + n]
    return rows_by_population


def compared(experiment: Experiment) -> list[tuple[Population, Population]]:
    """Lists the populations of every contrast: a contrast of learners at each point where there are both."""
    assert experiment.report is not None
    points: dict[str, dict[str, Population]] = {}
    for population in experiment.populations:
        if experiment.declared.grids[population.condition.axes["grid"]].is_compared:
            points.setdefault(population.condition.name, {})[population.learner.name] = population
    return [
        (sides[x], sides[y])
        for sides in points.values()
        for x, y in experiment.report.contrasts
        if x in sides and y in sides
    ]


def contrasts(experiment: Experiment, curves: pd.DataFrame) -> list[Contrast]:
    """Lists all contrasts that have enough runs for a look, each looked at until it is decided."""
    report, solved, pairs = experiment.report, experiment.declared.solved, compared(experiment)
    assert report is not None
    assert solved is not None
    # The same contrast may be in two grids.
    n_contrasts = len({(x.first.digest, y.first.digest) for x, y in pairs})
    tail, rows, looked = tail_of(n_contrasts, len(report.looks)), rows_of(experiment, curves), []
    for sides in pairs:
        if not all(side in rows for side in sides):
            continue
        levels, decision = (solved.success, *solved.further), None
        taken = {level: [took(rows[side], level) for side in sides] for level in levels}
        x, y = taken[solved.success]
        for n in (n for n in report.looks if n <= min(len(x), len(y))):
            decision = _look(taken[solved.success], n, report.margins.faster, tail)
            if decision.verdict != UNDECIDED:
                break
        if decision is not None:
            at_level = {
                level: _look(taken[level], decision.n, report.margins.faster, tail).verdict
                for level in solved.further
            }
            looked.append(Contrast(*sides, (x[: decision.n], y[: decision.n]), decision, at_level))
    return looked


def _look(taken: Sequence[pd.DataFrame], n: int, margin: float, tail: float) -> Decision:
    """Decides by the first n pairs of runs, given what both sides took."""
    x, y = (side["steps"].to_numpy()[:n] for side in taken)
    return decide(x, y, margin, tail)


def stages(experiment: Experiment, store: Store) -> Iterator[list[Group]]:
    """Yields the declared runs, and for every further look those of contrasts that are undecided before it.

    Whoever asks for the next stage has stored those before.
    """
    assert experiment.report is not None
    sides = {side for pair in compared(experiment) for side in pair}
    groups = [Group(population, population.runs()) for population in experiment.populations]
    looked_at = [group for group in groups if group.population in sides]
    yield groups
    for before, n in pairwise(experiment.report.looks):
        _, curves = tables(looked_at, store, ["success", *SPENT.values()])
        looked = contrasts(experiment, curves)
        undecided = [contrast for contrast in looked if contrast.decision.verdict == UNDECIDED]
        if not undecided:
            return
        groups = []
        for side in dict.fromkeys(side for contrast in undecided for side in (contrast.x, contrast.y)):
            start = side.seeds.start
            groups.append(Group(side, side.runs(range(start + before, start + n))))
        looked_at += groups
        yield groups
