"""The replication by itself: its tables and claims by hand, and what it says of them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats

from benchmark.analysis.population import Population, optimal_values
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
    assert frame["score"].to_numpy() == pytest.approx([0, 1.5 / 4, 0.25, 1])  # -9 counts as 0
    assert frame["unbounded_score"].to_numpy() == pytest.approx([0, -1.875, 0.25, 1])
    assert frame["optimal_share"].tolist() == [0, 0, 0.25, 1]
    # The exact interval of 4 of 4 reaches down to the fourth root of 0.025 (Clopper and Pearson 1934).
    least = 0.025 ** (1 / 4)
    assert frame["score_low"].iloc[3] == pytest.approx(least)
    assert frame["score_high"].iloc[3] == pytest.approx(1)
    assert frame["success_high"].tolist() == pytest.approx([1 - least] * 4)
    assert list(frame)[-1] == "unbounded_score"
    assert not {"unbounded_score_low", "score_iqm"} & set(frame)


def test_success_table_by_hand() -> None:
    success = np.zeros((4, 4))
    success[:, -1] = [1, 1, 0.5, 0]
    frame = replication_tables.success([population("S2", success=success).subset(0, 3)])
    (row,) = frame.to_dict("records")
    assert [row[key] for key in ("scenario", "agents", "first_seed", "last_seed")] == ["S2", 3, 0, 2]
    assert row["success"] == pytest.approx(2.5 / 3)


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


def judged(side: str, threshold: float, *parts: list[float]) -> list[dict[str, Any]]:
    """Judges made-up parts: of each, the value, the ends of its interval and perhaps its standard error."""
    made = []
    for i, (value, low, high, *error) in enumerate(parts):
        made.append(claims.Part(str(i), value, low, high, error[0] if error else np.nan))
    claim = claims.Claim("c", "", "", side, threshold, "", lambda *_: made)
    return claims.judge_claim(claim, {"S1": population()}, "visited")


@pytest.mark.parametrize(
    ("side", "threshold", "parts", "verdict", "weakest"),
    [
        (">", 1.0, [[2.0, 1.5, 2.5]], "holds", 2.0),
        (">", 1.0, [[2.0, 0.5, 3.5]], "undecided", 2.0),  # right, but not all its interval
        (">", 1.0, [[0.9, 0.5, 3.5]], "undecided", 0.9),  # wrong, but the interval is not
        (">", 1.0, [[0.9, 0.5, 0.99]], "does not hold", 0.9),
        (">", 1.0, [[2.0, 0.5, 3.5], [0.9, 0.5, 0.99]], "does not hold", 0.9),
        (">", 1.0, [[2.0, 1.5, 2.5], [0.5, 0.4, 0.6]], "does not hold", 0.5),  # one part fails
        (">", 1.0, [[2.0, 1.5, 2.5], [1.2, 0.4, 1.6]], "undecided", 1.2),
        (">", 1.0, [[0.8, 0.7, 0.9], [0.5, 0.1, 1.1]], "does not hold", 0.8),  # a failure before a doubt
        (">", 1.0, [[0.2, 0.1, 0.3], [0.5, 0.4, 0.6]], "does not hold", 0.2),
        ("<", 1.0, [[0.2, 0.1, 0.3], [0.5, 0.4, 0.6]], "holds", 0.5),
        ("<", 1.0, [[0.0, 0.0, 0.0]], "holds", 0.0),
        ("<", 1.0, [[1.5, 1.0, 2.0]], "does not hold", 1.5),
        (">", 0.0, [[0.0, 0.0, 0.0]], "does not hold", 0.0),
        ("<", 1.0, [[np.nan, np.nan, np.nan]], "undecided", np.nan),  # no number refutes nothing
        ("<", 1.0, [[np.inf, np.nan, np.nan]], "undecided", np.inf),
        ("<", 1.0, [[0.2, 0.1, 0.3], [np.nan, np.nan, np.nan]], "undecided", np.nan),
        ("<", 1.0, [[np.nan, np.nan, np.nan], [1.5, 1.2, 2.0]], "does not hold", 1.5),
    ],
)
def test_verdicts(
    side: str, threshold: float, parts: list[list[float]], verdict: str, weakest: float
) -> None:
    rows = judged(side, threshold, *parts)
    assert {row["verdict"] for row in rows} == {verdict}
    (shown,) = claims.weakest(pd.DataFrame(rows))["value"]
    assert shown == pytest.approx(weakest, nan_ok=True)


def test_effects_by_hand() -> None:
    # Four agents and a standard error of 0.5: a standard deviation of 1.
    (right,) = judged("<", 2.0, [1.72, 0.0, 3.0, 0.5])
    assert right["effect"] == pytest.approx(0.28)
    assert right["agents_needed"] == 101  # ((1.96 + 0.84) / 0.28)^2 = 100, and 100.11 without rounding
    (wrong,) = judged(">", 2.0, [1.72, 0.0, 1.9, 0.5])
    assert wrong["effect"] == pytest.approx(-0.28)
    assert np.isnan(wrong["agents_needed"])  # it is decided
    for error in (0.0, 1e-12, np.nan):
        (none,) = judged(">", 2.0, [1.72, 0.0, 3.0, error])
        assert np.isnan(none["effect"])
        assert np.isnan(none["agents_needed"])
    (equal,) = judged(">", 2.0, [2.0, 1.0, 3.0, 0.5])
    assert equal["effect"] == 0
    assert np.isnan(equal["agents_needed"])


def test_agreement_of_sets_by_hand() -> None:
    def frame(**verdicts: str) -> pd.DataFrame:
        return pd.DataFrame({"claim": verdicts.keys(), "verdict": verdicts.values()})

    here = frame(a="holds", b="undecided")
    sets = [frame(a="holds", b="holds")] * 3 + [frame(a="holds", b="undecided")]
    found = claims.agreement(pd.concat([here, here.iloc[:1]], ignore_index=True), sets)
    assert found["sets_agreeing"].tolist() == [4, 1, 4]
    assert found["share"].tolist() == [1, 0.25, 1]
    assert found["share_low"].iloc[0] == pytest.approx(0.025 ** (1 / 4))
    assert found["sets"].tolist() == [4, 4, 4]
    assert claims.agreement(here, [])["share"].isna().all()


def parts_of(id: str, populations: dict[str, Population], curve: str = "visited") -> list[claims.Part]:  # noqa: A002
    (claim,) = [claim for claim in claims.CLAIMS if claim.id == id]
    return claim.parts(populations, curve)


def measured(id: str, populations: dict[str, Population], curve: str = "visited") -> dict[str, float]:  # noqa: A002
    return {part.name: part.value for part in parts_of(id, populations, curve)}


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


def test_signs_of_cells_give_intervals_by_hand() -> None:
    one = population()
    target, outside = np.flatnonzero(one.in_target), np.flatnonzero(~one.in_target)
    spread = np.array([-1, 1, -1, 1]) * 0.01 * np.sqrt(3)  # a standard error of 0.01
    t = stats.t.ppf(1 - 0.05 / 240, 3)
    assert 0.1 < t * 0.01 < 0.2  # so a mean of 0.1 or -0.1 is open
    q = np.zeros((4, 120, 5))
    for cells, mean in ((target[:12], 1.0), (target[12:], 0.1), (outside[:2], 1.0), (outside[2:5], -0.1)):
        q[:, cells, PING] = mean + spread[:, None]
    q[:, outside[5:9], PING] = -1.0 + spread[:, None]
    # Inside 12 cells are surely above zero and 4 open, outside 2 surely and 3 open. The others surely are
    # not: 4 have means far below zero, and in the rest nobody ever chose PING.
    three = trio(S1={"q": q}, S2={"q": np.zeros((4, 120, 5))}, S3={"q": q})
    (part,) = parts_of("ping-S1", three)
    assert (part.value, part.low, part.high) == (2, 2, 5)
    mean_map = parts_of("identifies", three)[0]
    assert mean_map.name == "mean map S1"
    assert mean_map.value == pytest.approx(16 / 18)
    assert (mean_map.low, mean_map.high) == pytest.approx((12 / (16 + 5), 16 / (16 + 2)))
    # In S2 nothing was learned: its overlap is 0 for sure. At 97.5 % the same cells of S1 are open.
    difference = parts_of("random-helps", three)[0]
    assert (difference.value, difference.low, difference.high) == pytest.approx(
        (-16 / 18, -16 / 18, -12 / 21)
    )


def test_count_of_cells_is_covered() -> None:
    """In 95 of 100 simulations or more the interval holds the true number of cells above zero."""
    rng = np.random.default_rng(20210803)
    one = population("S1", 100)
    truth = np.where(one.in_target, 0.5, -0.3)
    truth[np.flatnonzero(~one.in_target)[:20]] = np.linspace(-0.05, 0.05, 20)  # 10 of them are above zero
    covered = without_width = 0
    for _ in range(100):
        q = np.zeros((100, 120, 5))
        q[:, :, PING] = truth + rng.normal(scale=0.3, size=(100, 120))
        (part,) = parts_of("ping-S1", {"S1": replace(one, arrays={"q": q})})
        covered += part.low <= 10 <= part.high
        without_width += part.low == part.high
    assert covered >= 95
    assert not without_width


def test_reaching_by_hand() -> None:
    success = np.zeros((4, 4))
    success[:, -1] = [1, 1, 0.9, 0.4]
    assert measured("reaches", trio(S1={"success": success})) == {"S1": 0.75}
    (part,) = parts_of("reaches", {"S1": population("S1", 100, success=np.ones((100, 4)))})
    # Clopper and Pearson (1934): if all of n agree, the lower end is the n-th root of 0.025.
    assert (part.low, part.high) == pytest.approx((0.025 ** (1 / 100), 1.0))
    assert np.isnan(part.effect(">", 0.95, 100))  # all agree


def test_own_maps_have_students_and_welchs_intervals() -> None:
    """Overlaps of agents that mark 4, 8, 12 or 16 of 16 cells, and no other, against SciPy's tests."""
    target = np.flatnonzero(population().in_target)

    def pings(counts: list[int]) -> NDArray[Any]:
        q = np.zeros((len(counts), 120, 5))
        for agent, n in enumerate(counts):
            q[agent, target[:n], PING] = 1.0
        return q

    few, many = [4, 8, 8, 12] * 5, [8, 12, 16, 16, 4] * 6
    three = {"S1": population("S1", 20, q=pings(few)), "S2": population("S2", 30, q=pings(many))}
    part = parts_of("random-helps", three)[1]
    x, y = np.array(many) / 16, np.array(few) / 16
    expected = stats.ttest_ind(x, y, equal_var=False).confidence_interval()
    assert (part.value, part.low, part.high) == pytest.approx((x.mean() - y.mean(), *expected))
    own = parts_of("identifies", three | {"S3": three["S1"]})[4]
    expected = stats.ttest_1samp(x, 0).confidence_interval()
    assert own.name == "own maps S2"
    assert own.value == pytest.approx(x.mean())
    assert (own.low, own.high) == pytest.approx(tuple(expected))
    alike = parts_of("random-helps", {"S1": three["S1"], "S2": population("S2", 4, q=pings([8] * 4))})[1]
    assert alike.low < alike.value < alike.high
    same = population("S1", 4, q=pings([8] * 4))
    assert parts_of("random-helps", {"S1": same, "S2": same})[1].high == 0


