"""The native vector env against Gymnasium's `SyncVectorEnv`, and what is its business alone."""

import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import NDArray

from envs import OBSERVATIONS, InputError, ProxemicVectorEnv, load_scenario, scenario_names

MODES = tuple(AutoresetMode)


def sync_env(
    n: int, name: str, observation: str = "index", limit: int = -1, mode: AutoresetMode = MODES[0]
) -> SyncVectorEnv[Any, Any]:
    def make() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(
            f"envs:Proxemic/{name}-v0",
            observation=observation,
            max_episode_steps=limit,
            disable_env_checker=True,
        )

    return SyncVectorEnv([make] * n, autoreset_mode=mode)


def assert_same(ours: Any, theirs: Any) -> None:
    """Compares values, types, shapes and dtypes, at all depths."""
    assert data_equivalence(ours, theirs), (ours, theirs)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", scenario_names())
def test_batch_equals_gymnasiums(name: str, mode: AutoresetMode) -> None:
    n, limit = 5, 12
    observation = OBSERVATIONS[(scenario_names().index(name) + MODES.index(mode)) % len(OBSERVATIONS)]
    options: dict[str, Any] = {"max_episode_steps": limit, "autoreset_mode": mode}
    ours = gymnasium.make_vec(f"envs:Proxemic/{name}-v0", num_envs=n, observation=observation, **options)
    assert isinstance(ours, ProxemicVectorEnv)
    theirs = sync_env(n, name, observation, limit, mode)
    for space in ("single_observation_space", "observation_space", "single_action_space", "action_space"):
        assert getattr(ours, space) == getattr(theirs, space)
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    assert_same(ours.reset(seed=7), theirs.reset(seed=7))
    rng = np.random.default_rng(1)
    n_ends = n_resets = 0
    for _ in range(150):
        actions = rng.choice(5, size=n, p=[0.15, 0.15, 0.15, 0.15, 0.4])
        mine, its = ours.step(actions), theirs.step(actions)
        assert_same(mine, its)
        ended = its[2] | its[3]
        n_ends += int(ended.sum())
        mask = rng.random(n) < 0.1
        if mode is AutoresetMode.DISABLED:
            mask |= ended
        if mask.any():
            seeds = [int(s) if s < 50 else None for s in rng.integers(0, 100, n)]
            seed = None if rng.random() < 0.5 else seeds
            assert_same(
                ours.reset(seed=seed, options={"reset_mask": mask}),
                theirs.reset(seed=seed, options={"reset_mask": mask}),
            )
            n_resets += 1
        elif rng.random() < 0.05:
            assert_same(ours.reset(), theirs.reset())
    assert n_ends > 30
    assert n_resets > 30


def test_noise_equals_gymnasiums() -> None:
    ours, theirs = ProxemicVectorEnv(3, "S2"), sync_env(3, "S2")
    ours.reset(seed=[np.int64(5), 5, 2**70])  # type: ignore[list-item]
    theirs.reset(seed=[5, 5, 2**70])
    rng = np.random.default_rng(0)
    for _ in range(100):
        actions = rng.choice(5, size=3, p=[0.1, 0.1, 0.1, 0.1, 0.6])
        assert (ours.step(actions)[1] == theirs.step(actions)[1]).all()


def test_images_equal_gymnasiums() -> None:
    """In a scenario where agents differ in the place of the person, too."""
    options: dict[str, Any] = {"num_envs": 3, "render_mode": "rgb_array"}
    ours = gymnasium.make_vec("envs:Proxemic/Anywhere-v0", **options)
    theirs = gymnasium.make_vec("envs:Proxemic/Anywhere-v0", vectorization_mode="sync", **options)
    assert isinstance(ours, ProxemicVectorEnv)
    for env in (ours, theirs):
        env.reset(seed=3)
        env.step(np.array([1, 3, 4]))
    images: Any = ours.render()
    assert isinstance(images, tuple)
    assert [(each.shape, each.dtype) for each in images] == [((400, 480, 3), np.uint8)] * 3
    assert not (images[0] == images[1]).all()
    assert_same(images, theirs.render())
    assert ours.metadata["render_fps"] == theirs.metadata["render_fps"]


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


def test_spec_of_a_batch_is_json_and_makes_it_again() -> None:
    env = gymnasium.make_vec(
        "envs:Proxemic/S1-v0",
        num_envs=np.int64(4),  # type: ignore[arg-type]
        scenario=load_scenario("S3", {"issuer.position": [8, 6]}),
        autoreset_mode=AutoresetMode.SAME_STEP,
        max_episode_steps=9,
    )
    assert env.spec is not None
    again = gymnasium.make_vec(EnvSpec.from_json(env.spec.to_json()))
    assert isinstance(env, ProxemicVectorEnv)
    assert isinstance(again, ProxemicVectorEnv)
    assert again.num_envs == 4
    assert again.model is env.model
    assert again.metadata == env.metadata
    again.reset()
    truncated = [again.step(np.zeros(4, dtype=int))[3].all() for _ in range(9)]
    assert truncated == [False] * 8 + [True]


# Refusals


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"num_envs": 0}, "num_envs = 0"),
        ({"max_episode_steps": 0}, "max_episode_steps = 0"),
        ({"autoreset_mode": "Sometimes"}, "Sometimes; accepted: NextStep, SameStep, Disabled"),
        ({"render_mode": "human"}, "'human'; accepted for a batch: rgb_array or None; .*\"sync\""),
    ],
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


def test_without_autoreset_an_ended_episode_is_refused() -> None:
    env = ProxemicVectorEnv(3, max_episode_steps=1, autoreset_mode=AutoresetMode.DISABLED)
    env.reset()
    env.step(np.ones(3, int))
    env.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(InputError, match=r"envs \[1, 2\] are over"):
        env.step(np.ones(3, int))


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"seed": [1, 2, 3]}, "seed: 3 seeds"),
        ({"options": {"reset_mask": [True, False]}}, "reset_mask: list"),
        ({"options": {"reset_mask": np.array([1, 0])}}, r"reset_mask: int64 \(2,\)"),
        ({"options": {"reset_mask": np.ones(3, dtype=bool)}}, r"reset_mask: bool \(3,\)"),
        ({"options": {"reset_mask": np.zeros(2, dtype=bool)}}, "reset_mask: no env"),
    ],
)
def test_wrong_resets_are_refused(arguments: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicVectorEnv(2).reset(**arguments)
