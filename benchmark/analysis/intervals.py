"""Bootstrap intervals over agents: 95 %, percentile, seeded, so the same records give the same digits."""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

RESAMPLES: Final = 1000
BOOTSTRAP_SEED: Final = 20210803


@lru_cache(maxsize=8)
def resample(n_agents: int, scenario: str) -> NDArray[np.float64]:
    """Draws how often each agent is counted, (RESAMPLES + 1, N); the first row is the sample itself.

    A statistic that is a function of means is thus resampled by one product of matrices. Scenarios
    are resampled apart from each other; the readings of one share their draws, as they do their seeds.
    """
    rng = np.random.default_rng([BOOTSTRAP_SEED, *scenario.encode()])
    counts = rng.multinomial(n_agents, np.full(n_agents, 1 / n_agents), size=RESAMPLES)
    return np.vstack([np.ones(n_agents), counts]).astype(np.float64)


def interval(samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of the 95 % interval of resampled values.

    Args:
      samples: (RESAMPLES + 1, ...), the first of which is the sample's own.
    """
    with np.errstate(invalid="ignore"):  # infinite ratios have no interval
        low, high = np.percentile(samples[1:], [2.5, 97.5], axis=0)
    return low, high


def mean_with_interval(name: str, samples: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Names a resampled statistic, (RESAMPLES + 1, T), and its interval."""
    low, high = interval(samples)
    return {name: samples[0], f"{name}_low": low, f"{name}_high": high}


def interquartile_mean(name: str, scores: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Names the interquartile mean of (N, T) scores and its bootstrap interval."""

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
