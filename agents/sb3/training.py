"""Trains Stable-Baselines3's DQN and PPO so that a run is the same wherever and beside whatever it runs.

SB3's own classes do the learning; this module gives them the native vector env, one torch thread, random
streams that derive from one seed, and exactly the declared number of environment steps. At each
evaluation step the net becomes a table over all cells, by one batched forward pass.
"""

import hashlib
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.random import SeedSequence
from numpy.typing import NDArray
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from agents.contract import Training
from agents.policy import ALL_ACTIONS
from agents.sb3.settings import DqnSettings, PpoSettings
from agents.sb3.vec_env import SB3VecEnv
from envs import Model, ProxemicVectorEnv
from envs.model import ACTIONS
from envs.observations import observation_table

Settings = DqnSettings | PpoSettings
CLASSES: Final[dict[str, type[BaseAlgorithm]]] = {"dqn": DQN, "ppo": PPO}
_LOG_INTERVAL: Final = {"dqn": 10, "ppo": 1}  # episodes, or rollouts, from one line of a log to the next
_OURS: Final = {"budget", "time_limit", "n_envs"}  # settings that are no arguments of SB3's


@dataclass(frozen=True, eq=False, kw_only=True)
class DeepTraining(Training):
    """What came of training N deep agents, beside what every algorithm tells."""

    weights: NDArray[np.uint8]  # (N, 32) SHA-256 of all final weights


class _DivergedError(Exception):
    """The net's values are no longer finite."""


def train(
    name: str,
    model: Model,
    settings: Settings,
    observation: str,
    seeds: Sequence[SeedSequence],
    evaluation_steps: Sequence[int] = (),
    map_steps: Sequence[int] = (),
    logs: Sequence[Path] = (),
) -> DeepTraining:
    """Trains one agent a seed, one after the other.

    Args:
      name: `"dqn"` or `"ppo"`.
      model: Compiled scenario.
      settings: SB3's arguments, the same for all.
      observation: `"one_hot"` or `"coordinates"`.
      seeds: One an agent.
      evaluation_steps: When to keep the policy: rising, in environment steps, 0 to the budget.
      map_steps: When to keep what the net makes of every cell: some of the evaluation steps, rising.
      logs: A folder for TensorBoard for each agent, or none; what is learned is the same.

    Raises:
      ValueError: No agents, evaluation steps that do not rise from 0 to the budget, or map steps that are
        none of them.
    """
    points = list(evaluation_steps)
    if not seeds:
        raise ValueError("0 agents; at least one.")
    if points != sorted(set(points)) or (points and not 0 <= points[0] <= points[-1] <= settings.budget):
        raise ValueError(f"evaluation_steps: must rise, from at least 0 to at most {settings.budget}.")
    if list(map_steps) != [point for point in points if point in map_steps]:
        raise ValueError("map_steps: must be among the evaluation steps, and rise.")
    is_mapped = np.isin(points, map_steps)
    folders: list[Path | None] = [*logs] if logs else [None] * len(seeds)
    agents = [
        _train_one(name, model, settings, observation, seed, points, is_mapped, folder)
        for seed, folder in zip(seeds, folders, strict=True)
    ]
    return DeepTraining(**{key: np.stack([agent[key] for agent in agents]) for key in agents[0]})


def sb3_arguments(settings: Settings) -> dict[str, Any]:
    """Returns the arguments that SB3's class is to be given beside policy and env."""
    arguments = settings.model_dump(mode="json", exclude=_OURS, exclude_none=True)
    if isinstance(settings, DqnSettings):  # a larger buffer would never fill, and costs memory
        arguments["buffer_size"] = min(settings.buffer_size, settings.budget)
    return arguments


def make_agent(name: str, settings: Settings, env: VecEnv) -> BaseAlgorithm:
    """Makes SB3's own agent, on the CPU, seeded by nobody yet.

    Args:
      name: `"dqn"` or `"ppo"`.
      settings: SB3's arguments.
      env: Of `settings.n_envs` envs.
    """
    with warnings.catch_warnings():  # a rollout's last mini-batch may be smaller, and that is meant
        warnings.filterwarnings("ignore", message="You have specified a mini-batch size")
        agent = CLASSES[name]("MlpPolicy", env, device="cpu", **sb3_arguments(settings))
    # The same Adam, a step in one call. As an argument it would unset what SB3 gives Adam's epsilon.
    for group in agent.policy.optimizer.param_groups:
        group["fused"] = True
    # It walks all modules, twice a step, to tell dropout and batch norm, of which there are none.
    agent.policy.set_training_mode = lambda _: None  # type: ignore[assignment,method-assign]
    return agent


