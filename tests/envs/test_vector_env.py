"""The native vector env against Gymnasium's `SyncVectorEnv`, and what is its business alone."""

import pickle
from typing import Any, Final

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from envs import OBSERVATIONS, InputError, ProxemicVectorEnv, scenario_names
from tests.support import few_places

MODES: Final = "sync", "vector_entry_point"
NAMES: Final = {name for name in {*dir(VectorEnv), *VectorEnv.__annotations__} if not name.startswith("_")}


def seen(env: Any) -> dict[str, Any]:
    """Returns the public attributes that Gymnasium declares for vector envs, as values to compare."""
    values = {name: getattr(env, name) for name in NAMES} | {"autoreset_mode": env.unwrapped.autoreset_mode}
    assert values.pop("unwrapped") is env
    values["spec"] = values["spec"].id
    values["np_random"] = [generator.bit_generator.state for generator in values["np_random"]]
    return {name: value for name, value in values.items() if not callable(value)}


def assert_same(ours: Any, theirs: Any) -> None:
    """Compares values, types, shapes and dtypes, at all depths."""
    assert data_equivalence(ours, theirs), (ours, theirs)


@pytest.mark.parametrize("name", scenario_names())
def test_batch_equals_gymnasiums(name: str) -> None:
    n = 5
    observation = OBSERVATIONS[scenario_names().index(name) % len(OBSERVATIONS)]
    options: dict[str, Any] = {"num_envs": n, "observation": observation, "max_episode_steps": 12}
    options["render_mode"] = ["ansi", "rgb_array"][scenario_names().index(name) % 2]
    options["overrides"] = few_places(name)
    ours = gymnasium.make_vec(f"envs:Proxemic/{name}-v0", **options)
    theirs = gymnasium.make_vec(f"envs:Proxemic/{name}-v0", vectorization_mode="sync", **options)
    assert isinstance(ours, ProxemicVectorEnv)
    assert isinstance(theirs, SyncVectorEnv)
    assert ours.metadata["autoreset_mode"] is ours.unwrapped.autoreset_mode is AutoresetMode.NEXT_STEP
    assert_same(ours.reset(seed=7), theirs.reset(seed=7))
    rng = np.random.default_rng(1)
    n_ends = n_resets = 0
    for _ in range(100):
        actions = rng.choice(5, size=n, p=[0.15, 0.15, 0.15, 0.15, 0.4])
        mine, its = ours.step(actions), theirs.step(actions)
        assert_same(mine, its)
        n_ends += int((its[2] | its[3]).sum())
        if rng.random() < 0.15:
            seeds = [int(s) if s < 50 else None for s in rng.integers(0, 100, n)]
            seed: Any = [None, int(rng.integers(100)), seeds, tuple(seeds)][rng.integers(4)]
            mask = rng.random(n) < 0.5
            mask[rng.integers(n)] = True
            for given in ({"reset_mask": mask}, [None, {}, {"another": 1}][rng.integers(3)]):
                # The other env takes the mask out of what it is given.
                both_envs: Any = (ours, theirs)
                assert_same(*(env.reset(seed=seed, options=given and dict(given)) for env in both_envs))
                assert_same(ours.render(), theirs.render())
                assert_same(seen(ours), seen(theirs))
            n_resets += 1
    assert n_ends > 15
    assert n_resets > 4
    ours.close()
    theirs.close()
    assert_same(seen(ours), seen(theirs))


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
    env = ProxemicVectorEnv(np.int64(3), "S2", "coordinates")  # type: ignore[arg-type]
    env.reset(seed=np.array([4, 5, 6], dtype=kind))
    env.step(np.array([1, 3, 4], dtype=kind))
    copied = pickle.loads(pickle.dumps(env))
    assert_same(copied.step(np.array([4, 4, 4])), env.step(np.array([4, 4, 4], dtype=kind)))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("limit", "expected"), [({}, [199]), ({"max_episode_steps": -1}, [])])
def test_registered_time_limit_and_how_to_lift_it(
    mode: str, limit: dict[str, Any], expected: list[int]
) -> None:
    env = gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=3, vectorization_mode=mode, **limit)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(3, dtype=int))
    env.reset(seed=0)
    up = np.zeros(3, dtype=int)  # into the wall: an episode without end
    assert np.flatnonzero([env.step(up)[3].all() for _ in range(201)]).tolist() == expected


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"num_envs": 0}, "num_envs = 0"),
        ({"max_episode_steps": "9"}, "max_episode_steps = '9'"),
        ({"render_mode": "human"}, "'human'; accepted: ansi, rgb_array"),
    ],
)
def test_wrong_batch_arguments_are_refused(arguments: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicVectorEnv(**arguments)


SEEDS: Final = "; accepted: None, a whole number from 0, or 2 of these, one per env."


@pytest.mark.parametrize(
    ("act", "refused", "expected"),
    [
        (lambda env, actions: env.step(actions), [
            np.zeros(3, int), np.zeros(2), np.zeros((2, 1), int), np.array([0, -1]), np.array([0, 5]),
            0, None, [1], [1.0, 2], [None, 1], "12",
        ], "actions = "),
        (lambda env, seed: env.reset(seed=seed), [
            [1, 2, 3], -1, [0, -1], 1.5, [None, "2"], np.array([1.0, 2.0]),
        ], SEEDS),
        (lambda env, mask: env.reset(seed=3, options={"reset_mask": mask}), [
            None, [True, False], np.zeros(2, bool), np.ones(3, bool), np.ones(2, int),
        ], "reset_mask"),
    ],
)  # fmt: skip
def test_what_gymnasiums_env_refuses_is_refused(act: Any, refused: list[Any], expected: str) -> None:
    for value in refused:
        for mode in MODES:
            env = gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=2, vectorization_mode=mode)
            env.reset(seed=0)
            with pytest.raises(InputError if mode != "sync" else Exception) as caught:
                act(env, value)
        assert expected in str(caught.value)
        seeds: Any = env.np_random_seed
        assert seeds == (0, 1)
