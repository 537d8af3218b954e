"""The Gymnasium env and the native vector env, as their users would use them."""

import pickle
import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from envs import OBSERVATIONS, InputError, ProxemicEnv, ProxemicVectorEnv

SCENARIOS = ("S1", "S2", "S3")


@pytest.mark.parametrize("observation", OBSERVATIONS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_gymnasium_checker_is_content(name: str, observation: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # the check opens every render mode, the window too
    monkeypatch.setenv("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    env = gymnasium.make(f"envs:Proxemic/{name}-v0", observation=observation, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@pytest.mark.parametrize("observation", OBSERVATIONS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_stable_baselines3_checker_is_content(name: str, observation: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what its own imports warn of
        from stable_baselines3.common.env_checker import check_env as check_env_sb3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env_sb3(ProxemicEnv(name, observation))


def test_id_works_without_another_import() -> None:
    make = "gymnasium.make('envs:Proxemic/S1-v0', observation='one_hot')"
    code = f"import gymnasium; print({make}.reset()[0].sum())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1.0"


def test_importing_envs_stays_light() -> None:
    heavy = "{'torch', 'pandas', 'matplotlib', 'numba', 'pygame', 'stable_baselines3', 'scipy'}"
    code = f"import sys, envs; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_step_returns_python_values() -> None:
    env = ProxemicEnv("S2")
    env.reset(seed=3)
    observation, reward, terminated, truncated, info = env.step(4)
    assert type(observation) is int
    assert type(reward) is float
    assert type(terminated) is bool
    assert type(truncated) is bool
    assert {key: type(value) for key, value in info.items()} == {
        "event": str,
        "zone": str,
        "wrong_pings": int,
        "grid_reward": float,
        "issuer_reward": float,
    }
    assert reward == info["grid_reward"] + info["issuer_reward"]


def test_paper_optimum_by_hand() -> None:
    env = ProxemicEnv("S1", "coordinates")
    env.reset()
    rewards = []
    for action in [1] * 4 + [3] * 6 + [4]:  # four down, six right, PING in the corner of the target region
        observation, reward, terminated, _, info = env.step(action)
        rewards.append(reward)
    assert terminated
    assert info["event"] == "target_ping"
    assert info["zone"] == "target"
    assert sum(rewards) == pytest.approx(0.0)
    assert np.asarray(observation).tolist() == pytest.approx([4 / 9, 6 / 11])


def test_fifth_wrong_ping_ends_the_episode() -> None:
    env = ProxemicEnv("S3")
    env.reset()
    steps = [env.step(4) for _ in range(5)]
    assert [step[2] for step in steps] == [False] * 4 + [True]
    assert [step[4]["wrong_pings"] for step in steps] == [1, 2, 3, 4, 5]
    assert [step[4]["grid_reward"] for step in steps] == [-0.4] * 4 + [-1.0]
    assert [step[4]["issuer_reward"] for step in steps] == [-1.0] * 5  # at the start, d1 / d1(start) = 1


def test_time_limit_truncates() -> None:
    env = gymnasium.make("envs:Proxemic/S1-v0", max_episode_steps=3)
    env.reset()
    assert [env.step(0)[3] for _ in range(3)] == [False, False, True]


def test_random_feedback_repeats_with_its_seed_and_stays_in_bounds() -> None:
    def feedback(seed: int) -> list[float]:
        env = ProxemicEnv("S2")
        env.reset(seed=seed)
        rewards = []
        for _ in range(400):
            _, _, over, _, info = env.step(4)
            rewards.append(info["issuer_reward"])
            if over:
                env.reset()
        return rewards

    first = np.array(feedback(1))
    assert (first == feedback(1)).all()
    assert (first != feedback(2)).any()
    assert (abs(first) < 1).all()
    assert abs(first.mean()) < 4 / np.sqrt(3 * 400)  # four standard errors of a uniform draw on (-1, 1)
    assert first.std() == pytest.approx(1 / np.sqrt(3), rel=0.1)


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_pickle_and_spec_round_trip(observation: str) -> None:
    env = gymnasium.make(
        "envs:Proxemic/S2-v0", observation=observation, overrides={"issuer.position": [8, 6]}
    )
    env.reset(seed=5)
    env.step(1)
    again = pickle.loads(pickle.dumps(env.unwrapped))
    for action in (4, 1, 4):
        one, other = env.step(action), again.step(action)
        assert np.array_equal(one[0], other[0])
        assert one[1:] == other[1:]
    assert env.spec is not None
    rebuilt = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert rebuilt.unwrapped.model is env.unwrapped.model  # type: ignore[attr-defined]
    assert rebuilt.observation_space == env.observation_space


def test_text_rendering() -> None:
    env = gymnasium.make("envs:Proxemic/S1-v0", render_mode="ansi")
    env.reset()
    env.step(3)
    lines = str(env.render()).splitlines()
    assert lines[0] == ". A . . . . . . . . . ."
    assert lines[6] == ". . . . . . + x I x + ."
    assert lines[-1] == "event: move"


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
    env = gymnasium.make("envs:Proxemic/S1-v0", render_mode="human")
    env.reset()
    env.step(1)
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    image = gymnasium.make("envs:Proxemic/S1-v0", render_mode="rgb_array")
    image.reset()
    image.step(1)
    assert (shown == image.render()).all()
    env.close()


def test_window_without_pygame_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    env = ProxemicEnv(render_mode="human")
    with pytest.raises(InputError, match="needs pygame-ce"):
        env.reset()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"observation": "one-hot"}, r"unknown form one-hot \(did you mean one_hot\?\)"),
        ({"scenario": "S9"}, "unknown scenario S9"),
        ({"render_mode": "holo"}, "render_mode = 'holo'; accepted: ansi, rgb_array, human"),
        ({"overrides": {"grid.rows": -1}}, "grid.rows = -1"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicEnv(**arguments)


@pytest.mark.parametrize("action", [-1, 5, 2.0, "UP", None])
def test_wrong_action_is_refused(action: Any) -> None:
    env = ProxemicEnv()
    env.reset()
    with pytest.raises(InputError, match="accepted: 0 to 4"):
        env.step(action)


@pytest.mark.parametrize("action", [-1, 5])
def test_wrong_action_in_a_batch_is_refused(action: int) -> None:
    batch = ProxemicVectorEnv(2)
    batch.reset()
    with pytest.raises(InputError, match="accepted: 0 to 4"):
        batch.step(np.array([0, action]))


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"num_envs": 0}, "num_envs = 0"),
        ({"max_episode_steps": 0}, "max_episode_steps = 0"),
        ({"autoreset_mode": AutoresetMode.DISABLED}, "accepted: NextStep, SameStep"),
        ({"autoreset_mode": "Sometimes"}, "accepted: NextStep, SameStep"),
        ({"render_mode": "human"}, "a batch is not drawn"),
    ],
)
def test_wrong_batch_arguments_are_refused(arguments: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        ProxemicVectorEnv(**arguments)


@pytest.mark.parametrize("actions", [np.zeros(3, int), np.zeros(2), np.zeros((2, 1), int)])
def test_wrong_batch_actions_are_refused(actions: np.ndarray[Any, Any]) -> None:
    batch = ProxemicVectorEnv(2)
    batch.reset()
    with pytest.raises(InputError, match=r"accepted: \(2,\) integers"):
        batch.step(actions)


def test_make_vec_makes_the_native_one() -> None:
    env = gymnasium.make_vec(
        "envs:Proxemic/S1-v0",
        num_envs=3,
        vectorization_mode="vector_entry_point",
        observation="one_hot",
        max_episode_steps=7,
    )
    assert isinstance(env.unwrapped, ProxemicVectorEnv)
    assert env.reset(seed=0)[0].shape == (3, 120)
    for _ in range(6):
        assert not env.step(np.zeros(3, int))[3].any()
    assert env.step(np.zeros(3, int))[3].all()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("observation", OBSERVATIONS)
@pytest.mark.parametrize("name", ["S1", "S3"])
def test_batch_equals_gymnasium_sync_batch(name: str, observation: str, mode: AutoresetMode) -> None:
    n = 6
    ours = ProxemicVectorEnv(n, name, observation, max_episode_steps=20, autoreset_mode=mode)
    stock = SyncVectorEnv(
        [
            lambda: gymnasium.make(f"envs:Proxemic/{name}-v0", observation=observation, max_episode_steps=20)
            for _ in range(n)
        ],
        autoreset_mode=mode,
    )
    assert ours.single_observation_space == stock.single_observation_space
    assert ours.observation_space == stock.observation_space
    assert ours.action_space == stock.action_space
    _assert_same(ours.reset(seed=0), stock.reset(seed=0))
    rng = np.random.default_rng(1)
    ends = 0
    for _ in range(300):
        actions = rng.integers(0, 5, n)
        one, other = ours.step(actions), stock.step(actions)
        _assert_same((one[0], one[4]), (other[0], other[4]))
        for a, b in zip(one[1:4], other[1:4], strict=True):
            assert (a == b).all()
            assert a.dtype == b.dtype
        ends += int((one[2] | one[3]).sum())
    assert ends > 50  # both kinds of end were met


def _assert_same(one: tuple[Any, dict[str, Any]], other: tuple[Any, dict[str, Any]]) -> None:
    """Compares observations and info; Gymnasium's masks of which env gave what are optional."""
    assert np.array_equal(one[0], other[0])
    assert one[0].dtype == other[0].dtype
    for key, values in other[1].items():
        if key == "final_info":
            for name, inner in values.items():
                mask = other[1]["_final_info"]
                assert (np.asarray(one[1][key][name])[mask] == np.asarray(inner)[mask]).all()
        elif key == "final_obs":
            for a, b in zip(one[1][key], values, strict=True):
                assert np.array_equal(a, b)
        elif not key.startswith("_"):
            assert (one[1][key] == values).all(), key


def test_random_feedback_in_a_batch_is_each_envs_own_and_none_on_reset() -> None:
    env = ProxemicVectorEnv(500, "S2")
    env.reset(seed=0)
    pings = np.full(500, 4)
    rewards = np.array([env.step(pings)[4]["issuer_reward"] for _ in range(6)])
    assert (abs(rewards[:5]) < 1).all()
    assert len(np.unique(rewards[:5])) == 2500
    assert abs(rewards[:5].mean()) < 4.5 / np.sqrt(3 * 2500)
    assert not rewards[5].any()  # after the fifth PING the sixth step resets


@pytest.mark.parametrize("kind", [np.uint64, np.int8])
def test_batch_takes_any_integers_and_pickles(kind: type) -> None:
    env = ProxemicVectorEnv(3, "S2", "coordinates")
    env.reset(seed=4)
    env.step(np.array([1, 3, 4], dtype=kind))
    again = pickle.loads(pickle.dumps(env))
    one, other = env.step(np.array([4, 4, 4], dtype=kind)), again.step(np.array([4, 4, 4]))
    assert (one[0] == other[0]).all()
    assert (one[1] == other[1]).all()


def test_reset_forgets_which_episodes_were_over() -> None:
    env = ProxemicVectorEnv(2)
    env.reset()
    for _ in range(5):
        _, _, terminated, *_ = env.step(np.array([4, 1]))
    assert terminated.tolist() == [True, False]
    env.reset()
    observation, reward, *_ = env.step(np.array([1, 1]))
    assert observation.tolist() == [12, 12]  # a step down, and no second reset in its place
    assert reward.tolist() == [-0.1, -0.1]


def test_batch_returns_copies() -> None:
    env = ProxemicVectorEnv(2, observation="one_hot")
    first, _ = env.reset()
    kept = first.copy()
    second, rewards, *_ = env.step(np.array([1, 3]))
    first[:] = 9
    rewards_before = rewards.copy()
    third, *_ = env.step(np.array([1, 3]))
    assert (env.reset()[0] == kept).all()
    assert (rewards == rewards_before).all()
    assert not np.shares_memory(second, third)
