"""The Gymnasium env, as its users would use it."""

import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from envs import OBSERVATIONS, InputError, ProxemicEnv, scenario_names
from envs.model import PING
from tests.envs import Changes
from tests.support import few_places


@pytest.mark.parametrize("name", scenario_names())
def test_gymnasium_checker_passes(name: str) -> None:
    observation = OBSERVATIONS[scenario_names().index(name) % len(OBSERVATIONS)]
    arguments: Any = {"observation": observation, "overrides": few_places(name)}
    env = gymnasium.make(f"envs:Proxemic/{name}-v0", **arguments, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_id_works_without_another_import_and_stays_light() -> None:
    heavy = "{'torch', 'pandas', 'matplotlib', 'numba', 'pygame', 'stable_baselines3', 'scipy'}"
    make = "gymnasium.make('envs:Proxemic/S1-v0', observation='one_hot')"
    code = (
        f"import sys, gymnasium; print({make}.reset()[0].sum(), sorted({heavy} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1.0 []"


def test_step_returns_python_values() -> None:
    env = ProxemicEnv("S2")
    env.reset(seed=3)
    observation, reward, terminated, truncated, info = env.step(4)
    found = [type(value) for value in (observation, reward, terminated, truncated, *info.values())]
    assert found == [int, float, bool, bool, int, int, int, float, float, bool]
    assert [*info] == ["event", "zone", "wrong_pings", "grid_reward", "issuer_reward", "is_success"]
    assert reward == info["grid_reward"] + info["issuer_reward"]


def test_text_shows_agent_walls_people_and_phase() -> None:
    def text(name: str, state: int = 0) -> list[str]:
        env = ProxemicEnv(name, render_mode="ansi")
        env.s = state
        return str(env.render()).splitlines()

    walls = text("Walls")
    assert (walls[0], walls[2]) == ("A . . . # . . . . . . .", ". . . . # # # # # # . #")
    assert len(walls) == 11  # there is a single phase
    assert text("TwoPeople")[2] == ". . . . . . . + x x I x"
    lines = text("Moody", 600)
    assert lines[-2:] == ["phase: tense", "event: none"]
    assert lines[6].endswith("x x I x x +")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"observation": "one-hot"}, r"unknown form one-hot \(did you mean one_hot\?\)"),
        ({"scenario": "S9"}, "unknown scenario S9"),
        ({"render_mode": "holo"}, "= 'holo'; accepted: ansi, rgb_array; human with gymnasium.make"),
        ({"overrides": {"grid.rows": -1}}, "grid.rows = -1"),
    ],
)
def test_wrong_arguments_are_refused(arguments: Changes, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicEnv(**arguments)


@pytest.mark.parametrize("action", [-1, 5, 2.0, None, [2], np.array([2]), torch.tensor([2])])
def test_wrong_action_is_refused(action: Any) -> None:
    env: Any = ProxemicEnv()
    env.reset()
    with pytest.raises(InputError, match="accepted: 0 to 4"):
        env.step(action)
    assert env.step(torch.tensor(2))[0] == env.step(np.int32(2))[0] == 0


def test_an_episode_begins_with_reset_or_where_the_state_is_set() -> None:
    env = ProxemicEnv(overrides={"ping_limit": 1})
    with pytest.raises(InputError, match=r"options = .*3}; accepted: none\."):
        env.reset(options={"start": 3})
    for begin in (lambda: env.reset(options={}), lambda: setattr(env, "s", 5)):
        with pytest.raises(ResetNeeded, match=r"call reset\(\) first"):
            env.step(PING)
        begin()
        assert env.step(PING)[2]
