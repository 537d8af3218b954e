"""The replication by itself: its tables and claims by hand, and what it says of them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from benchmark.analysis import intervals
from benchmark.analysis.population import Population, optimal_values
from benchmark.drawing.tables import LINK
from benchmark.experiments import load_experiment
from benchmark.reports import load_report
from benchmark.reports.published import Published
from benchmark.reports.replication import claims, findings
from benchmark.reports.replication import tables as replication_tables
from envs import InputError
from envs.model import PING
from tests.benchmark.populations import population

ROOT = Path(__file__).parents[3]


# Tables


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
    q = optimal_values(learned)
    best = np.array([1 << int(row.argmax()) for row in q], dtype=np.uint8)
    perfect = population(greedy=np.tile(best, (4, 4, 1)), q=np.tile(q, (4, 1, 1)))
    assert not replication_tables.differing(perfect).any()
    assert abs(replication_tables.optimal_cells([perfect])["difference"]).max() == 0
    # In the start cell, where DOWN and RIGHT are best, one agent goes UP and another draws from all actions.
    mixed = np.tile(best, (4, 4, 1))
    mixed[0, -1, 0] = 0b00001
    mixed[1, -1, 0] = 0b11111
    assert replication_tables.differing(population(greedy=mixed))[0] == pytest.approx((1 + 3 / 5) / 4)


# Claims


def judged(side: str, threshold: float, *samples: list[float]) -> dict[str, Any]:
    """Judges made-up parts: of each, the value and 1,000 resampled values spread between two ends."""
    parts = [
        claims.Part(str(i), np.concatenate([[value], np.linspace(low, high, intervals.RESAMPLES)]))
        for i, (value, low, high) in enumerate(samples)
    ]
    claim = claims.Claim("c", "", "", side, threshold, "", lambda *_: parts)
    return claims.judge_claim(claim, {"S1": population()}, "visited")


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
    row = judged(side, threshold, *samples)
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

    def pings(marked: list[list[int]]) -> dict[str, NDArray[Any]]:
        q = np.full((4, 120, 5), -0.1)
        for agent, cells in enumerate(marked):
            q[agent, cells, PING] = 1.0
        return {"q": q}

    each_a_quarter = [target[i::4].tolist() for i in range(4)]
    too_many = [[*target.tolist(), 0]] * 4
    three = trio(S1=pings(too_many), S2=pings(each_a_quarter), S3=pings([target.tolist()] * 4))
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


# Sentences


def folder(tmp_path: Path, verdicts: dict[str, tuple[str, str]]) -> Published:
    """Returns a folder with these claims: of each, its verdict and its parts."""
    rows = [
        {"claim": name, "value": 1.0, "low": 0.5, "high": 1.5, "verdict": verdict, "parts": parts}
        for name, (verdict, parts) in verdicts.items()
    ]
    frame = pd.DataFrame(rows)
    frame.to_csv(tmp_path / "claims.csv", index=False)
    default = frame.assign(reading="default")
    control = default.assign(reading="control", verdict="does not hold").iloc[:1]
    pd.concat([default, control]).to_csv(tmp_path / "sensitivity.csv", index=False)
    return Published(tmp_path)


def test_parts_that_fail_are_counted_where_no_claim_fails(tmp_path: Path) -> None:
    published = folder(
        tmp_path,
        {
            "a": ("holds", "S1: 3 [3, 5] outside; 16 of 16 target cells, passes"),
            "b": (
                "holds in part",
                "S1: 1 [1, 1], passes; S3: 0.8 [0.7, 0.9], fails; S2: nan [nan, nan], fails: no number",
            ),
            "c": ("holds in part", "S1: 1 [0, 2], undecided"),
        },
    )
    text = findings.headline(published)
    assert text == (
        "Of the 3 claims of the paper, [1](claims.csv#row=2) holds, [2](claims.csv#row=3-4) hold in part and "
        "none fails as a whole. Of those that hold in part, [2 of the 3 parts](claims.csv#row=3) of `b` "
        "fail. Of those that hold, [1](sensitivity.csv#row=5) (`a`) fails under `control`."
    )


def test_without_claims_there_is_no_headline(tmp_path: Path) -> None:
    assert findings.headline(Published(tmp_path)) == ""


def test_published_sentences_put_chance_into_perspective() -> None:
    published = Published(ROOT / "results" / "reproduce")
    first, variability, success = findings.sentences(published)
    assert "[100](optimal.csv" in first
    assert "16 of 30 sets of 100 agents" in variability
    (link,) = LINK.findall(success)
    row = published.frame("learning").iloc[int(link[2]) - 2]
    assert (row["scenario"], row["step"]) == ("S2", 10_000)
    assert link[0] == f"{row['success']:.2f}"
    assert "2,000 agents" in success
    assert "0.515" in success
    # The estimate and the published draw agree: its interval holds the estimate.
    assert row["success_low"] < 0.515 < row["success_high"]


def test_notes_are_no_part_of_the_table() -> None:
    published = Published(ROOT / "results" / "reproduce").frame("claims")
    (claim,) = (claim for claim in claims.CLAIMS if claim.note)
    assert not published.apply(lambda column: column.astype(str).str.contains("16 of 30")).any(axis=None)
    table = findings.claims_table(Published(ROOT / "results" / "reproduce"))
    cell = next(row[0] for row in table.rows if row[0].order == claim.id)
    assert "16 of 30" in cell.note


def test_readings_that_change_nothing_are_named(tmp_path: Path) -> None:
    readings = {name: {"question": "Q?", "answer": "a"} for name in ("default", "same", "other")}
    manifest = {"readings": readings, "facts": {"learned_as_default": ["same"]}}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    texts = dict(findings.readings(Published(tmp_path)))
    assert texts["same"] == "Q? A. (Every agent learns the same values as by default.)"
    assert texts["default"] == texts["other"] == "Q? A."


# What it demands


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"algorithm": "dqn", "observations": ("one_hot",), "settings": {}}, "takes exactly one"),
        ({}, ""),
    ],
)
def test_replication_takes_a_table_that_records_max_q(changes: dict[str, Any], expected: str) -> None:
    experiment = load_experiment("reproduce_smoke")
    arm = experiment.algorithms["q_learning"].model_copy(update=changes)
    experiment = experiment.model_copy(update={"algorithms": {"mine": arm}})
    check = load_report("replication").check
    if not expected:
        check(experiment)
        return
    with pytest.raises(InputError, match=expected):
        check(experiment)
