"""Contrasts that are tested at several looks and get no more runs once they are decided.

Two learners are compared by what a run takes until it has learned, in steps and in wrong PINGs: by the
probability that the first takes less, with ties counted as a half, over pairs of runs of the same seed, which
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

Looks share an error of 5 % equally. At each, intervals hold for all contrasts at once, so it does not matter
why a contrast gets more runs (repeated confidence intervals: Jennison and Turnbull 1989, Journal of
the Royal Statistical Society B 51:305-361). Which learner is faster is decided step by step, as by Holm
(1979): each such decision narrows the intervals by which the others are decided, as if there were fewer
contrasts. So the probability of any wrong claim that a learner is faster, or that neither learns, is at most
5 %, and that of any wrong claim of equal speed a third of it. Deciding step by step assumes independent
contrasts (Shaffer 1980, Annals of Statistics 8:1342-1347); otherwise, it relies on simulation.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import lcm
from typing import Final, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.analysis.frames import Group, by_population, by_step, learned, tables
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate, proportion_interval
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Population
from benchmark.studies.map.declared import MapDeclared, compared, name_of

FASTER, SLOWER, EQUAL, UNDECIDED = "faster", "slower", "equally fast", "undecided"
NEITHER: Final = "neither learns"  # most runs of neither learner learn
NO_VERDICT: Final = "no verdict"  # for one of the reasons below
VERDICTS: Final = (FASTER, SLOWER, EQUAL, NEITHER, UNDECIDED, NO_VERDICT)
COARSE: Final = "evaluations are too far apart"
TRIVIAL: Final = "an untrained policy reaches the level"
LOST: Final = "the faster learner has lost the level at the end of training"
SPENT: Final = {"steps": "step", "disagreements": "training_wrong_pings", "cpu_time_s": "cpu_time_s"}
# In which contrasts are decided; in the last one, only where there are unseen places
UNITS: Final = {"steps": "steps", "disagreements": "wrong PINGs", "failures": "failures in unseen places"}
_ERROR: Final = 0.05  # the probability of any wrong verdict
_ENDS: Final = 3  # if a verdict is wrong, so is one end of an interval: two of a probability, one of a share
_OPEN: Final = (UNDECIDED, NO_VERDICT)  # further looks may decide these
_DIGITS: Final = 9  # of failures; the last ones are rounding
_COARSE: Final = 1.25  # largest ratio of successive evaluation steps that are not too far apart

Numbers = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = Mapping[Population, pd.DataFrame]
Runs = NDArray[np.void]  # (N,): what the runs of a population needed, see `until_learned`
Sides = tuple[Runs, Runs]  # those of x and y
Key = TypeVar("Key")


class Decision(NamedTuple):
    """The decision of a look at a contrast in a unit."""

    n: int  # pairs of runs
    verdict: str
    why: str  # why there is no verdict; empty if there is one
    faster: Estimate  # the probability that x takes less; intervals hold for all contrasts and looks at once


@dataclass(frozen=True, eq=False)
class Contrast:
    """Two learners at a point of a map, with the decision of the first look that decides, or the last."""

    x: Population
    y: Population
    learned: Sides  # as many pairs as its decisions use
    decisions: Mapping[str, Decision]  # by unit; in failures only where there are unseen places
    at_level: Mapping[float, str]  # verdicts on the same pairs at further levels of success, exploratory

    @cached_property
    def names(self) -> dict[str, str]:
        """The columns that name it: its point and its learners."""
        return name_of(self.x) | {"x": self.x.learner.name, "y": self.y.learner.name}

    @cached_property
    def shares(self) -> list[float]:
        """By pick, the share of the pairs of the verdict in steps in which x takes fewer."""
        x, y = (runs["steps"][: self.decisions["steps"].n] for runs in self.learned)
        return [float(wins.mean()) for wins in by_pick(wins_of(x, y), self.x, self.y)]

    @cached_property
    def ratios(self) -> dict[str, Estimate]:
        """How many times as much y takes as x, by unit, over the pairs of the verdict in steps."""
        n = self.decisions["steps"].n
        return {unit: ratio(*self.learned, n, unit) for unit in ("steps", "disagreements")}


def wins_of(x: Numbers, y: Numbers) -> Numbers:
    """Returns 1 where x took less than y, 1/2 where both took the same, else 0."""
    return np.where(x == y, 0.5, x < y)


def by_pick(values: Numbers, *populations: Population) -> list[Numbers]:
    """Returns the values of runs, or of pairs, (N,) in the order of seeds, by their pick of settings."""
    n_picks = lcm(*(len(population.firsts) for population in populations))
    return [values[pick::n_picks] for pick in range(min(n_picks, len(values)))]


def ratio(x: Runs, y: Runs, n: int, unit: str) -> Estimate:
    """Returns the median of y divided by that of x, over n pairs of runs, see `until_learned`.

    Where at least half of the runs never learn, what they spend within the budget counts, so the ratio is
    a bound. It is NaN if this holds for both learners, or if a median is 0. The 95 % interval comes from
    resampling pairs.
    """
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    drawn = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
    medians = [np.median(runs[unit][drawn], axis=1) for runs in (x, y)]
    if all(np.isinf(median[0]) for median in medians) or any(median[0] == 0 for median in medians):
        return Estimate(np.nan, np.nan, np.nan)
    spent = [np.median(runs[f"spent_{unit}"][:n]) for runs in (x, y)]
    below, above = (np.where(np.isinf(m), most, m) for m, most in zip(medians, spent, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):  # some runs may have learned at step 0
        samples = above / below
    return Estimate(float(samples[0]), *map(float, np.nanpercentile(samples[1:], [2.5, 97.5])))


def tail_of(n_contrasts: int, error: float) -> float:
    """Returns the tail probability beyond one end of an interval, given a look's share of the error.

    >>> round(tail_of(10, 0.03), 6)  # three ends for each contrast
    0.001
    """
    return error / (_ENDS * n_contrasts)


def decide(
    x: Numbers, y: Numbers, margin: float, tails: tuple[float, float], is_open: Mask
) -> tuple[str, Estimate]:
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
    is_equal = (low[:3] > 0.5 - margin) & (high[:3] < 0.5 + margin)
    low, high = proportion_interval(np.array(means), len(x), max(tails))
    verdicts = np.select([is_equal, low > 0.5, high < 0.5], [EQUAL, FASTER, SLOWER], UNDECIDED).tolist()
    is_known = verdicts[0] == UNDECIDED or len({*verdicts}) == 1
    return verdicts[0] if is_known else NO_VERDICT, faster


def until_learned(curves: pd.DataFrame, level: float, unseen: Numbers | None = None) -> Runs:
    """Returns what the runs of a population took until they had learned, as a structured array (N,).

    It has the keys of `SPENT`, infinite if the run never learned; the same at the evaluation before
    (`before_`) and at the last one (`spent_`); the last success; whether the first and last
    policy reach the level; and, given success in unseen places (N,), the failures there.
    """
    steps, success = by_step(curves, "step")[0], by_step(curves, "success")
    first, last = learned(success, steps, level, until=2), len(steps) - 1
    columns: dict[str, NDArray[np.generic]] = {"success": success[:, last]}
    columns |= {"untrained": success[:, 0] >= level, "lasts": success[:, last] >= level}
    runs, before = np.arange(len(success)), np.clip(first - 1, 0, last)
    for name, column in SPENT.items():
        values = by_step(curves, column).astype(float)
        columns[name] = np.where(first > last, np.inf, values[runs, np.minimum(first, last)])
        columns[f"spent_{name}"] = values[:, last]
        columns[f"before_{name}"] = np.where(first > 0, values[runs, before], 0.0)
    if unseen is not None:
        columns["failures"] = columns["before_failures"] = np.round(1 - unseen, _DIGITS)
    kinds = [(name, values.dtype) for name, values in columns.items()]
    return np.rec.fromarrays([*columns.values()], kinds)


def rows_of(experiment: Experiment, frame: pd.DataFrame) -> Rows:
    """Returns the rows of every population of a map that has any, without runs after a missing one."""
    populations = {(each.condition.name, each.learner.name): each for each in experiment.populations}
    complete = {}
    for keys, rows in by_population(frame):
        population = populations[keys["condition"], keys["learner"]]
        seeds = range(population.seeds.start, population.seeds.start + len(rows) + 1)
        missing = min({*seeds} - {*rows["seed"]})
        if missing > seeds.start:
            complete[population] = rows[rows["seed"] < missing]
    return complete


def learned_at(
    experiment: Experiment, curves: Rows, runs: Rows | None = None
) -> dict[float, dict[Population, Runs]]:
    """Returns what all runs took until they had learned, by level, the declared level first."""
    solved = experiment.declared.solved
    assert solved is not None
    unseen = {
        population: rows["unseen_budget"].to_numpy()
        for population, rows in (runs or {}).items()
        if population.scenario.issuer.unseen
    }
    return {
        level: {
            population: until_learned(rows, level, unseen.get(population))
            for population, rows in curves.items()
        }
        for level in (solved.success,)
    }


def digests(x: Population, y: Population) -> tuple[str, str]:
    """Returns a key of two populations, which is the same for the same runs in another grid."""
    return "".join(run.digest for run in x.firsts), "".join(run.digest for run in y.firsts)


def contrasts_of(
    experiment: Experiment, declared: MapDeclared, learned: Mapping[float, Mapping[Population, Runs]]
) -> list[Contrast]:
    """Lists the contrasts with enough runs for a look; one that is in two grids is decided once."""
    pairs, none, (first, *further) = compared(experiment, declared.contrasts), np.array([], np.void), learned
    runs: dict[float, dict[tuple[str, str], Sides]] = {
        level: {digests(x, y): (rows.get(x, none), rows.get(y, none)) for x, y in pairs}
        for level, rows in learned.items()
    }
    margin, tail = declared.margins.faster, tail_of(len(runs[first]), _ERROR / len(declared.looks))
    decided = {unit: decide_all(runs[first], declared.looks, margin, unit) for unit in UNITS}
    contrasts = []
    for x, y in pairs:
        key = digests(x, y)
        if key in decided["steps"]:
            decisions = {unit: found[key] for unit, found in decided.items() if key in found}
            most, n = max(decision.n for decision in decisions.values()), decisions["steps"].n
            looks = {level: _look(runs[level][key], n, margin, (tail, tail), "steps") for level in further}
            at_level = {level: look.verdict for level, look in looks.items()}
            used = learned[first][x][:most], learned[first][y][:most]
            contrasts.append(Contrast(x, y, used, decisions, at_level))
    return contrasts


def decide_all(
    pairs: Mapping[Key, Sides], looks: Sequence[int], margin: float, unit: str
) -> dict[Key, Decision]:
    """Decides contrasts in a unit, look after look; see the module's docstring."""
    pairs = {key: sides for key, sides in pairs.items() if unit in (sides[0].dtype.names or (unit,))}
    decisions, n_faster, error = dict[Key, Decision](), 0, _ERROR / len(looks)
    tail = tail_of(max(len(pairs), 1), error)
    for n in looks:
        looked = {
            key: sides
            for key, sides in pairs.items()
            if min(map(len, sides)) >= n and (key not in decisions or decisions[key].verdict in _OPEN)
        }
        n_before = -1
        while n_faster > n_before:
            n_before, stepped = n_faster, tail_of(max(len(pairs) - n_faster, 1), error)
            for key, sides in [*looked.items()]:
                decisions[key] = _look(sides, n, margin, (tail, stepped), unit)
                if decisions[key].verdict not in _OPEN:
                    del looked[key]
                n_faster += decisions[key].verdict in (FASTER, SLOWER)
    return decisions


