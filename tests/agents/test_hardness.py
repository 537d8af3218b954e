"""Measures of how hard a scenario is, by second methods: simulation, brute force and hand arithmetic."""

import numpy as np
import pytest

from agents.dynamic_programming import solve
from agents.hardness import COVERED, hardness
from envs import Model, load_scenario
from envs.model import ACTIONS
from envs.observations import compile_seen

HORIZON = 60
SMALL = {"grid.rows": 5, "grid.columns": 6, "issuer.places": 3, "draw": 1}


def model_of(observation: str, **more: object) -> Model:
    return compile_seen(load_scenario("Anywhere", SMALL | more), observation)


def test_covering_steps_by_simulation() -> None:
    model = model_of("index")
    rng = np.random.default_rng(1)
    n_steps = 200_000
    visits = np.zeros(model.n_observations)
    state, step = int(rng.choice(model.starts)), 0
    for _ in range(n_steps):
        visits[model.observation[state]] += 1
        action, step = int(rng.integers(len(ACTIONS))), step + 1
        if model.terminated[state, action] or step == HORIZON:
            state, step = int(rng.choice(model.starts)), 0
        else:
            state = int(model.next_state[state, action, 0])
    rate = visits[visits > 0] / n_steps / len(ACTIONS)
    found = hardness(model, HORIZON).covering_steps
    assert (1 - np.exp(-found * rate)).mean() == pytest.approx(COVERED, abs=0.02)


def test_solvable_k_by_brute_force() -> None:
    model = model_of("index")
    best = solve(model, horizon=HORIZON)
    reward = model.grid_reward + model.issuer_reward

    def backed_up(value: np.ndarray) -> np.ndarray:
        return reward + np.where(model.terminated, 0.0, value[model.next_state[:, :, 0]])

    value = np.zeros(len(reward))
    for _ in range(HORIZON):
        q = backed_up(value)
        value = q.mean(axis=1)
    optimum = best.value[model.starts].mean()
    k = 1
    while True:
        # The exact return of acting greedily, as if the agent saw its state.
        total, going = np.zeros(len(reward)), np.arange(len(reward))
        is_over = np.zeros(len(reward), dtype=bool)
        for _ in range(HORIZON):
            action = q.argmax(axis=1)[going]
            total += np.where(is_over, 0.0, reward[going, action])
            is_over |= model.terminated[going, action]
            going = model.next_state[going, action, 0]
        if total[model.starts].mean() == pytest.approx(optimum, abs=1e-9):
            break
        q, k = backed_up(q.max(axis=1)), k + 1
    assert hardness(model, HORIZON).solvable_k == k > 1


def test_random_outcomes_are_refused() -> None:
    with pytest.raises(ValueError, match="random"):
        hardness(compile_seen(load_scenario("Moody"), "index"), HORIZON)
