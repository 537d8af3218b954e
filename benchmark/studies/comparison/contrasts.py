"""Contrasts: whether one learner does better than another, by a rule that is fixed before the runs.

Learners are compared by their mean over equally weighted scenarios of numbers in [0, 1]. P-values are
adjusted by Holm's method (1979, Scandinavian Journal of Statistics 6:65-70), so that for each endpoint the
probability of any wrong claim of a difference is at most about 5 %, and so is that of any wrong claim of
equivalence. Equivalence takes two one-sided tests (Schuirmann 1987); `document.md.jinja` has the rules, too.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from benchmark.analysis.intervals import LEVEL, TAIL, combined, p_above

VERDICTS: Final = (
    "better",
    "worse",
    "equivalent",
    "neither learned",  # neither is shown to beat the random policy
    "mixed",  # on a mean over scenarios: some contradict the others
    "undecided",
    "no verdict",  # too few runs
)
ALPHA: Final = 1 - LEVEL


class Means(NamedTuple):
    """A learner's means of numbers in [0, 1], one per scenario, and the number of runs of each."""

    means: Sequence[float]
    sizes: Sequence[int]

    @property
    def mean(self) -> float:
        """The mean over scenarios."""
        return float(np.mean(self.means))

    @property
    def weights(self) -> list[float]:
        """The weights of the scenarios, which are equal."""
        return [1 / len(self.means)] * len(self.means)


class Contrast(NamedTuple):
    """A difference, x - y, with p-values before adjustment."""

    difference: float
    difference_low: float  # of the 95 % interval
    difference_high: float
    difference_low_90: float  # of the 90 % interval: within the margin if two one-sided tests reject at 5 %
    difference_high_90: float
    p_different: float
    p_equivalent: float


def contrast(x: Means, y: Means, margin: float) -> Contrast:
    """Compares two learners in the same scenarios; a difference below the margin is equivalence."""
    weights = x.weights + [-weight for weight in y.weights]
    means, sizes = [*x.means, *y.means], [*x.sizes, *y.sizes]
    signs = weights, [-weight for weight in weights]
    return Contrast(
        x.mean - y.mean,
        *combined(weights, means, sizes),
        *combined(weights, means, sizes, 2 * TAIL),
        p_different=min(1.0, *(2 * p_above(signed, means, sizes, 0.0) for signed in signs)),
        p_equivalent=max(p_above(signed, means, sizes, -margin) for signed in signs),
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns p-values adjusted by Holm's method, in the same order."""
    adjusted = np.array(p_values, dtype=float)
    order = np.argsort(adjusted, kind="stable")
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.maximum.accumulate(np.minimum(factors * adjusted[order], 1.0))
    return [float(p) for p in adjusted]


def verdict(difference: float, p_different: float, p_equivalent: float) -> str:
    """Returns the verdict on x against y, by their difference, x - y, and adjusted p-values."""
    if p_equivalent <= ALPHA:
        return "equivalent"  # even if a difference is significant, too
    if p_different <= ALPHA:
        return "better" if difference > 0 else "worse"
    return "undecided"


def over_scenarios(decided: str, x: Means, y: Means, margin: float) -> tuple[str, list[int]]:
    """Returns a verdict on a mean over scenarios, *mixed* if some contradict it, and the indices of these.

    A scenario contradicts a verdict if its own difference does so by the margin or more: opposite differences
    must not cancel. If none does, the indices are those of scenarios whose own 90 % interval does not exclude
    such a difference.
    """
    if len(x.means) == 1 or decided not in ("better", "worse", "equivalent"):
        return decided, []
    alone = [
        contrast(Means([a], [n]), Means([b], [m]), margin)
        for a, n, b, m in zip(x.means, x.sizes, y.means, y.sizes, strict=True)
    ]

    def contradicting(lows: Sequence[float], highs: Sequence[float]) -> list[int]:
        is_worse = (decided != "worse") & (np.array(lows) <= -margin)
        is_better = (decided != "better") & (np.array(highs) >= margin)
        return np.flatnonzero(is_worse | is_better).tolist()

    differences, _, _, lows, highs = [*zip(*alone, strict=True)][:5]
    if found := contradicting(differences, differences):
        return "mixed", found
    return decided, contradicting(lows, highs)