def test_resampled_part_has_the_standard_error_of_a_mean() -> None:
    rng = np.random.default_rng(0)
    curves = np.repeat(rng.normal(size=(200, 1)), 60, axis=1)
    part = parts_of("max-near-1", {name: population(name, 200, max_q=curves) for name in ("S1", "S3")})[0]
    assert part.value == pytest.approx(curves[:, 0].mean())
    assert part.standard_error == pytest.approx(curves[:, 0].std() / np.sqrt(200), rel=0.1)
    assert (part.high - part.low) / 2 == pytest.approx(1.96 * part.standard_error, rel=0.1)


def test_every_claim_of_the_paper_is_judged() -> None:
    frame = claims.judge(trio(), "visited")
    assert frame["claim"].unique().tolist() == [
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
    assert len(frame) == 2 + 2 + 2 + 2 + 1 + 1 + 1 + 2 + 6
    assert (frame["agents"] == 4).all()
    # Nothing was learned, so there is nothing to count.
    assert frame.set_index("claim").loc[["ping-S3", "ping-S1"], "state"].tolist() == ["undecided"] * 2
    assert all(claim.says and claim.measure and claim.because for claim in claims.CLAIMS)


# Sentences


def folder(tmp_path: Path, *sizes: int) -> Published:
    """Returns a folder with three made-up claims, judged with these numbers of agents, and four sets."""
    rows = []
    for claim, part, few, many, agreeing in (
        ("a", "S1", "passes", "passes", 4),
        ("b", "S1", "passes", "passes", 3),
        ("b", "S3", "undecided", "fails", 3),
        ("c", "S1", "passes", "passes", 1),
    ):
        for size, state in zip(sizes, (few, many), strict=False):
            rows.append(
                {"claim": claim, "part": part, "agents": size, "value": 1.5, "low": 1.0, "high": 2.0}
                | {
                    "right_side": ">",
                    "threshold": 1.0,
                    "state": state,
                    "effect": 0.1,
                    "agents_needed": np.nan,
                }
                | {"sets": 4, "sets_agreeing": agreeing, "share": agreeing / 4, "share_low": 0.1}
                | {"share_high": 0.9, "note": "", "says": "Says.", "measure": "m", "because": "b"}
            )
    frame = pd.DataFrame(rows)
    states = frame.groupby(["claim", "agents"])["state"]
    frame["verdict"] = states.transform(lambda column: claims.verdict(column.tolist()))
    frame = frame.sort_values(["claim", "agents"], kind="stable", ignore_index=True)
    frame.to_csv(tmp_path / "claims.csv", index=False)
    default = frame[frame["agents"] == sizes[0]].assign(reading="default")
    control = default.assign(reading="control")
    control.loc[control["claim"] == "a", ["state", "verdict"]] = ["fails", "does not hold"]
    control.loc[control["claim"] == "c", ["state", "verdict"]] = ["undecided", "undecided"]
    pd.concat([default, control]).to_csv(tmp_path / "sensitivity.csv", index=False)
    seeds = [{"first_seed": start, "last_seed": start + 9} for start in range(0, 40, 10)]
    pd.DataFrame(seeds).to_csv(tmp_path / "claim_sets.csv", index=False)
    pd.DataFrame({"scenario": ["S1"], "agents": [sizes[0]]}).to_csv(tmp_path / "optimal.csv", index=False)
    pd.DataFrame({"scenario": ["S1"], "agents": [sizes[0]]}).to_csv(tmp_path / "success.csv", index=False)
    return Published(tmp_path)


def test_headline_counts_the_verdicts_by_agents(tmp_path: Path) -> None:
    assert findings.headline(folder(tmp_path, 10, 40)) == (
        "With 40 agents per scenario, of the paper's 3 claims [2](claims.csv#row=3;9) hold and "
        "[1](claims.csv#row=7) does not hold; with 10 agents, as many as the paper has, "
        "[2](claims.csv#row=2;8) hold and [1](claims.csv#row=5) is undecided."
    )
    assert findings.headline(folder(tmp_path, 10)) == (
        "With 10 agents per scenario, of the paper's 3 claims [2](claims.csv#row=2;5) hold and "
        "[1](claims.csv#row=4) is undecided."
    )


def test_sentences_say_what_verdicts_depend_on(tmp_path: Path) -> None:
    assert findings.sentences(folder(tmp_path, 10, 40)) == [
        "Tables and figures show [10](optimal.csv#row=2) agents per scenario, unless they name another "
        "number.",
        "The verdict depends on the number of agents for `b` (undecided with 10, does not hold with 40).",
        "The 40 agents are 4 disjoint sets of 10: seeds 0-9, 10-19, ..., 30-39. 1 of the 3 verdicts with 40 "
        "agents is the same in every set; `b` has the same verdict in [3](claims.csv#row=7) of 4 (a share of "
        "0.75 [0.1, 0.9]) and `c` in [1](claims.csv#row=9) of 4 (a share of 0.25 [0.1, 0.9]).",
        "Of the parts of claims, [1 of 2](claims.csv#row=7) of `b` fails.",
        "Of the 2 claims that hold by default with 10 agents: under `control`, [1](sensitivity.csv#row=9) is "
        "undecided (`c`) and [1](sensitivity.csv#row=6) does not hold (`a`).",
    ]


def test_every_part_is_shown(tmp_path: Path) -> None:
    table = findings.claims_table(folder(tmp_path, 10, 40))
    assert [row[0].text for row in table.rows] == ["`a`", "`b`", "", "`c`"]
    labels = [label for label, _ in table.columns]
    assert all(len(row) == len(labels) for row in table.rows)
    shown = dict(zip(labels, (entry.text for entry in table.rows[1]), strict=True))
    assert shown["verdict, 40"] == "✗ does not hold"
    assert shown["verdict, 10"] == "? undecided"
    assert shown["of 4 sets"] == "3 [10%, 90%]"
    second = dict(zip(labels, table.rows[2], strict=True))
    assert second["part"].text == "S3"
    assert second["value, 40"].text == "1.5 [1, 2] ✗"
    assert second["value, 40"].row == "claims.csv#row=7"
    assert second["value, 10"].row == "claims.csv#row=5"
    readings = findings.sensitivity_table(folder(tmp_path, 10, 40))
    assert [row[1].text for row in readings.rows] == ["✓ holds", "? undecided", "✓ holds"]
    assert readings.rows[0][2].text == "`control`: [does not hold](sensitivity.csv#row=6)"
    assert readings.rows[1][2].text == "no reading changes it"


def test_without_claims_there_is_no_headline(tmp_path: Path) -> None:
    assert findings.headline(Published(tmp_path)) == ""


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
