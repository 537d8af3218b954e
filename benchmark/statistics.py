"""Intervals, p-values and contrasts.

Means of numbers in [0, 1] have exact binomial intervals, from which those of sums and differences
of such means follow; they have a width even where all agents agree. Other statistics have
percentile intervals over seeded resamples, so equal records give equal digits.

A contrast compares two learners by means of numbers in [0, 1]. Equivalence takes two one-sided
tests (Schuirmann 1987). P-values of several contrasts are adjusted by Holm's method (1979,
Scandinavian Journal of Statistics 6:65-70): the probability of any wrong claim is at most 5 %.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special, stats

from benchmark.experiment import OBSERVED, Population

RESAMPLES = 1000
BOOTSTRAP_SEED = 20210803
MAX_Z = 8.0  # standard errors beyond which p-values count as zero
_NONE = 1e-12  # smaller counts are rounding errors
_DIGITS = 12  # of a difference, which may be as large as the margin
LEVEL = 0.95  # confidence, unless another is given
ALPHA = 1 - LEVEL
TAIL = ALPHA / 2  # what an interval leaves out on each side

Numbers = Any  # a float, or an array
Floats = NDArray[np.float64]


class Estimate(NamedTuple):
    """A number, or several as an array, with the 95 % interval of each."""

    value: Numbers
    low: Numbers
    high: Numbers


def with_ends(name: str, estimate: Estimate) -> dict[str, Numbers]:
    """Returns the columns of a number, or of several, with its interval."""
    return {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def ends_of(name: str, row: Mapping[Any, Any]) -> Estimate:
    """Returns a number of a row of a table with its interval."""
    return Estimate(row[name], row[f"{name}_low"], row[f"{name}_high"])


@lru_cache(maxsize=8)
def resample(n_agents: int, scenario: str) -> Floats:
    """Draws how often each agent counts in each resample, (RESAMPLES + 1, N).

    In the first one, all count once. Populations of the same scenario and size share the draws.
    """
    rng = np.random.default_rng([BOOTSTRAP_SEED, *scenario.encode()])
    counts = rng.multinomial(n_agents, np.full(n_agents, 1 / n_agents), size=RESAMPLES)
    return np.vstack([np.ones(n_agents), counts]).astype(np.float64)


def interval(samples: Floats) -> tuple[Floats, Floats]:
    """Returns the ends of the 95 % interval of a statistic, which is the first of its samples."""
    with np.errstate(invalid="ignore"):  # infinite ratios give NaN
        low, high = np.percentile(samples[1:], [2.5, 97.5], axis=0)
    return low, high


def proportion_interval(
    mean: Floats | float, n: NDArray[np.int_] | int, tail: float = TAIL
) -> tuple[Floats, Floats]:
    """Returns the ends of intervals of means of n numbers in [0, 1].

    Means have any shape; an interval leaves out a tail on each side. For shares of successes they
    are the exact binomial ones (Clopper and Pearson 1934). Other numbers in [0, 1] with the same
    mean vary less; in all cases that were tried, the interval is conservative for them.

    >>> [round(float(end), 4) for end in proportion_interval(1.0, 100)]  # 0.025 ** (1 / 100)
    [0.9638, 1.0]
    """
    mean, n = np.asarray(mean), np.asarray(n)
    count = np.clip(mean, 0, 1) * n
    ones, zeros = np.maximum(count, _NONE), np.maximum(n - count, _NONE)
    low, high = (
        special.betaincinv(ones, zeros + 1, tail),
        special.betainccinv(ones + 1, zeros, tail),
    )
    return np.minimum(low, mean), np.maximum(high, mean)


def proportion(values: NDArray[np.generic]) -> Estimate:
    """Returns means over N agents of (N, ...) numbers in [0, 1]."""
    mean = values.mean(axis=0)
    return Estimate(mean, *proportion_interval(mean, len(values)))


def combined(
    weights: Sequence[float], means: Sequence[float], sizes: Sequence[int], tail: float = TAIL
) -> tuple[float, float]:
    """Returns the ends of the interval of a weighted sum of independent means.

    Each is a mean of numbers in [0, 1]; `sizes` says of how many. Like Newcombe's interval of a
    difference, it follows from the intervals of the means: the distance of each end from the sum
    is the root of the summed squares of the distances of the means' own ends (Zou and Donner
    2008, Statistics in Medicine 27:1693-1702). Weights may be negative.
    """
    weight, mean = np.array(weights), np.array(means)
    reach = weight * (np.array(proportion_interval(mean, np.array(sizes), tail)) - mean)
    value, below, above = weight @ mean, reach.min(axis=0), reach.max(axis=0)
    return float(value - np.linalg.norm(below)), float(value + np.linalg.norm(above))


def p_above(
    weights: Sequence[float], means: Sequence[float], sizes: Sequence[int], value: float
) -> float:
    """Returns the one-sided p-value of a weighted sum of means being at most a value.

    It is the tail for which the lower end of `combined` is the value; 1 if there is none, as when
    the observed sum is at most the value.
    """

    def distance(z: float) -> float:
        return combined(weights, means, sizes, float(stats.norm.sf(z)))[0] - value

    if distance(0.0) <= 0:
        return 1.0
    if distance(MAX_Z) > 0:
        return 0.0
    return float(stats.norm.sf(optimize.brentq(distance, 0.0, MAX_Z)))


def student(values: Floats, level: float = LEVEL, n_means: int = 1) -> Estimate:
    """Returns means over N agents of (N, ...) values without outliers, with Student's intervals.

    By Bonferroni's correction, `n_means` intervals contain all their true means at once with this
    confidence.
    """
    n = len(values)
    t = stats.t.ppf(1 - (1 - level) / (2 * n_means), n - 1)
    mean = values.mean(axis=0)
    is_constant = np.ptp(values, axis=0) == 0  # rounding would give it a width
    reach = np.where(is_constant, 0.0, t * values.std(axis=0, ddof=1) / np.sqrt(n))
    return Estimate(mean, mean - reach, mean + reach)


def median(values: Floats) -> Estimate:
    """Returns the median of N values with its exact interval by ranks.

    For few values, ends are 0 or infinite.

    >>> median(np.arange(1.0, 21.0)), median(np.array([1.0, 2.0, np.inf])).value
    (Estimate(value=10.5, low=6.0, high=15.0), 2.0)
    """
    n = len(values)
    ranks = stats.binom.cdf(np.arange(n), n, 0.5)  # of at most so many values below the median
    low, high = int((ranks <= TAIL).sum()), int((ranks < 1 - TAIL).sum())
    ends = np.array([0.0, *np.sort(values), np.inf])
    return Estimate(float(np.median(values)), float(ends[low]), float(ends[high + 1]))


def wins(x: Floats, y: Floats) -> Floats:
    """Returns 1 where x took less than y, 1/2 where both took the same, else 0.

    Of independent pairs, the mean is the probability that x takes less: its interval is that of a
    `proportion`, its p-value `p_half`.
    """
    return np.where(x == y, 0.5, x < y)


def p_half(mean: float, n: int) -> float:
    """Returns the one-sided p-value of a mean of n numbers being on the other side of 1/2.

    It is the tail for which its `proportion_interval` ends at 1/2; without ties, the sign test's.

    >>> p_half(1.0, 5), p_half(0.0, 5)
    (0.03125, 0.03125)
    """
    count = max(mean, 1 - mean) * n
    return float(special.betainc(count, n - count + 1, 0.5))


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns p-values adjusted by Holm's method, in the same order.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    adjusted = np.array(p_values, dtype=float)
    order = np.argsort(adjusted, kind="stable")
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.maximum.accumulate(np.minimum(factors * adjusted[order], 1.0))
    return [*map(float, adjusted)]


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

    @property
    def estimate(self) -> Estimate:
        """The mean over scenarios with its interval."""
        return Estimate(self.mean, *combined(self.weights, *self))

    def minus(self, y: "Means") -> tuple[list[float], list[float], list[int]]:
        """Returns weights, means and sizes of a difference of means over scenarios."""
        weights = self.weights + [-weight for weight in y.weights]
        return weights, [*self.means, *y.means], [*self.sizes, *y.sizes]


class Contrast(NamedTuple):
    """A difference, x - y, with the p-values of no difference, and of one as large as a margin."""

    difference: float
    difference_low: float  # of the 95 % interval
    difference_high: float
    difference_low_90: float  # of the 90 % interval, which belongs to two one-sided tests at 5 %
    difference_high_90: float
    p_different: float
    p_equivalent: float


def contrast(x: Means, y: Means, margin: float) -> Contrast:
    """Compares two learners in the same scenarios; p-values are not adjusted."""
    gap, opposite = x.minus(y), y.minus(x)
    return Contrast(
        round(x.mean - y.mean, _DIGITS),
        *combined(*gap),
        *combined(*gap, ALPHA),
        p_different=min(1.0, 2 * p_above(*gap, 0.0), 2 * p_above(*opposite, 0.0)),
        p_equivalent=max(p_above(*gap, -margin), p_above(*opposite, -margin)),
    )


def contrasts(pairs: Sequence[tuple[Means, Means]], margin: float) -> list[Contrast]:
    """Compares pairs of learners; each kind of p-value is adjusted over all pairs."""
    found = [contrast(x, y, margin) for x, y in pairs]
    *others, different, equivalent = zip(*found, strict=True)
    return [*map(Contrast, *others, holm(different), holm(equivalent))]


def standing_apart(x: Means, y: Means, margin: float, verdict: str) -> tuple[list[int], list[int]]:
    """Returns the indices of scenarios that contradict a verdict on x in the mean, or may do so.

    The first contradict it by their own difference: if it is *better* or *worse*, by the opposite
    of the margin or more, else by either. The others may do so by their own 90 % interval.
    """

    def contradicting(ends: Iterable[tuple[float, float]]) -> list[int]:
        return [
            i
            for i, (low, high) in enumerate(ends)
            if (verdict != "worse" and low <= -margin) or (verdict != "better" and high >= margin)
        ]

    pairs = [*zip(*x, *y, strict=True)]
    gaps = (round(a - b, _DIGITS) for a, _, b, _ in pairs)
    ends = (combined([1, -1], [a, b], [n, m], ALPHA) for a, n, b, m in pairs)
    return contradicting((gap, gap) for gap in gaps), contradicting(ends)


# The row of a table and the one-hot input of a net are the same observation.
_SAME_INPUT = {"index": "one_hot", "offset": "offset_one_hot"}


def differences(x: Population, y: Population, diverged: Sequence[int] = (0, 0)) -> str:
    """Says what differs between two learners besides their algorithms and their settings' values.

    `diverged` says how many runs of each did. An empty text says that nothing differs.
    """
    of_x, of_y = _conditions(x, diverged[0]), _conditions(y, diverged[1])
    apart = [name for name in of_x if of_x[name] != of_y[name]]
    return "; ".join(f"{name} {of_x[name]} against {of_y[name]}" for name in apart)


def _conditions(population: Population, n_diverged: int) -> dict[str, str]:
    """Returns under which conditions a learner was trained, in words."""
    learner, settings = population.learner, population.first.settings
    form = _SAME_INPUT.get(learner.observation, learner.observation)
    return {
        "settings": f"searched ({learner.search})" if learner.search else "declared",
        "time limit": f"{settings.time_limit:,}" if settings.time_limit else "none",
        "input": OBSERVED.get(form, form),
        "policy": learner.policy,
        "training steps": f"{settings.budget:,}",
        "diverged runs": f"{n_diverged:,}",
    }
