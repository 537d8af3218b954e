"""The compiled DQN and PPO: Stable-Baselines3's, and the same bits on every processor."""

import hashlib
import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import numba
import numpy as np
import pytest
import torch
from numpy.random import SeedSequence
from numpy.typing import NDArray
from scipy.stats import kstest
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents import Schedule, load_algorithm
from agents.dynamic_programming import evaluate
from agents.linear.learner import Q_LAMBDA, LinearSettings
from agents.nets import arithmetic
from agents.nets.dqn import DqnAgent, DqnNetSettings
from agents.nets.ppo import PpoAgent, PpoNetSettings
from agents.people import PEOPLE_EXTRACTOR
from agents.policy import mask_policy
from agents.sb3 import algorithms
from agents.sb3.settings import PolicyArguments
from agents.sb3.training import make_agent
from agents.sb3.vec_env import SB3VecEnv
from agents.tabular import learner
from envs import Model, compile_scenario, load_scenario
from envs.arrays import Floats, Ints
from envs.observations import compile_seen
from tests.agents import MOODS, Changes
from tests.agents.words import uniform, xoshiro
from tests.support import ROOT

S1 = compile_scenario(load_scenario("S1"))
# Three observed parts, two outcomes of every action, and six starts. O = 490.
MOODY = compile_scenario(
    load_scenario(
        "S1",
        {
            "grid": {"rows": 7, "columns": 7, "start": [[0, 0], [6, 0], [0, 6]]},
            "issuer.position": [4, 4],
            "phases": MOODS,
            "first_phase": "any",
            "observe": ["agent", "phase", "wrong_pings"],
        },
    )
)
FEEDBACK = {"issuer.feedback": {"kind": "uniform", "low": -1.0, "high": 1.0}}
NOISY_MOODY = compile_scenario(load_scenario(MOODY.scenario, FEEDBACK))
# Many observations, 13,320, of which an agent meets few.
ANYWHERE = compile_scenario(
    load_scenario("S1", {"issuer.position": "anywhere", "observe": ["agent", "issuer"]})
)
BADGES = load_scenario(
    "S1",
    {
        "grid": {"rows": 6, "columns": 6, "start": "anywhere"},
        "issuer.position": "anywhere",
        "issuer.places": 5,
        "observe": ["agent", "issuer"],
        "onlookers": {"people": 2, "ways": 20, "badge": True},
    },
)
SCENES = {
    "S1": S1,
    "moods": MOODY,
    "noisy moods": NOISY_MOODY,
    "anywhere": ANYWHERE,
    "badges": compile_scenario(BADGES),
    "relative badges": compile_seen(BADGES, "relative_centred"),
}
AGENTS: Changes = {"compiled_dqn": DqnAgent, "compiled_ppo": PpoAgent}
SHARED: Changes = {
    "budget": 400, "time_limit": 30, "gamma": 0.875,
    "policy_kwargs": PolicyArguments(net_arch=(24, 16)),
}  # fmt: skip
SETTINGS: Changes = {
    "compiled_dqn": DqnNetSettings(
        train_freq=2,
        learning_rate=1e-3,
        target_update_interval=50,
        exploration_fraction=0.8,
        **SHARED,
    ),
    "compiled_ppo": PpoNetSettings(
        n_envs=2, n_steps=20, batch_size=20, n_epochs=10, gae_lambda=0.75, **SHARED
    ),
}
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
    **changes: Any,
) -> Any:
    settings = settings_of(name, **changes)
    schedule = Schedule(settings.budget, points, points[::2])
    return load_algorithm(name).train(model, settings, observation, sequences(seeds), schedule)


def agent_of(name: str, observation: str, model: Model, settings: Any, kind: Any) -> Any:
    """Returns an agent that is not trained yet."""
    points, (sequence,) = np.zeros(0, np.int64), sequences([0])
    return AGENTS[name](model, settings, observation, points, sequence, kind)


