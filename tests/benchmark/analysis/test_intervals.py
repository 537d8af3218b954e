"""Intervals, by hand, against SciPy, and by simulation of how often they contain the truth."""

import numpy as np
import pytest
from scipy import stats

from benchmark.analysis.intervals import (
    RESAMPLES,
    combined,
    interval,
    p_above,
    proportion_interval,
    resample,
    student,
)


def test_resamples_count_every_agent_as_often_as_they_are_large() -> None:
    weights = resample(6, "S1")
    assert weights.shape == (RESAMPLES + 1, 6)
    assert (weights[0] == 1).all()
    assert (weights.sum(axis=1) == 6).all()
    assert abs(weights[1:].mean(axis=0) - 1).max() < 0.1
    assert (weights == resample(6, "S1")).all()
    assert (weights != resample(6, "S2")).any()


def test_interval_agrees_with_scipy() -> None:
    values = np.random.default_rng(0).normal(size=60)
    low, high = interval(resample(60, "S1") @ values / 60)
    other = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=1)
    width = other.confidence_interval.high - other.confidence_interval.low
    assert low == pytest.approx(other.confidence_interval.low, abs=0.08 * width)
    assert high == pytest.approx(other.confidence_interval.high, abs=0.08 * width)


@pytest.mark.parametrize("count", [0, 1, 30, 59, 60])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_interval_of_a_share_is_the_exact_binomial_one(count: int, level: float) -> None:
    expected = stats.binomtest(count, 60).proportion_ci(level, method="exact")
    assert proportion_interval(count / 60, 60, (1 - level) / 2) == pytest.approx(
        (expected.low, expected.high), abs=1e-9
    )


def test_ends_of_a_sum_are_as_far_as_the_root_of_summed_squares() -> None:
    """By hand: a single mean, all of 100 against none of 100, and twice one half."""
    low, high = map(float, proportion_interval(0.3, 40))
    assert combined([1], [0.3], [40]) == pytest.approx((low, high))
    assert combined([-1], [0.3], [40]) == pytest.approx((-high, -low))
    reach = 1 - 0.025 ** (1 / 100)  # of the exact interval of all or none of 100
    low, high = combined([1, -1], [1.0, 0.0], [100, 100])
    assert (low, high) == pytest.approx((1 - np.sqrt(2) * reach, 1.0))
    half = (stats.binomtest(50, 100).proportion_ci().high - 0.5) / np.sqrt(2)
    assert combined([0.5, 0.5], [0.5, 0.5], [100, 100]) == pytest.approx((0.5 - half, 0.5 + half))


def test_p_value_is_the_tail_at_which_the_interval_ends_at_the_value() -> None:
    weights, means, sizes = [1, -1], [0.9, 0.7], [50, 60]
    p = p_above(weights, means, sizes, 0.0)
    assert combined(weights, means, sizes, p)[0] == pytest.approx(0, abs=1e-9)
    assert 0 < p < 0.025
    assert p_above(weights, [0.7, 0.9], sizes, 0.0) == 1
    assert p_above([1], [1.0], [100], 0.95) == pytest.approx(0.95**100)  # of a share: the exact test
    assert p_above([1], [1.0], [1000], 0.0) == 0


THIRDS = [1 / 3] * 3


@pytest.mark.parametrize(
    ("weights", "truth"),  # the chance of success in each scenario
    [
        (THIRDS, (1.0, 0.9, 1.0)),
        (THIRDS, (0.97, 0.5, 1.0)),
        ([*THIRDS, *[-1 / 3] * 3], (1.0, 0.92, 0.99, 1.0, 0.99, 1.0)),  # a difference of such means
    ],
)
@pytest.mark.parametrize("n", [10, 100])
def test_mean_over_scenarios_is_covered(weights: list[float], truth: tuple[float, ...], n: int) -> None:
    """One scenario that fails one time in ten is where resampling covers 65 % with ten runs."""
    means = np.random.default_rng(n).binomial(n, truth, size=(1000, len(truth))) / n
    value, covered = np.dot(weights, truth), 0
    for row, count in zip(*np.unique(means, axis=0, return_counts=True), strict=True):
        low, high = combined(weights, row, [n] * len(row))
        covered += count * (low - 1e-9 <= value <= high + 1e-9)
    assert covered >= 0.935 * 1000


@pytest.mark.parametrize("n", [10, 30, 100])
def test_bounded_scores_are_covered(n: int) -> None:
    """Nine scores in ten are near 1 and one is 0: between a share of successes and a smooth mean."""
    rng = np.random.default_rng(n)
    scores = np.where(rng.random((2000, n)) < 0.1, 0.0, rng.uniform(0.9, 1.0, (2000, n)))
    low, high = proportion_interval(scores.mean(axis=1), n)
    assert np.mean((low <= 0.9 * 0.95) & (high >= 0.9 * 0.95)) >= 0.95


def test_simultaneous_intervals_by_hand() -> None:
    values = np.array([[1.0, 0.5], [2, 0.5], [3, 0.5], [4, 0.5]])
    _, low, high = student(values, 0.9, 2)
    # Two means, so 2.5 % in each tail; t with 3 degrees of freedom is 3.182 (Student's table).
    reach = 3.182 * np.sqrt(5 / 3) / 2
    assert low == pytest.approx([2.5 - reach, 0.5], abs=1e-3)
    assert high == pytest.approx([2.5 + reach, 0.5], abs=1e-3)
