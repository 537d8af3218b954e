"""Intervals over agents.

Means of numbers in [0, 1] have exact binomial intervals, from which those of sums and differences of such
means follow; they have a width even where all agents agree. Other statistics have percentile intervals over
seeded resamples, so equal records give equal digits.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special, stats

RESAMPLES: Final = 1000
BOOTSTRAP_SEED: Final = 20210803
MAX_Z: Final = 8.0  # standard errors beyond which p-values count as zero
_NONE: Final = 1e-12  # smaller counts are rounding errors
LEVEL: Final = 0.95  # confidence, unless another is given
TAIL: Final = (1 - LEVEL) / 2  # what an interval leaves out on each side

Numbers = Any  # a float, or an array


class Estimate(NamedTuple):
    """A number, or several as an array, with the 95 % interval of each."""

    value: Numbers
    low: Numbers
    high: Numbers


@lru_cache(maxsize=8)
def resample(n_agents: int, scenario: str) -> NDArray[np.float64]:
    """Draws how often each agent counts in each resample, (RESAMPLES + 1, N); in the first, all count once.

    Populations of the same scenario and size share the draws.
    """
    rng = np.random.default_rng([BOOTSTRAP_SEED, *scenario.encode()])
    counts = rng.multinomial(n_agents, np.full(n_agents, 1 / n_agents), size=RESAMPLES)
    return np.vstack([np.ones(n_agents), counts]).astype(np.float64)


def interval(samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of the 95 % interval of a resampled statistic; the first sample is the statistic."""
    with np.errstate(invalid="ignore"):  # infinite ratios give NaN
        low, high = np.percentile(samples[1:], [2.5, 97.5], axis=0)
    return low, high


def proportion_interval(
    mean: NDArray[np.float64] | float, n: NDArray[np.int_] | int, tail: float = TAIL
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of intervals of means, of any shape, of n numbers in [0, 1], with a tail on each side.

    For shares of successes they are the exact binomial ones (Clopper and Pearson 1934). Other numbers in
    [0, 1] with the same mean vary less; in all cases that were tried, the interval is conservative for them.

    >>> [round(float(end), 4) for end in proportion_interval(1.0, 100)]  # 0.025 ** (1 / 100)
    [0.9638, 1.0]
    """
    mean, n = np.asarray(mean), np.asarray(n)
    count = np.clip(mean, 0, 1) * n
    ones, zeros = np.maximum(count, _NONE), np.maximum(n - count, _NONE)
    low = np.where(count > _NONE, special.betaincinv(ones, zeros + 1, tail), 0.0)
    high = np.where(n - count > _NONE, special.betainccinv(ones + 1, zeros, tail), 1.0)
    return np.minimum(low, mean), np.maximum(high, mean)


def proportion(values: NDArray[np.generic]) -> Estimate:
    """Returns means over N agents of (N, ...) numbers in [0, 1]."""
    mean = values.mean(axis=0)
    return Estimate(mean, *proportion_interval(mean, len(values)))


def combined(
    weights: Sequence[float], means: Sequence[float], sizes: Sequence[int], tail: float = TAIL
) -> tuple[float, float]:
    """Returns the ends of the interval of a weighted sum of independent means of `sizes` numbers in [0, 1].

    Like Newcombe's interval of a difference, it follows from the intervals of the means: the distance of each
    end from the sum is the root of the summed squares of the distances of the means' own ends (Zou and Donner
    2008, Statistics in Medicine 27:1693-1702). Weights may be negative.
    """
    weight, mean = np.asarray(weights, dtype=float), np.asarray(means, dtype=float)
    low, high = proportion_interval(mean, np.asarray(sizes), tail)
    down, up = weight * (mean - low), weight * (high - mean)
    sides = np.where(weight > 0, down, up), np.where(weight > 0, up, down)
    value, below, above = float(weight @ mean), *(float(np.linalg.norm(side)) for side in sides)
    return value - below, value + above


def mean_over_scenarios(values: Sequence[NDArray[np.float64]]) -> Estimate:
    """Returns the mean over scenarios of the mean of each one's numbers in [0, 1], with its interval."""
    means = [float(numbers.mean()) for numbers in values]
    weights = [1 / len(values)] * len(values)
    return Estimate(float(np.mean(means)), *combined(weights, means, [*map(len, values)]))


def p_above(weights: Sequence[float], means: Sequence[float], sizes: Sequence[int], value: float) -> float:
    """Returns the one-sided p-value of the hypothesis that a weighted sum of means is at most a value.

    It is the tail for which the lower end of `combined` is the value; 1 if there is none, as when the
    observed sum is at most the value.
    """

    def distance(z: float) -> float:
        return combined(weights, means, sizes, float(stats.norm.sf(z)))[0] - value

    if distance(0.0) <= 0:
        return 1.0
    return 0.0 if distance(MAX_Z) > 0 else float(stats.norm.sf(optimize.brentq(distance, 0.0, MAX_Z)))


def student(values: NDArray[np.float64], level: float = LEVEL, n_means: int = 1) -> Estimate:
    """Returns means over N agents of (N, ...) values without outliers, with Student's intervals.

    By Bonferroni's correction, `n_means` intervals contain all their true means at once with this confidence.
    """
    n = len(values)
    t = stats.t.ppf(1 - (1 - level) / (2 * n_means), n - 1)
    mean = values.mean(axis=0)
    is_constant = np.ptp(values, axis=0) == 0  # rounding would give it a width
    reach = np.where(is_constant, 0.0, t * values.std(axis=0, ddof=1) / np.sqrt(n))
    return Estimate(mean, mean - reach, mean + reach)


def median(values: NDArray[np.float64]) -> Estimate:
    """Returns the median of N values with its exact interval by ranks; for few values, 0 or infinite ends.

    >>> median(np.arange(1.0, 21.0)), median(np.array([1.0, 2.0, np.inf])).value
    (Estimate(value=10.5, low=6.0, high=15.0), 2.0)
    """
    n = len(values)
    ranks = stats.binom.cdf(np.arange(n), n, 0.5)  # of at most so many values below the median
    low, high = int((ranks <= TAIL).sum()), int((ranks < 1 - TAIL).sum())
    ends = np.array([0.0, *np.sort(values), np.inf])
    return Estimate(float(np.median(values)), float(ends[low]), float(ends[min(high + 1, n + 1)]))
