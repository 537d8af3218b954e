"""Contrasts that are tested at several looks and get no more runs once they are decided.

Two learners are compared by what a run takes until it has learned, in steps and in wrong PINGs: by the
probability that the first takes less, with ties counted as a half, over pairs of runs of the same seed, which
have the same draw of the scenario. Pairs are independent, so the mean of these numbers, each 0, 1/2 or 1, has
the interval of a proportion, and what a scenario draws is part of its width.

Looks share an error of 5 % equally. At each, intervals hold for all contrasts at once, so it does not matter
why a contrast gets more runs (repeated confidence intervals: Jennison and Turnbull 1989, Journal of
the Royal Statistical Society B 51:305-361). Which learner is faster is decided step by step, as by Holm
(1979): once some are, the intervals of all others, also of those that are equally fast, are narrower, as for
so many. So any claim that a learner is faster, or that neither learns, is wrong with a probability of at most
5 %, and any that both are equally fast with a third of it. Steps need independent contrasts (Shaffer 1980,
Annals of Statistics 8:1342-1347), or else simulation.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.analysis.frames import Group, by_population, by_step, learned, tables
from benchmark.analysis.intervals import Estimate, proportion_interval
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Population, Reporting

FASTER, SLOWER, EQUAL, UNDECIDED = "faster", "slower", "equally fast", "undecided"
NEITHER: Final = "neither learns"  # most runs of neither learner learn
NO_VERDICT: Final = "no verdict"  # for one of the reasons below
VERDICTS: Final = (FASTER, SLOWER, EQUAL, NEITHER, UNDECIDED, NO_VERDICT)
COARSE: Final = "evaluations are too far apart"
TRIVIAL: Final = "an untrained policy reaches the level"
LOST: Final = "the faster learner has lost the level at the end of training"
SPENT: Final = {"steps": "step", "disagreements": "training_wrong_pings", "cpu_time_s": "cpu_time_s"}
UNITS: Final = {"steps": "steps", "disagreements": "wrong PINGs"}  # in which contrasts are decided
_ERROR: Final = 0.05  # of the probability of any wrong verdict
_ENDS: Final = 3  # if a verdict is wrong, so is one end of an interval: two of a probability, one of a share
_COARSE: Final = 1.25  # an evaluation that is more than so many times as late as the one before

Numbers = NDArray[np.float64]
Mask = NDArray[np.bool_]
Taken = Mapping[Population, pd.DataFrame]  # see `took`


class Decision(NamedTuple):
    """What a look at a contrast says in a unit."""

    n: int  # pairs of runs
    verdict: str
    why: str  # there is no verdict; else empty
    faster: Estimate  # the probability that x takes less; intervals hold for all contrasts and looks at once


class Contrast(NamedTuple):
    """Two learners at a point of a map, and what the first look that decides says, or else the last one."""

    x: Population
    y: Population
    took: tuple[pd.DataFrame, pd.DataFrame]  # see `took`: of as many pairs as its decisions use
    decisions: Mapping[str, Decision]  # by unit
    at_level: Mapping[float, str]  # verdicts on the same pairs at further levels of success, exploratory


def tail_of(n_contrasts: int, error: float) -> float:
    """Returns the probability that one end of an interval may leave out, of a look with a share of the error.

    >>> round(tail_of(10, 0.03), 6)  # three ends each
    0.001
    """
    return error / (_ENDS * n_contrasts)


def decide(
    x: Numbers, y: Numbers, margin: float, tail: float, stepped: float = 0.0, is_open: Mask | None = None
) -> str:
    """Compares what runs of the same seeds took, (N,) each, infinite if they never learned.

    `stepped`, if it is larger, is the tail by which one learner is faster. `is_open` (N,) marks pairs
    of which evaluations are too rare to tell who took less: there is a verdict only if it does not depend on
    them.
    """
    wins = np.where(x == y, 0.5, x < y)
    never = min(float(proportion_interval(np.isinf(taken).mean(), len(x), tail)[0]) for taken in (x, y))
    if never > 0.5:
        return NEITHER
    tails = tail, max(tail, stepped)
    verdicts = [_verdict(wins, margin, *tails)]
    if is_open is not None and is_open.any():
        verdicts += [_verdict(np.where(is_open, end, wins), margin, *tails) for end in (0.0, 1.0)]
    return verdicts[0] if len({*verdicts}) == 1 else NO_VERDICT if verdicts[0] != UNDECIDED else UNDECIDED


def _verdict(wins: Numbers, margin: float, tail: float, stepped: float) -> str:
    low, high = (float(end) for end in proportion_interval(wins.mean(), len(wins), tail))
    if 0.5 - margin < low <= high < 0.5 + margin:
        return EQUAL
    low, high = (float(end) for end in proportion_interval(wins.mean(), len(wins), stepped))
    return FASTER if low > 0.5 else SLOWER if high < 0.5 else UNDECIDED


def took(curves: pd.DataFrame, level: float) -> pd.DataFrame:
    """Returns what the runs of a population took until they had learned, a row for each.

    It has the keys of `SPENT`, infinite if the run never learned; the same at the evaluation before
    (`before_`) and at the last one (`spent_`); and whether the first and last policy reach the level.
    """
    steps, success = by_step(curves, "step")[0], by_step(curves, "success")
    first, last = learned(success, steps, level, until=2), len(steps) - 1
    of_runs: dict[str, NDArray[np.generic]] = {"success": success[:, last]}
    of_runs |= {"untrained": success[:, 0] >= level, "lasts": success[:, last] >= level}
    for name, column in SPENT.items():
        values = by_step(curves, column).astype(float)
        each, before = np.arange(len(values)), np.clip(first - 1, 0, last)
        at_first = values[each, np.minimum(first, last)]
        of_runs |= {name: np.where(first > last, np.inf, at_first), f"spent_{name}": values[:, last]}
        of_runs[f"before_{name}"] = np.where(first > 0, values[each, before], 0.0)
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
    """Lists the contrasts that have enough runs for a look; one of two grids is decided once."""
    report, solved, looked = experiment.report, experiment.declared.solved, list[Contrast]()
    assert report is not None
    assert solved is not None
    runs, *further = (
        {population: took(rows, level) for population, rows in rows_of(experiment, curves).items()}
        for level in (solved.success, *solved.further)
    )
    distinct = {(x.first.digest, y.first.digest): (x, y) for x, y in compared(experiment)}
    decided = {unit: _decide_all(distinct, runs, report, unit) for unit in UNITS}
    for sides in compared(experiment):
        key = (sides[0].first.digest, sides[1].first.digest)
        if key not in decided["steps"]:
            continue
        decisions = {unit: of_unit[key] for unit, of_unit in decided.items()}
        n, n_steps = max(decision.n for decision in decisions.values()), decisions["steps"].n
        tail, margin = tail_of(len(distinct), _ERROR / len(report.looks)), report.margins.faster
        at_level = {
            level: _look([of_level[side] for side in sides], n_steps, margin, (tail, tail), "steps")[0]
            for level, of_level in zip(solved.further, further, strict=True)
        }
        x, y = (runs[side][:n] for side in sides)
        looked.append(Contrast(*sides, (x, y), decisions, at_level))
    return looked


def _decide_all(
    pairs: Mapping[tuple[str, str], tuple[Population, Population]], runs: Taken, report: Reporting, unit: str
) -> dict[tuple[str, str], Decision]:
    """Decides contrasts in a unit, look after look; see the module's docstring."""
    decisions, margin, n_faster = dict[tuple[str, str], Decision](), report.margins.faster, 0
    error = _ERROR / len(report.looks)
    tail = tail_of(len(pairs), error)
    for n in report.looks:
        looked = {
            key: [runs[side] for side in sides]
            for key, sides in pairs.items()
            if all(side in runs and len(runs[side]) >= n for side in sides)
            and (key not in decisions or decisions[key].verdict in (UNDECIDED, NO_VERDICT))
        }
        n_before = -1
        while n_faster > n_before:
            n_before = n_faster
            stepped = tail_of(max(len(pairs) - n_faster, 1), error)
            for key, sides in [*looked.items()]:
                verdict, why = _look(sides, n, margin, (tail, stepped), unit)
                x, y = (side[unit].to_numpy()[:n] for side in sides)
                mean = float(np.where(x == y, 0.5, x < y).mean())
                ends = (float(end) for end in proportion_interval(mean, n, tail))
                decisions[key] = Decision(n, verdict, why, Estimate(mean, *ends))
                if verdict not in (UNDECIDED, NO_VERDICT):
                    del looked[key]
                n_faster += verdict in (FASTER, SLOWER)
    return decisions


