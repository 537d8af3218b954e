"""A batch of envs: as `gymnasium.make_vec` makes it, and its arguments."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from envs import InputError, ProxemicVectorEnv
from tests.envs import Changes


def test_batch_equals_gymnasiums() -> None:
    options: Changes = {"num_envs": 5, "observation": "one_hot", "max_episode_steps": 12}
    made: Any = [
        gymnasium.make_vec("envs:Proxemic/S2-v0", vectorization_mode=mode, **options)
        for mode in ("sync", "vector_entry_point")
    ]
    assert isinstance(made[1], ProxemicVectorEnv)
    ours, theirs = (env.reset(seed=7)[0] for env in made)
    assert np.array_equal(ours, theirs)
    rng = np.random.default_rng(1)
    for _ in range(100):
        actions = rng.choice(5, size=5, p=[0.15, 0.15, 0.15, 0.15, 0.4])
        for ours, theirs in zip(*(env.step(actions)[:4] for env in made), strict=True):
            assert np.array_equal(ours, theirs)


def test_gymnasiums_own_batches_take_its_modes_and_tell_mistakes() -> None:
    batch = gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=2, autoreset_mode="Disabled")
    assert batch.metadata["autoreset_mode"] == AutoresetMode.DISABLED
    batch.reset(options={"minari_autoseed": True})
    # `AsyncVectorEnv` makes an error of the error that a worker raised.
    assert str(InputError(InputError("a; accepted: b."))) == "a; accepted: b."


@pytest.mark.parametrize(("limit", "expected"), [({}, [199]), ({"max_episode_steps": -1}, [])])
def test_registered_time_limit_and_how_to_lift_it(limit: Changes, expected: list[int]) -> None:
    env = gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=3, **limit)
    env.reset(seed=0)
    up = np.zeros(3, dtype=int)  # into the wall: an episode without end
    assert np.flatnonzero([env.step(up)[3].all() for _ in range(201)]).tolist() == expected


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"num_envs": 0}, "num_envs = 0"),
        ({"num_envs": 10**9}, "num_envs = 1000000000; accepted: a whole number from 1 to 4,096"),
        ({"max_episode_steps": "9"}, "max_episode_steps = '9'"),
        ({"render_mode": "human"}, "'human'; accepted: ansi, rgb_array"),
    ],
)
def test_wrong_batch_arguments_are_refused(arguments: Changes, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicVectorEnv(**arguments)
