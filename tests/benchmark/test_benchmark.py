"""Aggregation, claims and tables, each by itself."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats

from benchmark.analysis import intervals
from benchmark.analysis import population as aggregate
from benchmark.analysis.population import Population
from benchmark.drawing import tables
from benchmark.execution.driver import pending, run
from benchmark.execution.store import Store
from benchmark.experiments import (
    load_experiment,
    specifications,
)
from benchmark.reports.replication import claims
from benchmark.reports.replication import tables as replication_tables
from envs import InputError
from envs.model import PING

SMOKE = load_experiment("reproduce_smoke")


def test_one_run_has_no_interval(tmp_path: Path) -> None:
    runs = specifications(SMOKE, "default", "S1", "q_learning", "index", [0])
    with Store(tmp_path / "runs.db") as store:
        run(runs, store, jobs=1)
        with pytest.raises(InputError, match="1 run a scenario: accepted: at least 2"):
            aggregate.load_population(runs, store)


def test_incomplete_populations_are_refused(tmp_path: Path) -> None:
    runs = specifications(SMOKE, "default", "S2", "q_learning", "index")
    with Store(tmp_path / "runs.db") as store:
        run(runs[:2] + runs[3:], store, jobs=2)
        with pytest.raises(InputError, match=r"1 of 6 runs .* \(the first is seed 2\)"):
            aggregate.load_population(runs, store)
        assert pending(runs, store) == [runs[2]]


# Aggregation


def population(name: str = "S1", n: int = 4, **arrays: NDArray[Any]) -> Population:
    """A population with given arrays and otherwise nothing learned."""
    specification = specifications(SMOKE, "default", name, "q_learning", "index")[0]
    blank: dict[str, NDArray[Any]] = {
        "q": np.zeros((n, 120, 5)),
        "stochastic": np.zeros((n, 0, 120, 5)),
        "greedy": np.full((n, 4, 120), 31, dtype=np.uint8),
        "max_q": np.zeros((n, 60)),
        "table_max_q": np.zeros((n, 60)),
        "grid_return": np.zeros((n, 4)),
        "success": np.zeros((n, 4)),
        "scenario_return": np.zeros((n, 4)),
    }
    return Population(json.loads(specification.content), blank | arrays, range(n), [{}] * n)


def test_scores_lie_between_the_exact_anchors() -> None:
    random, optimal = population().anchors["grid_return"]
    assert optimal == pytest.approx(0.0, abs=1e-12)
    returns = np.array([[optimal, random, (optimal + random) / 2, random - (optimal - random)]])
    assert population(n=1, grid_return=returns).scores[0] == pytest.approx([1, 0, 0.5, -1])


def test_learning_table_by_hand() -> None:
    random, optimal = population().anchors["grid_return"]
    scores = np.array([[0, -9, 0, 1.0], [0, 0.2, 0, 1], [0, 0.4, 0, 1], [0, 0.9, 1, 1]])
    frame = replication_tables.learning([population(grid_return=random + scores * (optimal - random))])
    assert frame["step"].tolist() == [0, 200, 400, 600]
    assert frame["score"].to_numpy() == pytest.approx([0, -1.875, 0.25, 1])
    assert frame["score_iqm"].to_numpy() == pytest.approx([0, 0.3, 0, 1])  # the middle two of four
    assert frame["optimal_share"].tolist() == [0, 0, 0.25, 1]
    assert (frame["score_low"] <= frame["score"] + 1e-12).all()
    assert (frame["score_high"] >= frame["score"] - 1e-12).all()
    assert frame["score_high"].iloc[3] == pytest.approx(1)


def test_bootstrap_interval_agrees_with_scipy() -> None:
    values = np.random.default_rng(0).normal(size=60)
    low, high = intervals.interval(intervals.resample(60, "S1") @ values / 60)
    other = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=1)
    width = other.confidence_interval.high - other.confidence_interval.low
    assert low == pytest.approx(other.confidence_interval.low, abs=0.08 * width)
    assert high == pytest.approx(other.confidence_interval.high, abs=0.08 * width)


def test_value_tables_by_hand() -> None:
    q = np.zeros((4, 120, 5))
    q[:, 13, 4] = [1, 2, 3, 6]  # row 1, column 1, PING
    max_q = np.zeros((4, 60))
    max_q[:, 1] = [0, 0, 4, 4]
    frame = replication_tables.q_values([population(q=q)])
    assert len(frame) == 600
    (row,) = frame[frame["mean"] != 0].to_dict("records")
    assert (row["scenario"], row["row"], row["column"], row["action"]) == ("S1", 1, 1, "PING")
    assert (row["mean"], row["min"], row["max"]) == (3, 1, 6)
    assert row["std"] == pytest.approx(np.sqrt(14 / 3))
    curve = replication_tables.max_q([population(max_q=max_q, table_max_q=max_q + 1)])
    assert curve["step"].tolist() == list(range(0, 600, 10))
    assert curve.iloc[1][["mean", "min", "max", "table_mean", "table_min"]].tolist() == [2, 0, 4, 3, 1]


def test_optimal_tables_compare_with_the_exact_optimum() -> None:
    learned = population(grid_return=np.full((4, 4), -0.5), scenario_return=np.full((4, 4), -0.5))
    (row,) = replication_tables.optimal([learned]).to_dict("records")
    assert row["grid_return_regret"] == pytest.approx(0.5)
    assert row["optimal_share"] == 0
    assert row["start_value_optimal"] == pytest.approx(2 * 0.9**10 - 1)
    q = aggregate.optimal_values(learned)
    best = np.array([1 << int(row.argmax()) for row in q], dtype=np.uint8)
    perfect = population(greedy=np.tile(best, (4, 4, 1)), q=np.tile(q, (4, 1, 1)))
    assert not replication_tables.differing(perfect).any()
    assert abs(replication_tables.optimal_cells([perfect])["difference"]).max() == 0
    # Somebody who always goes UP, and somebody who draws from all five actions, in the start cell,
    # where DOWN and RIGHT are best:
    mixed = np.tile(best, (4, 4, 1))
    mixed[0, -1, 0] = 0b00001
    mixed[1, -1, 0] = 0b11111
    assert replication_tables.differing(population(greedy=mixed))[0] == pytest.approx((1 + 3 / 5) / 4)


# Claims


def one_claim(side: str, threshold: float, *samples: list[float]) -> dict[str, Any]:
    """Judges made-up parts: of each, the value and 1,000 resampled values spread between two ends."""
    parts = [
        claims.Part(str(i), np.concatenate([[value], np.linspace(low, high, intervals.RESAMPLES)]))
        for i, (value, low, high) in enumerate(samples)
    ]
    claim = claims.Claim("c", "", "", side, threshold, "", lambda *_: parts)
    return claims._judge(claim, {"S1": population()}, "visited")


@pytest.mark.parametrize(
    ("side", "threshold", "samples", "verdict", "value"),
    [
        (">", 1.0, [[2.0, 1.5, 2.5]], "holds", 2.0),
        (">", 1.0, [[2.0, 0.5, 3.5]], "holds in part", 2.0),  # right, but not all its interval
        (">", 1.0, [[0.9, 0.5, 3.5]], "holds in part", 0.9),  # wrong, but the interval is not
        (">", 1.0, [[0.9, 0.5, 0.99]], "does not hold", 0.9),
        (">", 1.0, [[2.0, 0.5, 3.5], [0.9, 0.5, 0.99]], "does not hold", 0.9),
        (">", 1.0, [[2.0, 1.5, 2.5], [0.5, 0.4, 0.6]], "holds in part", 0.5),
        (">", 1.0, [[0.2, 0.1, 0.3], [0.5, 0.4, 0.6]], "does not hold", 0.2),
        ("<", 1.0, [[0.2, 0.1, 0.3], [0.5, 0.4, 0.6]], "holds", 0.5),
        ("<", 1.0, [[0.0, 0.0, 0.0]], "holds", 0.0),
        ("<", 1.0, [[1.5, 1.0, 2.0]], "does not hold", 1.5),
        (">", 0.0, [[0.0, 0.0, 0.0]], "does not hold", 0.0),
        ("<", 1.0, [[np.nan, np.nan, np.nan]], "does not hold", np.nan),
    ],
)
def test_verdicts(
    side: str, threshold: float, samples: list[list[float]], verdict: str, value: float
) -> None:
    row = one_claim(side, threshold, *samples)
    assert row["verdict"] == verdict
    assert row["value"] == pytest.approx(value, nan_ok=True)


def measured(id: str, populations: dict[str, Population], curve: str = "visited") -> dict[str, float]:  # noqa: A002
    (claim,) = [claim for claim in claims.CLAIMS if claim.id == id]
    parts = claim.parts(populations, curve)
    return {part.name: part.samples[0] for part in parts}


def trio(**by_scenario: dict[str, NDArray[Any]]) -> dict[str, Population]:
    return {name: population(name, 4, **by_scenario.get(name, {})) for name in ("S1", "S2", "S3")}


def test_variability_by_hand() -> None:
    def curves(spread: float) -> dict[str, NDArray[Any]]:
        return {"max_q": np.outer([-1, -1, 1, 1], np.full(60, spread)), "table_max_q": np.zeros((4, 60))}

    three = trio(S1=curves(1.0), S2=curves(3.0), S3=curves(0.5))
    assert measured("variability-S2", three) == pytest.approx({"S2/S1": 3, "S2/S3": 6})
    assert measured("variability-S3", three) == pytest.approx({"S3/S1": 0.5, "S3/S2": 1 / 6})
    assert all(np.isnan(list(measured("variability-S2", three, "table").values())))


def test_nearness_to_one_by_hand() -> None:
    high = np.zeros((4, 60))
    high[:2, :2] = 0.9  # two of sixty steps are more than one in a hundred
    three = trio(S1={"max_q": high})
    assert measured("max-near-1", three) == pytest.approx({"S1": 0.45, "S3": 0.0})


def test_focus_by_hand() -> None:
    def moves(*cells: tuple[int, int]) -> dict[str, NDArray[Any]]:
        q = np.full((4, 120, 5), -1.0)
        q[:, :, PING] = 9.0  # PING does not count
        for row, column in cells:
            q[:, row * 12 + column, 1] = 0.5
        return {"q": q}

    # From the target region (rows 4 to 8, columns 6 to 10, less its inside) these lie 4, 2, 0 and 1 off.
    three = trio(S1=moves((0, 8)), S2=moves((2, 8), (6, 4)), S3=moves((4, 6), (6, 8), (6, 7)))
    assert measured("moves-focused", three) == pytest.approx({"S3/S1": 1 / 4, "S3/S2": 1 / 2})


def test_ping_maps_by_hand() -> None:
    target = np.flatnonzero(population().model.zone_of_cell == 1)

    def pings(own: list[list[int]]) -> dict[str, NDArray[Any]]:
        q = np.full((4, 120, 5), -0.1)
        for agent, cells in enumerate(own):
            q[agent, cells, PING] = 1.0
        return {"q": q}

    each_a_quarter = [target[i::4].tolist() for i in range(4)]
    one_too_many = [[*target.tolist(), 0]] * 4
    three = trio(S1=pings(one_too_many), S2=pings(each_a_quarter), S3=pings([target.tolist()] * 4))
    assert measured("ping-S1", three) == {"S1": 1}
    assert measured("ping-S3", three) == {"S3": 0}
    assert measured("identifies", three) == pytest.approx(
        {
            "mean map S1": 16 / 17,
            "mean map S2": 1.0,
            "mean map S3": 1.0,
            "own maps S1": 16 / 17,
            "own maps S2": 0.25,
            "own maps S3": 1.0,
        }
    )
    assert measured("random-helps", three) == pytest.approx({"mean map": 1 / 17, "own maps": 1 / 4 - 16 / 17})


def test_reaching_by_hand() -> None:
    success = np.zeros((4, 4))
    success[:, -1] = [1, 1, 0.9, 0.4]
    assert measured("reaches", trio(S1={"success": success})) == {"S1": 0.75}
    (claim,) = [claim for claim in claims.CLAIMS if claim.id == "reaches"]
    (part,) = claim.parts({"S1": population("S1", 100, success=np.ones((100, 4)))}, "visited")
    # Exact binomial (Clopper and Pearson 1934): with all of n agreeing the lower end is 0.025**(1/n).
    assert part.interval == pytest.approx((0.025 ** (1 / 100), 1.0))


def test_every_claim_of_the_paper_is_judged() -> None:
    frame = claims.judge(trio(), "visited")
    assert frame["claim"].tolist() == [
        "variability-S2",
        "max-near-1",
        "variability-S3",
        "moves-focused",
        "ping-S3",
        "ping-S1",
        "reaches",
        "random-helps",
        "identifies",
    ]
    assert set(frame["verdict"]) <= set(claims.VERDICTS)
    assert (frame[["says", "measure", "because"]] != "").all(axis=None)


# Tables


def test_tables_come_in_three_forms(tmp_path: Path) -> None:
    frame = pd.DataFrame({"name": ["a_b", "c"], "value": [1 / 3, -1e-17], "n": [2, 3]})
    tables.write_table(frame, tmp_path / "t")
    assert (tmp_path / "t.csv").read_text() == "name,value,n\na_b,0.333333,2\nc,0,3\n"
    assert (tmp_path / "t.md").read_text().splitlines()[2] == "| a_b    |   0.333 |   2 |"
    tex = (tmp_path / "t.tex").read_text()
    assert r"a\_b" in tex
    assert r"\toprule" in tex
