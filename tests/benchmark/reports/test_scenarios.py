"""The report on scenarios: its tables by hand, its sentences against its tables, and it in miniature."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from agents.dynamic_programming import from_starts, solve
from benchmark.analysis.contrasts import Side, contrast, holm
from benchmark.analysis.intervals import proportion_interval
from benchmark.analysis.population import Population
from benchmark.drawing.tables import LINK
from benchmark.experiments import all_specifications, load_experiment
from benchmark.experiments.schema import Effect
from benchmark.reports.comparison.data import Data
from benchmark.reports.comparison.protocol import Learner, Protocol
from benchmark.reports.published import Published
from benchmark.reports.scenarios import findings, tables
from envs import compile_scenario, load_scenario, scenario_names
from tests.benchmark.reports.made import compared
from tests.support import make, mistyped_columns

X, Y = Learner("x", "index"), Learner("y", "index")
PROTOCOL = Protocol(Y, [X], [(X, Y)], 0.1, 0.05, 10, is_declared=True)


def with_success(success: list[NDArray[np.float64]], scenario: str, wrong: int = 0) -> Population:
    """Returns runs with this success at the five evaluations, and so many wrong PINGs at the end."""
    values = np.array(success)
    n = len(values)
    disagreements = np.zeros((n, 5), dtype=np.int64)
    disagreements[:, -1] = wrong + np.arange(n) % 2
    return compared(scenario, n, success=values, disagreements=disagreements)


def made(n: int = 20) -> Data:
    """Returns a net x that learns S1 at step 200 and never S2, and a table y that learns both at step 300."""
    early, never, late = ([0, 0.2, 1, 1, 1], [0, 0, 0, 0, 0.25], [0, 0, 0.5, 0.95, 1])
    populations = {
        X: {"S1": [early] * n, "S2": [never] * n},
        Y: {"S1": [late] * n, "S2": [late] * n},
    }
    learners = {
        learner: {
            name: with_success([np.array(row) for row in rows], name, wrong=4 if learner == X else 2)
            for name, rows in by_scenario.items()
        }
        for learner, by_scenario in populations.items()
    }
    effects = [Effect(name="noise", scenario="S2", against="S1")]
    return Data(learners, protocol=PROTOCOL, effects=effects)


def test_every_scene_has_its_own_verdict_and_all_are_adjusted_together() -> None:
    found = tables.contrasts(made(), {})
    assert found is not None
    assert list(found["scenario"]) == ["S1", "S2"]
    assert list(found["success_verdict"]) == ["undecided", "worse"]  # 20 runs of 1 and 20 of 1 decide nothing
    raw = [contrast(Side([a], [20]), Side([1.0], [20]), 0.1) for a in (1.0, 0.25)]
    assert found["success_p_different"].to_numpy() == pytest.approx(holm([each.p_different for each in raw]))
    assert found["success_p_equivalent"].to_numpy() == pytest.approx(
        holm([each.p_equivalent for each in raw])
    )
    few = tables.contrasts(made(5), {})
    assert few is not None
    assert set(few["success_verdict"]) == {"no verdict"}


def test_steps_count_from_the_last_evaluation_below_enough() -> None:
    found = tables.steps(made(), {}).set_index(["scenario", "algorithm"])["step"]
    assert found["S1", "x"] == 200
    assert found["S1", "y"] == found["S2", "y"] == 300  # 0.95 is enough
    assert np.isinf(found["S2", "x"])


def test_ahead_is_where_the_interval_lies_above_zero() -> None:
    found = tables.ahead(made(), {})
    assert found is not None
    first = found.iloc[0]
    assert (first["scenario"], first["x"], first["y"]) == ("S1", "x, index", "y, index")
    # At step 100 it is 0.2 against 0 with 20 runs each, and the interval of the difference holds 0.
    low, high = proportion_interval(np.array([0.2, 0.0]), np.array([20, 20]))
    assert 0.2 - np.hypot(0.2 - low[0], high[1] - 0.0) < 0
    assert (first["first_step"], first["last_step"], first["steps_ahead"]) == (200, 200, 1)
    assert (first["largest_difference"], first["largest_at"]) == (0.5, 200)
    assert np.isinf(found.iloc[2]["first_step"])  # x is never ahead in S2
    assert found.iloc[3]["first_step"] == 200  # y is


def test_effects_are_differences_of_scenes_by_hand() -> None:
    found = tables.effects(made(), {})
    assert found is not None
    rows = found.set_index("algorithm").to_dict("index")
    assert rows["x"]["success"] == pytest.approx(-0.75)
    assert rows["y"]["success"] == 0
    assert rows["x"]["disagreements"] == 0
    low, high = proportion_interval(np.array([0.25, 1.0]), np.array([20, 20]))
    expected = -0.75 - np.hypot(0.25 - low[0], high[1] - 1.0)
    assert rows["x"]["success_low"] == pytest.approx(expected)
    # 4.5 and 2.5 wrong PINGs on average in 400 steps
    summary = tables.summary(made(), {}).set_index(["scenario", "algorithm"]).to_dict("index")
    assert summary["S1", "x"]["disagreements"] == pytest.approx(4.5 / 400 * 1000)
    assert summary["S1", "y"]["disagreements"] == pytest.approx(2.5 / 400 * 1000)
    half = 2.093 * np.std([4, 5] * 10, ddof=1) / np.sqrt(20) / 400 * 1000  # t with 19 degrees of freedom
    assert summary["S1", "x"]["disagreements_high"] == pytest.approx(11.25 + half, rel=1e-3)
    assert tables.effects(replace(made(), effects=[]), {}) is None


# In miniature


@pytest.fixture(scope="session")
def beyond(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with the scenarios in miniature, as `make beyond` makes it."""
    folder = tmp_path_factory.mktemp("beyond")
    done = make("beyond", "EXPERIMENT=beyond_smoke", f"RESULTS={folder}")
    assert done.returncode == 0, done.stderr
    return folder / "beyond_smoke"