def _look(sides: Sides, n: int, margin: float, tails: tuple[float, float], unit: str) -> Decision:
    """Decides by the first n pairs of runs, see `decide`."""
    x, y = (side[:n] for side in sides)
    # What a run took lies between what it had spent at two evaluations.
    is_coarse = [side["steps"] > _COARSE * side["before_steps"] for side in (x, y)]
    overlaps = (x[unit] > y[f"before_{unit}"]) & (y[unit] > x[f"before_{unit}"])
    is_learned = np.isfinite(x[unit]) & np.isfinite(y[unit])
    is_open = is_learned & overlaps & (is_coarse[0] | is_coarse[1])
    verdict, faster = decide(x[unit], y[unit], margin, tails, is_open)
    why, winner = COARSE if verdict == NO_VERDICT else "", {FASTER: x, SLOWER: y}.get(verdict)
    if unit == "failures":  # learned or not
        return Decision(n, verdict, "", faster)
    if winner is not None and winner["lasts"][np.isfinite(winner["steps"])].mean() < 0.5:
        why = LOST
    if max(x["untrained"].mean(), y["untrained"].mean()) > 0.5:
        why = TRIVIAL
    return Decision(n, NO_VERDICT if why else verdict, why, faster)


def stages(experiment: Experiment, declared: MapDeclared, store: Store) -> Iterator[list[Group]]:
    """Yields the declared runs, and for every further look those of contrasts that are undecided before it.

    The caller stores each stage before it asks for the next.
    """
    sides = {side for pair in compared(experiment, declared.contrasts) for side in pair}
    groups = [Group(population, population.runs()) for population in experiment.populations]
    stored = [group for group in groups if group.population in sides]
    yield groups
    for before, n in pairwise(declared.looks):
        _, curves = tables(stored, store, ["success", *SPENT.values()])
        learned = learned_at(experiment, rows_of(experiment, curves))
        contrasts = contrasts_of(experiment, declared, learned)
        undecided = [each for each in contrasts if each.decisions["steps"].verdict == UNDECIDED]
        if not undecided:
            return
        more = dict.fromkeys(side for contrast in undecided for side in (contrast.x, contrast.y))
        seeds = [range(side.seeds.start + before, side.seeds.start + n) for side in more]
        groups = [Group(side, side.runs(own)) for side, own in zip(more, seeds, strict=True)]
        stored += groups
        yield groups