def policy_table(agent: BaseAlgorithm, observations: torch.Tensor) -> NDArray[np.float64]:
    """Returns what the net makes of every observation, by one forward pass.

    Args:
      agent: SB3's.
      observations: (O, ...) float32.

    Returns:
      (O, A): DQN's values, or PPO's probabilities, rows summing to one; not finite where it diverged.
    """
    with torch.no_grad():
        if isinstance(agent, DQN):
            return np.asarray(agent.q_net(observations).numpy(), dtype=np.float64)
        try:
            distribution: Any = agent.policy.get_distribution(observations)  # type: ignore[operator]
        except ValueError:  # torch's refusal of probabilities that are not finite
            return np.full((len(observations), len(ACTIONS)), np.nan)
        probabilities = distribution.distribution.probs.numpy().astype(np.float64)
    return np.asarray(probabilities / probabilities.sum(axis=1, keepdims=True))


class _Snapshots(BaseCallback):
    """Keeps the policy, and the count of disagreements and seconds, at each evaluation step.

    A policy changes only between rollouts, so the one at a rollout's start is that of every evaluation
    step from there to the next rollout.
    """

    def __init__(self, env: SB3VecEnv, settings: Settings, cells: torch.Tensor, points: list[int]) -> None:
        super().__init__()
        self._env = env
        self._rollout = settings.rollout
        self._cells = cells  # (O, ...) all observations
        self._points = points
        shape = len(points), len(cells)  # (T, O)
        self._n_taken = 0  # of the policies
        self._n_counted = 0  # of the counts
        self._aside_s = 0.0  # spent on policies, which is no training
        self._started_s = time.thread_time()
        self.greedy = np.full(shape, ALL_ACTIONS, dtype=np.uint8)
        self.tables = np.full((*shape, len(ACTIONS)), np.nan)  # see `policy_table`
        self.disagreements = np.zeros(len(points), dtype=np.int64)
        self.cpu_time_s = np.zeros(len(points))
        self.diverged_at = -1

    def _on_training_start(self) -> None:
        self.keep_counts(0)

    def _on_rollout_start(self) -> None:
        self.keep_policy(before=self.model.num_timesteps + self._rollout)

    def _on_step(self) -> bool:
        self.keep_counts(self.model.num_timesteps)
        return True

    def keep_policy(self, before: int) -> None:
        """Keeps the policy of now for all evaluation steps before a step that have none yet."""
        due = sum(point < before for point in self._points[self._n_taken :])
        if due == 0:
            return
        started_s = time.thread_time()
        table = policy_table(self.model, self._cells)
        if not np.isfinite(table).all():
            self.diverged()
            raise _DivergedError
        if self._points[self._n_taken] == self.model.num_timesteps:  # the update to it has been made by now
            self.cpu_time_s[self._n_taken] = started_s - self._started_s - self._aside_s
        where = slice(self._n_taken, self._n_taken + due)
        self.greedy[where] = 1 << table.argmax(axis=1)  # SB3 takes the first of several best actions, too
        self.tables[where] = table
        self._n_taken += due
        self._aside_s += time.thread_time() - started_s

    def keep_counts(self, step: int) -> None:
        """Keeps disagreements and seconds for all evaluation steps up to a step."""
        self.logger.record("proxemic/disagreements", self._env.disagreements)
        while self._n_counted < len(self._points) and self._points[self._n_counted] <= step:
            self.disagreements[self._n_counted] = self._env.disagreements
            self.cpu_time_s[self._n_counted] = time.thread_time() - self._started_s - self._aside_s
            self._n_counted += 1

    def diverged(self) -> None:
        """Notes that from here on there is no policy: it counts as the uniform random one."""
        self.diverged_at = self._points[min(self._n_taken, len(self._points) - 1)] if self._points else 0
        self.keep_counts(2**62)


