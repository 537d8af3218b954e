"""The replication: its claims and tables by hand, its text, and what it demands."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats

from benchmark import replication
from benchmark.experiment import load_experiment
from benchmark.experiments import reproduce
from benchmark.folder import Folder
from benchmark.records import Records, anchors
from benchmark.replication import CLAIMS, SCENARIOS, Claim, Part, check, judge
from benchmark.study import Data, Report
from envs import InputError
from envs.model import PING
from tests.benchmark.populations import population
from tests.support import ROOT, made

EXPERIMENT = load_experiment("reproduce", smoke=True)
MADE = Report(kind="replication")


def data_of(monkeypatch: pytest.MonkeyPatch, few: int, n: int = 4, **arrays: Any) -> Data:
    """Returns the data of n agents with these arrays; as many as in the paper are `few`."""
    ((name, learner),) = EXPERIMENT.learners.items()
    fewer = replace(learner, declared=learner.declared.model_copy(update={"seeds": few}))
    agents = {scenario: population(scenario, n, **arrays) for scenario in SCENARIOS}
    readings = EXPERIMENT.declared.readings
    monkeypatch.setattr(replication, "load", lambda _: dict.fromkeys(readings, agents))
    experiment = replace(EXPERIMENT, learners={name: fewer})
    return Data(experiment, MADE, pd.DataFrame(), pd.DataFrame())


# Tables


def test_optimality_after_training(monkeypatch: pytest.MonkeyPatch) -> None:
    random, optimal = anchors(population().model, population().run.horizon)
    returns, success = np.full((4, 4), float(random)), np.zeros((4, 4))
    returns[1:, -1], success[:, -1] = optimal, [1, 0.5, 0.5, 0]
    data = data_of(monkeypatch, 2, grid_return=returns, success=success)
    frame = replication.optimal(data)
    frame = frame[frame["scenario"] == "S1"]
    keys = ["agents", "step", "success", "optimal_share"]
    assert frame[keys].to_numpy().tolist() == [[2, 600, 0.75, 0.5], [4, 600, 0.5, 0.75]]


def test_values_of_cells_and_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    q = np.zeros((4, 120, 5))
    q[:, 13, 4] = [1, 2, 3, 6]  # row 1, column 1, PING
    data = data_of(monkeypatch, 4, q=q, max_q=np.outer([1, 2, 3, 6], np.arange(60)))
    frame = replication.q_values(data)[:600]
    (row,) = frame[frame["mean"] != 0].to_dict("records")
    where = row["scenario"], row["row"], row["column"], row["action"]
    assert where == ("S1", 1, 1, "PING")
    assert (row["mean"], row["min"], row["max"]) == (3, 1, 6)
    assert row["std"] == pytest.approx(np.sqrt(14 / 3))
    curve = replication.max_q(data)[:60]
    assert curve["mean"].tolist() == (3.0 * np.arange(60)).tolist()
    assert curve["step"].tolist() == [*range(0, 600, 10)]


def test_verdicts_on_disjoint_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    success = np.zeros((5, 4))
    success[:, -1] = [1, 1, 0.9, 0.4, 0]
    data = data_of(monkeypatch, 2, 5, success=success)
    frame = data.tables["claims"] = replication.claims(data)
    frame = frame[frame["reading"] == "default"]
    assert frame["claim"].unique().tolist() == [claim.id for claim in CLAIMS]
    reached = frame[frame["claim"] == "reaches"][["agents", "first_seed", "value"]]
    assert reached.to_numpy().tolist() == [[2, 0, 1], [2, 2, 0.5], [5, 0, 0.6]]
    # Nothing was learned of PING, so there is nothing to count outside.
    assert set(frame["state"][frame["claim"].isin(["ping-S3", "ping-S1"])]) == {"undecided"}
    verdicts = replication.verdicts_of(frame)
    assert [*verdicts["identifies"]] == ["does not hold"] * 3
    assert [*verdicts["reaches"]] == ["undecided", "undecided", "does not hold"]
    assert "5 agents per scenario, 400 steps" in replication.headline(data)
    assert "(`identifies`, *does not hold*, 2/2)" in replication.reading(data)


def test_a_reading_says_which_curve_claims_are_about(monkeypatch: pytest.MonkeyPatch) -> None:
    data = data_of(monkeypatch, 4, max_q=np.zeros((4, 60)), table_max_q=np.ones((4, 60)))
    frame = data.tables["claims"] = replication.claims(data)
    near_one = frame[(frame["claim"] == "max-near-1") & (frame["part"] == "S1")]
    values = near_one.set_index("reading")["value"]
    assert [*values.index[values == 1]] == ["max_q"]
    assert {*values.drop("max_q")} == {0}
    texts = [text.get_text() for text in replication.sensitivity_figure(data).axes[0].texts]
    assert len(texts) == len(CLAIMS) * len(values)


# Verdicts


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
    measures = [lambda *_, numbers=numbers: Part("", *numbers) for numbers in parts]
    claim = Claim("c", "", side, 1.0, "S1", measures, "")
    assert set(judge({"S1": population()}, "", [claim])["verdict"]) == {verdict}


# Claims


def parts_of(claim_id: str, agents: dict[str, Records], curve: str = "max_q") -> pd.DataFrame:
    """Returns the parts of a claim."""
    (claim,) = [claim for claim in CLAIMS if claim.id == claim_id]
    return judge(agents, curve, [claim])


def numbers(claim_id: str, agents: dict[str, Records]) -> list[list[float]]:
    """Returns the value and the interval of each part of a claim."""
    found: list[list[float]] = (
        parts_of(claim_id, agents)[["value", "low", "high"]].to_numpy().tolist()
    )
    return found


def trio(**by_scenario: dict[str, Any]) -> dict[str, Records]:
    """Returns four agents in each scenario, with these arrays."""
    return {name: population(name, 4, **by_scenario.get(name, {})) for name in SCENARIOS}


def test_variability_by_hand() -> None:
    def curves(spread: float) -> dict[str, NDArray[Any]]:
        agents = [-spread, -spread, spread, spread]
        return {"max_q": np.outer(agents, np.ones(60)), "table_max_q": np.zeros((4, 60))}

    three = trio(S1=curves(1.0), S2=curves(3.0), S3=curves(0.5))
    found = parts_of("variability-S2", three)
    assert found[["part", "value"]].to_numpy().tolist() == [["S2/S1", 3], ["S2/S3", 6]]
    assert parts_of("variability-S2", three, "table_max_q")["value"].isna().all()


def test_nearness_to_one_by_hand() -> None:
    high = np.zeros((4, 60))
    high[:2, :2] = 0.9  # two of sixty steps are more than one in a hundred
    high[2, 3:5] = 1.0
    found = parts_of("max-near-1", trio(S1={"max_q": high}))
    assert found["value"].tolist() == pytest.approx([2.8 / 4, 0])


def test_focus_by_hand() -> None:
    def moves(*cells: tuple[int, int]) -> dict[str, NDArray[Any]]:
        q = np.full((4, 120, 5), -1.0)
        q[:, :, PING] = 9.0  # PING does not count
        for row, column in cells:
            q[:, row * 12 + column, 1] = 0.5
        return {"q": q}

    # From the target region (rows 4 to 8, columns 6 to 10, less its inside): 4, 2, 0 and 1.
    three = trio(S1=moves((0, 8)), S2=moves((2, 8), (6, 4)), S3=moves((4, 6), (6, 8), (6, 7)))
    assert parts_of("moves-focused", three)["value"].tolist() == pytest.approx([1 / 4, 1 / 2])


def test_signs_of_cells_give_intervals_by_hand() -> None:
    in_target = population().in_target
    target, outside = np.flatnonzero(in_target), np.flatnonzero(~in_target)
    spread = np.array([-1, 1, -1, 1]) * 0.01 * np.sqrt(3)  # a standard error of 0.01
    t = stats.t.ppf(1 - 0.05 / 240, 3)
    assert 0.1 < t * 0.01 < 0.2  # so a mean of 0.1 or -0.1 is open
    q = np.zeros((4, 120, 5))
    means = (target[:12], 1.0), (target[12:], 0.1), (outside[:2], 1.0), (outside[2:5], -0.1)
    for cells, mean in (*means, (outside[5:9], -1.0)):
        q[:, cells, PING] = mean + spread[:, None]
    # Inside 12 cells are surely above zero and 4 open, outside 2 surely and 3 open. The others
    # surely are not: 4 have means far below zero, and in the rest nobody ever chose PING.
    three = trio(S1={"q": q}, S3={"q": q})
    assert numbers("ping-S1", three) == [[2, 2, 5]]
    assert numbers("ping-S3-inside", three) == [[0, 0, 4]]
    assert numbers("identifies-S1", three)[0] == pytest.approx([16 / 18, 12 / 21, 16 / 18])
    # In S2 nothing was learned: its overlap is 0 for sure. At 97.5 % the same cells of S1 are open.
    assert numbers("random-helps", three)[0] == pytest.approx([-16 / 18, -16 / 18, -12 / 21])


def test_own_maps_have_students_and_welchs_intervals() -> None:
    """Overlaps of agents that mark 4, 8, 12 or 16 of 16 cells, and no other, against SciPy's."""
    target = np.flatnonzero(population().in_target)

    def pings(name: str, counts: list[int]) -> Records:
        q = np.full((len(counts), 120, 5), -0.1)
        for agent, n in enumerate(counts):
            q[agent, target[:n], PING] = 1.0
        return population(name, len(counts), q=q)

    few, many = [4, 8, 8, 12] * 5, [8, 12, 16, 16, 4] * 6
    three = {"S1": pings("S1", few), "S2": pings("S2", many), "S3": pings("S3", few)}
    x, y = np.array(many) / 16, np.array(few) / 16
    of_x, of_y = x.var(ddof=1) / 30, y.var(ddof=1) / 20
    freedom = (of_x + of_y) ** 2 / (of_x**2 / 29 + of_y**2 / 19)  # Welch's
    reach = stats.t.ppf(0.975, freedom) * np.sqrt(of_x + of_y)
    difference = x.mean() - y.mean()
    expected = [difference, difference - reach, difference + reach]
    assert numbers("random-helps", three)[1] == pytest.approx(expected)
    ends = stats.ttest_1samp(x, 0).confidence_interval()
    own = parts_of("identifies", three).iloc[2]
    assert own["part"] == "own maps S2"
    assert own[["value", "low", "high"]].tolist() == pytest.approx([x.mean(), *ends])
    same = three | {"S2": pings("S2", [8] * 4), "S1": pings("S1", [4] * 4)}
    assert numbers("random-helps", same)[1] == [0.25] * 3  # agents that agree have no spread


