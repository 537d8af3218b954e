"""Intervals, by hand, against SciPy, and by simulation of how often they contain the truth."""

import numpy as np
import pytest
from scipy import stats

from benchmark.analysis.intervals import (
    RESAMPLES,
    better_probability,
    combined,
    interval,
    p_above,
    proportion_interval,
    resample,
    simultaneous,
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


def test_interval_leaves_out_a_fortieth_at_each_end() -> None:
    samples = np.concatenate([[7.0], np.arange(1001)])
    assert np.array(interval(samples)).tolist() == [25.0, 975.0]


@pytest.mark.parametrize("count", [0, 1, 30, 59, 60])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_interval_of_a_share_is_the_exact_binomial_one(count: int, level: float) -> None:
    expected = stats.binomtest(count, 60).proportion_ci(level, method="exact")
    assert proportion_interval(count / 60, 60, level) == pytest.approx(
        (expected.low, expected.high), abs=1e-9
    )


def test_interval_of_one_mean_is_that_of_the_share() -> None:
    low, high = proportion_interval(0.3, 40)
    assert combined([1], [0.3], [40]) == pytest.approx((float(low), float(high)))
    assert combined([-1], [0.3], [40]) == pytest.approx((-float(high), -float(low)))


def test_ends_of_a_sum_are_as_far_as_the_root_of_summed_squares() -> None:
    """By hand: all of 100 against none of 100, and twice one half."""
    reach = 1 - 0.025 ** (1 / 100)  # of the exact interval of all or none of 100
    low, high = combined([1, -1], [1.0, 0.0], [100, 100])
    assert (low, high) == pytest.approx((1 - np.sqrt(2) * reach, 1.0))
    half = stats.binomtest(50, 100).proportion_ci()
    low, high = combined([0.5, 0.5], [0.5, 0.5], [100, 100])
    assert high - 0.5 == pytest.approx(0.5 - low)
    assert high - 0.5 == pytest.approx((half.high - 0.5) / np.sqrt(2))


def test_p_value_is_the_tail_at_which_the_interval_ends_at_the_value() -> None:
    weights, means, sizes = [1, -1], [0.9, 0.7], [50, 60]
    p = p_above(weights, means, sizes, 0.0)
    assert combined(weights, means, sizes, 1 - 2 * p)[0] == pytest.approx(0, abs=1e-9)
    assert 0 < p < 0.025
    assert p_above(weights, [0.7, 0.9], sizes, 0.0) == 1
    assert p_above([1], [1.0], [100], 0.95) == pytest.approx(0.95**100)  # of a share: the exact test
    assert p_above([1], [1.0], [1000], 0.0) == 0


# Of three scenarios: the chance of success in each
TRUTHS = [
    (1.0, 0.9, 1.0),
    (1.0, 0.92, 0.99),
    (0.5, 0.5, 0.5),
    (0.9, 0.9, 0.9),
    (0.97, 0.5, 1.0),
    (1.0, 1.0, 1.0),
]


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("n", [10, 30, 100])
def test_mean_over_scenarios_is_covered(truth: tuple[float, ...], n: int) -> None:
    """One scenario that fails one time in ten is where resampling covers 65 % with ten runs."""
    found = np.random.default_rng(n).binomial(n, truth, size=(2000, 3)) / n
    ends = {tuple(row): combined([1 / 3] * 3, row, [n] * 3) for row in np.unique(found, axis=0)}
    covered = np.mean(
        [ends[tuple(row)][0] - 1e-9 <= np.mean(truth) <= ends[tuple(row)][1] + 1e-9 for row in found]
    )
    assert covered >= 0.94


@pytest.mark.parametrize("n", [10, 30, 100])
def test_bounded_scores_are_covered(n: int) -> None:
    """Nine scores in ten are near 1 and one is 0: between a share of successes and a smooth mean."""
    rng = np.random.default_rng(n)
    scores = np.where(rng.random((2000, n)) < 0.1, 0.0, rng.uniform(0.9, 1.0, (2000, n)))
    low, high = proportion_interval(scores.mean(axis=1), n)
    assert np.mean((low <= 0.9 * 0.95) & (high >= 0.9 * 0.95)) >= 0.95


@pytest.mark.parametrize("n", [10, 30, 100])
def test_difference_of_means_over_scenarios_is_covered(n: int) -> None:
    rng = np.random.default_rng(n)
    x, y = (1.0, 0.92, 0.99), (1.0, 0.99, 1.0)
    found = rng.binomial(n, (*x, *y), size=(1000, 6)) / n
    truth = np.mean(x) - np.mean(y)
    weights = [1 / 3] * 3 + [-1 / 3] * 3
    ends = {tuple(row): combined(weights, row, [n] * 6) for row in np.unique(found, axis=0)}
    assert np.mean([ends[tuple(row)][0] <= truth <= ends[tuple(row)][1] for row in found]) >= 0.95


def test_students_interval_agrees_with_scipy() -> None:
    values = np.random.default_rng(0).gamma(4, size=(30, 2))
    expected = stats.ttest_1samp(values, 0).confidence_interval()
    low, high = student(values)
    assert low == pytest.approx(expected.low)
    assert high == pytest.approx(expected.high)


@pytest.mark.parametrize("n", [10, 30, 100])
def test_students_interval_covers_moderately_skewed_means(n: int) -> None:
    values = np.random.default_rng(n).gamma(4, size=(n, 4000))
    low, high = student(values)
    assert np.mean((low <= 4) & (high >= 4)) >= 0.925


@pytest.mark.parametrize("n", [10, 30, 100])
@pytest.mark.parametrize("shift", [0.0, 1.0, 2.5])
def test_probability_of_improvement_is_covered(n: int, shift: float) -> None:
    rng = np.random.default_rng([n, round(shift * 10)])
    truth = stats.norm.cdf(shift / np.sqrt(2))
    x, y = rng.normal(shift, size=(400, n)), rng.normal(size=(400, n))
    shares = (x[:, :, None] > y[:, None, :]).mean(axis=(1, 2))
    ends = [better_probability(float(share), n, n) for share in shares]
    assert np.mean([low <= truth <= high for low, high in ends]) >= 0.93


def test_probability_of_improvement_has_a_width_where_all_agree() -> None:
    low, high = better_probability(1.0, 100, 100)
    assert (0.95 < low < 0.99, high) == (True, 1.0)
    assert better_probability(0.0, 100, 100) == pytest.approx((0.0, 1 - low))
    low, high = better_probability(0.5, 40, 40)
    assert low + high == pytest.approx(1)


def test_simultaneous_intervals_by_hand() -> None:
    values = np.array([[1.0, 0.5], [2, 0.5], [3, 0.5], [4, 0.5]])
    low, high = simultaneous(values, 0.9)
    # Two means, so 2.5 % in each tail; t with 3 degrees of freedom is 3.182 (Student's table).
    reach = 3.182 * np.sqrt(5 / 3) / 2
    assert low == pytest.approx([2.5 - reach, 0.5], abs=1e-3)
    assert high == pytest.approx([2.5 + reach, 0.5], abs=1e-3)


def test_simultaneous_intervals_hold_all_means_at_once() -> None:
    rng = np.random.default_rng(20210803)
    means = np.linspace(-1, 1, 120)
    held = 0
    for _ in range(400):
        shared = rng.normal(size=(100, 1))  # agents differ in all columns alike
        low, high = simultaneous(means + shared + rng.normal(size=(100, 120)), 0.95)
        held += bool(((low <= means) & (means <= high)).all())
    assert held >= 0.94 * 400
