"""Contrasts: whether one learner does better than another, by a rule that is fixed before the runs.

A learner's number is its mean over scenarios, which all weigh the same, of means of numbers in [0, 1]. Of a
set of contrasts, p-values are adjusted by Holm's method (1979, Scandinavian Journal of Statistics 6:65-70),
so that for each endpoint the probability of any wrong claim of a difference is at most about 5 %, and so is
that of any wrong claim of equivalence. Equivalence takes two one-sided tests (Schuirmann 1987).
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmark.analysis.intervals import LEVEL, TAIL, combined, p_above

BETTER: Final = "better"
WORSE: Final = "worse"
EQUIVALENT: Final = "equivalent"
MIXED: Final = "mixed"  # on a mean over scenarios: some contradict the others
UNDECIDED: Final = "undecided"
NO_VERDICT: Final = "no verdict"  # too few runs, or runs are missing
VERDICTS: Final = (BETTER, WORSE, EQUIVALENT, MIXED, UNDECIDED, NO_VERDICT)
POWER: Final = 0.8  # probability with which a number of runs or agents that is called needed decides


@dataclass(frozen=True)
class Means:
    """A learner's means of numbers in [0, 1], one per scenario, and how many runs each is of."""

    means: Sequence[float]
    sizes: Sequence[int]

    @property
    def mean(self) -> float:
        """The mean over scenarios."""
        return float(np.mean(self.means))

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the mean over scenarios."""
        share = 1 / len(self.means)
        return combined([share] * len(self.means), self.means, self.sizes)


@dataclass(frozen=True)
class Contrast:
    """What the runs say of a difference, x - y, before p-values are adjusted."""

    difference: float
    low: float  # of the 95 % interval
    high: float
    low_90: float  # of the 90 % interval, which lies within the margin if two one-sided tests reject at 5 %
    high_90: float
    p_different: float
    p_equivalent: float


def contrast(x: Means, y: Means, margin: float) -> Contrast:
    """Compares two learners that were trained in the same scenarios, by different runs.

    They are equivalent if their difference is smaller than the margin.
    """
    weights = [1 / len(x.means)] * len(x.means) + [-1 / len(y.means)] * len(y.means)
    means, sizes = [*x.means, *y.means], [*x.sizes, *y.sizes]
    opposite = [-weight for weight in weights]
    above, below = (p_above(signed, means, sizes, 0.0) for signed in (weights, opposite))
    not_less, not_more = (p_above(signed, means, sizes, -margin) for signed in (weights, opposite))
    return Contrast(
        x.mean - y.mean,
        *combined(weights, means, sizes),
        *combined(weights, means, sizes, 2 * TAIL),
        p_different=min(2 * min(above, below), 1.0),
        p_equivalent=max(not_less, not_more),
    )


def mixed(verdict: str, differences: Sequence[float], margin: float) -> list[int]:
    """Returns which scenarios contradict a verdict on their mean; if any does, the verdict is *mixed*.

    A mean may not cancel: no scenario may be worse by the margin than the verdict says of all together.
    Differences are x - y in each scenario.

    >>> mixed(EQUIVALENT, [0.3, -0.15, -0.15], 0.1), mixed(BETTER, [0.3, 0.0, -0.05], 0.1)
    ([0, 1, 2], [])
    """
    low = -margin if verdict in (BETTER, EQUIVALENT) else -math.inf
    high = margin if verdict in (WORSE, EQUIVALENT) else math.inf
    return [i for i, difference in enumerate(differences) if not low < difference < high]


def runs_for_any_equivalence(margin: float, n_scenarios: int, n_contrasts: int) -> int:
    """Returns how few runs can show that two learners are equivalent, if all runs of both succeed.

    Means are over scenarios, and p-values are adjusted for so many contrasts.

    >>> runs_for_any_equivalence(0.1, 1, 1), runs_for_any_equivalence(0.1, 1, 51)
    (29, 66)
    """

    def is_enough(n: int) -> bool:
        side = Means([1.0] * n_scenarios, [n] * n_scenarios)
        return contrast(side, side, margin).p_equivalent * n_contrasts <= 1 - LEVEL

    most = 2
    while not is_enough(most):
        most *= 2
    return 1 + bisect_left(range(1, most), True, key=is_enough)


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns p-values adjusted by Holm's method, in the same order.

    >>> [round(p, 6) for p in holm([0.01, 0.04, 0.03, 0.005])]
    [0.03, 0.06, 0.06, 0.02]
    """
    n, adjusted, largest = len(p_values), [0.0] * len(p_values), 0.0
    for rank, index in enumerate(sorted(range(n), key=lambda i: p_values[i])):
        largest = max(largest, min((n - rank) * p_values[index], 1.0))
        adjusted[index] = largest
    return adjusted


def verdict(difference: float, p_different: float, p_equivalent: float) -> str:
    """Returns the verdict on x against y, by their difference, x - y, and adjusted p-values.

    A difference that is shown, but shown to be smaller than the margin, too, does not matter: the two are
    equivalent.
    """
    if p_equivalent <= 1 - LEVEL:
        return EQUIVALENT
    if p_different <= 1 - LEVEL:
        return BETTER if difference > 0 else WORSE
    return UNDECIDED


def decide(
    contrasts: Sequence[Contrast],
    *,
    is_allowed: Sequence[bool],
    adjust: Callable[[Sequence[float]], list[float]] = holm,
) -> list[Mapping[str, object]]:
    """Returns the p-values of a set of contrasts, adjusted for all, and verdicts on those that are allowed.

    To adjust p-values by `list` leaves them as they are.
    """
    different = adjust([found.p_different for found in contrasts])
    equivalent = adjust([found.p_equivalent for found in contrasts])
    return [
        {
            "p_different": p,
            "p_equivalent": q,
            "verdict": verdict(found.difference, p, q) if allowed else NO_VERDICT,
        }
        for found, p, q, allowed in zip(contrasts, different, equivalent, is_allowed, strict=True)
    ]
