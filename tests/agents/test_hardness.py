"""Measures of how hard a scenario is, by second methods: simulation, brute force and hand arithmetic."""

import numpy as np
import pytest

from agents.dynamic_programming import evaluate, solve
from agents.hardness import COVERED, REGULARISER, hardness
from agents.policy import uniform_policy
from envs import Model, load_scenario
from envs.model import ACTIONS
from envs.observations import compile_seen, observation_table

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
    found = hardness(model, "index", HORIZON).covering_steps
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
    assert hardness(model, "index", HORIZON).solvable_k == k > 1


def test_gaps_and_errors_by_brute_force() -> None:
    model = model_of("coordinates")
    found = hardness(model, "coordinates", HORIZON)
    q = solve(model, horizon=HORIZON).q
    # The random policy reaches every cell from which it can still act.
    reached = {int(state) for state in model.starts}
    todo = [*reached]
    while todo:
        state = todo.pop()
        for action in range(len(ACTIONS)):
            following = int(model.next_state[state, action, 0])
            if not model.terminated[state, action] and following not in reached:
                reached.add(following)
                todo.append(following)
    fresh = [int(state) for state in model.fresh_state if int(state) in reached]
    gaps = [gap for state in fresh for gap in q[state].max() - q[state] if gap > 1e-9]
    assert found.reciprocal_gaps == pytest.approx(sum(1 / max(gap, REGULARISER) for gap in gaps))
    table = observation_table(model, "coordinates").astype(float)
    best = {state: {a for a in range(len(ACTIONS)) if q[state, a] > q[state].max() - 1e-9} for state in fresh}
    for is_elsewhere, error in ((True, found.error_across_places), (False, found.error_nearby)):
        wrong = []
        for state in fresh:
            others = [
                other
                for other in fresh
                if other != state and not (is_elsewhere and model.context[other] == model.context[state])
            ]
            far = {
                other: float(
                    np.linalg.norm(table[model.observation[other]] - table[model.observation[state]])
                )
                for other in others
            }
            nearest = [other for other in others if far[other] <= min(far.values()) + 1e-9]
            wrong.append(np.mean([1 - len(best[state] & best[o]) / len(best[o]) for o in nearest]))
        assert error == pytest.approx(float(np.mean(wrong)))


def test_what_a_table_is_given_does_not_count_as_near() -> None:
    found = hardness(model_of("index"), "index", HORIZON)
    assert np.isnan([found.error_across_places, found.error_nearby]).all()
    alone = hardness(model_of("coordinates", **{"issuer.places": 1}), "coordinates", HORIZON)
    assert np.isnan(alone.error_across_places)
    assert alone.error_nearby > 0
    # Permuting changes what is near, and nothing else.
    plain, permuted = (
        hardness(model_of("coordinates", **{"issuer.permuted": share}), "coordinates", HORIZON)
        for share in (0.0, 1.0)
    )
    assert plain[:3] == permuted[:3]
    assert plain.error_across_places != permuted.error_across_places


def test_random_outcomes_are_refused() -> None:
    with pytest.raises(ValueError, match="random"):
        hardness(compile_seen(load_scenario("Moody"), "index"), "index", HORIZON)
    uniform = evaluate(model_of("index"), uniform_policy(model_of("index")), HORIZON)
    assert 0 < uniform.success < 1
