"""The native vector env against Gymnasium's `SyncVectorEnv`, and what is its business alone."""

import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import SyncVectorEnv
from numpy.typing import NDArray

from envs import OBSERVATIONS, InputError, ProxemicVectorEnv, scenario_names
from tests.support import few_places


def assert_same(ours: Any, theirs: Any) -> None:
    """Compares values, types, shapes and dtypes, at all depths."""
    assert data_equivalence(ours, theirs), (ours, theirs)


@pytest.mark.parametrize("name", scenario_names())
def test_batch_equals_gymnasiums(name: str) -> None:
    n = 5
    observation = OBSERVATIONS[scenario_names().index(name) % len(OBSERVATIONS)]
    options: dict[str, Any] = {"num_envs": n, "observation": observation, "max_episode_steps": 12}
    options["overrides"] = few_places(name)
    ours = gymnasium.make_vec(f"envs:Proxemic/{name}-v0", **options)
    theirs = gymnasium.make_vec(f"envs:Proxemic/{name}-v0", vectorization_mode="sync", **options)
    assert isinstance(ours, ProxemicVectorEnv)
    assert isinstance(theirs, SyncVectorEnv)
    for space in ("single_observation_space", "observation_space", "single_action_space", "action_space"):
        assert getattr(ours, space) == getattr(theirs, space)
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    assert_same(ours.reset(seed=7), theirs.reset(seed=7))
    rng = np.random.default_rng(1)
    n_ends = n_resets = 0
    for _ in range(400):
        actions = rng.choice(5, size=n, p=[0.15, 0.15, 0.15, 0.15, 0.4])
        mine, its = ours.step(actions), theirs.step(actions)
        assert_same(mine, its)
        n_ends += int((its[2] | its[3]).sum())
        if rng.random() < 0.05:
            seeds = [int(s) if s < 50 else None for s in rng.integers(0, 100, n)]
            seed = None if rng.random() < 0.5 else seeds
            assert_same(ours.reset(seed=seed), theirs.reset(seed=seed))
            n_resets += 1
    assert n_ends > 30
    assert n_resets > 5


def test_batch_returns_copies() -> None:
    env = ProxemicVectorEnv(2, observation="one_hot")
    first, info = env.reset()
    start = first.copy()
    second, rewards, *_ = env.step(np.array([1, 3]))
    first[:] = 9
    info["_event"][:] = False
    assert info["_zone"].all()
    rewards_before = rewards.copy()
    third, *_ = env.step(np.array([1, 3]))
    assert (env.reset()[0] == start).all()
    assert (rewards == rewards_before).all()
    assert not np.shares_memory(second, third)


@pytest.mark.parametrize("kind", [np.uint64, np.int8])
def test_batch_takes_any_integers_and_pickles(kind: type) -> None:
    env = ProxemicVectorEnv(3, "S2", "coordinates")
    env.reset(seed=4)
    env.step(np.array([1, 3, 4], dtype=kind))
    copied = pickle.loads(pickle.dumps(env))
    assert_same(copied.step(np.array([4, 4, 4])), env.step(np.array([4, 4, 4], dtype=kind)))


# Making


@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
def test_registered_time_limit_and_how_to_lift_it(mode: str) -> None:
    up = np.zeros(3, dtype=int)  # into the wall: an episode without end
    cases: list[tuple[dict[str, Any], list[int]]] = [({}, [199]), ({"max_episode_steps": -1}, [])]
    for arguments, expected in cases:
        env = gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=3, vectorization_mode=mode, **arguments)
        env.reset(seed=0)
        truncated = [env.step(up)[3].all() for _ in range(201)]
        assert np.flatnonzero(truncated).tolist() == expected


# Refusals


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [({"num_envs": 0}, "num_envs = 0"), ({"max_episode_steps": 0}, "max_episode_steps = 0")],
)
def test_wrong_batch_arguments_are_refused(arguments: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicVectorEnv(**arguments)


@pytest.mark.parametrize(
    "actions", [np.zeros(3, int), np.zeros(2), np.zeros((2, 1), int), np.array([0, -1]), np.array([0, 5])]
)
def test_wrong_actions_are_refused(actions: NDArray[Any]) -> None:
    with pytest.raises(InputError, match=r"^actions: "):
        ProxemicVectorEnv(2).step(actions)


def test_wrong_number_of_seeds_is_refused() -> None:
    with pytest.raises(InputError, match="seed: 3 seeds"):
        ProxemicVectorEnv(2).reset(seed=[1, 2, 3])