# What is demanded, and the text


@pytest.mark.parametrize(
    "changes",
    [
        '"algorithms.q_learning.observations" = ["index", "offset"]',
        'scenarios = ["S1", "S2", "Egg"]',
        '"readings.default.scenario" = { "rewards.target_ping" = 0.5 }',
    ],
)
def test_a_replication_takes_one_table_in_the_papers_scenarios(
    changes: str, tmp_path: Path
) -> None:
    text = f'extends = "reproduce"\ndescription = ""\n[changes]\n{changes}\n'
    experiment = made(tmp_path / "mine.toml", text)
    with pytest.raises(InputError, match=r"mine\.toml: accepted in a replication: one table"):
        check(experiment, MADE)


def test_without_stored_records_there_are_no_tables() -> None:
    with pytest.raises(InputError, match="reproduce --smoke: action values are not"):
        replication.claims(Data(EXPERIMENT, MADE, pd.DataFrame(), pd.DataFrame()))


def test_the_finding_says_what_the_tables_show() -> None:
    tables = Folder(ROOT / "results" / "reproduce").tables()
    claims = tables["claims"]
    claims.loc[claims["reading"] == "equal_pay", "verdict"] = "undecided"
    text = " ".join(reproduce.finding(tables).split())
    assert "Of the paper's 11 claims, 3 do not hold" in text
    assert re.search(r" (\d) of the \1 claims that hold", text)
    claims.loc[claims["claim"] == "reaches", "verdict"] = "does not hold"
    with pytest.raises(AssertionError, match="exactly these claims"):
        reproduce.finding(tables)