# Equal to Stable-Baselines3. An agent of its own makes the same run with the random numbers of
# ours: first weights, exploration, what happens in the scenario, mini-batches. All else it does by
# itself, in float64, in which both round so little that the final weights agree to eight digits on
# any processor.


class Chance:
    """The random numbers of an agent of ours, as an agent of Stable-Baselines3 needs them."""

    def __init__(self, seed: SeedSequence, env: SB3VecEnv) -> None:
        acting, learning, _ = seed.generate_state(12, np.uint64).reshape(3, 4)
        self.acting = map(uniform, xoshiro([int(word) for word in acting]))
        self.learning = map(uniform, xoshiro([int(word) for word in learning]))
        self.env, self.model = env, env.model
        self.queue: deque[list[float]] = deque()
        if len(self.model.starts) > 1:
            self.queue.append([next(self.acting) for _ in range(env.num_envs)])

    def random(self, n: int) -> Floats:
        """Returns what `SB3VecEnv` draws."""
        numbers = np.array(self.queue.popleft())
        assert numbers.shape == (n,)
        return numbers

    def actions(self, choose: Callable[[int], int]) -> Ints:
        """Returns an action for each env, and draws what their steps take, env after env."""
        actions, noise, outcome, start = [], [], [], []
        for e, state in enumerate(self.env._state):
            action = choose(e)
            actions.append(action)
            noise.append(next(self.acting) if self.model.issuer_noise[state, action] > 0 else 0.5)
            outcome.append(next(self.acting) if self.model.n_outcomes > 1 else np.nan)
            ends = self.model.terminated[state, action] or self.env._steps[e] + 1 >= self.env._limit
            if ends and len(self.model.starts) > 1:
                start.append(next(self.acting))
        self.queue.extend([noise] * self.model.is_noisy + [outcome] * (self.model.n_outcomes > 1))
        self.queue.extend([start] * bool(start))
        return np.array(actions)


class ExactVecEnv(SB3VecEnv):
    """Rewards in float64, to which Stable-Baselines3 adds values of truncated episodes."""

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = super().step_wait()
        return observations, rewards.astype(np.float64), dones, infos


def agents_of(name: str, observation: str, scene: str, settings: Any) -> tuple[Any, Any, Chance]:
    """Returns ours and Stable-Baselines3's, both in float64, and the random numbers of ours."""
    model = SCENES[scene]
    ours = agent_of(name, observation, model, settings, np.float64)
    method = algorithms.DQN if name == "compiled_dqn" else algorithms.PPO
    vec_env: Any = ExactVecEnv(model, observation, settings.n_envs, settings.time_limit)
    vec_env._generator = chance = Chance(sequences([0])[0], vec_env)
    stock: Any = make_agent(method.load(), settings, vec_env)
    stock.policy.double()
    for module in stock.policy.modules():
        if isinstance(module, BaseFeaturesExtractor):
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
    return ours, stock, chance


def linear_layers(
    *nets: torch.nn.Module, values: list[NDArray[Any]] | None = None
) -> list[torch.Tensor]:
    """Returns weights and biases of all linear layers, as ours but transposed; sets values."""
    layers = [
        layer for net in nets for layer in net.modules() if isinstance(layer, torch.nn.Linear)
    ]
    parts = [part for layer in layers for part in (layer.weight, layer.bias)]
    for part, value in zip(parts, values or (), strict=values is not None):
        part.data.copy_(torch.from_numpy(value.T.copy()))
    return parts


def check_weights(parts: list[torch.Tensor], values: list[NDArray[Any]]) -> None:
    for part, value in zip(parts, values, strict=True):
        theirs = part.detach().numpy()
        assert np.linalg.norm(value.T - theirs) <= 1e-8 * np.linalg.norm(theirs)


