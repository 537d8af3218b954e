"""The ordinary tools of Stable-Baselines3 and Gymnasium, with what the extra `deep` installs."""

import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor

from agents.dynamic_programming import evaluate
from agents.sb3.tables import agent_table
from agents.sb3.vec_env import SB3VecEnv
from envs import compile_scenario, load_scenario

# Two moves from the target region, so that an untrained agent may succeed.
NEAR: Any = {"grid.start": [4, 4]}
MODEL = compile_scenario(load_scenario("S2", NEAR))


@pytest.mark.filterwarnings("ignore:rich is experimental", "ignore:Training and eval env")
def test_success_in_training_and_evaluation_is_the_exact_one(tmp_path: Path) -> None:
    made: Any = SB3VecEnv(MODEL, "one_hot", 4, 200)
    agent = PPO(
        "MlpPolicy", VecMonitor(made), n_steps=64, n_epochs=1, seed=2, learning_rate=0.0,
        stats_window_size=1000, tensorboard_log=str(tmp_path),
    )  # fmt: skip
    table, _ = agent_table(agent, MODEL, "one_hot")
    exact = float(evaluate(MODEL, table, 200).success)  # if it draws its actions
    assert 0.2 < exact < 0.8
    env: Any = gymnasium.make("envs:Proxemic/S2-v0", observation="one_hot", overrides=NEAR)
    evaluated = Monitor(env)
    evaluated.reset(seed=3)
    callback = EvalCallback(
        evaluated, n_eval_episodes=200, eval_freq=512, log_path=str(tmp_path), deterministic=False
    )
    agent.learn(2048, callback=callback, progress_bar=True)
    (successes,) = np.load(tmp_path / "evaluations.npz")["successes"]
    assert agent.ep_success_buffer is not None
    for episodes in (successes, agent.ep_success_buffer):
        assert len(episodes) > 50
        assert abs(np.mean(episodes) - exact) < 3.3 * math.sqrt(exact * (1 - exact) / len(episodes))
