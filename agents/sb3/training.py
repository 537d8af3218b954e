"""Trains agents of Stable-Baselines3 so that a run does not depend on where it runs, or next to what.

SB3's classes do the learning. This module gives them the native vector env, one torch thread, random
streams that derive from one seed, and exactly the declared number of environment steps. At each
evaluation step one batched forward pass turns the net into a table over all observations.
"""

import hashlib
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.random import SeedSequence
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from torch.optim.optimizer import register_optimizer_step_post_hook

from agents.contract import Schedule, snapshots
from agents.sb3.algorithms import Sb3Algorithm
from agents.sb3.settings import Sb3Settings
from agents.sb3.tables import first_line, output_of, policy_table, readable_table
from agents.sb3.vec_env import SB3VecEnv
from envs import InputError, Model, ProxemicVectorEnv
from envs.model import ACTIONS
from envs.observations import observation_table


class _DivergedError(Exception):
    """The net's values are no longer finite."""


def make_agent(algorithm: Sb3Algorithm, settings: Sb3Settings, env: VecEnv) -> BaseAlgorithm:
    """Makes an agent of SB3's class for an env of `settings.n_envs` envs, on the CPU, not seeded yet."""
    with warnings.catch_warnings():  # the last mini-batch of a rollout is allowed to be smaller
        warnings.filterwarnings("ignore", message="You have specified a mini-batch size")
        agent: BaseAlgorithm = algorithm.load()("MlpPolicy", env, device="cpu", **settings.arguments)
    # The same Adam, a step in one call. As an argument it would unset the epsilon that SB3 gives Adam.
    optimizer = getattr(agent.policy, "optimizer", None)
    if isinstance(optimizer, torch.optim.Adam):
        for group in optimizer.param_groups:
            group["fused"] = True
    if not algorithm.has_modes:  # SB3 would walk all modules twice per step to switch modes
        agent.policy.set_training_mode = lambda _: None  # type: ignore[assignment,method-assign]
    return agent


def check_settings(algorithm: Sb3Algorithm, settings: Sb3Settings) -> None:
    """Refuses, by a ValueError, what cannot be trained: makes an agent, and reads its policy as a table."""
    env = SB3VecEnv(ProxemicVectorEnv(settings.n_envs, "S1", "coordinates"))
    with torch.random.fork_rng(devices=[]), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            agent: Any = make_agent(algorithm, settings, env)
        except Exception as error:  # whatever the class raises
            raise ValueError(f"{algorithm.path} cannot be made: {first_line(error)}") from error
        try:
            readable_table(agent, torch.as_tensor(env.reset()))
        except ValueError as error:
            raise ValueError(f"{algorithm.path} cannot be evaluated: {first_line(error)}") from error


class _Snapshots(BaseCallback):
    """Keeps what the net says, the count of wrong PINGs and the CPU seconds at each evaluation step.

    The policy changes only between rollouts, so the policy at a rollout's start is that of every evaluation
    step from there to the next rollout.
    """

    def __init__(self, env: SB3VecEnv, rollout: int, observations: torch.Tensor, schedule: Schedule) -> None:
        super().__init__()
        self._env = env
        self._rollout = rollout
        self._next_rollout = 0
        self._observations = observations  # (O, ...)
        self._points = schedule.evaluation_steps  # (T,)
        self._may_end = schedule.may_end
        self.has_ended = False  # early
        self._n_policies = 0  # evaluation steps whose policy is kept
        self._n_counts = 0  # evaluation steps whose counts are kept
        self._reading_s = 0.0  # CPU seconds spent on reading policies, which is not training
        self._started_s = time.thread_time()
        points = self._points
        self.tables = np.full((len(points), len(observations), len(ACTIONS)), np.nan)  # see `policy_table`
        self.disagreements = np.zeros(len(points), dtype=np.int64)
        self.cpu_time_s = np.zeros(len(points))
        self.diverged_at = -1

    def _on_training_start(self) -> None:
        self.keep_counts(0)

    def _on_rollout_start(self) -> None:
        step = self.model.num_timesteps
        if step != self._next_rollout:
            raise InputError(
                f"{type(self.model).__name__}: a rollout began after {step} steps; accepted: after "
                f"{self._next_rollout}, since the settings say that a rollout has {self._rollout} steps."
            )
        self._next_rollout += self._rollout
        self.keep_policy(before=self._next_rollout)

    def _on_step(self) -> bool:
        self.keep_counts(self.model.num_timesteps)
        return not self.has_ended

    def keep_policy(self, before: int) -> None:
        """Keeps the present policy for all evaluation steps before a step that have none yet."""
        due = sum(point < before for point in self._points[self._n_policies :])
        if due == 0:
            return
        started_s = time.thread_time()
        table = policy_table(self.model, self._observations)
        if not np.isfinite(table).all():
            self.diverged()
            raise _DivergedError
        if self._points[self._n_policies] == self.model.num_timesteps:  # its update is done
            self.cpu_time_s[self._n_policies] = started_s - self._started_s - self._reading_s
        self.tables[self._n_policies : self._n_policies + due] = table
        if self._may_end is not None:
            rows = range(self._n_policies, self._n_policies + due)
            self.has_ended = any(self._may_end(i, self.tables[i]) for i in rows)
        self._n_policies += due
        self._reading_s += time.thread_time() - started_s

    def keep_counts(self, step: int) -> None:
        """Keeps wrong PINGs and CPU seconds for all evaluation steps up to a step."""
        self.logger.record("proxemic/disagreements", self._env.disagreements)
        while self._n_counts < len(self._points) and self._points[self._n_counts] <= step:
            self.disagreements[self._n_counts] = self._env.disagreements
            self.cpu_time_s[self._n_counts] = time.thread_time() - self._started_s - self._reading_s
            self._n_counts += 1

    def fill(self) -> None:
        """Lets what follows an early end be as it is there."""
        self.tables[self._n_policies :] = self.tables[self._n_policies - 1 : self._n_policies]
        self.keep_counts(2**62)

    def diverged(self) -> None:
        """Notes that there is no policy from here on; it counts as the uniform random one."""
        self.diverged_at = self._points[min(self._n_policies, len(self._points) - 1)] if self._points else 0
        self.keep_counts(2**62)


