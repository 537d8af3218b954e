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

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, UNDECIDED, WORSE
from benchmark.analysis.intervals import LEVEL, Estimate, proportion_interval
from benchmark.execution import driver
from benchmark.execution.solving import solved
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, RunSpecification, specifications

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


class Cell(NamedTuple):
    """A population: a point of a grid in a scenario, and a learner."""

    condition: str
    scenario: str
    variant: str
    observation: str

    @property
    def learner(self) -> str:
        """The learner's name."""
        return f"{self.variant}, {self.observation}"

    @property
    def place(self) -> tuple[str, str]:
        """Condition and scenario."""
        return self[:2]


@dataclass(frozen=True, eq=False)
class Ends:
    """The curves of N runs of a population, of successive seeds, over T evaluations."""

    success: NDArray[np.float64]  # (N, T)
    spent: NDArray[np.float64]  # (3, N, T) steps, disagreements of the issuer, and CPU seconds until then
    unseen: NDArray[np.float64]  # (N,) success in unseen places at the end; NaN without any
    enough: float  # the success that counts as solved

    @property
    def n(self) -> int:
        """How many runs there are."""
        return len(self.success)

    @property
    def budget(self) -> int:
        """Steps that a run may train."""
        return int(self.spent[0, 0, -1])

    def first(self, n: int) -> "Ends":
        """Returns the same of the first n runs."""
        return Ends(self.success[:n], self.spent[:, :n], self.unseen[:n], self.enough)

    def took(self, budget: float = math.inf) -> NDArray[np.float64]:
        """Returns what runs took until they had solved, (3, N), with this budget; infinite if never."""
        steps = self.spent[0, 0][self.spent[0, 0] <= budget]
        never = np.full(3, np.inf)
        found = []
        for run, curve in enumerate(self.success[:, : len(steps)].tolist()):
            place = solved(curve, steps, self.enough).place
            found.append(self.spent[:, run, place] if place < len(steps) else never)
        return np.array(found).T

    def spent_within(self, budget: float) -> NDArray[np.float64]:
        """Returns what runs that do not solve have spent of a budget, (3, N)."""
        return self.spent[:, :, int((self.spent[0, 0] <= budget).sum()) - 1]


def cells(experiment: Experiment) -> list[Cell]:
    """Lists the populations of all grids."""
    return [
        Cell(condition, *population)
        for condition in experiment.conditions
        for population in experiment.populations_of(condition)
    ]


def pairs(experiment: Experiment) -> list[tuple[Cell, Cell]]:
    """Lists the cells of every contrast: a contrast of learners at each point where there are both."""
    assert experiment.report is not None
    grids = experiment.grids
    found = {
        (each.place, each.learner): each
        for each in cells(experiment)
        if grids[each.condition.split("/")[1]].is_compared
    }
    return [
        (found[place, x], found[place, y])
        for place in dict.fromkeys(place for place, _ in found)
        for x, y in experiment.report.contrasts
        if (place, x) in found and (place, y) in found
    ]


def runs_of(experiment: Experiment, cell: Cell, seeds: range) -> Runs:
    """Lists a cell's runs, of seeds that count from its first one."""
    first = specifications(experiment, *cell)[0]
    return [first.with_seed(first.seed + seed) for seed in seeds]


def read(experiment: Experiment, store: Store, most: int | None = None) -> dict[Cell, Ends]:
    """Reads the stored runs of every cell, up to the first missing one, at most so many of compared cells."""
    ended = store.ended()
    compared = {cell for pair in pairs(experiment) for cell in pair}
    found = {}
    for cell in cells(experiment):
        n_runs = experiment.algorithms[cell.variant].seeds
        if cell in compared:
            n_runs = most or max(_looks(experiment))
        runs = [*takewhile(lambda run: run.digest in ended, runs_of(experiment, cell, range(n_runs)))]
        if runs:
            found[cell] = _ends(runs, store)
    return found


def _ends(runs: Runs, store: Store) -> Ends:
    assert runs[0].solved is not None
    steps = runs[0].schedule.evaluation_steps
    records = store.get([run.digest for run in runs])
    spent = [[steps, record.arrays["disagreements"], record.provenance["cpu_time_s"]] for record in records]
    return Ends(
        success=np.array([record.arrays["success"] for record in records]),
        spent=np.array(spent, dtype=np.float64).swapaxes(0, 1),
        unseen=np.array([[*record.arrays["unseen_success"], math.nan][0] for record in records]),
        enough=runs[0].solved["success"],
    )


def _looks(experiment: Experiment) -> tuple[int, ...]:
    assert experiment.report is not None
    return experiment.report.looks


def identities(experiment: Experiment) -> dict[tuple[Cell, Cell], tuple[str, ...]]:
    """Returns what makes each contrast: the first runs of its sides; those of two grids may be the same."""
    return {
        pair: tuple(runs_of(experiment, cell, range(1))[0].digest for cell in pair)
        for pair in pairs(experiment)
    }


def decisions(experiment: Experiment, ends: Mapping[Cell, Ends]) -> dict[tuple[Cell, Cell], Decision]:
    """Returns for every contrast the first look that decides it, or the last one that its runs allow.

    Both sides have the smaller budget of the two. A contrast without enough runs for a look is left out.
    """
    assert experiment.report is not None
    known, looks = identities(experiment), _looks(experiment)
    tail = tail_of(len({*known.values()}), len(looks))
    found = {}
    for x, y in known:
        if x in ends and y in ends:
            budget = min(ends[x].budget, ends[y].budget)
            both, within_own = (
                [ends[cell].took(limit)[0] for cell in (x, y)] for limit in (budget, math.inf)
            )
            for n in (n for n in looks if min(map(len, both)) >= n):
                one_learns = any(np.isfinite(steps[:n]).mean() > 0.5 for steps in within_own)
                found[x, y] = decide(
                    both[0][:n],
                    both[1][:n],
                    experiment.report.margins.faster,
                    tail,
                    one_learns=one_learns,
                )
                if found[x, y].verdict != UNDECIDED:
                    break
    return found


def later_stages(experiment: Experiment, store: Store) -> Iterator[Runs]:
    """Yields the further runs of every look, as long as those before are stored: of undecided contrasts."""
    for before, n in pairwise(_looks(experiment)):
        decided = decisions(experiment, read(experiment, store, before))
        undecided = [pair for pair, each in decided.items() if each.verdict == UNDECIDED]
        more = dict.fromkeys(cell for pair in undecided for cell in pair)
        runs = {run.digest: run for cell in more for run in runs_of(experiment, cell, range(before, n))}
        if not runs:
            return
        yield [*runs.values()]
        if driver.pending([*runs.values()], store):
            return
