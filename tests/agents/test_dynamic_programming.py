"""Exact values against hand arithmetic, a linear programme and a backward sweep."""

from typing import Any

import numpy as np
import pytest
from scipy import optimize, sparse

from agents.dynamic_programming import evaluate, solve
from envs import EVENTS, ZONES, Model, compile_scenario, load_scenario
from envs.arrays import Floats
from envs.observations import compile_seen
from tests.agents import Changes


def model_of(name: str, **overrides: Any) -> Model:
    return compile_scenario(load_scenario(name, overrides))


def linear_programme(model: Model, discount: float) -> Floats:
    """Optimal values by the primal linear programme (Puterman 1994, section 6.9.1)."""
    n_states, n_actions, _ = model.next_state.shape
    rows = np.arange(n_states * n_actions)
    state = rows // n_actions
    following = model.next_state.ravel()
    matrix = sparse.coo_array((np.ones(len(rows)), (rows, state)), shape=(len(rows), n_states))
    bootstrap = discount * ~model.terminated.ravel()
    matrix = matrix - sparse.coo_array((bootstrap, (rows, following)), shape=matrix.shape)
    reward = (model.grid_reward + model.issuer_reward).ravel()
    solution = optimize.linprog(np.ones(n_states), -matrix.toarray(), -reward, bounds=(None, None))
    assert solution.success
    return np.asarray(solution.x)


@pytest.mark.parametrize(("name", "discount"), [("S1", 0.5), ("S2", 0.9), ("S3", 0.9)])
def test_optimum_equals_linear_programme(name: str, discount: float) -> None:
    model = model_of(name)
    assert solve(model, discount).value == pytest.approx(
        linear_programme(model, discount), abs=1e-7
    )


def test_optimum_by_hand() -> None:
    # Ten moves and a PING: 10 * (-0.1) + 1 = 0, and discounted
    # -0.1 * (1 - 0.9**10) / 0.1 + 0.9**10 = 2 * 0.9**10 - 1.
    model = model_of("S1")
    assert solve(model, 1.0, 200, issuer_rewards=False).value[0] == pytest.approx(0.0, abs=1e-12)
    assert solve(model, 0.9).value[0] == pytest.approx(2 * 0.9**10 - 1)
    # Ten moves leave no time for a PING. Bumping a wall costs as much as moving, so -0.1 per step.
    assert solve(model, 1.0, 10).value[0] == pytest.approx(-1.0)
    assert solve(model, 1.0, 11).value[0] == pytest.approx(0.0, abs=1e-12)
    # The nearest corner of the target region has L1 distance 4 from the issuer: -1 + 1 - 4/14. A
    # step nearer costs 0.1 and saves only 1/14.
    assert solve(model_of("S3"), 1.0, 200).value[0] == pytest.approx(-4 / 14)


def test_evaluation_by_hand() -> None:
    model = model_of("S1")
    always = np.zeros((4, 120, 5))
    always[0, :, 0] = 1  # UP against the wall until the horizon
    always[1, :, 4] = 1  # five wrong PINGs
    always[2, :, 3] = 1  # along the upper edge
    always[3, :, 1] = 1  # DOWN to row 6 ...
    always[3, 6 * 12 : 6 * 12 + 12] = np.eye(5)[3]  # ... and there to the RIGHT, into the issuer
    result = evaluate(model, always, 50)
    assert result.grid_return == pytest.approx([-5.0, -2.6, -5.0, -6 * 0.1 - 6 * 0.1 - 0.8 - 1.0])
    assert result.steps == pytest.approx([50, 5, 50, 14])
    assert result.success.tolist() == [0, 0, 0, 0]
    assert result.wrong_pings == pytest.approx([0, 5, 0, 0])
    assert result.zone_steps[3] == pytest.approx([11, 1, 1, 1])
    assert evaluate(model, always[1], 3).grid_return == pytest.approx(-1.2)


def backward(model: Model, policy: Floats, horizon: int) -> Floats:
    """All expectations from the start, (5 + zones,), by backward sweeps of Bellman's operator."""
    zones = [
        ((model.zone[model.next_state] == z) * model.probability).sum(2) for z in range(len(ZONES))
    ]
    gains = np.stack(
        [
            model.grid_reward,
            model.grid_reward + model.issuer_reward,
            model.event == EVENTS.index("target_ping"),
            np.ones(model.event.shape),
            np.isin(model.event, [EVENTS.index("wrong_ping"), EVENTS.index("last_wrong_ping")]),
            *zones,
        ]
    )
    totals = np.zeros((len(gains), len(model.observation)))
    for _ in range(horizon):
        following = (totals[:, model.next_state] * model.probability).sum(axis=-1)
        totals = (policy[model.observation] * (gains + ~model.terminated * following)).sum(axis=2)
    return np.asarray(totals[:, model.starts].mean(axis=1))


CIRCLE = {"kind": "circle", "radius": 1}
ROOM: Changes = {
    "grid.rows": 4, "grid.columns": 5, "grid.start": "anywhere", "ping_limit": 2,
    "observe": ["agent", "issuer"], "issuer.position": "anywhere",
    "group": {"people": 2, "apart": [2, 2.3]},
    "regions": {"uncomfortable": CIRCLE, "target": CIRCLE | {"radius": 1.5}},
}  # fmt: skip
WALK = {"others": [{"position": [0, 1], "walk": {"corners": [[0, 3]]}}], "ping_limit": 1}
PHASES: list[Changes] = [
    {"name": "calm", "next": {"tense": 0.3}},
    {"name": "tense", "heading": "up", "next": {}},
]
TALKING = {"group": {"people": 3, "apart": [2, 3]}, "regions.target": {"kind": "ring", "width": 1}}


@pytest.mark.parametrize("form", ["index", "offset"])
@pytest.mark.parametrize(
    "scene", [{}, WALK, {"phases": PHASES}, TALKING], ids=["strangers", "walk", "moods", "talking"]
)
def test_evaluation_of_groups_equals_backward_sweep(scene: Changes, form: str) -> None:
    model = compile_seen(load_scenario("S1", ROOM | scene), form)
    policy = np.random.default_rng(1).dirichlet(np.ones(5), model.n_observations)
    found = evaluate(model, policy, 25)
    sums = [found.grid_return, found.scenario_return, found.success, found.steps, found.wrong_pings]
    assert [*sums, *found.zone_steps] == pytest.approx(backward(model, policy, 25), abs=1e-9)
