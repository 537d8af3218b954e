"""The replication by itself: its tables and claims by hand, and what it demands."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats

from benchmark.analysis.records import Records, anchors, optimal_values
from benchmark.execution.store import Store
from benchmark.experiments import Population, load_experiment
from benchmark.folder import Folder
from benchmark.studies import report_of
from benchmark.studies.data import Data
from benchmark.studies.replication import STUDY, claims
from benchmark.studies.replication.analysis import ReplicationAnalysis, analyse
from benchmark.studies.study import Declared
from envs import InputError
from envs.model import PING
from tests.benchmark.populations import population
from tests.support import ROOT

SCENARIOS = ("S1", "S2", "S3")
PUBLISHED = Folder(ROOT / "results" / "reproduce")


def analysed(few: int | None = None, n: int = 4, **arrays: Any) -> ReplicationAnalysis:
    """Returns the analysis of n agents that have these arrays, the first `few` as many as the paper has."""

    class Made(Data[Declared]):
        def records(self, of: Population) -> Records:
            return population(of.scenario.name, n, **arrays)

    experiment = load_experiment("reproduce", smoke=True)
    ((name, learner),) = experiment.learners.items()
    variant = learner.declared.model_copy(update={"seeds": few or n})
    readings = {"default": experiment.declared.readings["default"]}
    declared = experiment.declared.model_copy(update={"readings": readings})
    experiment = replace(experiment, declared=declared, learners={name: replace(learner, declared=variant)})
    return analyse(Made(experiment, Declared(kind="replication"), cast(Store, None), (), ()))


def table(name: str, analysis: ReplicationAnalysis) -> pd.DataFrame:
    """Returns a table by its name."""
    (item,) = [item for item in STUDY.items if item.name == name]
    frame = item.tabulate(analysis)
    assert frame is not None
    return frame


# Tables


def test_learning_table_by_hand() -> None:
    random, optimal = anchors(population().model, population().run.horizon, "start")
    scores = np.array([[0, -9, 0, 1.0], [0, 0.2, 0, 1], [0, 0.4, 0, 1], [0, 0.9, 1, 1]])
    frame = table("learning", analysed(grid_return=random + scores * (optimal - random)))[:4]
    assert frame["step"].tolist() == [0, 200, 400, 600]
    assert frame["score"].to_numpy() == pytest.approx([0, 1.5 / 4, 0.25, 1])  # -9 counts as 0
    assert frame["unbounded_score"].to_numpy() == pytest.approx([0, -1.875, 0.25, 1])
    assert frame["optimal_share"].tolist() == [0, 0, 0.25, 1]
    # The exact interval of 4 of 4 reaches down to the fourth root of 0.025 (Clopper and Pearson 1934).
    assert frame[["score_low", "score_high"]].iloc[3].tolist() == pytest.approx([0.025 ** (1 / 4), 1])
    assert "unbounded_score_low" not in frame  # no method bounds such a mean


def test_optimality_after_training() -> None:
    worse, success = np.full((4, 4), -0.5), np.zeros((4, 4))
    success[:, -1] = [1, 0.5, 0.5, 0]
    frame = table("optimal", analysed(2, grid_return=worse, scenario_return=worse, success=success))
    frame = frame[frame["scenario"] == "S1"]
    keys = ["agents", "first_seed", "last_seed", "success", "optimal_share"]
    assert frame[keys].to_numpy().tolist() == [[2, 0, 1, 0.75, 0], [4, 0, 3, 0.5, 0]]
    assert frame["grid_return_regret"].tolist() == pytest.approx([0.5] * 2)
    assert frame["start_value_optimal"].tolist() == pytest.approx([2 * 0.9**10 - 1] * 2)


def test_values_of_cells_and_where_policies_differ() -> None:
    best = optimal_values(population())
    greedy = np.tile(np.array([1 << int(row.argmax()) for row in best], dtype=np.uint8), (4, 4, 1))
    # In the start cell, where DOWN and RIGHT are best, one agent goes UP and another draws from all actions.
    greedy[:2, -1, 0] = 0b00001, 0b11111
    q = np.tile(best, (4, 1, 1))
    q[:, 13, 4] = [1, 2, 3, 6]  # row 1, column 1, PING
    frame = analysed(q=q, greedy=greedy).q_values[:600]
    (row,) = frame[frame["difference"] != 0].to_dict("records")
    assert (row["scenario"], row["row"], row["column"], row["action"]) == ("S1", 1, 1, "PING")
    assert (row["mean"], row["min"], row["max"], row["largest_learned"]) == (3, 1, 6, 3)
    assert row["std"] == pytest.approx(np.sqrt(14 / 3))
    assert frame["differs"].tolist() == pytest.approx([(1 + 3 / 5) / 4] * 5 + [0.0] * 595)


# Verdicts


def judged(side: str, threshold: float, parts: list[list[float]]) -> pd.DataFrame:
    """Judges made-up parts: of each, the value and the ends of its interval."""
    made = [claims.Part("", value, low, high) for value, low, high in parts]
    claim = claims.Claim("c", "", side, threshold, ("S1",), lambda *_: made)
    return claims.judge({"S1": population()}, "", [claim])


@pytest.mark.parametrize(
    ("side", "parts", "verdict"),
    [
        (">", [[2.0, 1.5, 2.5]], "holds"),
        (">", [[2.0, 0.5, 3.5]], "undecided"),  # right, but not all its interval
        (">", [[2.0, 1.5, 2.5], [0.5, 0.4, 0.6]], "does not hold"),  # one part fails
        (">", [[0.8, 0.7, 0.9], [0.5, 0.1, 1.1]], "does not hold"),  # a failure before a doubt
        ("<", [[1.5, 1.0, 2.0]], "does not hold"),
        ("<", [[np.nan] * 3], "undecided"),  # no number refutes nothing
        ("<", [[np.nan] * 3, [1.5, 1.2, 2.0]], "does not hold"),
    ],
)
def test_verdicts(side: str, parts: list[list[float]], verdict: str) -> None:
    assert set(judged(side, 1.0, parts)["verdict"]) == {verdict}


# Claims


def parts_of(claim_id: str, groups: dict[str, Records], curve: str = "max_q") -> list[claims.Part]:
    (claim,) = [claim for claim in claims.CLAIMS if claim.id == claim_id]
    return claim.measure([groups[name] for name in claim.scenarios], curve)


def trio(**by_scenario: dict[str, Any]) -> dict[str, Records]:
    return {name: population(name, 4, **by_scenario.get(name, {})) for name in SCENARIOS}


def test_variability_by_hand() -> None:
    def curves(spread: float, extreme: float) -> dict[str, NDArray[Any]]:
        agents = [-spread, -spread, spread, extreme]
        return {"max_q": np.outer(agents, np.ones(60)), "table_max_q": np.zeros((4, 60))}

    three = trio(S1=curves(1.0, 1.0), S2=curves(3.0, 3.0), S3=curves(0.5, 0.5))
    assert [part[:2] for part in parts_of("variability-S2", three)] == [("S2/S1", 3), ("S2/S3", 6)]
    assert np.isnan([part.value for part in parts_of("variability-S2", three, "table_max_q")]).all()
    # The figure shades the area between the extreme agents, which in S1 are -1 and 8.
    drawn = parts_of("variability-S2", three | {"S1": trio(S1=curves(1.0, 8.0))["S1"]})
    assert drawn[0].drawn == pytest.approx(6 / 9)


def test_nearness_to_one_by_hand() -> None:
    high = np.zeros((4, 60))
    high[:2, :2] = 0.9  # two of sixty steps are more than one in a hundred
    high[2, 3:5] = 1.0
    parts = parts_of("max-near-1", trio(S1={"max_q": high}))
    assert [part.value for part in parts] == pytest.approx([2.8 / 4, 0])
    assert [part.drawn for part in parts] == pytest.approx([1.8 / 4, 0])  # the peak of the averaged curve


def test_focus_by_hand() -> None:
    def moves(*cells: tuple[int, int]) -> dict[str, NDArray[Any]]:
        q = np.full((4, 120, 5), -1.0)
        q[:, :, PING] = 9.0  # PING does not count
        for row, column in cells:
            q[:, row * 12 + column, 1] = 0.5
        return {"q": q}

    # From the target region (rows 4 to 8, columns 6 to 10, less its inside) these lie 4, 2, 0 and 1 off.
    three = trio(S1=moves((0, 8)), S2=moves((2, 8), (6, 4)), S3=moves((4, 6), (6, 8), (6, 7)))
    assert [part.value for part in parts_of("moves-focused", three)] == pytest.approx([1 / 4, 1 / 2])


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
    three = trio(S1={"q": q}, S3={"q": q})
    assert [part[1:4] for part in parts_of("ping-S1", three)] == [(2, 2, 5)]
    assert [part[1:4] for part in parts_of("ping-S3-inside", three)] == [(0, 0, 4)]
    mean_map = parts_of("identifies-S1", three)[0]
    assert mean_map[1:4] == pytest.approx((16 / 18, 12 / (16 + 5), 16 / (16 + 2)))
    # In S2 nothing was learned: its overlap is 0 for sure. At 97.5 % the same cells of S1 are open.
    assert parts_of("random-helps", three)[0][1:4] == pytest.approx((-16 / 18, -16 / 18, -12 / 21))


def test_own_maps_have_students_and_welchs_intervals() -> None:
    """Overlaps of agents that mark 4, 8, 12 or 16 of 16 cells, and no other, against SciPy's tests."""
    target = np.flatnonzero(population().in_target)

    def pings(name: str, counts: list[int]) -> Records:
        q = np.full((len(counts), 120, 5), -0.1)
        for agent, n in enumerate(counts):
            q[agent, target[:n], PING] = 1.0
        return population(name, len(counts), q=q)

    few, many = [4, 8, 8, 12] * 5, [8, 12, 16, 16, 4] * 6
    three = {"S1": pings("S1", few), "S2": pings("S2", many), "S3": pings("S3", few)}
    x, y = np.array(many) / 16, np.array(few) / 16
    expected = stats.ttest_ind(x, y, equal_var=False).confidence_interval()
    assert parts_of("random-helps", three)[1][1:4] == pytest.approx((x.mean() - y.mean(), *expected))
    own = parts_of("identifies", three)[2]
    expected = stats.ttest_1samp(x, 0).confidence_interval()
    assert own[:4] == ("own maps S2", *map(pytest.approx, (x.mean(), *expected)))


