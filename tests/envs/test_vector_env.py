"""The native vector env against Gymnasium's `SyncVectorEnv`, and what is its business alone."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import VectorEnv

from envs import OBSERVATIONS, InputError, ProxemicVectorEnv, scenario_names
from tests.envs import Changes
from tests.support import few_places

MODES = "sync", "vector_entry_point"
ATTRIBUTES = {name for name in (*dir(VectorEnv), *VectorEnv.__annotations__) if name[0] != "_"}


def seen(env: Any) -> Changes:
    """Returns the public attributes that Gymnasium declares for vector envs, to compare."""
    values = {name: getattr(env, name) for name in ATTRIBUTES - {"unwrapped", "spec"}}
    values["np_random"] = [generator.bit_generator.state for generator in values["np_random"]]
    return {name: value for name, value in values.items() if not callable(value)}


def assert_same(ours: Any, theirs: Any) -> None:
    """Compares values, types, shapes and dtypes, at all depths."""
    assert data_equivalence(ours, theirs), (ours, theirs)


@pytest.mark.parametrize("name", scenario_names())
def test_batch_equals_gymnasiums(name: str) -> None:
    n, i = 5, scenario_names().index(name)
    options: Changes = {
        "num_envs": n,
        "observation": OBSERVATIONS[i % len(OBSERVATIONS)],
        "max_episode_steps": 12,
    }
    options |= {"render_mode": ["ansi", "rgb_array"][i % 2], "overrides": few_places(name)}
    made: Any = [
        gymnasium.make_vec(f"envs:Proxemic/{name}-v0", vectorization_mode=mode, **options)
        for mode in MODES
    ]
    assert isinstance(made[1], ProxemicVectorEnv)
    assert_same(*(env.reset(seed=7) for env in made))
    rng = np.random.default_rng(1)
    for _ in range(100):
        actions = rng.choice(5, size=n, p=[0.15, 0.15, 0.15, 0.15, 0.4])
        assert_same(*(env.step(actions) for env in made))
        if rng.random() < 0.1:
            seeds = [int(s) if s < 50 else None for s in rng.integers(0, 100, n)]
            seed: Any = [None, int(rng.integers(100)), seeds][rng.integers(3)]
            mask = rng.random(n) < 0.5
            mask[rng.integers(n)] = True
            for given in ({"reset_mask": mask}, [None, {}, {"another": 1}][rng.integers(3)]):
                assert_same(*(env.reset(seed=seed, options=given and dict(given)) for env in made))
                assert_same(*(env.render() for env in made))
                assert_same(*map(seen, made))


def test_batch_returns_copies() -> None:
    env = ProxemicVectorEnv(2, observation="one_hot")
    first, info = env.reset()
    start = first.copy()
    second, rewards, *_ = env.step(np.array([1, 3], dtype=np.int8))
    first[:] = 9
    info["_event"][:] = False
    assert info["_zone"].all()
    rewards_before = rewards.copy()
    third, *_ = env.step(np.array([1, 3]))
    assert (env.reset()[0] == start).all()
    assert (rewards == rewards_before).all()
    assert not np.shares_memory(second, third)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("limit", "expected"), [({}, [199]), ({"max_episode_steps": -1}, [])])
def test_registered_time_limit_and_how_to_lift_it(
    mode: str, limit: Changes, expected: list[int]
) -> None:
    env = gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=3, vectorization_mode=mode, **limit)
    up = np.zeros(3, dtype=int)  # into the wall: an episode without end
    with pytest.raises(ResetNeeded):
        env.step(up)
    env.reset(seed=0)
    assert np.flatnonzero([env.step(up)[3].all() for _ in range(201)]).tolist() == expected


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"num_envs": 0}, "num_envs = 0"),
        ({"max_episode_steps": "9"}, "max_episode_steps = '9'"),
        ({"render_mode": "human"}, "'human'; accepted: ansi, rgb_array"),
    ],
)
def test_wrong_batch_arguments_are_refused(arguments: Changes, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicVectorEnv(**arguments)


@pytest.mark.parametrize(
    ("act", "refused", "expected"),
    [
        (lambda env, actions: env.step(actions), [
            np.zeros(3, int), np.zeros(2), [0, -1], [0, 5], None,
        ], "actions = "),
        (lambda env, seed: env.reset(seed=seed), [[1, 2, 3], [0, -1], 1.5],
         "; accepted: None, a whole number from 0, or 2 of these, one per env."),
        (lambda env, mask: env.reset(seed=3, options={"reset_mask": mask}),
         [None, np.zeros(2, bool), np.ones(3, bool), np.ones(2, int)], "reset_mask"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(act: Any, refused: list[Any], expected: str) -> None:
    env = ProxemicVectorEnv(2)
    env.reset(seed=0)
    for value in refused:
        with pytest.raises(InputError) as caught:
            act(env, value)
        assert expected in str(caught.value)
        assert env.np_random_seed == (0, 1)
