"""Bootstrap intervals, by hand and against SciPy."""

import numpy as np
import pytest
from scipy import stats

from benchmark.analysis.intervals import (
    RESAMPLES,
    interquartile_mean,
    interval,
    mean_with_interval,
    resample,
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