def _train_one(
    name: str,
    model: Model,
    settings: Settings,
    observation: str,
    seed: SeedSequence,
    points: list[int],
    is_mapped: NDArray[np.bool_],
    log: Path | None,
) -> dict[str, NDArray[Any]]:
    """Returns the fields of `DeepTraining` for one agent."""
    with _isolated(seed) as (env_seed, action_seed):
        env = SB3VecEnv(
            ProxemicVectorEnv(
                settings.n_envs,
                model.scenario,
                observation,
                max_episode_steps=settings.time_limit,
                autoreset_mode=AutoresetMode.SAME_STEP,
            )
        )
        env.seed(env_seed)
        cells = torch.as_tensor(observation_table(model, observation))
        agent = make_agent(name, settings, VecMonitor(env) if log else env)
        if log:
            agent.set_logger(configure(str(log), ["tensorboard"]))
        agent.action_space.seed(action_seed)
        snapshots = _Snapshots(env, settings, cells, points)
        try:
            interval = _LOG_INTERVAL[name] if log else None
            agent.learn(settings.budget, callback=snapshots, log_interval=interval)  # type: ignore[arg-type]
            assert agent.num_timesteps == settings.budget
            snapshots.keep_policy(before=settings.budget + 1)
        except _DivergedError:
            pass
        except ValueError:  # PPO's, when it draws from probabilities that are not finite
            if np.isfinite(policy_table(agent, cells)).all():
                raise
            snapshots.diverged()
        if log:
            agent.logger.dump(agent.num_timesteps)
            agent.logger.close()
        q = policy_table(agent, cells) if name == "dqn" else np.empty((0, len(ACTIONS)))
        if snapshots.diverged_at >= 0:
            q[:] = np.nan
        # A policy that is not finite counts as the uniform random one.
        stochastic = np.where(np.isnan(snapshots.tables), 1 / len(ACTIONS), snapshots.tables)
        return {
            "greedy": snapshots.greedy,
            "stochastic": stochastic if name == "ppo" else stochastic[:0],
            "values": snapshots.tables[is_mapped].astype(np.float32),
            "disagreements": snapshots.disagreements,
            "cpu_time_s": snapshots.cpu_time_s,
            "updates": np.array(_n_updates(agent)),
            "parameters": np.array(_n_parameters(agent)),
            "diverged_at": np.array(snapshots.diverged_at),
            "q": q,
            "weights": np.frombuffer(_weights_digest(agent), dtype=np.uint8),
        }


@contextmanager
def _isolated(seed: SeedSequence) -> Iterator[tuple[int, int]]:
    """Seeds the global generators that SB3 draws from, on one torch thread, and restores all afterwards.

    Yields:
      Seeds for the env and for the action space.
    """
    words = seed.generate_state(14, np.uint32)
    integers = [
        int.from_bytes(part.astype("<u4").tobytes(), "little")
        for part in (words[4:6], words[6:10], words[10:])
    ]
    numpy_state = np.random.get_state()  # noqa: NPY002
    threads = torch.get_num_threads()
    try:
        with torch.random.fork_rng(devices=[]):
            torch.set_num_threads(1)
            torch.manual_seed(integers[0])
            np.random.seed(words[:4])  # noqa: NPY002
            yield integers[1], integers[2]
    finally:
        torch.set_num_threads(threads)
        np.random.set_state(numpy_state)  # noqa: NPY002


def _n_updates(agent: BaseAlgorithm) -> int:
    """Counts the optimizer's steps, by its own count."""
    states = agent.policy.optimizer.state.values()
    return int(next(iter(states))["step"]) if states else 0


def _n_parameters(agent: BaseAlgorithm) -> int:
    """Counts the numbers that are learned; DQN's target net is a copy and does not count."""
    net = agent.q_net if isinstance(agent, DQN) else agent.policy
    return sum(parameter.numel() for parameter in net.parameters())


def _weights_digest(agent: BaseAlgorithm) -> bytes:
    """Returns the SHA-256 of all weights."""
    digest = hashlib.sha256()
    for name, weights in sorted(agent.policy.state_dict().items()):
        digest.update(name.encode())
        digest.update(weights.numpy().tobytes())
    return digest.digest()
