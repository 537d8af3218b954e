"""Tables of a comparison, by hand and by second methods."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from rliable import metrics
from scipy import stats

from benchmark.analysis.records import anchors
from envs import compile_scenario, load_scenario
from tests.benchmark.studies.made import Cell, analysis_of, table


def test_wrong_pings_are_counted_per_1000_steps_of_training() -> None:
    counts = np.array([[0, 10, 10, 40, 40], [0, 30, 30, 40, 60]])
    analysis = analysis_of([Cell("a", np.zeros(2), wrong_pings=counts), Cell("b", np.zeros(2))])
    frame, rates = table("summary", analysis), np.array([40, 60]) / 400 * 1000
    assert frame["training_wrong_pings"].tolist() == [125, 0]
    reach = stats.t.ppf(0.975, 1) * rates.std(ddof=1) / np.sqrt(2)
    assert frame["training_wrong_pings_high"][0] == pytest.approx(125 + reach)
    assert frame["training_wrong_pings_low"][0] == max(125 - reach, 0)


def test_aggregates_by_a_second_method() -> None:
    rng, sizes = np.random.default_rng(0), {"a": 10, "b": 30, "a_sb3": 10}
    cells = [
        Cell(name, np.zeros(size), scenario, score=rng.normal(0.6 if name == "b" else 0.5, 0.3, size),
             reference_for="a" * (name == "a_sb3"))
        for scenario in ("S1", "S2", "S3")
        for name, size in sizes.items()
    ]  # fmt: skip
    frame = table("aggregate", analysis_of(cells)).set_index("variant").to_dict("index")
    assert list(frame) == ["a", "a_sb3", "b"]  # a reference follows its learner
    for name, row in frame.items():
        unbounded = [np.asarray(cell.score) for cell in cells if cell.name == name]
        clipped = [np.clip(values, 0, 1) for values in unbounded]
        assert row["score"] == pytest.approx(np.mean([values.mean() for values in clipped]))
        # Of numbers in [0, 1] the exact binomial interval is wider than the normal one.
        error = np.sqrt(np.mean([values.var() / len(values) for values in clipped]) / 3)
        low, high = row["score_low"], row["score_high"]
        assert low < row["score"] - 1.96 * error < row["score"] + 1.96 * error < high


def test_usual_measures_by_a_second_method() -> None:
    rng = np.random.default_rng(0)
    drawn = {name: rng.uniform(0.0, high, (2, 3, 12)) for name, high in (("table", 0.8), ("net", 1.0))}
    cells = [
        Cell(name, success[i], scenario, "deep" if name == "net" else "tabular", score=score[i])
        for i, scenario in enumerate(("S1", "S2", "S3"))
        for name, (success, score) in drawn.items()
    ]
    analysis = analysis_of(cells, [("net", "table")], baseline=("table",))
    state: Any = np.random.get_state()  # noqa: NPY002
    whole = table("rliable", analysis)
    after: Any = np.random.get_state()  # noqa: NPY002
    assert state[2] == after[2]
    pd.testing.assert_frame_equal(whole, table("rliable", analysis))
    for _, row in whole.iterrows():
        values = drawn[row["variant"]][["success", "score"].index(row["endpoint"])]
        means = values.mean(axis=1)
        expected = [stats.trim_mean(values.ravel(), 0.25), np.median(means), values.mean(), 1 - values.mean()]
        assert row[["iqm", "median", "mean", "optimality_gap"]].tolist() == pytest.approx(expected)
        error = 1.96 * np.sqrt(values.var(axis=1).mean() / 12 / 3)  # of strata with 12 runs each
        ends = [row["mean"] - error, row["mean"] + error]
        assert [row["mean_low"], row["mean_high"]] == pytest.approx(ends, abs=0.01)
    assert whole["endpoint"].tolist() == ["success"] * 2 + ["score"] * 2
    for i, (_, frame) in enumerate(whole.groupby("endpoint", sort=False)):
        frame, x, y = frame.set_index("variant"), drawn["net"][i].T, drawn["table"][i].T
        assert frame.loc["net", "p_improvement"] == pytest.approx(metrics.probability_of_improvement(x, y))
        assert frame["p_improvement"].isna().to_dict() == {"table": True, "net": False}


def test_giving_up_at_once_has_a_score_of_its_own() -> None:
    """Five wrong PINGs at the start: a return of 4 * -0.4 - 1, on a scale from the random policy to 0."""
    cells = [Cell("a", np.ones(2), scenario) for scenario in ("S1", "S3")]
    random, optimal = anchors(compile_scenario(load_scenario("S1")), 200, "start")
    assert optimal == pytest.approx(0.0)
    level = table("rliable", analysis_of(cells)).set_index("endpoint")["giving_up"]
    assert level["score"] == pytest.approx((-2.6 - random) / (0.0 - random), abs=1e-6)
    assert level["score"] == pytest.approx(0.43, abs=0.005)
    assert np.isnan(level["success"])


def test_difference_in_success_by_hand() -> None:
    cells = [Cell(name, np.arange(20) < count) for name, count in (("x", 20), ("y", 10))]
    (row,) = table("contrasts", analysis_of(cells, [("x", "y")])).to_dict("records")
    assert (row["n"], row["success_difference"]) == (20, 0.5)
    low, high = (stats.binomtest(k, 20).proportion_ci() for k in (10, 20))
    assert row["success_difference_low"] == pytest.approx(0.5 - np.hypot(1 - high.low, low.high - 0.5))
