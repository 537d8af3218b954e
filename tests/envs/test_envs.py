"""The Gymnasium env, as its users would use it."""

import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from envs import OBSERVATIONS, InputError, ProxemicEnv, load_scenario, scenario_names
from envs.scenario import SCENARIO_DIRECTORY


@pytest.mark.parametrize("name", scenario_names())
def test_gymnasium_checker_passes(name: str) -> None:
    observation = OBSERVATIONS[scenario_names().index(name) % len(OBSERVATIONS)]
    env = gymnasium.make(f"envs:Proxemic/{name}-v0", observation=observation, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_id_works_without_another_import_and_stays_light() -> None:
    heavy = "{'torch', 'pandas', 'matplotlib', 'numba', 'pygame', 'stable_baselines3', 'scipy'}"
    make = "gymnasium.make('envs:Proxemic/S1-v0', observation='one_hot')"
    code = f"import sys, gymnasium; print({make}.reset()[0].sum(), sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1.0 []"


def test_step_returns_python_values() -> None:
    env = ProxemicEnv("S2")
    env.reset(seed=3)
    observation, reward, terminated, truncated, info = env.step(4)
    found = [type(value) for value in (observation, reward, terminated, truncated, *info.values())]
    assert found == [int, float, bool, bool, int, int, int, float, float]
    assert [*info] == ["event", "zone", "wrong_pings", "grid_reward", "issuer_reward"]
    assert reward == info["grid_reward"] + info["issuer_reward"]


def test_pickle_goes_on_where_the_env_was() -> None:
    env = ProxemicEnv("S2", "one_hot", {"issuer.position": [8, 6]})
    env.reset(seed=5)
    env.step(1)
    copied = pickle.loads(pickle.dumps(env))
    for action in (4, 1, 4):
        expected, found = env.step(action), copied.step(action)
        assert np.array_equal(found[0], expected[0])
        assert found[1:] == expected[1:]


@pytest.mark.parametrize("kind", ["path", "scenario", "mapping"])
def test_spec_is_json_for_every_kind_of_scenario(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "corridor.toml"
    path.write_text((SCENARIO_DIRECTORY / "S2.toml").read_text().replace("rows = 10", "rows = 20"))
    scenario = load_scenario(path)
    given: dict[str, Any] = {"path": path, "scenario": scenario, "mapping": scenario.model_dump()}
    env = gymnasium.make("envs:Proxemic/S1-v0", scenario=given[kind], overrides={"ping_limit": 3})
    assert env.spec is not None
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    model = again.unwrapped.model  # type: ignore[attr-defined]
    assert model is env.unwrapped.model  # type: ignore[attr-defined]
    assert (model.scenario.name, model.scenario.grid.rows, model.scenario.ping_limit) == ("corridor", 20, 3)
    assert again.spec is not None
    assert again.spec.to_json() == env.spec.to_json()


def test_image_rendering_shows_the_agent_where_it_is() -> None:
    env = gymnasium.make("envs:Proxemic/S1-v0", render_mode="rgb_array")
    env.reset()
    before = np.asarray(env.render())
    assert before.shape == (400, 480, 3)
    assert before.dtype == np.uint8
    env.step(3)
    changed = np.argwhere((np.asarray(env.render()) != before).any(axis=2))
    assert {(y // 40, x // 40) for y, x in changed} == {(0, 0), (0, 1)}


def test_window_shows_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with pytest.warns(UserWarning, match="HumanRendering wrapper"):
        env = gymnasium.make("envs:Proxemic/S1-v0", render_mode="human")
    env.reset()
    env.step(1)
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    image = gymnasium.make("envs:Proxemic/S1-v0", render_mode="rgb_array")
    image.reset()
    image.step(1)
    assert (shown == image.render()).all()
    env.close()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"observation": "one-hot"}, r"unknown form one-hot \(did you mean one_hot\?\)"),
        ({"scenario": "S9"}, "unknown scenario S9"),
        (
            {"render_mode": "holo"},
            "render_mode = 'holo'; accepted: ansi, rgb_array; human with gymnasium.make",
        ),
        ({"overrides": {"grid.rows": -1}}, "grid.rows = -1"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicEnv(**arguments)


@pytest.mark.parametrize("action", [-1, 5, 2.0, "UP", None])
def test_wrong_action_is_refused(action: Any) -> None:
    with pytest.raises(InputError, match="accepted: 0 to 4"):
        ProxemicEnv().step(action)