def test_planners_are_no_learners(beyond: Path) -> None:
    names = set(pd.read_csv(beyond / "summary.csv")["algorithm"])
    declared = set(load_experiment("beyond_smoke").algorithms)
    assert names == declared - {"memoryless"}
    scores = pd.read_csv(beyond / "scores.csv")
    runs = all_specifications(load_experiment("beyond_smoke"))
    assert len(scores) == sum(run.arm != "memoryless" for run in runs)


def test_what_is_possible_is_bounded_by_an_agent_that_knows_the_state(beyond: Path) -> None:
    rows = pd.read_csv(beyond / "scenarios.csv").set_index("scenario").to_dict("index")
    for name, row in rows.items():
        model = compile_scenario(load_scenario(str(name)))
        optimum = from_starts(model) @ solve(model, 1.0, 200, issuer_rewards=False).value
        assert row["optimal_return"] == pytest.approx(optimum, abs=1e-5)
        assert row["random_return"] < row["memoryless_return"] <= row["optimal_return"] + 1e-6
        assert row["observations"] == model.n_observations
    assert rows["MoodyHidden"]["memoryless_return"] < rows["Moody"]["memoryless_return"] - 0.5


def test_numbers_in_sentences_are_in_the_rows_that_they_link_to(beyond: Path) -> None:
    texts = pd.read_csv(beyond / "findings.csv")["text"]
    assert "there is no verdict" in texts[0]  # two runs decide nothing
    n_links = 0
    for text in texts:
        for shown, file, row in re.findall(LINK, text):
            if "-" in row or ";" in row:
                continue
            values = pd.read_csv(beyond / file).iloc[int(row) - 2]
            numbers = [float(each) for each in values if isinstance(each, int | float)]
            number = float(shown.replace(",", "").replace("+", ""))
            decimals = len(shown.partition(".")[2])
            assert any(abs(each - number) <= 0.5 * 10**-decimals + 1e-6 for each in numbers), (text, shown)
            n_links += 1
    assert n_links > 10


def test_readers_infer_the_types_of_all_columns(beyond: Path) -> None:
    for path in beyond.glob("*.csv"):
        assert mistyped_columns(path) == [], path.name


def test_the_experiment_has_all_scenarios_and_hiding_changes_what_is_observed_alone() -> None:
    experiment = load_experiment("beyond")
    assert set(experiment.scenarios) == set(scenario_names()) - {"S2", "S3"}
    for effect in experiment.effects:
        one, other = (load_scenario(name).model_dump() for name in (effect.scenario, effect.against))
        changed = {key for key in one.keys() | other.keys() if one.get(key) != other.get(key)}
        changed -= {"name", "description"}
        if effect.name.startswith(("hiding", "seeing")):
            assert changed == {"observe"}, effect.name


@pytest.mark.parametrize(
    ("net", "table", "ending"),
    [
        ((12_000, 11_000), (360_000, 340_000), "so the table needs 28 to 33 times as many."),
        ((3_000, 2_000), (5_000, 4_000), "so the table needs 1.3 to 2.5 times as many."),
        ((1_000, 0), (2_000, 1_000), "so the table needs at least 1 times as many."),
        ((0, None), (2_000, 1_000), "from step [2,000](steps.csv#row=3) on."),
        ((1_000, 0), (np.inf, 20_000), "with [20,000](steps.csv#row=3) steps."),
    ],
)
def test_steps_are_compared_as_far_as_they_are_known(
    tmp_path: Path, net: tuple[int, int | None], table: tuple[float, int], ending: str
) -> None:
    rows = [
        {"scenario": "S1", "algorithm": name, "observation": "index", "budget": 20_000, "step": step,
         "below_at": below}
        for name, (step, below) in (("net", net), ("table", table))
    ]  # fmt: skip
    pd.DataFrame(rows).to_csv(tmp_path / "steps.csv", index=False)
    families = {"net": {"family": "deep"}, "table": {"family": "tabular"}}
    (tmp_path / "manifest.json").write_text(json.dumps({"algorithms": families}), encoding="utf-8")
    (sentence,) = findings._learned(Published(tmp_path))
    assert sentence.startswith("In S1 (exploratory), the mean success of `net, index`")
    assert sentence.endswith(ending)
