"""Intervals, by hand, against SciPy and against a published table."""

import numpy as np
import pytest
from scipy import stats

from benchmark.analysis.intervals import (
    RESAMPLES,
    interquartile_mean,
    interval,
    mean_with_interval,
    newcombe,
    resample,
    simultaneous,
    wilson,
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
    columns = mean_with_interval("score", samples[:, None])
    assert {name: value.tolist() for name, value in columns.items()} == {
        "score": [7.0],
        "score_low": [25.0],
        "score_high": [975.0],
    }


def test_interquartile_mean_leaves_out_a_quarter_at_each_end() -> None:
    scores = np.array([[0, 1], [-9, 1], [0.2, 1], [0.4, 1]])
    columns = interquartile_mean("iqm", scores)
    assert columns["iqm"] == pytest.approx([0.1, 1])
    assert columns["iqm_low"][1] == columns["iqm_high"][1] == 1
    assert columns["iqm_low"][0] < 0.1 < columns["iqm_high"][0]


@pytest.mark.parametrize("count", [0, 1, 30, 59, 60])
def test_score_interval_agrees_with_scipy(count: int) -> None:
    expected = stats.binomtest(count, 60).proportion_ci(0.9, method="wilson")
    assert wilson(count / 60, 60, 0.9) == pytest.approx((expected.low, expected.high), abs=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        ((56, 70), (48, 80), (0.0524, 0.3339)),
        ((9, 10), (3, 10), (0.1705, 0.8090)),
        ((6, 7), (2, 7), (0.0582, 0.8062)),
        ((5, 56), (0, 29), (-0.0381, 0.1926)),
        ((0, 10), (0, 20), (-0.1611, 0.2775)),
        ((0, 10), (0, 10), (-0.2775, 0.2775)),
        ((10, 10), (0, 20), (0.6791, 1.0)),
        ((10, 10), (0, 10), (0.6075, 1.0)),
    ],
)
def test_interval_of_a_difference_is_newcombes(
    x: tuple[int, int], y: tuple[int, int], expected: tuple[float, float]
) -> None:
    """Newcombe (1998), table II, method 10."""
    means = (x[0] / x[1], x[1]), (y[0] / y[1], y[1])
    assert newcombe(*means[0], *means[1], 0.95) == pytest.approx(expected, abs=5e-5)
    low, high = newcombe(*means[1], *means[0], 0.95)
    assert (-high, -low) == pytest.approx(expected, abs=5e-5)


def test_interval_of_a_difference_has_a_width_even_where_all_agree() -> None:
    z = stats.norm.ppf(0.95)
    reach = z**2 / (100 + z**2)  # of Wilson's interval of 0 of 100
    assert newcombe(1.0, 100, 1.0, 100, 0.9) == pytest.approx((-reach, reach))
    assert newcombe(0.0, 100, 1.0, 100, 0.9) == pytest.approx((-1, -1 + np.sqrt(2) * reach))


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
