"""Contrasts that are tested at several looks and get no more runs once they are decided.

The endpoint of a run is after how many steps it has solved its scenario. Two learners are compared by the
probability that the first is faster, with ties counted as a half, over pairs of runs of the same seed, which
have the same draw of the scenario. Pairs are independent, so the mean of these numbers, each 0, 1/2 or 1, has
the interval of a proportion, and what a scenario draws is part of its width.

At each of the declared looks, every contrast has intervals of such a level that the probability of any wrong
verdict, in all contrasts at all looks, is at most 5 % (repeated confidence intervals: Jennison and Turnbull
1989, Journal of the Royal Statistical Society B 51:305-361; here with Bonferroni's correction). So it does
not matter why a contrast gets more runs.
"""

from collections.abc import Iterator
from itertools import takewhile
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, UNDECIDED, WORSE
from benchmark.analysis.frames import Group
from benchmark.analysis.intervals import LEVEL, Estimate, proportion_interval
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Population, RunSpecification

NEITHER: Final = "neither"  # most runs of neither learner solve the scenario, whatever their budgets
TOO_SHORT: Final = "too short"  # nor within the smaller budget; within its own, most runs of one do
_ENDS: Final = (
    3  # of intervals; if a verdict is wrong, so is one of these: two of a probability, one of a share
)

Runs = list[RunSpecification]


class Decision(NamedTuple):
    """What a look at a contrast says."""

    n: int  # pairs of runs
    verdict: str
    faster: Estimate  # the probability that x is faster, with the interval of this look


def tail_of(n_contrasts: int, n_looks: int) -> float:
    """Returns the probability that one end of an interval may leave out.

    >>> round(tail_of(10, 5), 6)
    0.000333
    """
    return (1 - LEVEL) / (_ENDS * n_contrasts * n_looks)


def decide(
    x: NDArray[np.float64], y: NDArray[np.float64], margin: float, tail: float, *, one_learns: bool = False
) -> Decision:
    """Compares the steps, (N,) each, after which runs of the same seeds have solved; infinite if never.

    Both have the smaller of their budgets; `one_learns` says that most runs of one solve within its own.
    """
    n = len(x)
    wins = np.where(x == y, 0.5, x < y)
    mean = float(wins.mean())
    low, high = (float(end) for end in proportion_interval(mean, n, tail))
    never = min(float(proportion_interval(np.isinf(each).mean(), n, tail)[0]) for each in (x, y))
    if never > 0.5:
        verdict = TOO_SHORT if one_learns else NEITHER
    elif 0.5 - margin < low <= high < 0.5 + margin:
        verdict = EQUIVALENT
    else:
        verdict = BETTER if low > 0.5 else WORSE if high < 0.5 else UNDECIDED
    return Decision(n, verdict, Estimate(mean, low, high))


def pairs(experiment: Experiment) -> list[tuple[Population, Population]]:
    """Lists the populations of every contrast: a contrast of learners at each point where there are both."""
    assert experiment.report is not None
    grids = experiment.declared.grids
    found = {
        (each.condition.name, each.scenario.name, each.learner.name): each
        for each in experiment.populations
        if grids[each.condition.axes["grid"]].is_compared
    }
    return [
        (found[*place, x], found[*place, y])
        for place in dict.fromkeys(names[:2] for names in found)
        for x, y in experiment.report.contrasts
        if (*place, x) in found and (*place, y) in found
    ]


def groups(experiment: Experiment, store: Store, most: int | None = None) -> list[Group]:
    """Lists the stored runs of every population, up to the first missing one."""
    assert experiment.report is not None
    ended, looks = store.ended(), experiment.report.looks
    compared = {id(population) for pair in pairs(experiment) for population in pair}
    found = []
    for population in experiment.populations:
        n_runs = (most or max(looks)) if id(population) in compared else len(population.seeds)
        seeds = range(population.seeds.start, population.seeds.start + n_runs)
        runs = [*takewhile(lambda run: run.digest in ended, population.runs(seeds))]
        found.append(Group(population, runs))
    return found


def further_stages(experiment: Experiment, store: Store) -> Iterator[Runs]:
    """Yields the further runs of every look, as long as those before are stored: of undecided contrasts."""
    raise NotImplementedError
