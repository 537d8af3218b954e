"""The compiled DQN and PPO: Stable-Baselines3's, update by update, and the same bits on every processor."""

import hashlib
import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import torch
from numpy.random import SeedSequence
from numpy.typing import NDArray
from scipy.stats import kstest

from agents import DeepTraining, Schedule, load_algorithm
from agents.dynamic_programming import evaluate
from agents.nets import arithmetic
from agents.nets.dqn import DqnAgent
from agents.nets.learner import train
from agents.nets.ppo import PpoAgent
from agents.policy import ALL_ACTIONS, mask_policy
from agents.sb3 import algorithms
from agents.sb3.settings import DqnSettings, PolicyArguments, PpoSettings
from agents.sb3.training import make_agent
from agents.sb3.vec_env import SB3VecEnv
from envs import Model, ProxemicVectorEnv, compile_scenario, load_scenario
from tests.agents.words import uniform, xoshiro

S1 = compile_scenario(load_scenario("S1"))
# Three observed parts, two outcomes of every action, and six starts. O = 490.
MOODS = compile_scenario(
    load_scenario(
        "S1",
        {
            "grid": {"rows": 7, "columns": 7, "start": [[0, 0], [6, 0], [0, 6]]},
            "issuer.position": [4, 4],
            "phases": [
                {"name": "calm", "next": {"tense": 0.3}},
                {
                    "name": "tense",
                    "next": {"calm": 0.5},
                    "regions": {"uncomfortable_radius": 2, "target_radius": 3},
                },
            ],
            "first_phase": "any",
            "observe": ["agent", "phase", "wrong_pings"],
        },
    )
)
NOISY_MOODS = compile_scenario(
    load_scenario(MOODS.scenario, {"issuer.feedback": {"kind": "uniform", "low": -1.0, "high": 1.0}})
)
# Many observations, 13,320, of which an agent meets few.
ANYWHERE = compile_scenario(
    load_scenario("S1", {"issuer.position": "anywhere", "observe": ["agent", "issuer"]})
)
SCENES = {"S1": S1, "moods": MOODS, "noisy moods": NOISY_MOODS, "anywhere": ANYWHERE}
AGENTS: dict[str, Any] = {"compiled_dqn": DqnAgent, "compiled_ppo": PpoAgent}
SETTINGS: dict[str, Any] = {
    "compiled_dqn": DqnSettings(
        budget=400,
        time_limit=30,
        train_freq=2,
        learning_rate=1e-3,
        gamma=0.875,
        target_update_interval=50,
        exploration_fraction=0.8,
        policy_kwargs=PolicyArguments(net_arch=(24, 16)),
    ),
    "compiled_ppo": PpoSettings(
        budget=400,
        time_limit=30,
        n_envs=2,
        n_steps=20,
        batch_size=20,
        n_epochs=10,
        gamma=0.875,
        gae_lambda=0.75,
        policy_kwargs=PolicyArguments(net_arch=(24, 16)),
    ),
}
OBSERVATIONS = ["one_hot", "coordinates"]
N_AGENTS = 3


def settings_of(name: str, **changes: Any) -> Any:
    return type(SETTINGS[name]).model_validate(SETTINGS[name].model_dump() | changes)


def sequences(seeds: Any = range(N_AGENTS)) -> list[SeedSequence]:
    return [SeedSequence([4, seed]) for seed in seeds]


def trained(
    name: str,
    observation: str = "one_hot",
    seeds: Any = range(N_AGENTS),
    model: Model = S1,
    points: tuple[int, ...] = (0, 200, 400),
    make: Callable[..., Any] | None = None,
    **changes: Any,
) -> DeepTraining:
    settings = settings_of(name, **changes)
    schedule = Schedule(settings.budget, points, points[::2])
    return train(make or AGENTS[name], model, settings, observation, sequences(seeds), schedule)


def agent_of(name: str, observation: str, model: Model, kind: Any, seed: int = 0, **changes: Any) -> Any:
    """Returns an agent that is not trained yet."""
    points = np.zeros(0, np.int64)
    (sequence,) = sequences([seed])
    return AGENTS[name](model, settings_of(name, **changes), observation, points, sequence, kind)


# Equal to Stable-Baselines3. An agent of its own makes the same run with the random numbers of ours: first
# weights, exploration, what happens in the scenario, and mini-batches. All else it does by itself, in float64,
# in which both round so little that the final weights must agree to eight digits.


