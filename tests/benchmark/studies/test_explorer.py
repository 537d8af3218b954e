"""What the explorer is given, of learners that are made up number by number."""

import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.analysis.records import Records
from benchmark.studies import explorer
from benchmark.studies.explorer import FILE, MAX_MASKS, write
from envs import ACTIONS, load_scenario
from envs.observations import compile_seen
from tests.benchmark.populations import population as blank

UP, RIGHT, PING = (1 << ACTIONS.index(name) for name in ("UP", "RIGHT", "PING"))


def population(n: int = 120) -> Records:
    """Returns agents with maps at steps 0, 100, 200, 300; those between are policies alone."""
    values = np.zeros((n, 4, 120, 5), dtype=np.float32)
    values[0, 2, 13] = (0.12345, -0.5, 0.25, np.nan, 2.0)  # row 1, column 1
    values[0, 3, 13] = (1e9, -0.5, 0.25, 0, -2.0)
    values[1:] = 99
    greedy = np.full((n, 7, 120), RIGHT, dtype=np.uint8)
    greedy[0, 6, 13] = UP | PING
    greedy[:, 1::2] = PING  # between the maps
    success = np.tile(np.arange(n)[:, None] / n, 7)
    made = blank(n=n, budget=300, every=50, map_every=100, values=values, greedy=greedy, success=success)
    return replace(made, runs=[run.with_seed(run.seed + 4) for run in made.runs])


def masks(text: str) -> NDArray[np.uint8]:
    return (np.frombuffer(text.encode(), np.uint8) - ord("0")).reshape(-1, 120)


def written(folder: Path, *shown: Records) -> dict[str, Any]:
    """Returns the explorer's data as they are written."""
    write(shown, folder / FILE)
    return dict(json.loads(gzip.decompress((folder / FILE).read_bytes())))


def test_first_agent_over_training_and_the_final_policies_of_others(tmp_path: Path) -> None:
    data = written(tmp_path, population(), population())
    content = (tmp_path / FILE).read_bytes()
    written(tmp_path, population(), population())
    assert (tmp_path / FILE).read_bytes() == content
    assert (len(data["scenes"]), len(data["sights"])) == (1, 1)  # which both share
    agent = data["agents"][1]
    assert [agent[key] for key in ("variant", "kind", "scene", "sight")] == ["q_learning", "q", 0, 0]
    assert agent["steps"] == [0, 200, 300]  # every second map, and the last
    values = np.array(agent["values"]).reshape(3, 120, 5).cumsum(axis=0)
    assert values[1, 13].tolist() == [123, -500, 250, data["no_number"], 2000]
    assert values[2, 13].tolist() == [2**31 - 1, -500, 250, 0, -2000]  # clipped
    assert not values[0].any()
    greedy = masks(agent["greedy"])
    assert (greedy[2, 13], {*np.delete(greedy.ravel(), 2 * 120 + 13)}) == (UP | PING, {RIGHT})
    assert agent["seeds"] == [4, 5, 6, 7]
    assert MAX_MASKS == 4 * 120
    assert agent["others"]["success"] == pytest.approx([1 / 120, 2 / 120, 3 / 120], abs=1e-6)
    assert np.unique(masks(agent["others"]["greedy"])).tolist() == [RIGHT]


@pytest.mark.parametrize("name", ["Turning", "Moody", "Walking", "Walls", "TwoPeople", "Delayed", "Anywhere"])
def test_a_scenario_is_unpacked_as_it_was_compiled(name: str, tmp_path: Path) -> None:
    data = written(tmp_path, blank(name, 1, observation="offset"))
    model, scene = compile_seen(load_scenario(name), "offset"), data["scenes"][0]
    n_states, shape = len(model.observation), model.next_state.shape
    kind = np.array(scene["kind"])
    kinds = {
        key: np.array(values).reshape(kind.max() + 1, -1)[kind] for key, values in scene["kinds"].items()
    }
    change = kinds["change"].reshape(shape)
    assert (change + np.arange(n_states)[:, None, None] == model.next_state).all()
    assert (kinds["probability"].reshape(shape) == model.probability).all()
    for key in ("grid_reward", "issuer_reward", "terminated", "event"):
        assert (kinds[key] == getattr(model, key)).all()
    assert (kinds["over"][:, 0] == model.is_over).all()
    assert (np.cumsum(data["sights"][0]["changes"]) == model.observation).all()
    # The number of a state, and of the view that shows it.
    _, n_ticks, n_delayed, n_pings = scene["shape"]
    block = np.arange(n_states) // len(model.position)
    tick, position = block // n_pings // n_delayed % n_ticks, block // n_pings // n_delayed // n_ticks
    context = position * len(scene["phases"]) + np.array(scene["ticks"])[tick]
    assert (context == model.context).all()
    zones = np.array([[*map(int, view["zone"])] for view in scene["views"]])
    assert (zones[context, model.cell] == model.zone).all()
    for cell, view in zip(model.scenario.layout.places, scene["views"][:: len(scene["phases"])], strict=True):
        assert divmod(view["glyphs"][0]["cell"], scene["columns"]) == cell[0]
    assert scene["walls"] == np.flatnonzero(model.scenario.grid.is_wall).tolist()


def test_very_large_scenarios_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of six places, with 600 states each."""
    monkeypatch.setattr(explorer, "MAX_STATES", 3599)
    (agent,) = written(tmp_path, blank("SixPlaces", 1), blank(n=1))["agents"]
    assert agent["scenario"] == "S1"
    write([blank("SixPlaces", 1)], tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_scenarios_that_differ_in_what_is_seen_share_a_scene(tmp_path: Path) -> None:
    forms = [("Moody", "index"), ("MoodyHidden", "index"), ("Walking", "index"), ("Walking", "offset")]
    data = written(tmp_path, *(blank(name, 1, observation=form) for name, form in forms))
    assert [(agent["scene"], agent["sight"]) for agent in data["agents"]] == [(0, 0), (0, 1), (1, 2), (1, 3)]
    observed = [sight["observed"] for sight in data["sights"]]
    assert observed == [["agent", "phase"], ["agent"], ["agent", "issuer"], ["offset"]]


def test_large_tables_of_values_are_left_out(tmp_path: Path) -> None:
    data = written(tmp_path, *(blank("Anywhere", 3, observation=form) for form in ("index", "offset")))
    assert [agent["values"] is None for agent in data["agents"]] == [True, False]
    assert [len(agent["steps"]) for agent in data["agents"]] == [1, 3]
    assert [agent["seeds"] for agent in data["agents"]] == [[0], [0]]
    assert (data["agents"][0]["greedy"], data["agents"][0]["others"]["greedy"]) == ("O" * 13320, "")
