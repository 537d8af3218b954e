"""Intervals and contrasts: by hand, against SciPy, and how often they are wrong in simulation."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from benchmark.experiment import load_experiment
from benchmark.statistics import (
    Means,
    combined,
    contrast,
    differences,
    holm,
    interval,
    p_above,
    p_half,
    proportion_interval,
    resample,
    student,
    wins,
)

COMPARED = load_experiment("compare_deep")


def test_interval_agrees_with_scipy() -> None:
    values = np.random.default_rng(0).normal(size=60)
    ends = interval(resample(60, "S1") @ values / 60)
    other = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=1)
    width = other.confidence_interval.high - other.confidence_interval.low
    assert ends == pytest.approx(tuple(other.confidence_interval), abs=0.08 * width)


@pytest.mark.parametrize("count", [0, 1, 30, 59, 60])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_interval_of_a_share_is_the_exact_binomial_one(count: int, level: float) -> None:
    expected = stats.binomtest(count, 60).proportion_ci(level, method="exact")
    found = proportion_interval(count / 60, 60, (1 - level) / 2)
    assert found == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_ends_of_a_sum_are_as_far_as_the_root_of_summed_squares() -> None:
    """By hand: a single mean, all of 100 against none of 100, and twice one half."""
    low, high = map(float, proportion_interval(0.3, 40))
    assert combined([1], [0.3], [40]) == pytest.approx((low, high))
    assert combined([-1], [0.3], [40]) == pytest.approx((-high, -low))
    reach = 1 - 0.025 ** (1 / 100)  # of the exact interval of all or none of 100
    found = combined([1, -1], [1.0, 0.0], [100, 100])
    assert found == pytest.approx((1 - np.sqrt(2) * reach, 1.0))
    half = (stats.binomtest(50, 100).proportion_ci().high - 0.5) / np.sqrt(2)
    found = combined([0.5, 0.5], [0.5, 0.5], [100, 100])
    assert found == pytest.approx((0.5 - half, 0.5 + half))


def test_p_value_is_the_tail_at_which_the_interval_ends_at_the_value() -> None:
    weights, means, sizes = [1, -1], [0.9, 0.7], [50, 60]
    p = p_above(weights, means, sizes, 0.0)
    assert combined(weights, means, sizes, p)[0] == pytest.approx(0, abs=1e-9)
    assert 0 < p < 0.025
    assert p_above(weights, [0.7, 0.9], sizes, 0.0) == 1
    assert p_above([1], [1.0], [100], 0.95) == pytest.approx(
        0.95**100
    )  # of a share: the exact test
    assert p_above([1], [1.0], [1000], 0.0) == 0


THIRDS = [1 / 3] * 3


@pytest.mark.parametrize(
    ("weights", "truth"),  # the chance of success in each scenario
    [
        (THIRDS, (1.0, 0.9, 1.0)),
        ([*THIRDS, *[-1 / 3] * 3], (1.0, 0.92, 0.99, 1.0, 0.99, 1.0)),  # a difference of means
    ],
)
@pytest.mark.parametrize("n", [10, 100])
def test_mean_over_scenarios_is_covered(
    weights: list[float], truth: tuple[float, ...], n: int
) -> None:
    """One scenario that fails one time in ten is where resampling covers 65 % with ten runs."""
    means = np.random.default_rng(n).binomial(n, truth, size=(1000, len(truth))) / n
    value, covered = np.dot(weights, truth), 0
    for row, count in zip(*np.unique(means, axis=0, return_counts=True), strict=True):
        low, high = combined(weights, row, [n] * len(row))
        covered += count * (low - 1e-9 <= value <= high + 1e-9)
    assert covered >= 0.935 * 1000


def test_simultaneous_intervals_by_hand() -> None:
    values = np.array([[1.0, 0.5], [2, 0.5], [3, 0.5], [4, 0.5]])
    _, low, high = student(values, 0.9, 2)
    # Two means, so 2.5 % in each tail; t with 3 degrees of freedom is 3.182 (Student's table).
    reach = 3.182 * np.sqrt(5 / 3) / 2
    assert low == pytest.approx([2.5 - reach, 0.5], abs=1e-3)
    assert high == pytest.approx([2.5 + reach, 0.5], abs=1e-3)


def test_pairs_are_won_lost_or_tied_and_their_p_value_is_the_sign_tests() -> None:
    found = wins(np.array([1.0, 3, 2, np.inf]), np.array([2.0, 1, 2, np.inf]))
    assert found.tolist() == [1, 0, 0.5, 0.5]
    for count in (0, 6, 10, 17, 20):
        better = max(count, 20 - count)
        expected = stats.binomtest(better, 20, alternative="greater").pvalue
        assert p_half(count / 20, 20) == pytest.approx(expected)
    tied = p_half(0.775, 20)  # 15.5 of 20
    assert proportion_interval(0.775, 20, tied)[0] == pytest.approx(0.5)


def test_holm_by_hand() -> None:
    """Sorted, p-values are multiplied by 4, 3, 2, 1, never fall, and never exceed 1."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert (holm([0.5, 0.9]), holm([0.04]), holm([])) == ([1.0, 1.0], [0.04], [])


shares = st.tuples(*[st.integers(0, 20).map(lambda count: count / 20)] * 2)


@settings(max_examples=30)
@given(shares, shares, st.sampled_from([5, 20, 200]))
def test_tests_and_intervals_never_contradict_each_other(
    x: Sequence[float], y: Sequence[float], n: int
) -> None:
    found = contrast(Means(x, [n, n]), Means(y, [n, n]), 0.1)
    low, high, low_90, high_90 = found[1:5]
    assert (found.p_different < 0.05 - 1e-6) <= (low > 0 or high < 0)
    assert (found.p_different > 0.05 + 1e-6) <= (low <= 0 <= high)
    assert (found.p_equivalent < 0.05 - 1e-6) <= (low_90 > -0.1 and high_90 < 0.1)
    assert (found.p_equivalent > 0.05 + 1e-6) <= (low_90 <= -0.1 or high_90 >= 0.1)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        ("dqn", "sb3_dqn_default", "settings searched (tuning) against declared"),
        ("dqn", "dqn, coordinates", "input one-hot cells against coordinates"),
        ("dqn", "watkins_q_lambda, index", ""),  # a table's row for each cell
        ("ppo", "dqn", "policy stochastic against greedy"),
    ],
)
def test_what_differs_besides_algorithms_is_said(x: str, y: str, expected: str) -> None:
    of = {each.learner.name.removesuffix(", one_hot"): each for each in COMPARED.populations}
    assert differences(of[x], of[y]) == expected
