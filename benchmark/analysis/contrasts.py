"""Contrasts: whether one learner does better than another, by a rule that is fixed before the runs.

Learners are compared by their mean over equally weighted scenarios of numbers in [0, 1]. P-values are
adjusted by Holm's method (1979, Scandinavian Journal of Statistics 6:65-70), so that for each endpoint the
probability of any wrong claim of a difference is at most about 5 %, and so is that of any wrong claim of
equivalence. Equivalence takes two one-sided tests (Schuirmann 1987).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from benchmark.analysis.intervals import LEVEL, TAIL, combined, p_above

BETTER: Final = "better"
WORSE: Final = "worse"
EQUIVALENT: Final = "equivalent"
NEITHER: Final = "neither learned"  # neither is shown to beat the random policy
MIXED: Final = "mixed"  # on a mean over scenarios: some contradict the others
UNDECIDED: Final = "undecided"
NO_VERDICT: Final = "no verdict"  # too few runs, or runs are missing
VERDICTS: Final = (BETTER, WORSE, EQUIVALENT, NEITHER, MIXED, UNDECIDED, NO_VERDICT)
POWER: Final = 0.8  # probability with which a needed number of agents decides


class Means(NamedTuple):
    """A learner's means of numbers in [0, 1], one per scenario, and how many runs each is of."""

    means: Sequence[float]
    sizes: Sequence[int]

    @property
    def mean(self) -> float:
        """The mean over scenarios."""
        return float(np.mean(self.means))


class Contrast(NamedTuple):
    """A difference, x - y, with p-values before adjustment."""

    difference: float
    low: float  # of the 95 % interval
    high: float
    low_90: float  # of the 90 % interval, which lies within the margin if two one-sided tests reject at 5 %
    high_90: float
    p_different: float
    p_equivalent: float


def contrast(x: Means, y: Means, margin: float) -> Contrast:
    """Compares two learners in the same scenarios; a difference below the margin is equivalence."""
    weights = [1 / len(x.means)] * len(x.means) + [-1 / len(y.means)] * len(y.means)
    means, sizes = [*x.means, *y.means], [*x.sizes, *y.sizes]
    signs = weights, [-weight for weight in weights]
    return Contrast(
        x.mean - y.mean,
        *combined(weights, means, sizes),
        *combined(weights, means, sizes, 2 * TAIL),
        p_different=min(1.0, *(2 * p_above(signed, means, sizes, 0.0) for signed in signs)),
        p_equivalent=max(p_above(signed, means, sizes, -margin) for signed in signs),
    )


def contradicting(verdict: str, ends: Iterable[tuple[float, float]], margin: float) -> list[int]:
    """Returns which scenarios contradict a verdict on their mean by the margin or more.

    Each is given by both ends of an interval of its difference, x - y. If a difference itself contradicts,
    the verdict is *mixed*: opposite differences must not cancel.
    """
    return [
        i
        for i, (low, high) in enumerate(ends)
        if (verdict != WORSE and low <= -margin) or (verdict != BETTER and high >= margin)
    ]


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns p-values adjusted by Holm's method, in the same order."""
    n, adjusted, largest = len(p_values), [0.0] * len(p_values), 0.0
    for rank, i in enumerate(np.argsort(p_values, kind="stable").tolist()):
        largest = max(largest, min((n - rank) * p_values[i], 1.0))
        adjusted[i] = largest
    return adjusted


def verdict(difference: float, p_different: float, p_equivalent: float) -> str:
    """Returns the verdict on x against y, by their difference, x - y, and adjusted p-values."""
    if p_equivalent <= 1 - LEVEL:
        return EQUIVALENT  # even if a difference is significant, too
    if p_different <= 1 - LEVEL:
        return BETTER if difference > 0 else WORSE
    return UNDECIDED


def decide(contrasts: Sequence[Contrast], *, is_allowed: Sequence[bool]) -> list[Mapping[str, object]]:
    """Returns the adjusted p-values of all contrasts, and verdicts on those that are allowed."""
    different = holm([compared.p_different for compared in contrasts])
    equivalent = holm([compared.p_equivalent for compared in contrasts])
    decided: list[Mapping[str, object]] = []
    for compared, p, q, allowed in zip(contrasts, different, equivalent, is_allowed, strict=True):
        decision = verdict(compared.difference, p, q) if allowed else NO_VERDICT
        decided.append({"p_different": p, "p_equivalent": q, "verdict": decision})
    return decided
