"""All groups in a small room: dynamics, optimum and evaluation against a second implementation."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate, solve
from agents.process import process_of
from envs import EVENTS, Scenario, compile_scenario
from envs.inputs import override, parse, read_toml
from envs.observations import compile_seen
from envs.scenario import SCENARIO_DIRECTORY
from tests.envs.reference import Reference

HORIZON = 25
CIRCLE, RING = {"kind": "circle", "radius": 1}, {"kind": "ring", "width": 0.6}
ROOM: dict[str, Any] = {
    "name": "room", "grid.rows": 4, "grid.columns": 5, "grid.start": "anywhere", "ping_limit": 2,
    "observe": ["agent", "issuer"], "issuer.position": "anywhere", "issuer.feedback": {"kind": "distance"},
    "group": {"people": 2, "apart": [2, 2.3]},
    "regions": {"uncomfortable": CIRCLE, "target": CIRCLE | {"radius": 1.5}},
}  # fmt: skip
WALK = [{"position": [0, 1], "walk": {"corners": [[0, 3]]}}]
TALKING = {
    "grid.metres_per_cell": 0.5,
    "group": {"people": 3, "apart": [1.0, 1.5]},
    "regions": {"unit": "metres", "uncomfortable": CIRCLE | {"radius": 0.3}, "target": RING},
}
SCENES: dict[str, dict[str, Any]] = {
    "strangers": {},
    "three who talk": TALKING,
    "strangers and a bystander who walks": {"others": WALK, "ping_limit": 1},
}


def test_writing_out_in_chunks_makes_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    tables = override(
        read_toml(SCENARIO_DIRECTORY / "S1.toml"), ROOM | {"others": WALK, "grid.columns": 12}, "room"
    )
    model = compile_scenario(parse(Scenario, tables, "room"))
    whole = process_of(model)
    assert len(whole.outcomes) < len(model.observation)  # states share their outcomes
    for n_states in (1000, 777):
        monkeypatch.setattr("agents.process._STATES_AT_ONCE", n_states)
        chunked = process_of.__wrapped__(model)  # type: ignore[attr-defined]
        assert chunked.outcomes.tobytes() == whole.outcomes.tobytes()
        assert (chunked.first == whole.first).all()


@pytest.mark.parametrize("scene", SCENES)
def test_all_groups_of_a_small_room(scene: str) -> None:
    tables = override(read_toml(SCENARIO_DIRECTORY / "S1.toml"), ROOM | SCENES[scene], "room")
    reference, model = Reference(tables), compile_scenario(parse(Scenario, tables, "room"))
    assert [*model.scenario.layout.places] == reference.places
    shape = len(reference.places), len(reference.clock), 1, tables["ping_limit"], 4, 5
    n_states = math.prod(shape)
    assert len(model.observation) == n_states

    def index(state: tuple[Any, ...]) -> int:
        *rest, cell = state
        number = 0
        for value, size in zip((*rest, *cell), shape, strict=True):
            number = number * size + value
        return number

    assert model.starts.tolist() == [index(state) for state in reference.starts]
    following, ends = np.empty((n_states, 5), dtype=int), np.ones((n_states, 5), dtype=bool)
    reward, success = np.zeros((n_states, 5)), np.zeros((n_states, 5))
    for s in range(n_states):
        j, tick, _, pings, *cell = map(int, np.unravel_index(s, shape))
        following[s] = s
        if reference.zone(reference.places[j], reference.clock[tick], (cell[0], cell[1])) != "issuer":
            for a in range(5):
                states, facts = reference.step((j, tick, False, pings, (cell[0], cell[1])), a)
                (following[s, a],) = map(index, states)
                reward[s, a], ends[s, a] = facts[0] + facts[1], facts[3]
                success[s, a] = facts[4] == "target_ping"
    assert (model.next_state[:, :, 0] == following).all()
    assert (model.terminated == ends).all()
    assert (model.event == EVENTS.index("target_ping")).tolist() == (success == 1).tolist()
    assert model.grid_reward + model.issuer_reward == pytest.approx(reward)

    def swept(gain: NDArray[np.float64], policy: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Sweeps backwards from the horizon; without a policy, by the best actions."""
        value = np.zeros(n_states)
        for _ in range(HORIZON):
            q = gain + np.where(ends, 0.0, value[following])
            value = q.max(axis=1) if policy is None else (q * policy).sum(axis=1)
        return value

    assert solve(model, horizon=HORIZON).value == pytest.approx(swept(reward))
    for form in ("index", "two_nearest", "centre"):
        seen = compile_seen(model.scenario, form)
        policy = np.random.default_rng(1).dirichlet(np.ones(5), seen.n_observations)
        result, chances = evaluate(seen, policy, HORIZON), policy[seen.observation]
        expected = [swept(gain, chances)[model.starts].mean() for gain in (reward, success)]
        assert [result.scenario_return, result.success] == pytest.approx(expected)