def _look(
    sides: Sequence[pd.DataFrame], n: int, margin: float, tails: tuple[float, float], unit: str
) -> tuple[str, str]:
    """Returns the verdict by the first n pairs of runs, and why there is none."""
    x, y = (side[:n] for side in sides)
    if max(x["untrained"].mean(), y["untrained"].mean()) > 0.5:
        return NO_VERDICT, TRIVIAL
    is_coarse = [side["steps"] > _COARSE * side["before_steps"] for side in (x, y)]
    is_learned = np.isfinite(x[unit]) & np.isfinite(y[unit])
    # What a run took lies between what it had spent at two evaluations.
    overlaps = (x[unit] > y[f"before_{unit}"]) & (y[unit] > x[f"before_{unit}"])
    is_open = (is_learned & overlaps & (is_coarse[0] | is_coarse[1])).to_numpy()
    verdict = decide(x[unit].to_numpy(), y[unit].to_numpy(), margin, *tails, is_open)
    winner = {FASTER: x, SLOWER: y}.get(verdict)
    if winner is not None and winner["lasts"][np.isfinite(winner["steps"])].mean() < 0.5:
        return NO_VERDICT, LOST
    return verdict, COARSE if verdict == NO_VERDICT else ""


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
        undecided = [contrast for contrast in looked if contrast.decisions["steps"].verdict == UNDECIDED]
        if not undecided:
            return
        groups = []
        for side in dict.fromkeys(side for contrast in undecided for side in (contrast.x, contrast.y)):
            start = side.seeds.start
            groups.append(Group(side, side.runs(range(start + before, start + n))))
        looked_at += groups
        yield groups
