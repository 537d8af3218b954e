"""The interface of algorithms to the rest of the project, and what training returns.

Axis letters: N agents, T evaluation steps, V map steps, O observations, A actions.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import ArrayLike

from agents.policy import ALL_ACTIONS
from envs import ACTIONS, Model
from envs.arrays import Bools, Bytes, Floats, Ints, Singles
from envs.inputs import Count, Table
from envs.observations import INDICES

Family = Literal["tabular", "linear", "deep", "other"]


class LearnerSettings(Table):
    """The settings that every learner has."""

    budget: Count = 10_000
    """Environment steps of training, unless another setting gives another unit."""
    time_limit: Count | None = None
    """Steps until an episode is truncated; by default it is not."""

    @property
    @abstractmethod
    def discount_factor(self) -> float:
        """The discount of the learner's values, whatever its setting is called."""


@dataclass(frozen=True)
class Schedule:
    """When policies and values are recorded during training, in units of the learner's budget."""

    budget: int
    evaluation_steps: tuple[int, ...] = ()
    """(T,) when policies are recorded: rising, from 0 to at most the budget."""
    map_steps: tuple[int, ...] = ()
    """(V,) those of them when the values of all observations are, too."""
    may_end: Callable[[int, Floats], bool] | None = None
    """Whether training may end, given the index of an evaluation step and the table (O, A) there.
    Among the shipped algorithms, only nets ask. After an early end, the remaining evaluations
    repeat the last one."""
    keep: Callable[[Any], object] | None = None
    """Gets each trained net: a model of Stable-Baselines3, or an agent of `agents.nets`."""

    @property
    def is_mapped(self) -> Bools:
        """(T,) whether each evaluation step is a map step."""
        return np.isin(np.array(self.evaluation_steps, dtype=np.int64), self.map_steps)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Training:
    """What training N agents returns; subclasses may add fields, whose first axis is N."""

    greedy: Bytes
    """(N, T, O) masks of greedy actions, see `agents.policy`."""
    q: Floats
    """(N, O, A) final action values, NaN if the agent diverged; (N, 0, A) if the algorithm learns
    none."""
    stochastic: Floats
    """(N, T, O, A) probabilities of a policy that is learned directly, not from action values; else
    (N, 0, O, A)."""
    values: Singles
    """(N, V, O, A) at the map steps: probabilities, else action values; NaN after divergence."""
    disagreements: Ints
    """(N, T) wrong PINGs so far."""
    cpu_time_s: Floats
    """(N, T) CPU seconds spent on training so far."""
    updates: Ints
    """(N,) updates of the table, or gradient steps."""
    parameters: Ints
    """(N,) learned parameters."""
    diverged_at: Ints
    """(N,) the first evaluation step whose policy was not finite, or -1; it then counts as
    random."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class DeepTraining(Training):
    """What training N nets returns in addition."""

    weights: Bytes
    """(N, 32) SHA-256 of all final weights."""


class Algorithm(ABC):
    """A method of learning: its settings, where it runs, and how it trains.

    A subclass sets what differs.
    """

    settings: type[LearnerSettings]
    family: Family = "other"
    """What kind of learner it is. Baselines are tables or linear by default."""
    version: int = 1
    """Part of every run's identity; raised when a change alters what is learned."""
    observations: tuple[str, ...] = INDICES
    """The forms that it accepts, see `envs.observations`."""
    policies: tuple[str, ...] = ("greedy", "stochastic")
    """The policies that it may learn; another one is refused before any run."""
    packages: tuple[str, ...] = ()
    """Packages that it needs beyond the usual ones; a record names their versions."""
    batch_size: int = 1
    """How many agents one call of `train` should get."""
    placement: Literal["thread", "process"] = "process"
    """Where to call `train`: in a thread if it releases Python's global lock, else in a process."""

    @abstractmethod
    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
    ) -> Training:
        """Trains one agent per seed, whose results do not depend on the other seeds of the call.

        Args:
          model: Compiled scenario.
          settings: An instance of `settings`, the same for all agents.
          observation: One of `observations`.
          seeds: One per agent, at least one; equal seeds give equal agents.
          schedule: When to keep policies and values, for the budget of the settings.
        """


Fields = dict[str, ArrayLike]  # an agent's `Training` without the axis N


class SequentialAlgorithm(Algorithm):
    """An algorithm that trains one agent after another."""

    training: type[Training] = Training
    """What `train` returns."""

    @abstractmethod
    def train_agent(
        self, model: Model, settings: Any, observation: str, seed: SeedSequence, schedule: Schedule
    ) -> Fields:
        """Trains an agent, like `train`; returns the fields of its training without the axis N."""

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
    ) -> Training:
        """Trains one agent per seed, see `Algorithm.train`."""
        agents = [self.train_agent(model, settings, observation, seed, schedule) for seed in seeds]
        return self.training(
            **{key: np.stack([agent[key] for agent in agents]) for key in agents[0]}
        )


def snapshots(tables: Floats, final: Floats, schedule: Schedule, *, is_value: bool) -> Fields:
    """Returns the fields of `Training` that say what an agent's policy was, without the axis N.

    The tables (T, O, A) hold action values or probabilities, NaN from where the agent diverged; so
    does the final one, (O, A), after training.
    """
    is_lost = np.asarray(np.isnan(tables).any(axis=(1, 2)))
    has_diverged = bool(is_lost.any())
    # As in Stable-Baselines3, the first of several best actions is greedy.
    greedy = np.where(is_lost[:, None], ALL_ACTIONS, 1 << tables.argmax(axis=-1))
    probabilities = np.where(is_lost[:, None, None], 1 / tables.shape[-1], tables)
    return {
        "greedy": greedy.astype(np.uint8),
        "q": np.where(has_diverged, np.nan, final) if is_value else final[:0],
        "stochastic": probabilities[:0] if is_value else probabilities,
        "values": tables[schedule.is_mapped].astype(np.float32),
        "diverged_at": schedule.evaluation_steps[is_lost.argmax()] if has_diverged else -1,
    }


def check_training(training: Training, model: Model, n_agents: int, schedule: Schedule) -> None:
    """Refuses, by a ValueError, trainings of other shapes, and a training without policies."""
    n_steps = len(schedule.evaluation_steps)
    n_maps = len(schedule.map_steps)
    table = n_observations, n_actions = model.n_observations, len(ACTIONS)
    accepted: dict[str, list[tuple[int, ...]]] = {  # without the axis N
        "greedy": [(n_steps, n_observations)],
        "q": [table, (0, n_actions)],
        "stochastic": [(n_steps, *table), (0, *table)],
        "values": [(n_maps, *table)],
        **{key: [(n_steps,)] for key in ("disagreements", "cpu_time_s")},
        **{key: [()] for key in ("updates", "parameters", "diverged_at")},
    }
    for field in fields(training):
        shape = getattr(training, field.name).shape
        shapes = [(n_agents, *rest) for rest in accepted.get(field.name, [shape[1:]])]
        if shape not in shapes:
            raise ValueError(
                f"{field.name}: shape {shape}; accepted: {' or '.join(map(str, shapes))}."
            )
    if training.q.shape[1] == 0 and training.stochastic.shape[1] == 0 and n_steps:
        raise ValueError(
            "q, stochastic: both are empty; accepted: action values, probabilities, or both."
        )
