"""Env, vector env, planner and kernel agree step by step on the same actions and draws."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from agents.sb3.vec_env import SB3VecEnv
from envs import EVENTS, ProxemicVectorEnv, compile_scenario, load_scenario

SCENARIOS = ("S1", "S2", "S3")
MOVED = {"issuer.position": [8, 6], "rewards.wrong_ping_uncomfortable": -0.8}
NOISY_MOODS = {"issuer.feedback": {"kind": "noisy", "noise": 0.5}}
CASES = [
    *((name, overrides) for name in SCENARIOS for overrides in ({}, MOVED)),
    *((name, {}) for name in ("AnyStart", "Delayed", "Moody", "TwoPeople", "Walking")),
    ("Moody", NOISY_MOODS),  # draws three numbers: for a start, for noise, then for the outcome
]


def wandering(rng: np.random.Generator, n: int) -> NDArray[np.int64]:
    """Actions that drift towards the issuer, so that every region is met."""
    return rng.choice(5, size=n, p=[0.12, 0.28, 0.12, 0.33, 0.15])


@pytest.mark.parametrize(("name", "overrides"), CASES)
def test_env_batch_and_planner_walk_together(name: str, overrides: dict[str, Any]) -> None:
    env = gymnasium.make(f"envs:Proxemic/{name}-v0", overrides=overrides, max_episode_steps=-1)
    single = ProxemicVectorEnv(1, name, overrides=overrides, autoreset_mode="SameStep")
    model = compile_scenario(load_scenario(name, overrides))
    env.reset(seed=11)
    single.reset(seed=11)
    draws = np.random.default_rng(11)

    def start() -> int:
        n_starts = len(model.starts)
        return int(model.starts[int(draws.random() * n_starts)]) if n_starts > 1 else model.start

    state = start()
    met = set()
    for action in wandering(np.random.default_rng(0), 5000):
        observation, reward, terminated, truncated, info = env.step(int(action))
        batch = single.step(np.array([action]))
        # The planner's arrays, with the env's next draw.
        uniform = draws.random() if model.is_noisy else 0.5
        issuer = model.issuer_reward[state, action] + model.issuer_noise[state, action] * (2 * uniform - 1)
        chances = model.probability[state, action].cumsum()
        outcome = int((chances[:-1] <= draws.random()).sum()) if model.n_outcomes > 1 else 0
        following = model.next_state[state, action, outcome]
        assert (observation, terminated, truncated) == (
            model.observation[following],
            model.terminated[state, action],
            False,
        )
        assert reward == model.grid_reward[state, action] + issuer
        outcomes = env.unwrapped.P[state][action]  # type: ignore[attr-defined]
        probability, p_following, p_reward, p_terminated = outcomes[outcome]
        assert (probability, p_following) == (model.probability[state, action, outcome], following)
        assert p_terminated == terminated
        if not model.is_noisy:
            assert p_reward == reward
        batch_info = batch[4]["final_info"] if terminated else batch[4]
        batch_observation = batch[4]["final_obs"] if terminated else batch[0]
        assert batch_observation[0] == observation
        assert (batch[1][0], batch[2][0], batch[3][0]) == (reward, terminated, False)
        assert {key: values[0] for key, values in batch_info.items() if not key.startswith("_")} == info
        assert info["event"] == model.event[state, action]
        assert info["zone"] == model.zone[following]
        assert info["wrong_pings"] == model.wrong_pings[state, action]
        met.add(EVENTS[info["event"]])
        state = following
        if terminated:
            env.reset()
            state = start()
    assert met == set(EVENTS) - {"none"}


def test_batch_for_stable_baselines3_has_a_single_generator() -> None:
    """The published runs' noise: n draws per step from the generator of the seed, whatever has ended."""
    n, seed = 5, 2**65 + 1
    model = compile_scenario(load_scenario("S2"))
    env = SB3VecEnv(ProxemicVectorEnv(n, "S2", max_episode_steps=9, autoreset_mode="SameStep"))
    env.seed(seed)
    env.reset()
    draws = np.random.default_rng(seed)
    state, steps = np.full(n, model.start), np.zeros(n, dtype=int)
    n_ends = 0
    for actions in wandering(np.random.default_rng(2), 300 * n).reshape(300, n):
        _, rewards, dones, _ = env.step(actions)
        noise = model.issuer_noise[state, actions] * (2 * draws.random(n) - 1)
        expected = model.grid_reward[state, actions] + noise
        assert (rewards == expected.astype(np.float32)).all()
        steps += 1
        over = model.terminated[state, actions] | (steps == 9)
        assert (dones == over).all()
        state = np.where(over, model.start, model.next_state[state, actions, 0])
        steps[over] = 0
        n_ends += over.sum()
    assert n_ends > 100
