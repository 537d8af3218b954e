"""What the batched algorithms share: random streams, nets, and what is kept while they train."""

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import numpy as np
import torch
from numpy.random import SeedSequence
from numpy.typing import NDArray
from torch import Tensor

from agents.batched import kernels
from agents.batched.nets import Parameters
from agents.batched.settings import Device
from agents.contract import DeepTraining, Schedule
from agents.policy import ALL_ACTIONS
from envs import InputError, Model
from envs.model import ACTIONS
from envs.observations import observation_blocks, observation_table

N_ACTIONS: Final = len(ACTIONS)


@contextmanager
def torch_as_needed(device: Device) -> Iterator[torch.device]:
    """Sets one torch thread, no automatic gradients, and denormal numbers to zero; restores them afterwards.

    For denormal numbers see `agents.sb3.training`.

    Yields:
      The device.

    Raises:
      InputError: There is no such device.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError('device = "cuda": torch finds no CUDA device here; accepted: "cpu".')
    threads = torch.get_num_threads()
    try:
        with torch.no_grad():
            torch.set_num_threads(1)
            torch.set_flush_denormal(True)
            yield torch.device(device)
    finally:
        torch.set_flush_denormal(False)  # torch's default; it cannot be asked
        torch.set_num_threads(threads)


class Streams:
    """The random streams of every agent, which derive from its seed alone."""

    def __init__(self, seeds: Sequence[SeedSequence]) -> None:
        """Makes the streams."""
        words = np.array([seed.generate_state(9, np.uint64) for seed in seeds])
        self.acting = words[:, :4].copy()  # (N, 4), see `agents.batched.kernels`
        self.learning = words[:, 4:8].copy()  # (N, 4)
        self.weights = [torch.Generator().manual_seed(int(word)) for word in words[:, 8]]

    def agents(self, world: kernels.World, n_envs: int) -> kernels.Agents:
        """Returns agents, (N, E), of which each has drawn where its first episodes start."""
        shape = len(self.weights), n_envs
        agents = kernels.Agents(
            streams=self.acting,
            state=np.zeros(shape, dtype=np.int64),
            steps=np.zeros(shape, dtype=np.int64),
            disagreements=np.zeros(shape[0], dtype=np.int64),
        )
        kernels.start(world, agents)
        return agents


def input_table(model: Model, observation: str, device: torch.device) -> tuple[Tensor, int]:
    """Returns what a net reads of each observation, as `Nets` takes it, and its number of inputs."""
    if observation == "one_hot":
        blocks = observation_blocks(model)
        return torch.as_tensor(blocks, device=device), sum(part.size for part in model.parts)
    table = torch.as_tensor(observation_table(model, observation), device=device)
    return table, table.shape[1]


def all_observations(model: Model, n_agents: int, device: torch.device) -> Tensor:
    """Returns all observations as `Nets.forward` takes them, (N, O)."""
    return torch.arange(n_agents * model.n_observations, device=device).view(n_agents, -1)


class Snapshots:
    """Keeps policies, counts of wrong PINGs and CPU seconds at the evaluation steps.

    Policies change only between rollouts, so the policy at a rollout's start is that of every evaluation step
    from there to the next rollout. An agent that has diverged goes on to the end of the budget, which costs
    the others nothing; its counts stay what they were.
    """

    def __init__(
        self, model: Model, schedule: Schedule, n_agents: int, read: Callable[[], Tensor], *, is_value: bool
    ) -> None:
        """Starts the clock.

        Args:
          model: Compiled scenario.
          schedule: When to keep policies and values.
          n_agents: N.
          read: Returns the present table of action values or probabilities, (N, O, A).
          is_value: Whether these are action values.
        """
        self._points = schedule.evaluation_steps
        self._read = read
        self._is_value = is_value
        shape, table = (n_agents, len(self._points)), (model.n_observations, N_ACTIONS)
        # A policy that is not finite counts as the uniform random one.
        self._greedy = np.full((*shape, table[0]), ALL_ACTIONS, dtype=np.uint8)
        self._values = np.full((n_agents, len(schedule.map_steps), *table), np.nan, dtype=np.float32)
        self._stochastic = np.full((n_agents, 0 if is_value else shape[1], *table), 1 / N_ACTIONS)
        self._map_index = {step: i for i, step in enumerate(schedule.map_steps)}
        self._n_policies = 0  # evaluation steps whose policy is kept
        self._n_counts = 0  # evaluation steps whose counts are kept
        self._disagreements = np.zeros((n_agents, len(self._points)), dtype=np.int64)
        self._cpu_time_s = np.zeros(len(self._points))
        self._diverged_at = np.full(n_agents, -1)
        self._last_counts = np.zeros(n_agents, dtype=np.int64)  # of agents that have diverged
        self._reading_s = 0.0  # CPU seconds spent on reading policies, which is not training
        self._started_s = time.thread_time()

    def keep_policies(self, step: int, before: int, disagreements: NDArray[np.int64]) -> None:
        """Keeps the present policies for all evaluation steps before a step that have none yet.

        Args:
          step: The present step.
          before: The end of the next rollout.
          disagreements: (N,) wrong PINGs so far.
        """
        due = sum(point < before for point in self._points[self._n_policies :])
        if due == 0:
            return
        started_s = time.thread_time()
        table = self._read().double().cpu().numpy()
        if not self._is_value:
            table /= table.sum(axis=-1, keepdims=True)
        self.note_divergence(~np.isfinite(table).all(axis=(1, 2)), disagreements)
        sound = self._diverged_at < 0
        if self._points[self._n_policies] == step:  # its update is done
            self._cpu_time_s[self._n_policies] = started_s - self._started_s - self._reading_s
        table = table[sound]
        greedy = 1 << table.argmax(axis=-1)  # as in Stable-Baselines3, the first of several best actions
        for i in range(self._n_policies, self._n_policies + due):
            self._greedy[sound, i] = greedy
            if not self._is_value:
                self._stochastic[sound, i] = table
            if self._points[i] in self._map_index:
                self._values[sound, self._map_index[self._points[i]]] = table
        self._n_policies += due
        self._reading_s += time.thread_time() - started_s

    def note_divergence(self, diverged: NDArray[np.bool_], disagreements: NDArray[np.int64]) -> None:
        """Notes which agents (N,) have no policy from here on, and their wrong PINGs (N,) so far."""
        new = diverged & (self._diverged_at < 0)
        if new.any():
            self._diverged_at[new] = (
                self._points[min(self._n_policies, len(self._points) - 1)] if self._points else 0
            )
            self._last_counts[new] = disagreements[new]

    def keep_counts(self, step: int, disagreements: NDArray[np.int64]) -> None:
        """Keeps wrong PINGs (N,) and CPU seconds for all evaluation steps up to a step."""
        while self._n_counts < len(self._points) and self._points[self._n_counts] <= step:
            i = self._n_counts
            counts = np.where(self._diverged_at < 0, disagreements, self._last_counts)
            self._disagreements[:, i] = counts
            self._cpu_time_s[i] = time.thread_time() - self._started_s - self._reading_s
            self._n_counts += 1

    def training(self, parameters: Parameters) -> DeepTraining:
        """Returns what was learned, given the final parameters."""
        n_agents = len(parameters.n_steps)
        q = np.empty((n_agents, 0, N_ACTIONS))
        if self._is_value:
            q = self._read().double().cpu().numpy()
            q[self._diverged_at >= 0] = np.nan
        return DeepTraining(
            greedy=self._greedy,
            q=q,
            stochastic=self._stochastic,
            values=self._values,
            disagreements=self._disagreements,
            cpu_time_s=np.tile(self._cpu_time_s / n_agents, (n_agents, 1)),  # an agent's share
            updates=parameters.n_steps,
            parameters=np.full(n_agents, sum(values[0].numel() for values in parameters.values)),
            diverged_at=self._diverged_at,
            weights=_digests(parameters, n_agents),
        )


def _digests(parameters: Parameters, n_agents: int) -> NDArray[np.uint8]:
    """Returns the SHA-256 of every agent's weights, (N, 32)."""
    values = [value.cpu().numpy() for value in parameters.values]
    digests = [hashlib.sha256(b"".join(value[n].tobytes() for value in values)) for n in range(n_agents)]
    return np.array([list(digest.digest()) for digest in digests], dtype=np.uint8)
