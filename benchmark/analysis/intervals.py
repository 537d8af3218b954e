"""Intervals over agents.

Bootstrap intervals are 95 %, by the percentile method, and seeded: equal records give equal digits. Means of
numbers in [0, 1] have score intervals, too, which have a width even where all agents agree.
"""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

RESAMPLES: Final = 1000
BOOTSTRAP_SEED: Final = 20210803


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
    """Returns the ends of the 95 % interval of a resampled statistic.

    Args:
      samples: (RESAMPLES + 1, ...), the statistic itself first.
    """
    with np.errstate(invalid="ignore"):  # of infinite ratios the interval is NaN
        low, high = np.percentile(samples[1:], [2.5, 97.5], axis=0)
    return low, high


def mean_with_interval(name: str, samples: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Returns columns of a resampled statistic, (RESAMPLES + 1, T): `name`, `name_low` and `name_high`."""
    low, high = interval(samples)
    return {name: samples[0], f"{name}_low": low, f"{name}_high": high}


def interquartile_mean(name: str, scores: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Returns columns of the interquartile mean of scores, (N, T): `name`, `name_low` and `name_high`."""

    def iqm(values: NDArray[np.float64], axis: int = 0) -> NDArray[np.float64]:
        return np.asarray(stats.trim_mean(values, 0.25, axis=axis))

    bootstrap = stats.bootstrap(
        (scores,),
        iqm,
        axis=0,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(BOOTSTRAP_SEED),
    )
    low, high = bootstrap.confidence_interval
    return {name: iqm(scores), f"{name}_low": np.asarray(low), f"{name}_high": np.asarray(high)}


def wilson(
    mean: NDArray[np.float64] | float, n: int, level: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of score intervals of means of numbers in [0, 1].

    For shares of successes it is Wilson's. Other numbers in [0, 1] with the same mean vary less, so for them
    the interval is conservative.

    Args:
      mean: Of any shape.
      n: How many numbers each mean is of.
      level: Of confidence, such as 0.95.
    """
    z = stats.norm.ppf((1 + level) / 2)
    mean = np.asarray(mean)
    centre = mean + z**2 / (2 * n)
    reach = z * np.sqrt(mean * (1 - mean) / n + z**2 / (4 * n**2))
    return (centre - reach) / (1 + z**2 / n), (centre + reach) / (1 + z**2 / n)


def newcombe(x: float, n_x: int, y: float, n_y: int, level: float) -> tuple[float, float]:
    """Returns the ends of the hybrid score interval of x - y, both means of numbers in [0, 1].

    Newcombe (1998), Statistics in Medicine 17:873-890, method 10.

    Args:
      x: A mean.
      n_x: How many numbers it is of.
      y: Another mean, of other agents.
      n_y: How many numbers it is of.
      level: Of confidence, such as 0.95.

    >>> [round(end, 4) for end in newcombe(56 / 70, 70, 48 / 80, 80, 0.95)]  # Newcombe's table II, (a)
    [0.0524, 0.3339]
    """
    x_low, x_high = wilson(x, n_x, level)
    y_low, y_high = wilson(y, n_y, level)
    return float(x - y - np.hypot(x - x_low, y_high - y)), float(x - y + np.hypot(x_high - x, y - y_low))


def simultaneous(
    values: NDArray[np.float64], level: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of intervals of several means that hold the true means all at once.

    By Student's t with Bonferroni's correction, so it does not matter how the values of an agent depend on
    each other. If all values of a column are equal, the interval has no width.

    Args:
      values: (N, M), of N agents.
      level: Of confidence in all M intervals together, such as 0.95.

    Returns:
      Lower and upper ends, (M,) each.
    """
    n_agents, n_means = values.shape
    t = stats.t.ppf(1 - (1 - level) / (2 * n_means), n_agents - 1)
    mean = values.mean(axis=0)
    is_constant = np.ptp(values, axis=0) == 0  # rounding would give it a width
    reach = np.where(is_constant, 0.0, t * values.std(axis=0, ddof=1) / np.sqrt(n_agents))
    return mean - reach, mean + reach
