"""Trains nets one after the other, and records them at the evaluation steps."""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Literal, Protocol

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents.contract import DeepTraining, Schedule, check_request
from agents.nets.arithmetic import Numbers
from agents.nets.dqn import DqnAgent
from agents.nets.net import Parameters
from agents.nets.ppo import PpoAgent
from agents.nets.walk import Walk
from agents.policy import ALL_ACTIONS
from agents.process import N_ACTIONS
from agents.sb3.settings import DqnSettings, PpoSettings, Sb3Settings
from envs import Model

VERSION: Final = 2  # part of every run's identity: raise it when a change alters what is learned


class Agent(Protocol):
    """An agent while it is trained."""

    is_value: bool  # whether its table has action values; else it has probabilities
    parameters: Parameters
    walk: Walk

    def advance(self, until: int) -> None:
        """Trains until so many steps are done, a whole number of rollouts."""

    def table(self) -> Numbers:
        """Returns action values or probabilities of all observations, (O, A)."""

    def weights(self) -> list[Numbers]:
        """Returns weights (inputs, outputs) and biases (outputs,) of each layer in turn."""


def _train_agent(agent: Agent, rollout: int, model: Model, schedule: Schedule) -> dict[str, NDArray[Any]]:
    """Returns the fields of `DeepTraining` for one agent.

    The policy changes only between rollouts, so the policy at a rollout's start is that of every evaluation
    step from there to the next rollout.
    """
    points = schedule.evaluation_steps
    shape = len(points), model.n_observations
    greedy = np.full(shape, ALL_ACTIONS, np.uint8)  # a policy that is not finite counts as the random one
    tables = np.full((*shape, N_ACTIONS), np.nan)
    cpu_time_s = np.zeros(len(points))
    seconds, diverged_at = 0.0, -1

    def advance(until: int) -> None:
        nonlocal seconds
        started_s = time.thread_time()
        agent.advance(until)
        seconds += time.thread_time() - started_s

    agent.advance(0)  # compiles before the clock runs
    for start, group in groupby(range(len(points)), lambda i: points[i] // rollout * rollout):
        indices = list(group)
        advance(start)
        cpu_time_s[indices[0] :] = seconds
        table = agent.table().astype(np.float64)
        if not np.isfinite(table).all():
            diverged_at = points[indices[0]]
            agent.walk.counts[indices[0] :] = agent.walk.disagreements[0]
            break
        greedy[indices] = 1 << table.argmax(axis=1)  # as in Stable-Baselines3, the first of several best
        tables[indices] = table if agent.is_value else table / table.sum(axis=1, keepdims=True)
    if diverged_at < 0:
        advance(schedule.budget)
    q = agent.table().astype(np.float64) if agent.is_value else np.empty((0, N_ACTIONS))
    weights = hashlib.sha256(b"".join(part.tobytes() for part in agent.weights()))
    return {
        "greedy": greedy,
        "q": q if diverged_at < 0 else np.full_like(q, np.nan),
        "stochastic": (tables[:0] if agent.is_value else np.where(np.isnan(tables), 1 / N_ACTIONS, tables)),
        "values": tables[schedule.is_mapped].astype(np.float32),
        "disagreements": agent.walk.counts,
        "cpu_time_s": cpu_time_s,
        "updates": agent.parameters.n_steps[0],
        "parameters": np.array(sum(part.size for part in agent.weights())),
        "diverged_at": np.array(diverged_at),
        "weights": np.frombuffer(weights.digest(), np.uint8),
    }


@dataclass(frozen=True)
class NetAlgorithm:
    """An algorithm that learns a net, see `agents.contract.Algorithm`."""

    agent: Callable[..., Agent]  # makes an agent
    settings: type[Sb3Settings]
    version: int = VERSION
    family: Literal["tabular", "deep"] = "deep"
    observations: tuple[str, ...] = ("one_hot", "coordinates")
    packages: tuple[str, ...] = ("numba",)
    batch_size: int = 1
    placement: Literal["thread", "process"] = "thread"
    writes_logs: bool = False

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),  # noqa: ARG002
    ) -> DeepTraining:
        """Trains one agent per seed, see `agents.contract.Algorithm`."""
        check_request(settings, seeds, schedule)
        points = np.array(schedule.evaluation_steps, np.int64)
        trained = []
        for seed in seeds:
            agent = self.agent(model, settings, observation, points, seed, np.float32)
            trained.append(_train_agent(agent, settings.rollout, model, schedule))
        return DeepTraining(**{key: np.stack([fields[key] for fields in trained]) for key in trained[0]})


DQN: Final = NetAlgorithm(DqnAgent, DqnSettings)
PPO: Final = NetAlgorithm(PpoAgent, PpoSettings)
