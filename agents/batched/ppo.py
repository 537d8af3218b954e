"""PPO (Schulman et al. 2017) as in Stable-Baselines3, for many agents at once."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.random import SeedSequence
from numpy.typing import NDArray
from torch import Tensor

from agents.batched import kernels
from agents.batched.nets import MANY, Nets, Parameters, layer_shapes
from agents.batched.settings import BatchedPpoSettings
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

_ADAM_EPSILON = 1e-5  # Stable-Baselines3's
_GAINS = {"hidden": math.sqrt(2), "policy": 0.01, "value": 1.0}  # of the first weights, in Stable-Baselines3


def train(
    model: Model,
    settings: BatchedPpoSettings,
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
        learner = ActorCritics(model, settings, observation, len(seeds), device)
        learner.draw_weights(streams.weights)
        world = kernels.world_of(model, settings.time_limit)
        agents = streams.agents(world, settings.n_envs)
        counts = np.empty((len(seeds), settings.n_steps), dtype=np.int64)
        order = np.empty((len(seeds), settings.rollout), dtype=np.int64)
        learner.compile(world, agents, counts, order)
        snapshots = Snapshots(model, schedule, len(seeds), learner.probabilities, is_value=False)
        snapshots.keep_counts(0, agents.disagreements)
        for step in range(0, settings.budget, settings.rollout):
            snapshots.keep_policies(step, step + settings.rollout, agents.disagreements)
            learner.read_actors(world.observation[agents.state])
            snapshots.note_divergence(~learner.is_finite(), agents.disagreements)
            learner.roll_out(world, agents, counts)
            for t in range(settings.n_steps):
                snapshots.keep_counts(step + (t + 1) * settings.n_envs, counts[:, t])
            for _ in range(settings.n_epochs):
                kernels.shuffle(streams.learning, order)
                for start in range(0, settings.rollout, settings.batch_size):
                    learner.update(order[:, start : start + settings.batch_size])
        snapshots.keep_policies(settings.budget, settings.budget + 1, agents.disagreements)
        return snapshots.training(learner.parameters)


def reads_tables(settings: BatchedPpoSettings, n_observations: int) -> bool:
    """Returns whether to read actors and critics for all observations before each rollout.

    Else actors are read for the present observations at each step, and critics for those of the rollout. With
    many observations, the fewer rows decide.

    >>> settings = BatchedPpoSettings(budget=8000, n_steps=1000, n_envs=8)
    >>> [reads_tables(settings, n_observations) for n_observations in (8000, 8001)]
    [True, False]
    """
    return n_observations <= max(MANY, settings.rollout)


class ActorCritics:
    """The actors and critics of N agents, and their rollouts.

    While a rollout is made, actors and critics do not change, so they may be read as tables over all O
    observations, see `reads_tables`.
    """

    def __init__(
        self,
        model: Model,
        settings: BatchedPpoSettings,
        observation: str,
        n_agents: int,
        device: torch.device,
    ) -> None:
        """Makes nets whose weights are zero."""
        self._settings = settings
        self._device = device
        self._reads_tables = reads_tables(settings, model.n_observations)
        self._n_observations = model.n_observations
        self._first_observation = np.arange(n_agents)[:, None] * model.n_observations  # (N, 1)
        self._all_observations = all_observations(model, n_agents, device)
        table, n_inputs = input_table(model, observation, device)
        hidden = settings.policy_kwargs.net_arch
        shapes = [*layer_shapes(n_inputs, hidden, N_ACTIONS), *layer_shapes(n_inputs, hidden, 1)]
        self.parameters = Parameters(
            n_agents,
            shapes,
            settings.learning_rate,
            _ADAM_EPSILON,
            settings.max_grad_norm,
            device,
            stops_early=settings.target_kl is not None,
        )
        values, gradients, half = self.parameters.values, self.parameters.gradients, len(shapes) // 2
        self._actors = Nets(values[:half], gradients[:half], "tanh", table)
        self._critics = Nets(values[half:], gradients[half:], "tanh", table)
        shape = n_agents, settings.rollout
        self.rollout = kernels.Rollout(
            observed=np.empty(shape, dtype=np.int64),
            action=np.empty(shape, dtype=np.int64),
            old_log_probability=np.empty(shape, dtype=np.float32),
            old_value=np.empty(shape, dtype=np.float32),
            advantage=np.empty(shape, dtype=np.float32),
            value_target=np.empty(shape, dtype=np.float32),
        )
        self.results = kernels.Results(
            reward=np.empty(shape, dtype=np.float32),
            next_observed=np.empty(shape, dtype=np.int64),
            terminated=np.empty(shape, dtype=np.bool_),
            truncated=np.empty(shape, dtype=np.bool_),
        )
        self._on_device = [torch.from_numpy(values).to(device) for values in self.rollout]
        # By which agents act, (N, O, A) or for the present observations (N, E, A).
        self._probability = self._log_probability = np.empty((n_agents, 0, N_ACTIONS), dtype=np.float32)
        self._is_learning = torch.ones(n_agents, dtype=torch.bool, device=device)  # not stopped by the KL

    def draw_weights(self, generators: Sequence[torch.Generator]) -> None:
        """Draws orthogonal weights; biases stay zero."""
        half = len(self.parameters.values) // 2
        for i, weights in enumerate(self.parameters.values[::2]):
            is_last = 2 * i + 2 in (half, 2 * half)
            gain = _GAINS["hidden" if not is_last else "policy" if 2 * i < half else "value"]
            for n, generator in enumerate(generators):
                drawn = torch.empty(weights.shape[2], weights.shape[1])
                torch.nn.init.orthogonal_(drawn, gain, generator=generator)
                weights[n].copy_(drawn.T)

    def probabilities(self) -> Tensor:
        """Returns the action probabilities for all observations, (N, O, A)."""
        return self._actors.read(self._all_observations).softmax(dim=2)

    def compile(
        self,
        world: kernels.World,
        agents: kernels.Agents,
        counts: NDArray[np.int64],
        order: NDArray[np.int64],
    ) -> None:
        """Compiles the kernels, before any clock runs; takes the arrays that they will write."""
        none = kernels.none_of(agents)
        rollout, results = kernels.none_of(self.rollout), kernels.none_of(self.results)
        nothing = self._probability[:0]
        kernels.roll_out(world, none, nothing, nothing, False, 0, 0, 1, rollout, results, counts[:0])
        gamma, gae_lambda = self._settings.gamma, self._settings.gae_lambda
        kernels.estimate_advantages(rollout, results, rollout.old_value, 1, gamma, gae_lambda)
        kernels.shuffle(none.streams, order[:0])

    def read_actors(self, observations: NDArray[np.int64]) -> None:
        """Reads the probabilities by which agents act: of all observations, or of the present ones (N, E)."""
        observed = self._all_observations
        if not self._reads_tables:
            observed = torch.from_numpy(observations + self._first_observation).to(self._device)
        log_probability = self._actors.read(observed).log_softmax(dim=2)
        self._probability = log_probability.exp().cpu().numpy()
        self._log_probability = log_probability.cpu().numpy()

    def is_finite(self) -> NDArray[np.bool_]:
        """Returns whether all probabilities of each agent were finite when they were read, (N,)."""
        return np.asarray(np.isfinite(self._probability).all(axis=(1, 2)))

    def roll_out(self, world: kernels.World, agents: kernels.Agents, counts: NDArray[np.int64]) -> None:
        """Makes the next rollouts, after `read_actors`.

        Args:
          world: The scenario.
          agents: Who acts.
          counts: Where to write wrong PINGs so far after each step of the envs, (N, L).
        """
        settings, rollout, results = self._settings, self.rollout, self.results
        for first in [0] if self._reads_tables else range(settings.n_steps):
            if first:
                self.read_actors(world.observation[agents.state])
            kernels.roll_out(
                world,
                agents,
                self._probability,
                self._log_probability,
                not self._reads_tables,
                first,
                settings.n_steps if self._reads_tables else first + 1,
                self._n_observations,
                rollout,
                results,
                counts,
            )
        value_of = self._critics_as_function()
        rollout.old_value[:] = value_of(rollout.observed)
        kernels.estimate_advantages(
            rollout,
            results,
            value_of(results.next_observed),
            settings.n_envs,
            settings.gamma,
            settings.gae_lambda,
        )
        for there, here in zip(self._on_device, self.rollout, strict=True):
            there.copy_(torch.from_numpy(here))
        self._is_learning.fill_(True)

    def _critics_as_function(self) -> Callable[[NDArray[np.int64]], NDArray[np.float32]]:
        """Returns what gives the critics' values (N, B) of observations (N, B), until the next update."""
        if self._reads_tables:
            table = self._critics.read(self._all_observations).flatten().cpu().numpy()
            return lambda observed: table[observed]
        return lambda observed: (
            self._critics.read(torch.from_numpy(observed).to(self._device)).squeeze(2).cpu().numpy()
        )

    def update(self, chosen: NDArray[np.int64]) -> None:
        """Makes a gradient step on mini-batches.

        Args:
          chosen: (N, B) places in the rollouts.
        """
        settings, n_rows = self._settings, chosen.shape[1]
        places = torch.from_numpy(chosen).to(self._device)
        observed, actions, old_log_probability, old_value, advantage, value_target = (
            values.gather(1, places) for values in self._on_device
        )
        log_probability = self._actors.forward(observed).log_softmax(dim=2)
        value = self._critics.forward(observed).squeeze(2)
        taken = actions[..., None]
        log_ratio = log_probability.gather(2, taken).squeeze(2).sub_(old_log_probability)
        ratio = log_ratio.exp()
        if settings.target_kl is not None:
            divergence = (ratio - 1 - log_ratio).mean(dim=1)
            self._is_learning &= ~(divergence > 1.5 * settings.target_kl)

        if settings.normalize_advantage and n_rows > 1:
            advantage = advantage - advantage.mean(dim=1, keepdim=True)
            advantage /= (advantage.square().sum(dim=1, keepdim=True) / (n_rows - 1)).sqrt_().add_(1e-8)
        surrogate = advantage * ratio
        clipped = advantage * ratio.clamp(1 - settings.clip_range, 1 + settings.clip_range)
        # By the log-probability of the action taken, and by those of all actions through the softmax.
        slope = torch.where(surrogate <= clipped, surrogate, 0.0)[..., None]
        probability = log_probability.exp()
        gradient = probability * slope
        gradient.scatter_add_(2, taken, -slope)
        if settings.ent_coef:
            entropy = -(probability * log_probability).sum(dim=2, keepdim=True)
            gradient += settings.ent_coef * probability * (log_probability + entropy)
        self._actors.backward(gradient.div_(n_rows))

        predicted, is_free = value, None
        if settings.clip_range_vf is not None:
            change = value - old_value
            predicted = old_value + change.clamp(-settings.clip_range_vf, settings.clip_range_vf)
            is_free = change.abs() <= settings.clip_range_vf
        error = (predicted - value_target) * (2 * settings.vf_coef / n_rows)
        if is_free is not None:
            error *= is_free
        self._critics.backward(error[..., None])
        self.parameters.step(self._is_learning)