# What is shown


def test_verdicts_on_disjoint_sets() -> None:
    success = np.zeros((5, 4))
    success[:, -1] = [1, 1, 0.9, 0.4, 0]
    analysis = analysed(few=2, n=5, success=success)
    sets = table("claim_sets", analysis)
    reached = sets[sets["claim"] == "reaches"]
    assert reached[["first_seed", "last_seed", "value"]].to_numpy().tolist() == [[0, 1, 1], [2, 3, 0.5]]
    frame = table("claims", analysis)
    assert frame["claim"].unique().tolist() == [claim.id for claim in claims.CLAIMS]
    assert frame[frame["claim"] == "reaches"]["agents"].tolist() == [2, 5]
    # Nothing was learned of PING, so there is nothing to count outside.
    assert set(frame["state"][frame["claim"].isin(["ping-S3", "ping-S1"])]) == {"undecided"}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ('"algorithms.q_learning.observations" = ["index", "offset"]', "algorithms"),
        ('scenarios = ["S1", "S2", "Egg"]', "scenarios"),
        ('"readings.origin.scenario" = { observe = ["agent", "issuer"] }', r"scenarios: S1 \(origin\)"),
    ],
)
def test_a_replication_takes_one_table_in_scenarios_like_the_papers(
    changes: str, expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "reproduce"\ndescription = ""\n[changes]\n{changes}\n')
    with pytest.raises(InputError, match=f"mine.toml: {expected}"):
        report_of(load_experiment(path)).check()