class Chance:
    """The random numbers of an agent of ours, as an agent of Stable-Baselines3 needs them."""

    def __init__(self, seed: SeedSequence, env: ProxemicVectorEnv, limit: int | None) -> None:
        acting, learning, _ = seed.generate_state(12, np.uint64).reshape(3, 4)
        self.acting = map(uniform, xoshiro([int(word) for word in acting]))
        self.learning = map(uniform, xoshiro([int(word) for word in learning]))
        self.env, self.model, self.limit = env, env.model, limit or 2**62
        self.queue: deque[list[float]] = deque()
        if len(self.model.starts) > 1:
            self.queue.append([next(self.acting) for _ in range(env.num_envs)])

    def random(self, n: int) -> NDArray[np.float64]:
        """Returns what `SB3VecEnv` draws."""
        numbers = np.array(self.queue.popleft())
        assert numbers.shape == (n,)
        return numbers

    def actions(self, choose: Callable[[int], int]) -> NDArray[np.int64]:
        """Returns an action for each env, and draws what their steps take, env after env."""
        actions, noise, outcome, start = [], [], [], []
        for e, state in enumerate(self.env._state):
            action = choose(e)
            actions.append(action)
            noise.append(next(self.acting) if self.model.issuer_noise[state, action] > 0 else np.nan)
            outcome.append(next(self.acting) if self.model.n_outcomes > 1 else np.nan)
            ends = self.model.terminated[state, action] or self.env._steps[e] + 1 >= self.limit
            if ends and len(self.model.starts) > 1:
                start.append(next(self.acting))
        noise = [0.5 if np.isnan(number) else number for number in noise]
        drawn = (
            [noise] * self.model.is_noisy + [outcome] * (self.model.n_outcomes > 1) + [start] * bool(start)
        )
        self.queue.extend(drawn)
        return np.array(actions)


class ExactVecEnv(SB3VecEnv):
    """Rewards in float64, to which Stable-Baselines3 adds values of truncated episodes."""

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = super().step_wait()
        return observations, rewards.astype(np.float64), dones, infos


def stock_agent(name: str, settings: Any, observation: str, model: Model, seed: int) -> tuple[Any, Chance]:
    """Returns an agent of Stable-Baselines3 that computes in float64, and the random numbers of ours."""
    method = algorithms.DQN.method if name == "compiled_dqn" else algorithms.PPO.method
    limit = settings.time_limit
    env = ProxemicVectorEnv(
        settings.n_envs, model.scenario, observation, max_episode_steps=limit, autoreset_mode="SameStep"
    )
    vec_env: Any = ExactVecEnv(env)
    vec_env._generator = chance = Chance(sequences([seed])[0], env, limit)
    stock: Any = make_agent(method, settings, vec_env)
    stock.policy.double()
    for module in stock.policy.modules():
        if type(module).__name__ == "FlattenExtractor":
            module.register_forward_pre_hook(lambda _, arguments: (arguments[0].double(),))
    buffer = stock.replay_buffer if name == "compiled_dqn" else stock.rollout_buffer
    reset = buffer.reset

    def reset_in_float64() -> None:
        reset()
        for key in ("rewards", "returns", "values", "log_probs", "advantages"):
            if hasattr(buffer, key):
                setattr(buffer, key, getattr(buffer, key).astype(np.float64))

    buffer.reset = reset_in_float64
    if name == "compiled_dqn":
        buffer.rewards = buffer.rewards.astype(np.float64)
    return stock, chance


def linear_layers(*nets: torch.nn.Module) -> list[torch.Tensor]:
    """Returns weights and biases of all linear layers, as ours list them but transposed."""
    layers = [layer for net in nets for layer in net.modules() if isinstance(layer, torch.nn.Linear)]
    return [part for layer in layers for part in (layer.weight, layer.bias)]


def set_weights(parts: list[torch.Tensor], values: list[NDArray[Any]]) -> None:
    for part, value in zip(parts, values, strict=True):
        part.data.copy_(torch.from_numpy(value.T.copy()))


def check_weights(parts: list[torch.Tensor], values: list[NDArray[Any]]) -> None:
    for part, value in zip(parts, values, strict=True):
        theirs = part.detach().numpy()
        assert np.linalg.norm(value.T - theirs) <= 1e-8 * np.linalg.norm(theirs)


