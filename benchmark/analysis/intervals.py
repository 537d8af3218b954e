"""Intervals over agents.

Means of numbers in [0, 1] have exact binomial intervals, and sums and differences of such means intervals
that follow from these. Those have a width even where all agents agree. Statistics that are no such means are
resampled, see `resample`; those intervals are percentiles, and seeded: equal records give equal digits.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special, stats

RESAMPLES: Final = 1000
BOOTSTRAP_SEED: Final = 20210803
_FARTHEST: Final = 8.0  # standard errors: smaller p-values count as zero
_NONE: Final = 1e-12  # a count below is zero but for rounding
LEVEL: Final = 0.95  # of confidence, unless another is given
TAIL: Final = (1 - LEVEL) / 2  # which an interval leaves out on each side


class Estimate(NamedTuple):
    """A number, or several as an array, with the 95 % interval of each."""

    value: Any
    low: Any
    high: Any


@lru_cache(maxsize=8)
def resample(n_agents: int, scenario: str) -> NDArray[np.float64]:
    """Draws how often each agent counts in each resample, (RESAMPLES + 1, N).

    The first row counts every agent once, and so gives the statistic itself. A product of this matrix with
    the agents' values resamples their sum. Each scenario has its own draws. All populations of a scenario
    that have the same size share them, as the conditions of an experiment share random streams.
    """
    rng = np.random.default_rng([BOOTSTRAP_SEED, *scenario.encode()])
    counts = rng.multinomial(n_agents, np.full(n_agents, 1 / n_agents), size=RESAMPLES)
    return np.vstack([np.ones(n_agents), counts]).astype(np.float64)


def interval(samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of the 95 % interval of a resampled statistic, which itself is the first sample."""
    with np.errstate(invalid="ignore"):  # of infinite ratios the interval is NaN
        low, high = np.percentile(samples[1:], [2.5, 97.5], axis=0)
    return low, high


def proportion_interval(
    mean: NDArray[np.float64] | float, n: NDArray[np.int_] | int, tail: float = TAIL
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of intervals of means of numbers in [0, 1].

    For shares of successes they are the exact binomial ones (Clopper and Pearson 1934), which contain the
    truth at least as often as they say. Other numbers in [0, 1] with the same mean vary less, and in all
    cases that were tried the interval is conservative for them, often by far.

    Args:
      mean: Of any shape.
      n: How many numbers each mean is of.
      tail: The probability that is left out on each side.

    >>> [round(float(end), 4) for end in proportion_interval(1.0, 100)]  # 0.025 ** (1 / 100)
    [0.9638, 1.0]
    """
    mean, n = np.asarray(mean), np.asarray(n)
    count = np.clip(mean, 0, 1) * n
    least, most = np.maximum(count, _NONE), np.maximum(n - count, _NONE)
    low = np.where(count > _NONE, special.betaincinv(least, most + 1, tail), 0.0)
    high = np.where(n - count > _NONE, special.betainccinv(least + 1, most, tail), 1.0)
    return np.minimum(low, mean), np.maximum(high, mean)


def proportion(values: NDArray[np.generic]) -> Estimate:
    """Returns means over agents of (N, ...) numbers in [0, 1], see `proportion_interval`; NaN without any."""
    if not len(values):
        return Estimate(np.nan, np.nan, np.nan)
    mean = values.mean(axis=0)
    return Estimate(mean, *proportion_interval(mean, len(values)))


def combined(
    weights: Sequence[float], means: Sequence[float], sizes: Sequence[int], tail: float = TAIL
) -> tuple[float, float]:
    """Returns the ends of the interval of a weighted sum of independent means of numbers in [0, 1].

    It follows from the intervals of the means, as Newcombe's interval of a difference does: each end of the
    sum is as far from it as the root of the summed squares of the distances to the means' own ends (Zou and
    Donner 2008, Statistics in Medicine 27:1693-1702).

    Args:
      weights: Of the means; negative for those that are subtracted.
      means: Each of other agents.
      sizes: How many numbers each mean is of.
      tail: The probability that is left out on each side.
    """
    weight, mean = np.asarray(weights, dtype=float), np.asarray(means, dtype=float)
    low, high = proportion_interval(mean, np.asarray(sizes), tail)
    value = float(weight @ mean)
    down, up = weight * (mean - low), weight * (high - mean)
    return (
        value - float(np.linalg.norm(np.where(weight > 0, down, up))),
        value + float(np.linalg.norm(np.where(weight > 0, up, down))),
    )


def p_above(weights: Sequence[float], means: Sequence[float], sizes: Sequence[int], value: float) -> float:
    """Returns the one-sided p-value of a weighted sum of means being at most a value.

    It is the tail that the lower end of `combined` leaves out when that end is the value; 1 if the observed
    sum is at most the value, or so little above it that no end is.
    """

    def distance(z: float) -> float:
        return combined(weights, means, sizes, float(stats.norm.sf(z)))[0] - value

    if distance(0.0) <= 0:
        return 1.0
    return 0.0 if distance(_FARTHEST) > 0 else float(stats.norm.sf(optimize.brentq(distance, 0.0, _FARTHEST)))


def student(values: NDArray[np.float64], level: float = LEVEL, n_means: int = 1) -> Estimate:
    """Returns means over agents with Student's intervals.

    For numbers that vary alike between agents, not for those of which a few are far from all others. Where
    all agents agree, the interval has no width.

    Args:
      values: (N, ...), of N agents.
      level: Of confidence.
      n_means: How many intervals hold the true means all at once with this confidence, by Bonferroni's
        correction: it does not matter how the values of an agent depend on each other.
    """
    n = len(values)
    t = stats.t.ppf(1 - (1 - level) / (2 * n_means), n - 1)
    mean = values.mean(axis=0)
    is_constant = np.ptp(values, axis=0) == 0  # rounding would give it a width
    reach = np.where(is_constant, 0.0, t * values.std(axis=0, ddof=1) / np.sqrt(n))
    return Estimate(mean, mean - reach, mean + reach)


def median(values: NDArray[np.float64]) -> Estimate:
    """Returns the median of N values with its exact interval by ranks.

    Where N is too small for such an end, it is 0 or infinite.

    >>> median(np.arange(1.0, 21.0)), median(np.array([1.0, 2.0, np.inf])).value
    (Estimate(value=10.5, low=6.0, high=15.0), 2.0)
    """
    n = len(values)
    ranks = stats.binom.cdf(np.arange(n), n, 0.5)  # of at most so many values below the median
    low, high = int((ranks <= TAIL).sum()), int((ranks < 1 - TAIL).sum())
    ends = np.array([0.0, *np.sort(values), np.inf])
    return Estimate(float(np.median(values)), float(ends[low]), float(ends[min(high + 1, n + 1)]))
