"""What the explorer is given, of learners that are made up number by number."""

import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark.experiment import Experiment
from benchmark.page import explorer
from benchmark.page.explorer import MAX_MASKS
from benchmark.records import Records
from benchmark.specification import RunSpecification
from benchmark.tables import AGENTS
from envs import ACTIONS, load_scenario
from envs.observations import compile_seen
from tests.benchmark.populations import population
from tests.support import made as loaded
from tests.support import small_experiment, variant

UP, RIGHT, PING = (1 << ACTIONS.index(name) for name in ("UP", "RIGHT", "PING"))


def experiment(folder: Path, *scenarios: str, **observations: list[str]) -> Experiment:
    """Returns an experiment with maps at steps 0, 100, 200 and 300."""
    table = {"scenarios": [*scenarios], "evaluation_every": 50, "map_every": 100}
    learners = {name: variant("q_learning", *forms) for name, forms in observations.items()}
    table |= {"settings": {"budget": 300, "record_every": 5}, "algorithms": learners}
    return loaded(folder / "mine.toml", small_experiment(**table))


def made(runs: list[RunSpecification]) -> Records:
    """Returns made-up records of runs; between maps there are policies alone."""
    n, n_observed = len(runs), compile_seen(runs[0].scenario, runs[0].observation).n_observations
    values = np.zeros((n, 4, n_observed, 5), dtype=np.float32)
    values[0, 2, 13] = (0.12345, -0.5, 0.25, np.nan, 2.0)  # row 1, column 1
    values[1:] = 99
    greedy = np.full((n, 7, n_observed), RIGHT, dtype=np.uint8)
    greedy[0, 6, 13] = UP | PING
    greedy[:, 1::2] = PING
    success = np.tile(np.arange(n)[:, None] / n, 7)
    records = population(
        runs[0].scenario,
        n,
        budget=300,
        every=50,
        map_every=100,
        observation=runs[0].observation,
        values=values,
        greedy=greedy,
        success=success,
    )
    return replace(records, runs=runs)


@pytest.fixture(autouse=True)
def records(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explorer, "load_records", lambda runs, _: made(runs))


def written(shown: Experiment, seeds: range | None = None) -> dict[str, Any]:
    """Returns the explorer's data as they are written."""
    path = shown.path.with_name(AGENTS)
    explorer.write(shown, None, path, seeds)  # type: ignore[arg-type]
    return dict(json.loads(gzip.decompress(path.read_bytes())))


def test_first_agent_over_training_and_the_final_policies_of_others(tmp_path: Path) -> None:
    data = written(experiment(tmp_path, "S1", table=["index"]), range(4, 60))
    (agent,) = data["agents"]
    named = [agent[key] for key in ("scenario", "learner", "family", "kind", "scene", "sight")]
    assert named == ["S1", "table", "tabular", "q", 0, 0]
    assert agent["steps"] == [0, 200, 300]  # every second map, and the last
    values = np.array(agent["values"]).reshape(3, 120, 5)
    assert values[1, 13].tolist() == [0.123, -0.5, 0.25, None, 2]
    assert not values[[0, 2]].any()
    greedy = np.reshape(agent["greedy"], (-1, 120))
    others = np.delete(greedy.ravel(), 2 * 120 + 13)
    assert (greedy[2, 13], {*others}) == (UP | PING, {RIGHT})
    assert agent["seeds"] == [4, 5, 6, 7]
    assert MAX_MASKS == 4 * 120
    assert agent["others"]["success"] == [1 / 4, 2 / 4, 3 / 4]
    assert agent["others"]["greedy"] == [RIGHT] * 3 * 120


@pytest.mark.parametrize("name", ["Turning", "Moody", "Walking", "Walls", "TwoPeople", "Delayed"])
def test_a_scenario_is_unpacked_as_it_was_compiled(name: str, tmp_path: Path) -> None:
    data = written(experiment(tmp_path, name, table=["offset"]))
    model, scene = compile_seen(load_scenario(name), "offset"), data["scenes"][0]
    n_states, shape = len(model.observation), model.next_state.shape
    kind = np.array(scene["kind"])
    kinds = {
        key: np.array(values).reshape(kind.max() + 1, -1)[kind]
        for key, values in scene["kinds"].items()
    }
    change = kinds["change"].reshape(shape)
    assert (change + np.arange(n_states)[:, None, None] == model.next_state).all()
    assert (kinds["probability"].reshape(shape) == model.probability).all()
    for key in ("grid_reward", "issuer_reward", "terminated", "event"):
        assert (kinds[key] == getattr(model, key)).all()
    assert (kinds["over"][:, 0] == model.is_over).all()
    assert data["sights"][0]["of"] == model.observation.tolist()
    # The number of a state, and of the view that shows it.
    _, n_ticks, n_delayed, n_pings = scene["shape"]
    block = np.arange(n_states) // len(model.position) // n_pings // n_delayed
    phase = np.array(scene["ticks"])[block % n_ticks]
    context = block // n_ticks * len(scene["phases"]) + phase
    assert (context == model.context).all()
    zones = np.array([[*map(int, view["zone"])] for view in scene["views"]])
    assert (zones[context, model.cell] == model.zone).all()


def test_what_is_seen_alike_is_written_once_and_large_tables_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    forms = {"one": ["index", "offset"], "other": ["index"]}
    data = written(experiment(tmp_path, "Moody", "Walking", **forms))
    places = [(agent["scene"], agent["sight"]) for agent in data["agents"]]
    assert places == [(0, 0), (0, 0), (0, 0), (1, 1), (1, 2), (1, 1)]
    observed = [sight["observed"] for sight in data["sights"]]
    assert observed == [["agent", "phase"], ["agent", "issuer"], ["offset"]]
    monkeypatch.setattr(explorer, "MAX_STATES", 3600)
    data = written(experiment(tmp_path, "Anywhere", "SixPlaces", "S1", table=["index"]))
    six, one = data["agents"]
    assert (six["values"], six["seeds"], len(six["steps"])) == (None, [0], 1)
    assert len(one["steps"]) == 3
