"""The ordinary tools of Stable-Baselines3 and Gymnasium, with what the extra `deep` installs."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor

from agents.dynamic_programming import evaluate
from agents.sb3.tables import agent_table
from agents.sb3.vec_env import SB3VecEnv
from envs import ProxemicVectorEnv, compile_scenario, load_scenario

NEAR: Any = {"grid.start": [4, 4]}  # two moves from the target region, so that an untrained agent may succeed
MODEL = compile_scenario(load_scenario("S2", NEAR))
N = 200  # episodes


@pytest.fixture
def env() -> Iterator[Any]:
    made: Any = gymnasium.make("envs:Proxemic/S2-v0", observation="one_hot", overrides=NEAR)
    yield made
    made.close()


def untrained(env: Any, **more: Any) -> tuple[PPO, float]:
    """Returns an agent of Stable-Baselines3, and how often it succeeds, exactly, if it draws its actions."""
    agent = PPO("MlpPolicy", env, n_steps=64, n_epochs=1, seed=2, **more)
    table, _ = agent_table(agent, "agent", MODEL, "one_hot")
    return agent, float(evaluate(MODEL, table, 200).success)


def check(successes: Any, exact: float) -> None:
    """Compares the success of episodes with its probability, within 3.3 standard errors."""
    error = math.sqrt(exact * (1 - exact) / len(successes))
    assert 0.2 < exact < 0.8
    assert abs(np.mean(successes) - exact) < 3.3 * error


def test_success_rate_of_eval_callback_is_the_exact_one(env: Any, tmp_path: Path) -> None:
    agent, exact = untrained(env, learning_rate=0.0)
    evaluated = Monitor(gymnasium.make("envs:Proxemic/S2-v0", observation="one_hot", overrides=NEAR))
    evaluated.reset(seed=3)
    callback = EvalCallback(
        evaluated, n_eval_episodes=N, eval_freq=64, deterministic=False, log_path=str(tmp_path), verbose=0
    )
    agent.learn(64, callback=callback)
    (successes,) = np.load(tmp_path / "evaluations.npz")["successes"]
    assert len(successes) == N
    check(successes, exact)


@pytest.mark.parametrize("native", [False, True])
def test_success_of_training_episodes_is_the_exact_one(native: bool, env: Any) -> None:
    made = SB3VecEnv(ProxemicVectorEnv(4, "S2", "one_hot", NEAR, max_episode_steps=200)) if native else env
    agent, exact = untrained(VecMonitor(made) if native else made, learning_rate=0.0, stats_window_size=1000)
    agent.learn(2048)
    assert agent.ep_success_buffer is not None
    assert agent.ep_info_buffer is not None
    assert len(agent.ep_success_buffer) == len(agent.ep_info_buffer) > 50
    check(agent.ep_success_buffer, exact)


@pytest.mark.filterwarnings("ignore:rich is experimental")  # which Stable-Baselines3 ignores, too
def test_progress_bar_and_tensorboard(env: Any, tmp_path: Path) -> None:
    agent, _ = untrained(env, tensorboard_log=str(tmp_path))
    agent.learn(128, progress_bar=True)
    (log,) = tmp_path.glob("PPO_1/events.out.tfevents.*")
    assert b"rollout/success_rate" in log.read_bytes()


@pytest.mark.filterwarnings("ignore:.*human' rendering", "ignore:invalid escape")  # of moviepy's sources
def test_videos_and_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    shown = gymnasium.make("envs:Proxemic/S1-v0", render_mode="human")
    recorded = RecordVideo(
        gymnasium.make("envs:Proxemic/S1-v0", render_mode="rgb_array"), str(tmp_path / "videos")
    )
    for each in (shown, recorded):
        each.reset(seed=0)
        for action in (1, 3, 4):
            each.step(action)
        each.close()
    assert [path.name for path in tmp_path.glob("videos/*.mp4")] == ["rl-video-episode-0.mp4"]
