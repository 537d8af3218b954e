"""A scenario and an experiment from outside: two TOML files, and nothing else."""

import gzip
import json
from pathlib import Path

import gymnasium
import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.tables import AGENTS
from tests.support import small_experiment, variant

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
# Tables in a corridor, in the paper's room, with moods, and anywhere.
EXPERIMENT = small_experiment(
    scenarios=["corridor.toml", "S1", "Moody", "Anywhere"],
    evaluation_every=500,
    map_every=500,
    settings={"learning_rate": 0.5, "epsilon": 0.3, "budget": 2000, "record_every": 1000},
    report={"kind": "comparison"},
    algorithms={"one": variant(seeds=3), "two": variant("sarsa", "index", "offset", seeds=3)},
)
OPTIMUM = (
    3 * -0.25 + 2.0
)  # three moves RIGHT to the nearest cell at distance 2 from the issuer, then PING


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


def test_a_scenario_beside_the_experiment_is_compared_like_any_other(
    corridor: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(corridor.parents[1])
    (corridor.parent / "mine.toml").write_text(EXPERIMENT, encoding="utf-8")
    file, results = str(corridor.parent / "mine.toml"), corridor.parent
    assert main(["run", file, "--report", "--results", str(results)]) == 0
    table = pd.read_csv(results / "mine" / "summary.csv").set_index(["scenario", "learner"])
    assert 0.9 < table["unbounded_score"]["corridor", "one, index"] <= 1  # nearly the optimum
    explorer = json.loads(gzip.decompress((results / "mine" / AGENTS).read_bytes()))
    shown = [agent["scenario"] for agent in explorer["agents"]]
    assert shown == sorted(3 * ["corridor", "S1", "Moody", "Anywhere"], key=shown.index)
