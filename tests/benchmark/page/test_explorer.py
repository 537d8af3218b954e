"""The explorer's data are the published files, packed."""

import base64
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmark.page import explorer
from benchmark.page.sources import open_folder
from envs import ACTIONS, InputError, Scenario, compile_scenario
from envs.scene import scene_of
from tests.benchmark.page.pages import RESULTS


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    folders = [open_folder(RESULTS / name, f"{name}/") for name in ("compare_deep", "reproduce")]
    collected = explorer.collect(folders)
    assert collected is not None
    return collected


def values_of(packed: list[int], n_maps: int, data: dict[str, Any]) -> Any:
    """Returns packed values, a row an observation."""
    integers = np.array(packed).reshape(n_maps, -1).cumsum(axis=0)
    values = np.where(integers == data["no_number"], np.nan, integers / 10 ** data["decimals"])
    return values.reshape(-1, len(ACTIONS))


def test_every_agent_of_every_experiment_is_shown(data: dict[str, Any]) -> None:
    keys = ["scenario", "algorithm", "observation"]
    expected = []
    for name in ("compare_deep", "reproduce"):
        frame = pd.read_csv(RESULTS / name / "agent.csv")
        expected += [(name, *key) for key in frame[keys].drop_duplicates().itertuples(index=False)]
    assert [tuple(agent[key] for key in ("experiment", *keys)) for agent in data["agents"]] == expected


@pytest.mark.parametrize("place", [0, 10, -1])
def test_agent_is_as_in_the_files(data: dict[str, Any], place: int) -> None:
    agent = data["agents"][place]
    for key in ("maps", "evaluation", "curve"):
        line, frame = agent[key]["line"], pd.read_csv(RESULTS / agent[key]["file"])
        row = frame.iloc[line - 2]
        for name in {"scenario", "algorithm", "observation"} & set(frame):
            assert row[name] == agent[name]
        assert row["step"] == agent["steps"][0] == 0
    frame = pd.read_csv(RESULTS / agent["maps"]["file"])
    values = values_of(agent["values"], len(agent["steps"]), data)
    rows = frame.iloc[agent["maps"]["line"] - 2 :][: len(values)]
    assert rows[list(ACTIONS)].to_numpy() == pytest.approx(values, nan_ok=True)
    assert rows["step"].tolist() == np.repeat(agent["steps"], len(values) // len(agent["steps"])).tolist()
    masks = base64.b64decode(agent["greedy"])
    names = ["|".join(name for i, name in enumerate(ACTIONS) if mask >> i & 1) for mask in masks]
    assert names == rows["greedy"].tolist()
    optimum = data["optima"][agent["optimum"]]
    best = pd.read_csv(RESULTS / optimum["file"], dtype={"discount": str}).iloc[optimum["line"] - 2 :]
    assert best.iloc[0][["scenario", "discount"]].tolist() == [agent["scenario"], agent["discount"]]
    packed = values_of(optimum["values"], 1, data)
    assert best[list(ACTIONS)].to_numpy()[: len(packed)] == pytest.approx(packed)


def test_scenes_are_those_of_the_compiled_scenarios(data: dict[str, Any]) -> None:
    assert len(data["scenes"]) == 3  # both experiments have the same
    for agent in data["agents"]:
        manifest = json.loads((RESULTS / agent["experiment"] / "manifest.json").read_text(encoding="utf-8"))
        declared = json.dumps(manifest["scenarios"][agent["scenario"]])
        model = compile_scenario(Scenario.model_validate_json(declared))
        scene = data["scenes"][agent["scene"]]
        assert {key: scene[key] for key in scene_of(model).as_json()} == scene_of(model).as_json()
        assert np.array_equal(np.reshape(scene["next"], model.next_state.shape), model.next_state)
        assert [scene["observation"][state] for state in scene["fresh"]] == list(range(model.n_observations))


def test_experiment_without_snapshots_has_no_explorer(tmp_path: Path) -> None:
    shutil.copytree(RESULTS / "reproduce", tmp_path / "reproduce")
    (tmp_path / "reproduce" / "agent.csv").unlink()
    assert explorer.collect([open_folder(tmp_path / "reproduce", "")]) is None


def test_learner_without_a_mean_score_over_training(tmp_path: Path) -> None:
    shutil.copytree(RESULTS / "reproduce", tmp_path / "reproduce")
    (tmp_path / "reproduce" / "learning.csv").unlink()
    collected = explorer.collect([open_folder(tmp_path / "reproduce", "")])
    assert collected is not None
    assert {agent["curve"] for agent in collected["agents"]} == {None}


def test_maps_that_lack_a_cell_are_refused(tmp_path: Path) -> None:
    shutil.copytree(RESULTS / "reproduce", tmp_path / "reproduce")
    file = tmp_path / "reproduce" / "agent_S1.csv"
    file.write_text(
        "".join(file.read_text(encoding="utf-8").splitlines(keepends=True)[:-1]), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"agent_S1\.csv has not as many rows as agent.csv says"):
        explorer.collect([open_folder(tmp_path / "reproduce", "")])


@pytest.fixture
def with_agents(tmp_path: Path) -> Path:
    """The replication with final policies of three agents per scenario; those of seed 8 always go RIGHT."""
    folder = tmp_path / "reproduce"
    shutil.copytree(RESULTS / "reproduce", folder)
    keys = pd.read_csv(folder / "agent.csv")[["scenario", "algorithm", "observation"]].drop_duplicates()
    rows = [
        {**key, "seed": seed, "score": 0.5, "success": 0.25, "greedy": ("I" if seed == 8 else "f") * 120}
        for key in keys.to_dict("records")
        for seed in (0, 8, 9)
    ]
    pd.DataFrame(rows).to_csv(folder / "agents.csv", index=False)
    return folder


def test_agents_of_other_seeds_stand_in_a_file_that_the_page_holds(with_agents: Path) -> None:
    folder = open_folder(with_agents, "reproduce/")
    collected = explorer.collect([folder])
    assert collected is not None
    assert collected["letters"].index("I") == 1 << ACTIONS.index("RIGHT")
    assert collected["letters"].index("f") == 2 ** len(ACTIONS) - 1
    assert "reproduce/agents.csv" in folder.embedded
    lines = folder.embedded["reproduce/agents.csv"].splitlines()
    for agent in collected["agents"]:
        assert agent["seeds"] == [0, 8, 9]
        assert agent["seed"] == 0
        assert agent["others"]["file"] == "reproduce/agents.csv"
        line = lines[agent["others"]["line"] - 1 + 1]
        assert line.startswith(f"{agent['scenario']},q_learning,index,8,")


def test_policies_that_lack_a_cell_are_refused(with_agents: Path) -> None:
    file = with_agents / "agents.csv"
    file.write_text(file.read_text(encoding="utf-8").replace("III\n", "II\n", 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"agents\.csv has policies of S1 that have not a letter for every"):
        explorer.collect([open_folder(with_agents, "")])


def test_results_without_other_agents_show_the_first_one(tmp_path: Path) -> None:
    shutil.copytree(RESULTS / "reproduce", tmp_path / "reproduce")
    (tmp_path / "reproduce" / "agents.csv").unlink(missing_ok=True)
    collected = explorer.collect([open_folder(tmp_path / "reproduce", "")])
    assert collected is not None
    assert [agent["seeds"] for agent in collected["agents"]] == [
        [agent["seed"]] for agent in collected["agents"]
    ]