# Whatever it computes in, Stable-Baselines3 rounds discounts to float32. Those here stay the same.
DQN_CASES: list[tuple[str, str, Changes]] = [
    ("one_hot", "S1", {}),
    ("coordinates", "S1", {
        "learning_rate": 1e-2, "gamma": 0.625, "policy_kwargs": {"net_arch": ()},
        "learning_starts": 173, "train_freq": 4, "gradient_steps": 3,
    }),
    ("factored", "S1", {
        "buffer_size": 150, "batch_size": 50, "policy_kwargs": {"net_arch": (128, 128)},
        "exploration_initial_eps": 0.9, "exploration_final_eps": 0.2, "exploration_fraction": 0.3,
    }),
    ("tiles", "S1", {
        "n_steps": 4, "n_envs": 2, "max_grad_norm": 0.01, "time_limit": None, "train_freq": 5,
        "gradient_steps": -1, "buffer_size": 203,
        "policy_kwargs": {"optimizer_kwargs": {"eps": 1e-3}},
    }),
    # More envs than rows of a mini-batch, and a single row of the buffer; the first step is greedy.
    ("centred", "S1", {
        "n_envs": 40, "batch_size": 8, "buffer_size": 20, "tau": 0.0, "train_freq": 1,
        "gradient_steps": 20, "learning_starts": 0,
    }),
    ("one_hot", "noisy moods", {
        "n_envs": 3, "n_steps": 3, "gamma": 0.5, "time_limit": 11, "gradient_steps": 3,
    }),
    ("coordinates", "anywhere", {"tau": 0.3, "target_update_interval": 7, "batch_size": 90}),
    ("coordinates", "badges", {"policy_kwargs": {
        "features_extractor_class": PEOPLE_EXTRACTOR,
        "features_extractor_kwargs": {"per_person": 3, "width": 24},
    }}),
    ("relative_centred", "relative badges", {"policy_kwargs": {
        "features_extractor_class": PEOPLE_EXTRACTOR,
        "features_extractor_kwargs": {"per_person": 3, "marks_first": False, "sees_agent": False},
    }}),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore:The number of environments used")
@pytest.mark.parametrize(("observation", "scene", "changes"), DQN_CASES, ids=str)
def test_dqn_is_stable_baselines3s(
    observation: str, scene: str, changes: Changes, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = settings_of("compiled_dqn", budget=600, **changes)
    ours, stock, chance = agents_of("compiled_dqn", observation, scene, settings)
    for net in (stock.q_net, stock.q_net_target):
        linear_layers(net, values=ours.weights())
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

    drawn: deque[Ints] = deque()

    def draw(low: int, high: int, size: Any) -> Ints:
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
    assert stock.env.disagreements == ours.envs.disagreements[0]
    check_weights(linear_layers(stock.q_net), ours.weights())


PPO_CASES: list[tuple[str, str, Changes]] = [
    ("one_hot", "S1", {}),
    ("coordinates", "S1", {
        "batch_size": 40, "ent_coef": 0.05, "n_epochs": 20,
        "policy_kwargs": {"net_arch": (128, 128)},
    }),
    ("factored", "S1", {
        "batch_size": 17, "gae_lambda": 0.5, "vf_coef": 1.5, "normalize_advantage": False,
        "max_grad_norm": 0.05, "time_limit": 7,
        "policy_kwargs": {"optimizer_kwargs": {"eps": 1e-2}},
    }),
    ("tiles", "S1", {
        "n_envs": 1, "n_steps": 40, "batch_size": 39, "time_limit": None, "clip_range": 0.02,
    }),
    ("centred", "moods", {
        "target_kl": 0.004, "learning_rate": 3e-3, "n_envs": 4, "n_steps": 5, "time_limit": 7,
    }),
    ("one_hot", "anywhere", {"clip_range_vf": 0.05, "n_envs": 5, "n_steps": 8, "time_limit": 7}),
]  # fmt: skip


@pytest.mark.parametrize(("observation", "scene", "changes"), PPO_CASES, ids=str)
def test_ppo_is_stable_baselines3s(
    observation: str, scene: str, changes: Changes, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = settings_of("compiled_ppo", **changes)
    ours, stock, chance = agents_of("compiled_ppo", observation, scene, settings)
    policy, extractor = stock.policy, stock.policy.mlp_extractor
    nets = extractor.policy_net, policy.action_net, extractor.value_net, policy.value_net
    linear_layers(*nets, values=ours.weights())
    ours.advance(400)

    def sample(distribution: Any, *_: Any) -> torch.Tensor:
        up_to = distribution.probs.numpy().cumsum(axis=1)[:, :-1]
        return torch.from_numpy(
            chance.actions(lambda e: int((next(chance.acting) >= up_to[e]).sum()))
        )

    def permute(n: int) -> Ints:
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
    whole = (
        400 // settings.rollout * settings.n_epochs * -(-settings.rollout // settings.batch_size)
    )
    assert 20 < n_steps < whole if settings.target_kl else n_steps == whole >= 200
    assert stock.env.disagreements == ours.envs.disagreements[0]
    check_weights(linear_layers(*nets), ours.weights())


# First weights


def test_first_weights_are_those_of_pytorch() -> None:
    """Of DQN uniform, bounded by 1 / sqrt(inputs); of PPO orthogonal, with SB3's gains."""
    net = {"net_arch": (64, 48)}
    dqn, ppo = (
        agent_of(name, "one_hot", S1, settings_of(name, policy_kwargs=net), np.float32).weights()
        for name in AGENTS
    )
    for weights, biases in zip(dqn[::2], dqn[1::2], strict=True):
        bound = 1 / np.sqrt(len(weights))
        values = np.append(weights, biases)
        assert kstest(values, "uniform", (-bound, 2 * bound)).pvalue > 1e-3
    gains = [np.sqrt(2), np.sqrt(2), 0.01, np.sqrt(2), np.sqrt(2), 1.0]
    assert not any(biases.any() for biases in ppo[1::2])
    for matrix, gain in zip(ppo[::2], gains, strict=True):
        short = matrix if len(matrix) <= len(matrix.T) else matrix.T
        assert short @ short.T == pytest.approx(gain**2 * np.eye(len(short)), abs=1e-5)


# The same bits


def equal(one: Any, other: Any, rows: Any = slice(None)) -> bool:
    """Returns whether all results are equal, bit for bit; times aside."""
    return all(
        np.array_equal(getattr(one, field.name)[rows], getattr(other, field.name), equal_nan=True)
        for field in fields(one)
        if field.name != "cpu_time_s"
    )


CASES: dict[str, list[Changes]] = {
    "compiled_dqn": [
        {"policy_kwargs": {"net_arch": (48, 40)}, "batch_size": 64},
        {"policy_kwargs": {"net_arch": ()}, "n_steps": 3, "batch_size": 128},
        {"policy_kwargs": {"net_arch": (33,)}, "tau": 0.3, "n_envs": 2, "batch_size": 17},
    ],
    "compiled_ppo": [
        {"policy_kwargs": {"net_arch": (48, 40)}, "n_steps": 50, "batch_size": 100},
        {"policy_kwargs": {"net_arch": ()}, "batch_size": 17, "ent_coef": 0.1},
        {
            "policy_kwargs": {"net_arch": (33,)},
            "batch_size": 13,
            "clip_range_vf": 0.1,
            "target_kl": 0.004,
        },
    ],
}


@pytest.mark.parametrize("name", CASES)
def test_bits_of_an_agent_do_not_depend_on_how_work_is_split(name: str) -> None:
    """Seeds in one call, one by one, in unequal parts, and in two threads at a time."""
    changes = {"budget": 200} | CASES[name][0]

    def some(seeds: list[int]) -> Any:
        return trained(name, "one_hot", seeds, MOODY, (0, 100, 200), **changes)

    together = some([*range(5)])
    with ThreadPoolExecutor(2) as pool:
        for parts in ([[seed] for seed in range(5)], [[4, 2, 1], [3, 0]]):
            for seeds, part in zip(parts, pool.map(some, parts), strict=True):
                assert equal(together, part, seeds)
    assert len(np.unique(together.weights, axis=0)) == 5


def digest_of_all() -> str:
    """Returns the digest of what nets, a table and tile coding learn, and of an evaluation."""
    digest = hashlib.sha256()
    for name, cases in CASES.items():
        for changes in cases:
            for observation, model in zip(
                ("one_hot", "coordinates"), (NOISY_MOODY, S1), strict=True
            ):
                training = trained(
                    name, observation, [0], model, (0, 100, 200), budget=200, **changes
                )
                for field in fields(training):
                    if field.name != "cpu_time_s":
                        digest.update(np.ascontiguousarray(getattr(training, field.name)).tobytes())
    settings = learner.Settings(budget=1000)
    table: Any = learner.Q_LEARNING.train(
        NOISY_MOODY, settings, "index", sequences(), Schedule(1000, (1000,))
    )
    evaluation = evaluate(NOISY_MOODY, mask_policy(table.greedy[:, -1]), 200)
    anywhere = compile_scenario(load_scenario("Anywhere"))
    tiling = LinearSettings(budget=1000, halved_after=90)
    linear = Q_LAMBDA.train(anywhere, tiling, "coordinates", sequences(), Schedule(1000, (1000,)))
    exact = evaluation.grid_return, evaluation.success, evaluation.zone_steps
    for values in (linear.q, linear.greedy, table.q, table.max_q, *exact):
        digest.update(values.tobytes())
    return digest.hexdigest()


# Of every processor. A change that is meant to alter it has to raise `NetAlgorithm.version`.
DIGEST = "da836768baacaa23c0bd268228b6a14df7fed18f154c563a5c3d886ab4894975"


@pytest.mark.parametrize("kind", ["this one", pytest.param("nehalem", marks=pytest.mark.slow)])
def test_bits_are_the_same_on_every_processor(kind: str) -> None:
    """As compiled for this processor, and for one of 2008, which emulates fused operations."""
    if kind == "this one":
        assert digest_of_all() == DIGEST
        return
    code = (
        "from numba.core.registry import cpu_target; from tests.agents import test_nets\n"
        "print(test_nets.digest_of_all(), cpu_target.target_context.codegen().magic_tuple()[1])"
    )
    target = {
        "NUMBA_CPU_NAME": kind,
        "NUMBA_CPU_FEATURES": "",
        "OPENBLAS_CORETYPE": kind.title(),
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
    }
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | target,
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == [DIGEST, kind], done.stderr


def _each(numbers: Any, of: Any) -> Any:
    """Returns a function of every number."""
    result = np.empty_like(numbers)
    for i in range(len(numbers)):
        result[i] = of(numbers[i])
    return result


each = numba.njit(_each)
tanh = numba.njit(lambda numbers: arithmetic.tanh(numbers))


def test_functions_are_those_of_analysis() -> None:
    x = np.append(np.linspace(-708, 708, 100_001), np.linspace(-1, 1, 100_001))
    exact = np.exp(x.astype(np.longdouble))
    assert np.abs(each(x, arithmetic.exp) / exact - 1).max() < 3e-16
    x = np.append(np.exp(np.linspace(-700, 700, 100_001)), np.linspace(0.5, 2, 100_001))
    exact = np.log(x.astype(np.longdouble))
    assert (np.abs(each(x, arithmetic.log) - exact) <= 3e-16 * np.abs(exact) + 1e-16).all()
    x = np.linspace(-12, 12, 100_001).astype(np.float32)
    y = x.copy()
    tanh(y)
    assert np.abs(y - np.tanh(x.astype(np.float64))).max() < 4e-7
    assert np.abs(y).max() <= 1
