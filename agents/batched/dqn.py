"""DQN (Mnih et al. 2015) as in Stable-Baselines3, for many agents at once."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.random import SeedSequence
from numpy.typing import NDArray
from torch import Tensor

from agents.batched import kernels
from agents.batched.nets import MANY, Nets, Parameters, layer_shapes
from agents.batched.settings import BatchedDqnSettings
from agents.batched.training import (
    N_ACTIONS,
    Snapshots,
    Streams,
    all_observations,
    input_table,
    torch_as_needed,
)
from agents.contract import DeepTraining, Schedule, check_request
from envs import Model

_ADAM_EPSILON = 1e-8  # PyTorch's, which Stable-Baselines3 leaves


def train(
    model: Model,
    settings: BatchedDqnSettings,
    observation: str,
    seeds: Sequence[SeedSequence],
    schedule: Schedule,
) -> DeepTraining:
    """Trains one agent per seed, all at once.

    Args:
      model: Compiled scenario.
      settings: The same for all agents.
      observation: `"one_hot"` or `"coordinates"`.
      seeds: One per agent.
      schedule: When to keep policies and values, in environment steps.

    Raises:
      InputError: There is no such device.
      ValueError: There are no seeds, or the schedule is for another budget.
    """
    check_request(settings, seeds, schedule)
    with torch_as_needed(settings.device) as device:
        streams = Streams(seeds)
        learner = QNets(model, settings, observation, len(seeds), device)
        learner.draw_weights(streams.weights)
        world = kernels.world_of(model, settings.time_limit)
        agents = streams.agents(world, settings.n_envs)
        learner.compile(world, agents)
        snapshots = Snapshots(model, schedule, len(seeds), learner.action_values, is_value=True)
        snapshots.keep_counts(0, agents.disagreements)
        n_synchronised = max(settings.target_update_interval // settings.n_envs, 1)
        epsilon = 0.0  # as in Stable-Baselines3, until the first step is done
        n_calls = 0
        for step in range(0, settings.budget, settings.rollout):
            snapshots.keep_policies(step, step + settings.rollout, agents.disagreements)
            for _ in range(settings.train_freq):
                taken = n_calls * settings.n_envs
                if taken < settings.learning_starts:
                    q, exploring = learner.no_values, 1.0
                else:
                    q, exploring = learner.values_of(world.observation[agents.state]), epsilon
                kernels.act(world, agents, q, exploring, learner.replay, learner.next_row())
                n_calls += 1
                taken = n_calls * settings.n_envs
                snapshots.keep_counts(taken, agents.disagreements)
                if n_calls % n_synchronised == 0:
                    learner.synchronise()
                epsilon = exploration_rate(settings, taken)
            if taken > settings.learning_starts:
                n_steps = settings.gradient_steps
                for _ in range(settings.rollout if n_steps < 0 else n_steps):
                    learner.update(*learner.draw(streams.learning))
        snapshots.keep_policies(settings.budget, settings.budget + 1, agents.disagreements)
        return snapshots.training(learner.parameters)


def exploration_rate(settings: BatchedDqnSettings, taken: int) -> float:
    """Returns the probability of a random action after so many steps.

    >>> exploration_rate(BatchedDqnSettings(budget=1000, exploration_fraction=0.5), 250)
    0.525
    """
    progress = 1.0 - (1.0 - taken / settings.budget)  # rounded as in Stable-Baselines3
    first, last = settings.exploration_initial_eps, settings.exploration_final_eps
    if progress > settings.exploration_fraction:
        return last
    return first + progress * (last - first) / settings.exploration_fraction


def reads_tables(settings: BatchedDqnSettings, n_observations: int) -> bool:
    """Returns whether to read the target nets for all observations after each synchronisation.

    Else they are read for the next observations of every mini-batch. With many observations, the fewer rows
    decide; the same whatever the number of agents, on which results must not depend.

    >>> settings = BatchedDqnSettings(batch_size=64, train_freq=2, target_update_interval=200)
    >>> [reads_tables(settings, n_observations) for n_observations in (120, 6400, 6401)]
    [True, True, False]
    """
    n_updates = settings.rollout if settings.gradient_steps < 0 else settings.gradient_steps
    n_rollouts = max(settings.target_update_interval / settings.rollout, 1.0)  # per synchronisation
    return n_observations <= max(MANY, n_rollouts * n_updates * settings.batch_size)


class QNets:
    """The nets and the replay buffers of N agents.

    Between two synchronisations the target nets do not change, so they may be read as tables over all O
    observations, see `reads_tables`.
    """

    def __init__(
        self,
        model: Model,
        settings: BatchedDqnSettings,
        observation: str,
        n_agents: int,
        device: torch.device,
    ) -> None:
        """Makes nets whose weights are zero, and empty buffers."""
        self._settings = settings
        self._device = device
        self._n_agents = n_agents
        self._all_observations = all_observations(model, n_agents, device)
        table, n_inputs = input_table(model, observation, device)
        shapes = list(layer_shapes(n_inputs, settings.policy_kwargs.net_arch, N_ACTIONS))
        self.parameters = Parameters(
            n_agents, shapes, settings.learning_rate, _ADAM_EPSILON, settings.max_grad_norm, device
        )
        self._nets = Nets(self.parameters.values, self.parameters.gradients, "relu", table)
        self._target = [value.clone() for value in self.parameters.values]
        self._target_nets = Nets(self._target, [], "relu", table)
        self._reads_tables = reads_tables(settings, model.n_observations)
        self._next_value: Tensor | None = None  # (N * O,) of the target nets; None: out of date
        n_rows = max(settings.arguments["buffer_size"] // settings.n_envs, 1)
        shape = n_agents, n_rows, settings.n_envs
        self.replay = kernels.Replay(
            observation=np.zeros(shape, dtype=np.int32),
            action=np.zeros(shape, dtype=np.int8),
            reward=np.zeros(shape, dtype=np.float32),
            next_observation=np.zeros(shape, dtype=np.int32),
            terminated=np.zeros(shape, dtype=np.bool_),
            truncated=np.zeros(shape, dtype=np.bool_),
        )
        self._n_written = 0  # rows
        self.no_values = np.zeros((n_agents, settings.n_envs, N_ACTIONS), dtype=np.float32)
        self._n_observations = model.n_observations
        self._first_observation = np.arange(n_agents)[:, None] * model.n_observations  # (N, 1)
        batch = n_agents, settings.batch_size
        self._rows, self._envs = np.empty(batch, dtype=np.int64), np.empty(batch, dtype=np.int64)
        self._batches = kernels.Batches(
            observed=np.empty(batch, dtype=np.int64),
            action=np.empty(batch, dtype=np.int64),
            target=np.empty(batch, dtype=np.float32),
            next_observed=np.empty(batch, dtype=np.int64),
            discount=np.empty(batch, dtype=np.float32),
            terminated=np.empty(batch, dtype=np.bool_),
        )
        self._gradient = torch.zeros(*batch, N_ACTIONS, device=device)

    def draw_weights(self, generators: Sequence[torch.Generator]) -> None:
        """Draws weights and biases as PyTorch's linear layers do, and copies them to the target nets."""
        for weights, biases in zip(self.parameters.values[::2], self.parameters.values[1::2], strict=True):
            bound = 1 / math.sqrt(weights.shape[1])
            for n, generator in enumerate(generators):
                for values in (weights[n], biases[n]):
                    values.copy_(torch.empty(values.shape).uniform_(-bound, bound, generator=generator))
        for target, value in zip(self._target, self.parameters.values, strict=True):
            target.copy_(value)
        self._next_value = None

    def synchronise(self) -> None:
        """Moves the target nets towards the nets by `tau`."""
        for target, value in zip(self._target, self.parameters.values, strict=True):
            target.lerp_(value, self._settings.tau)
        self._next_value = None

    def compile(self, world: kernels.World, agents: kernels.Agents) -> None:
        """Compiles the kernels, before any clock runs."""
        none, replay = kernels.none_of(agents), kernels.none_of(self.replay)
        batches, rows, envs = kernels.none_of(self._batches), self._rows[:0], self._envs[:0]
        kernels.act(world, none, self.no_values[:0], 0.0, replay, 0)
        kernels.draw_batches(none.streams, 1, 1, rows, envs)
        kernels.read_batches(replay, rows, envs, 0, 1, self._settings.gamma, 1, batches)
        kernels.add_next_values(batches, batches.target)

    def action_values(self) -> Tensor:
        """Returns the action values of all observations, (N, O, A); they are overwritten by the next call."""
        return self._nets.read(self._all_observations)

    def values_of(self, observations: NDArray[np.int64]) -> NDArray[np.float32]:
        """Returns the action values of observations (N, E), (N, E, A)."""
        observed = torch.from_numpy(observations + self._first_observation).to(self._device)
        return np.asarray(self._nets.forward(observed).cpu().numpy())

    @property
    def _last_row(self) -> int:
        """The row of the buffers that was written last."""
        return (self._n_written - 1) % len(self.replay.reward[0])

    def next_row(self) -> int:
        """Returns the row of the buffers that is written next, and counts it as written."""
        self._n_written += 1
        return self._last_row

    def draw(self, streams: NDArray[np.uint64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Draws mini-batches: rows (N, B) and envs (N, B) of the buffers."""
        n_rows = min(self._n_written, len(self.replay.reward[0]))
        kernels.draw_batches(streams, n_rows, self._settings.n_envs, self._rows, self._envs)
        return self._rows, self._envs

    def update(self, rows: NDArray[np.int64], envs: NDArray[np.int64]) -> None:
        """Makes a gradient step on mini-batches, by the Huber loss.

        Args:
          rows: (N, B) of the transitions in the buffers.
          envs: (N, B) of the same.
        """
        settings, batches = self._settings, self._batches
        kernels.read_batches(
            self.replay,
            rows,
            envs,
            self._last_row,
            settings.n_steps,
            settings.gamma,
            self._n_observations,
            batches,
        )
        kernels.add_next_values(batches, self._next_values(batches.next_observed))
        observed, actions, targets = (
            torch.from_numpy(values).to(self._device)
            for values in (batches.observed, batches.action, batches.target)
        )
        taken = actions[..., None]
        error = self._nets.forward(observed).gather(2, taken).sub_(targets[..., None])
        self._gradient.zero_().scatter_(2, taken, error.clamp_(-1.0, 1.0).div_(rows.shape[1]))
        self._nets.backward(self._gradient)
        self.parameters.step()

    def _next_values(self, observed: NDArray[np.int64]) -> NDArray[np.float32]:
        """Returns the target nets' largest action value of observations (N, B), (N, B)."""
        places = torch.from_numpy(observed).to(self._device)
        if self._reads_tables:
            if self._next_value is None:
                self._next_value = self._target_nets.read(self._all_observations).amax(dim=2).flatten()
            values = self._next_value.take(places)
        else:
            values = self._target_nets.forward(places).amax(dim=2)
        return np.asarray(values.cpu().numpy())