def train_agent(
    algorithm: Sb3Algorithm,
    model: Model,
    settings: Sb3Settings,
    observation: str,
    seed: SeedSequence,
    schedule: Schedule,
    log: Path | None,
) -> dict[str, Any]:
    """Trains an agent, see `agents.contract.SequentialAlgorithm`."""
    with _isolated(seed) as (env_seed, action_seed):
        limit = settings.time_limit
        env = SB3VecEnv(
            ProxemicVectorEnv(settings.n_envs, model.scenario, observation, max_episode_steps=limit)
        )
        env.seed(env_seed)
        observations = torch.as_tensor(observation_table(model, observation))
        agent = make_agent(algorithm, settings, VecMonitor(env) if log else env)
        # Without one, SB3 makes a temporary folder for every agent, and leaves it there.
        agent.set_logger(configure(str(log), ["tensorboard"]) if log else Logger(None, []))
        agent.action_space.seed(action_seed)
        kept = _Snapshots(env, settings.rollout, observations, schedule)
        interval: Any = 1 if log else None  # from one line of the log to the next: episodes, or rollouts
        updates: list[None] = []
        hook = register_optimizer_step_post_hook(lambda *_: updates.append(None))
        try:
            agent.learn(settings.budget, callback=kept, log_interval=interval)
            if agent.num_timesteps != settings.budget and not kept.has_ended:
                raise InputError(
                    f"{algorithm.path}: trained for {agent.num_timesteps} steps; accepted: the budget of "
                    f"{settings.budget}."
                )
            if not kept.has_ended:
                kept.keep_policy(before=settings.budget + 1)
            kept.fill()
        except _DivergedError:
            pass
        except ValueError:  # torch refuses to draw from probabilities that are not finite
            if np.isfinite(policy_table(agent, observations)).all():
                raise
            kept.diverged()
        finally:
            hook.remove()
        if log:
            agent.logger.dump(agent.num_timesteps)
            agent.logger.close()
        digest = hashlib.sha256()
        for name, weights in sorted(agent.policy.state_dict().items()):
            digest.update(name.encode() + weights.numpy().tobytes())
        output = output_of(agent)
        q = policy_table(agent, observations) if output.is_value else np.empty((0, len(ACTIONS)))
        return {
            **snapshots(kept.tables, schedule, is_value=output.is_value),
            "q": q if kept.diverged_at < 0 else np.full_like(q, np.nan),
            "disagreements": kept.disagreements,
            "cpu_time_s": kept.cpu_time_s,
            "updates": len(updates),
            "parameters": sum(weights.numel() for weights in output.net.parameters()),
            "diverged_at": kept.diverged_at,
            "weights": np.frombuffer(digest.digest(), dtype=np.uint8),
        }


@contextmanager
def _isolated(seed: SeedSequence) -> Iterator[tuple[int, int]]:
    """Seeds the global generators that SB3 draws from and sets one torch thread; restores both afterwards.

    Denormal numbers count as zero meanwhile: Adam's moments of weights that get no gradient decay into them
    after some hundred updates, and arithmetic on them is slow.

    Yields:
      Seeds for the env and for the action space.
    """
    words = seed.generate_state(14, np.uint32)
    parts = words[4:6], words[6:10], words[10:]
    integers = [int.from_bytes(part.astype("<u4").tobytes(), "little") for part in parts]
    numpy_state = np.random.get_state()  # noqa: NPY002
    threads = torch.get_num_threads()
    try:
        with torch.random.fork_rng(devices=[]):
            torch.set_num_threads(1)
            torch.set_flush_denormal(True)
            torch.manual_seed(integers[0])
            np.random.seed(words[:4])  # noqa: NPY002
            yield integers[1], integers[2]
    finally:
        torch.set_flush_denormal(False)  # torch's default; it cannot be asked
        torch.set_num_threads(threads)
        np.random.set_state(numpy_state)  # noqa: NPY002