def in_turn(*cases: tuple[str, dict[str, Any]]) -> list[tuple[str, str, dict[str, Any]]]:
    """Gives the cases the two forms of observation by turns; the case without changes gets both."""
    given = [(OBSERVATIONS[i % 2], *case) for i, case in enumerate(cases)]
    return [*given, *((OBSERVATIONS[1], scene, changes) for scene, changes in cases if not changes)]


# Whatever it computes in, Stable-Baselines3 rounds discounts to float32. Those here are the same then.
DQN_CHANGES: list[dict[str, Any]] = [
    {},
    {"learning_rate": 1e-2, "gamma": 0.625, "policy_kwargs": {"net_arch": ()}},
    {"buffer_size": 150, "batch_size": 50, "policy_kwargs": {"net_arch": (128, 128)}},
    {"learning_starts": 173, "train_freq": 4, "gradient_steps": 3},
    {"n_envs": 4, "train_freq": 5, "gradient_steps": -1, "buffer_size": 203},
    {"tau": 0.3, "target_update_interval": 7},
    {"n_steps": 3, "time_limit": 11, "buffer_size": 90},
    {
        "n_steps": 4,
        "n_envs": 2,
        "max_grad_norm": 0.01,
        "time_limit": None,
        "gradient_steps": 2,
    },
    {"exploration_initial_eps": 0.9, "exploration_final_eps": 0.2, "exploration_fraction": 0.3},
    # Greedy from the start.
    {
        "exploration_initial_eps": 0.0,
        "exploration_final_eps": 0.0,
        "learning_starts": 0,
        "n_envs": 3,
        "train_freq": 1,
        "target_update_interval": 2,
        "batch_size": 40,
        "buffer_size": 60,
    },
]


