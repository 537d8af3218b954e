"""Contrasts of a map: which of two learners needs less until it has learned.

Two learners are compared by the steps that a run takes until it has learned: by the probability that the
first takes less, with ties counted as a half, over pairs of runs of the same seed, which
have the same draw of the scenario. Where there are unseen places, they are also compared by how often runs
fail there at the end of training, whether they have learned or not. Pairs are independent, so the mean of
these numbers, each 0, 1/2 or 1, has the interval of a proportion, and what a scenario draws is part of its
width.

A search may have picked several settings for a learner. Its runs take turns with them, and a pair has picks
of the same number. A verdict is about the mean over these picks. Given the picks, pairs are independent,
though their probabilities may differ. The number of pairs that x wins then varies less than if all had the
mean probability, so its interval is, if anything, too wide (Hoeffding 1956, Annals of Mathematical Statistics
27:713-721). It does not cover what other searches would pick; that would take many more searches. Tables
therefore show how medians and shares of pairs differ between picks.

Intervals hold for all contrasts at once, with an error of 5 %. Which learner is faster is decided step by
step, as by Holm (1979): each such decision narrows the intervals by which the others are decided, as if there
were fewer contrasts. So the probability of any wrong claim that a learner is faster, or that neither learns,
is at most 5 %. Deciding step by step assumes independent contrasts (Shaffer 1980, Annals of Statistics
8:1342-1347); otherwise, it relies on simulation.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import lcm
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.analysis.frames import by_step, learned
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate, proportion_interval
from benchmark.experiments import Experiment, Population
from benchmark.studies.map.declared import MapDeclared, compared, name_of

FASTER, SLOWER, UNDECIDED = "faster", "slower", "undecided"
NEITHER: Final = "neither learns"  # most runs of neither learner learn
NO_VERDICT: Final = "no verdict"  # for one of the reasons below
COARSE: Final = "evaluations are too far apart"
TRIVIAL: Final = "an untrained policy reaches the level"
LOST: Final = "the faster learner has lost the level at the end of training"
# In which contrasts are decided; in the last one, only where there are unseen places
UNITS: Final = ("steps", "failures")
_SPENT: Final = {"steps": "step", "disagreements": "training_wrong_pings", "cpu_time_s": "cpu_time_s"}
_ERROR: Final = 0.05  # the probability of any wrong verdict
_ENDS: Final = 3  # if a verdict is wrong, so is one end of an interval: two of a probability, one of a share
_OPEN: Final = (UNDECIDED, NO_VERDICT)  # a step down may decide these
_DIGITS: Final = 9  # of failures; the last ones are rounding
_COARSE: Final = 1.25  # largest ratio of successive evaluation steps that are not too far apart

Numbers = NDArray[np.float64]
Mask = NDArray[np.bool_]
Runs = Mapping[str, NDArray[Any]]  # (N,) each: what the runs of a population needed, see `until_learned`
Sides = tuple[Runs, Runs]  # those of x and y
Key = TypeVar("Key")


class Decision(NamedTuple):
    """The decision of a contrast in a unit."""

    verdict: str
    why: str  # why there is no verdict; empty if there is one
    faster: Estimate  # the probability that x takes less; intervals hold for all contrasts at once


@dataclass(frozen=True, eq=False)
class Contrast:
    """Two learners at a point of a map, with its decisions."""

    x: Population
    y: Population
    learned: Sides
    decisions: Mapping[str, Decision]  # by unit; in failures only where there are unseen places

    @cached_property
    def names(self) -> dict[str, str]:
        """The columns that name it: its point and its learners."""
        return name_of(self.x) | {"x": self.x.learner.name, "y": self.y.learner.name}

    @cached_property
    def shares(self) -> list[float]:
        """By pick, the share of the pairs in which x takes fewer steps."""
        x, y = (runs["steps"] for runs in self.learned)
        return [float(wins.mean()) for wins in by_pick(wins_of(x, y), self.x, self.y)]

    @cached_property
    def ratio(self) -> Estimate:
        """How many times as many steps y takes as x."""
        return ratio(*self.learned)


def wins_of(x: Numbers, y: Numbers) -> Numbers:
    """Returns 1 where x took less than y, 1/2 where both took the same, else 0."""
    return np.where(x == y, 0.5, x < y)


def by_pick(values: Numbers, *populations: Population) -> list[Numbers]:
    """Returns the values of runs, or of pairs, (N,) in the order of seeds, by their pick of settings."""
    n_picks = lcm(*(len(population.firsts) for population in populations))
    return [values[pick::n_picks] for pick in range(min(n_picks, len(values)))]


def ratio(x: Runs, y: Runs) -> Estimate:
    """Returns the median steps of y divided by those of x, over pairs of runs, see `until_learned`.

    Where at least half of the runs never learn, what they spend within the budget counts, so the ratio is
    a bound. It is NaN if this holds for both learners, or if a median is 0. The 95 % interval comes from
    resampling pairs.
    """
    rng, n = np.random.default_rng(BOOTSTRAP_SEED), len(x["steps"])
    drawn = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
    medians = [np.median(runs["steps"][drawn], axis=1) for runs in (x, y)]
    if all(np.isinf(median[0]) for median in medians) or any(median[0] == 0 for median in medians):
        return Estimate(np.nan, np.nan, np.nan)
    spent = [np.median(runs["spent"]) for runs in (x, y)]
    below, above = (np.where(np.isinf(m), most, m) for m, most in zip(medians, spent, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):  # some runs may have learned at step 0
        samples = above / below
    return Estimate(float(samples[0]), *map(float, np.nanpercentile(samples[1:], [2.5, 97.5])))


def tail_of(n_contrasts: int) -> float:
    """Returns the tail probability beyond one end of an interval.

    >>> round(tail_of(10), 6)  # three ends for each contrast
    0.001667
    """
    return _ERROR / (_ENDS * n_contrasts)


def decide(x: Numbers, y: Numbers, tails: tuple[float, float], is_open: Mask) -> tuple[str, Estimate]:
    """Compares what runs of the same seeds took, (N,) each, infinite if they never learned.

    *Faster* and *slower* use the larger of the tails, other verdicts the first. `is_open` (N,) marks pairs
    whose evaluations are too far apart to tell which run took less: there is a verdict only if it does not
    depend on them. Returns it, and the probability that x takes less, with its interval by the first tail.
    """
    wins = wins_of(x, y)
    means = [case.mean() for case in (wins, np.where(is_open, 0.0, wins), np.where(is_open, 1.0, wins))]
    never = [np.isinf(side).mean() for side in (x, y)]
    low, high = proportion_interval(np.array(means + never), len(x), tails[0])
    faster = Estimate(float(means[0]), float(low[0]), float(high[0]))
    if low[3:].min() > 0.5:
        return NEITHER, faster
    low, high = proportion_interval(np.array(means), len(x), max(tails))
    verdicts = np.select([low > 0.5, high < 0.5], [FASTER, SLOWER], UNDECIDED).tolist()
    is_known = verdicts[0] == UNDECIDED or len({*verdicts}) == 1
    return verdicts[0] if is_known else NO_VERDICT, faster


def until_learned(curves: pd.DataFrame, level: float, unseen: Numbers | None = None) -> Runs:
    """Returns what the runs of a population took until they had learned, (N,) each.

    It has the keys of `_SPENT`, infinite if the run never learned; the steps of the evaluation before, and
    of the last one; the last success; whether the first and last policy reach the level; and, given success
    in unseen places (N,), the failures there.
    """
    steps, success = by_step(curves, "step")[0], by_step(curves, "success")
    first, last = learned(success, steps, level, until=2), len(steps) - 1
    runs: dict[str, NDArray[Any]] = {"success": success[:, last]}
    runs |= {"untrained": success[:, 0] >= level, "lasts": success[:, last] >= level}
    runs["before"] = np.where(first > 0, steps[np.clip(first - 1, 0, last)], 0).astype(float)
    runs["spent"] = np.full(len(success), float(steps[last]))
    for name, column in _SPENT.items():
        values = by_step(curves, column).astype(float)[np.arange(len(success)), np.minimum(first, last)]
        runs[name] = np.where(first > last, np.inf, values)
    if unseen is not None:
        runs["failures"] = np.round(1 - unseen, _DIGITS)
    return runs


def contrasts_of(
    experiment: Experiment, declared: MapDeclared, learned: Mapping[Population, Runs]
) -> list[Contrast]:
    """Lists the contrasts; one that is in two grids is decided once."""

    def key(x: Population, y: Population) -> tuple[str, str]:
        first, second = ("".join(run.digest for run in side.firsts) for side in (x, y))
        return first, second

    pairs = compared(experiment, declared.contrasts)
    runs = {key(x, y): (learned[x], learned[y]) for x, y in pairs}
    decided = {unit: decide_all(runs, unit) for unit in UNITS}
    contrasts = []
    for x, y in pairs:
        decisions = {unit: found[key(x, y)] for unit, found in decided.items() if key(x, y) in found}
        contrasts.append(Contrast(x, y, runs[key(x, y)], decisions))
    return contrasts


def decide_all(pairs: Mapping[Key, Sides], unit: str) -> dict[Key, Decision]:
    """Decides the contrasts that have a unit; see the module's docstring."""
    pairs = {key: sides for key, sides in pairs.items() if unit in sides[0]}
    decisions, n_before, n_faster, tail = dict[Key, Decision](), -1, 0, tail_of(max(len(pairs), 1))
    while n_faster > n_before:
        n_before, stepped = n_faster, tail_of(max(len(pairs) - n_faster, 1))
        for key, sides in pairs.items():
            if key not in decisions or decisions[key].verdict in _OPEN:
                decisions[key] = _decision(sides, (tail, stepped), unit)
                n_faster += decisions[key].verdict in (FASTER, SLOWER)
    return decisions


def _decision(sides: Sides, tails: tuple[float, float], unit: str) -> Decision:
    """Decides by all pairs of runs, see `decide`."""
    x, y = sides
    if unit == "failures":  # learned or not
        verdict, faster = decide(x[unit], y[unit], tails, np.zeros(len(x[unit]), bool))
        return Decision(verdict, "", faster)
    # The steps that a run took lie between those of two evaluations.
    is_coarse = [side["steps"] > _COARSE * side["before"] for side in sides]
    overlaps = (x["steps"] > y["before"]) & (y["steps"] > x["before"])
    is_learned = np.isfinite(x["steps"]) & np.isfinite(y["steps"])
    is_open = is_learned & overlaps & (is_coarse[0] | is_coarse[1])
    verdict, faster = decide(x["steps"], y["steps"], tails, is_open)
    why, winner = COARSE if verdict == NO_VERDICT else "", {FASTER: x, SLOWER: y}.get(verdict)
    if winner is not None and winner["lasts"][np.isfinite(winner["steps"])].mean() < 0.5:
        why = LOST
    if max(x["untrained"].mean(), y["untrained"].mean()) > 0.5:
        why = TRIVIAL
    return Decision(NO_VERDICT if why else verdict, why, faster)
