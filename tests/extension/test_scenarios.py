"""A scenario and an experiment from outside: two TOML files, and nothing else."""

import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium
import pandas as pd
import pytest

import envs
from tests.support import command

RIGHT, PING = 3, 4
CORRIDOR = """
description = "A corridor with the issuer at its end."
ping_limit = 2

[grid]
rows = 3
columns = 6
start = [1, 0]

[issuer]
position = [1, 5]
feedback = { kind = "none" }

[regions]
uncomfortable_radius = 1
target_radius = 2

[rewards]
issuer_reached = -1.0
target_ping = 2.0
last_wrong_ping = -1.0
wrong_ping = -0.5
wrong_ping_uncomfortable = -0.5
uncomfortable = -0.75
other = -0.25
"""
EXPERIMENT = """
description = "Q-learning in a corridor."
report = "replication"
scenarios = ["SCENARIO"]
horizon = 50
evaluation_every = 500
map_every = 500

[algorithms.table]
algorithm = "q_learning"
observations = ["index"]
seeds = 3

[algorithms.table.settings]
learning_rate = 0.5
discount = 0.9
epsilon = 0.3
budget = 2000
record_every = 10
"""
OPTIMUM = 3 * -0.25 + 2.0  # three moves RIGHT to the nearest cell at distance 2 from the issuer, then PING


@pytest.fixture
def corridor(tmp_path: Path) -> Path:
    path = tmp_path / "corridor.toml"
    path.write_text(CORRIDOR, encoding="utf-8")
    return path


def test_a_scenario_is_given_by_its_path(corridor: Path) -> None:
    env = gymnasium.make("Proxemic/S1-v0", scenario=corridor)
    env.reset(seed=0)
    rewards = [float(env.step(action)[1]) for action in (RIGHT, RIGHT, RIGHT)]
    _, reward, terminated, _, _ = env.step(PING)
    assert terminated
    assert sum(rewards) + float(reward) == OPTIMUM
    assert env.observation_space == gymnasium.spaces.Discrete(3 * 6)


def test_a_scenario_in_the_folder_is_registered(corridor: Path, tmp_path: Path) -> None:
    package = Path(envs.__file__).parent
    shutil.copytree(package, tmp_path / "envs", ignore=shutil.ignore_patterns("__pycache__"))
    names = ["corridor", "corridor-v0", "9-x_"]
    for name in [*names, "not a name"]:
        shutil.copy(corridor, tmp_path / "envs" / "scenarios" / f"{name}.toml")
    code = f"""
import envs, gymnasium
for name in {names}:
    env = gymnasium.make(f"Proxemic/{{name}}-v0")
    print(env.spec.id, env.unwrapped.model.scenario.name, env.observation_space)
print([name for name in gymnasium.registry if "not" in name])
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    expected = [f"Proxemic/{name}-v0 {name} Discrete(18)" for name in names]
    assert done.stdout.splitlines() == [*expected, "[]"], done.stderr


def test_an_experiment_on_it_runs_and_is_drawn(corridor: Path, tmp_path: Path) -> None:
    experiment = tmp_path / "mine.toml"
    experiment.write_text(EXPERIMENT.replace("SCENARIO", str(corridor)), encoding="utf-8")
    done = command("run", experiment, "--report", "--jobs", "1", "--results", tmp_path)
    assert done.returncode == 0, done.stderr
    optimal = pd.read_csv(tmp_path / "mine" / "optimal.csv").set_index("scenario")
    assert optimal.index.tolist() == ["corridor"]
    assert optimal["agents"]["corridor"] == 3
    assert optimal["grid_return_optimal"]["corridor"] == pytest.approx(OPTIMUM)
    assert optimal["grid_return_learned"]["corridor"] == pytest.approx(OPTIMUM)
    names = {path.name for path in (tmp_path / "mine").iterdir()}
    assert {"figure.png", "learning.md", "README.md"} < names
    assert "claims.csv" not in names  # the paper's claims are about S1 to S3
    assert "Claims of the paper" not in (tmp_path / "mine" / "README.md").read_text(encoding="utf-8")


BEYOND = """
description = "Two tables in scenarios of which one has cell maps."
report = "REPORT"
scenarios = ["S1", "Walls", "Moody"]
horizon = 50
evaluation_every = 100
map_every = 200
settings = { budget = 200 }
algorithms.one = { algorithm = "q_learning", observations = ["index"], seeds = 2 }
algorithms.two = { algorithm = "sarsa", observations = ["index"], seeds = 2 }
"""


def test_scenarios_beyond_the_paper_are_compared_like_any_others(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(BEYOND.replace("REPORT", "comparison"), encoding="utf-8")
    done = command("run", str(file), "--report", "--results", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "mine").glob("agent_*.csv")} == {"agent_S1.csv"}
    summary = pd.read_csv(tmp_path / "mine" / "summary.csv")
    assert set(summary["scenario"]) == {"S1", "Walls", "Moody"}
    assert (tmp_path / "mine" / "index.html").exists()
    file.write_text(BEYOND.replace("REPORT", "scenarios"), encoding="utf-8")
    done = command("run", str(file), "--report", "--results", str(tmp_path))  # no deep learner, no protocol
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine" / "scenarios.png").exists()


def test_a_replication_takes_scenarios_like_the_papers(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(EXPERIMENT.replace("SCENARIO", "Moody"), encoding="utf-8")
    done = command("run", str(file), "--report", "--results", str(tmp_path))
    assert done.returncode == 2
    assert "scenarios: Moody (default): a replication takes scenarios like the paper's" in done.stderr
    assert not (tmp_path / "runs.db").exists()