@pytest.mark.filterwarnings("ignore:The number of environments used")
@pytest.mark.parametrize(
    ("observation", "scene", "changes"),
    in_turn(
        *(("S1", changes) for changes in DQN_CHANGES),
        (
            "moods",
            {
                "n_envs": 2,
                "n_steps": 3,
                "gamma": 0.5,
                "time_limit": 11,
                "buffer_size": 90,
                "gradient_steps": 2,
            },
        ),
        ("noisy moods", {"n_envs": 3, "gradient_steps": 3, "batch_size": 17}),
        ("anywhere", {"tau": 0.3, "target_update_interval": 7}),
        ("anywhere", {"batch_size": 90, "target_update_interval": 400}),
    ),
    ids=str,
)
def test_dqn_is_stable_baselines3s(
    observation: str, scene: str, changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = SCENES[scene]
    changes = {"budget": 600} | changes
    settings = settings_of("compiled_dqn", **changes)
    ours = agent_of("compiled_dqn", observation, model, np.float64, **changes)
    stock, chance = stock_agent("compiled_dqn", settings, observation, model, seed=0)
    for net in (stock.q_net, stock.q_net_target):
        set_weights(linear_layers(net), ours.weights())
    first = [part.copy() for part in ours.weights()]
    ours.advance(600)
    n_updates = 0

    def act(learning_starts: int, *_: Any) -> Any:
        rate = 1.0 if stock.num_timesteps < learning_starts else stock.exploration_rate
        explores = next(chance.acting) < rate
        greedy, _ = stock.policy.predict(stock._last_obs, deterministic=True)

        def choose(e: int) -> int:
            random = int(next(chance.acting) * 5)
            return random if explores else int(greedy[e])

        actions = chance.actions(choose)
        return actions, actions

    drawn: deque[NDArray[np.int64]] = deque()

    def draw(low: int, high: int, size: Any) -> NDArray[np.int64]:
        nonlocal n_updates
        assert low == 0
        if not drawn:  # rows of the buffer; then envs
            n_updates += 1
            numbers = [next(chance.learning) for _ in range(size * (1 + (settings.n_envs > 1)))]
            pairs = np.array(numbers).reshape(size, -1)
            drawn.append((pairs[:, -1] * settings.n_envs * (settings.n_envs > 1)).astype(np.int64))
            return (pairs[:, 0] * high).astype(np.int64)
        assert high == settings.n_envs
        return drawn.popleft()

    monkeypatch.setattr(stock, "_sample_action", act)
    monkeypatch.setattr(np.random, "randint", draw)
    stock.learn(600)
    assert n_updates == ours.parameters.n_steps[0] >= 200
    assert stock.env.disagreements == ours.walk.disagreements[0]
    check_weights(linear_layers(stock.q_net), ours.weights())
    # float32 is the same code, rounded otherwise. Its bits are the same on every processor, hence its error.
    rounded = agent_of("compiled_dqn", observation, model, np.float32, **changes)
    rounded.advance(600)
    for part, exact, start in zip(rounded.weights(), ours.weights(), first, strict=True):
        assert np.linalg.norm(part - exact) <= 0.05 * np.linalg.norm(exact - start)


PPO_CHANGES: list[dict[str, Any]] = [
    {},
    {"learning_rate": 1e-2, "gamma": 0.625, "policy_kwargs": {"net_arch": ()}},
    {"batch_size": 40, "ent_coef": 0.05, "n_epochs": 20, "policy_kwargs": {"net_arch": (128, 128)}},
    {"batch_size": 17, "gae_lambda": 0.5, "vf_coef": 1.5},
    {"batch_size": 13, "clip_range": 0.02, "learning_rate": 3e-3},
    {"clip_range_vf": 0.05, "learning_rate": 3e-3},
    {"normalize_advantage": False, "max_grad_norm": 0.05, "time_limit": 7},
    {"target_kl": 0.004, "learning_rate": 3e-3, "n_envs": 4, "n_steps": 5},
    {"n_envs": 1, "n_steps": 40, "batch_size": 39, "time_limit": None},
    {"batch_size": 64, "n_epochs": 20},
]


@pytest.mark.parametrize(
    ("observation", "scene", "changes"),
    in_turn(
        *(("S1", changes) for changes in PPO_CHANGES),
        ("moods", {"target_kl": 0.004, "learning_rate": 3e-3, "n_envs": 4, "n_steps": 5, "time_limit": 7}),
        ("noisy moods", {"n_envs": 5, "n_steps": 8, "time_limit": 9}),
        ("anywhere", {"clip_range_vf": 0.05, "n_envs": 5, "n_steps": 8, "time_limit": 7}),
    ),
    ids=str,
)
def test_ppo_is_stable_baselines3s(
    observation: str, scene: str, changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = SCENES[scene]
    settings = settings_of("compiled_ppo", **changes)
    ours = agent_of("compiled_ppo", observation, model, np.float64, **changes)
    stock, chance = stock_agent("compiled_ppo", settings, observation, model, seed=0)
    policy = stock.policy
    nets = (
        policy.mlp_extractor.policy_net,
        policy.action_net,
        policy.mlp_extractor.value_net,
        policy.value_net,
    )
    set_weights(linear_layers(*nets), ours.weights())
    first = [part.copy() for part in ours.weights()]
    ours.advance(400)

    def sample(distribution: Any, *_: Any) -> torch.Tensor:
        up_to = distribution.probs.numpy().cumsum(axis=1)[:, :-1]
        return torch.from_numpy(chance.actions(lambda e: int((next(chance.acting) >= up_to[e]).sum())))

    def permute(n: int) -> NDArray[np.int64]:
        order = list(range(n))
        for i in range(n - 1, 0, -1):
            j = int(next(chance.learning) * (i + 1))
            order[i], order[j] = order[j], order[i]
        return np.array(order)

    monkeypatch.setattr(torch.distributions.Categorical, "sample", sample)
    monkeypatch.setattr(np.random, "permutation", permute)
    stock.learn(400)
    n_steps = int(next(iter(policy.optimizer.state.values()))["step"])
    assert n_steps == ours.parameters.n_steps[0]
    whole = 400 // settings.rollout * settings.n_epochs * -(-settings.rollout // settings.batch_size)
    assert 20 < n_steps < whole if settings.target_kl else n_steps == whole >= 200
    assert stock.env.disagreements == ours.walk.disagreements[0]
    check_weights(linear_layers(*nets), ours.weights())
    rounded = agent_of("compiled_ppo", observation, model, np.float32, **changes)
    rounded.advance(400)
    for part, exact, start in zip(rounded.weights(), ours.weights(), first, strict=True):
        assert np.linalg.norm(part - exact) <= 0.05 * np.linalg.norm(exact - start)
