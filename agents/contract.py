"""What an algorithm is to the rest of the project, and what training one returns.

Axis letters: N agents, T evaluation steps, V map steps, O observations, A actions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray
from pydantic import Field

from envs import Model
from envs.inputs import Table


class LearnerSettings(Table):
    """What every learner can be given, whatever else it takes."""

    budget: Annotated[int, Field(ge=1, le=10**9)] = (
        10_000  # environment steps, unless the learner says otherwise
    )
    time_limit: Annotated[int, Field(ge=1, le=10**9)] | None = None  # steps until an episode is truncated

    @property
    def discount_factor(self) -> float:
        """The discount of the learner's values, whatever its setting is called."""
        raise NotImplementedError


@dataclass(frozen=True)
class Schedule:
    """When training is looked at, in units of the learner's budget."""

    budget: int
    evaluation_steps: tuple[int, ...] = ()  # (T,) when the policy is kept: rising, from 0 to the budget
    map_steps: tuple[int, ...] = ()  # (V,) when the values of all observations are kept: some of them

    def __post_init__(self) -> None:
        """Checks the steps.

        Raises:
          ValueError: Evaluation steps do not rise from 0 to the budget, or map steps are none of them.
        """
        steps = list(self.evaluation_steps)
        if steps != sorted(set(steps)) or (steps and not 0 <= steps[0] <= steps[-1] <= self.budget):
            raise ValueError(f"evaluation_steps: must rise, from at least 0 to at most {self.budget}.")
        if list(self.map_steps) != [step for step in steps if step in set(self.map_steps)]:
            raise ValueError("map_steps: must be among the evaluation steps, and rise.")

    @property
    def is_mapped(self) -> NDArray[np.bool_]:
        """(T,) which evaluation steps are map steps."""
        return np.isin(np.array(self.evaluation_steps, dtype=np.int64), self.map_steps)


@dataclass(frozen=True, eq=False, kw_only=True)
class Training:
    """What training N agents returns. It has action values, or action probabilities, or both."""

    # (N, T, O) masks of greedy actions, see `agents.policy`
    greedy: NDArray[np.uint8]
    # (N, O, A) final action values, NaN of an agent that diverged; (N, 0, A) of a learner that has none
    q: NDArray[np.float64]
    # (N, T, O, A) probabilities of the policy that the learner acts by and improves, if that is neither
    # greedy nor greedy with a fixed share of exploration; else (N, 0, O, A)
    stochastic: NDArray[np.float64]
    # (N, V, O, A) at the map steps: probabilities if there are any, else action values; NaN once diverged
    values: NDArray[np.float32]
    disagreements: NDArray[np.int64]  # (N, T) wrong PINGs so far
    cpu_time_s: NDArray[np.float64]  # (N, T) CPU seconds spent on training so far
    updates: NDArray[np.int64]  # (N,) updates of the table, or gradient steps
    parameters: NDArray[np.int64]  # (N,) learned parameters
    # (N,) the first evaluation step whose policy was not finite; from there on the policy counts as the
    # uniform random one. -1 if training stayed finite.
    diverged_at: NDArray[np.int64]


@runtime_checkable
class Algorithm(Protocol):
    """A way to learn: what it can be given, where it runs, and how it trains."""

    @property
    def version(self) -> int:
        """Part of every run's identity; raised when a change alters what is learned."""

    @property
    def family(self) -> Literal["tabular", "deep"]:
        """Whether it learns a table or a net."""

    @property
    def settings(self) -> type[LearnerSettings]:
        """What it can be given."""

    @property
    def observations(self) -> tuple[str, ...]:
        """The forms of observation that it can learn from, see `envs.observations`."""

    @property
    def packages(self) -> tuple[str, ...]:
        """Packages whose versions belong in a run's record, beside the usual ones."""

    @property
    def batch_size(self) -> int:
        """How many runs one call of `train` should get."""

    @property
    def placement(self) -> Literal["thread", "process"]:
        """Where a call belongs: in a thread if it releases Python's global lock, else in a process."""

    @property
    def depends_on_batch(self) -> bool:
        """Whether the bits of a run depend on the other runs of the call."""

    @property
    def writes_logs(self) -> bool:
        """Whether it can write TensorBoard logs."""

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),
    ) -> Training:
        """Trains one agent per seed.

        Args:
          model: Compiled scenario.
          settings: An instance of `settings`, the same for all agents.
          observation: One of `observations`.
          seeds: One per agent, at least one; equal seeds give equal agents.
          schedule: When to keep policies and values.
          logs: A TensorBoard folder per agent, or nothing; no result depends on it.

        Raises:
          ValueError: There are no seeds.
        """


def check_request(settings: LearnerSettings, seeds: Sequence[SeedSequence], schedule: Schedule) -> None:
    """Checks that a call of `Algorithm.train` makes sense.

    Raises:
      ValueError: There are no seeds, or the schedule is for another budget.
    """
    if not seeds:
        raise ValueError("0 agents; at least one.")
    if schedule.budget != settings.budget:
        raise ValueError(
            f"schedule: made for a budget of {schedule.budget}; the settings say {settings.budget}."
        )


def check_training(training: Training, model: Model, n_agents: int, schedule: Schedule) -> None:
    """Checks that a training has what the contract promises.

    Raises:
      ValueError: Names the field, its shape and the shape that the contract asks for.
    """
    n_observations, n_actions = model.n_observations, model.next_state.shape[1]
    n_steps, n_maps = len(schedule.evaluation_steps), len(schedule.map_steps)
    table = (n_observations, n_actions)
    expected: dict[str, list[tuple[int, ...]]] = {
        "greedy": [(n_agents, n_steps, n_observations)],
        "q": [(n_agents, *table), (n_agents, 0, n_actions)],
        "stochastic": [(n_agents, n_steps, *table), (n_agents, 0, *table)],
        "values": [(n_agents, n_maps, *table)],
        "disagreements": [(n_agents, n_steps)],
        "cpu_time_s": [(n_agents, n_steps)],
        "updates": [(n_agents,)],
        "parameters": [(n_agents,)],
        "diverged_at": [(n_agents,)],
    }
    for name, shapes in expected.items():
        shape = getattr(training, name).shape
        if shape not in shapes:
            raise ValueError(f"Training.{name}: shape {shape}; accepted: {' or '.join(map(str, shapes))}.")
    if training.q.shape[1] == 0 and training.stochastic.shape[1] == 0 and n_steps:
        raise ValueError("Training: neither q nor stochastic; a training needs values or probabilities.")
