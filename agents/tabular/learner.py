"""Trains populations of independent agents that each learn a table of action values.

An algorithm is an update rule, see `agents.tabular.updates`; all else is the same for all rules.
"""

import math
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray
from pydantic import Field, model_validator

from agents.contract import Algorithm, LearnerSettings, Schedule, Training
from agents.policy import ALL_ACTIONS
from agents.process import process_of
from agents.tabular import updates
from agents.tabular.kernel import Constants, Plan, Results, compile_kernel
from agents.tabular.updates import UpdateRule
from envs import ACTIONS, Model
from envs.arrays import Floats, Ints
from envs.inputs import Count, Share

# Part of every run's identity: raise it when a change alters what every update rule learns. A rule
# has a version, too; both only rise, so their sum is new after every change.
VERSION = 3

MAX_RECORDS = 10_000_000  # records of the largest action value that an agent may have


class ValueSettings(LearnerSettings):
    """The settings of a table or a linear learner; the defaults are the paper's."""

    learning_rate: Annotated[float, Field(gt=0, le=1)] = 0.6
    """How far an update moves a value towards its target, as a share of the difference."""
    halved_after: Count | None = None
    """Steps after which the learning rate is half as large; after k times as many, it is divided by
    k + 1. By default, it is constant."""
    discount: Share = 0.9
    """Discount of the action values."""
    epsilon: Share = 0.6
    """Probability of a uniformly random action."""
    ties: Literal["uniform", "lowest"] = "uniform"
    """Which of several best actions is greedy."""
    initial_value: float = 0.0
    """Value of every action in every observation before training."""

    @property
    def discount_factor(self) -> float:
        """The discount of the action values."""
        return self.discount

    @property
    def constants(self) -> Constants:
        """The settings that compiled loops take, of fixed types: others are compiled again."""
        return Constants(
            learning_rate=self.learning_rate,
            halved_after=float(self.halved_after or math.inf),
            discount=self.discount,
            epsilon=self.epsilon,
            initial_value=self.initial_value,
            trace_decay=getattr(self, "trace_decay", 0.0),
            takes_lowest=self.ties == "lowest",
            time_limit=self.time_limit or 2**62,
            backward_passes=getattr(self, "backward_passes", 0),
        )


class Settings(ValueSettings):
    """The settings of a tabular learner."""

    budget_unit: Literal["steps", "episodes"] = "steps"
    """Unit of the budget."""
    record_every: Count = 1
    """Budget units from one record of the largest action value to the next."""

    @model_validator(mode="after")
    def _settings_fit(self) -> Self:
        if self.budget > MAX_RECORDS * self.record_every:
            where = f"record_every = {self.record_every} with budget = {self.budget}"
            raise ValueError(f"{where}: accepted: at most {MAX_RECORDS:,} records")
        if self.budget_unit == "episodes" and self.epsilon == 0 and self.time_limit is None:
            raise ValueError(
                'budget_unit = "episodes" with epsilon = 0 may never end; set time_limit'
            )
        return self


class TraceSettings(ValueSettings):
    """The settings of a learner with eligibility traces."""

    trace_decay: Share = 0.9
    """Lambda: the share of a trace that remains after a step, besides the discount."""
    backward_passes: Annotated[int, Field(ge=0, le=100)] = 0
    """How often each episode, when it ends, is replayed from its last step to its first, by
    one-step updates at the last step's learning rate (Lin 1992, Machine Learning 8:293-321).
    `updates` does not count them."""

    @model_validator(mode="after")
    def _episodes_fit(self) -> Self:
        if self.backward_passes and (self.time_limit or math.inf) > MAX_RECORDS:
            raise ValueError(
                f"backward_passes = {self.backward_passes} needs time_limit <= {MAX_RECORDS:,}"
            )
        return self


class TabularTraceSettings(TraceSettings, Settings):
    """The settings of a tabular learner with eligibility traces."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TabularTraining(Training):
    """What training N agents returns beside the fields of every algorithm; R records."""

    # (N, R) max_a Q(o_t, a) of the visited o_t before its update; of an episode, the largest
    max_q: Floats
    table_max_q: Floats  # (N, R) the largest Q of the table then; R = 0 if it is not recorded
    steps_taken: Ints  # (N,)
    episodes_ended: Ints  # (N,)


class ValueAlgorithm(Algorithm):
    """An algorithm that learns action values in a compiled loop, `batch_size` agents in a call."""

    packages = ("numba",)
    placement = "thread"
    policies = ("greedy",)
    training: type[Training]

    @abstractmethod
    def loop(
        self, model: Model, settings: Any, observation: str
    ) -> tuple[Callable[..., None], int]:
        """Returns the loop, over a plan, streams and results, and the number of parameters."""

    def records(self, n_agents: int, settings: Any) -> dict[str, NDArray[Any]]:  # noqa: ARG002
        """Returns room for the further fields of `training`."""
        return {}

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
    ) -> Training:
        """Trains agents; raises an InputError if their loop needs too much memory."""
        loop, n_parameters = self.loop(model, settings, observation)
        n_agents = len(seeds)
        n_steps = len(schedule.evaluation_steps)
        n_maps = len(schedule.map_steps)
        table = model.n_observations, len(ACTIONS)
        room: dict[str, NDArray[Any]] = {
            "q": np.empty((n_agents, *table)),
            "greedy": np.empty((n_agents, n_steps, table[0]), dtype=np.uint8),
            "stochastic": np.empty((n_agents, 0, *table)),
            "values": np.empty((n_agents, n_maps, *table), dtype=np.float32),
            "disagreements": np.empty((n_agents, n_steps), dtype=np.int64),
            "cpu_time_s": np.empty((n_agents, n_steps)),
            "updates": np.full(n_agents, settings.budget),
            "parameters": np.full(n_agents, n_parameters),
            "diverged_at": np.full(n_agents, -1),
        }
        result = self.training(**room | self.records(n_agents, settings))
        is_mapped = schedule.is_mapped
        plan = Plan(
            budget=settings.budget,
            by_episode=getattr(settings, "budget_unit", "steps") == "episodes",
            record_every=getattr(settings, "record_every", 1),
            points=np.array([*schedule.evaluation_steps, settings.budget + 1], dtype=np.int64),
            map_index=np.where(is_mapped, is_mapped.cumsum() - 1, -1),
        )
        streams = np.array([seed.generate_state(4, np.uint64) for seed in seeds])
        nothing: Any = np.empty((n_agents, 0))

        def train_block(block: slice) -> None:
            rows = Results(*(getattr(result, name, nothing)[block] for name in Results._fields))
            loop(plan, streams[block], rows)

        train_block(slice(0))  # compiles, or loads what was compiled, before the clock runs
        for first in range(0, n_agents, self.batch_size):
            block = slice(first, first + self.batch_size)
            started_s = time.thread_time()
            train_block(block)
            # One agent may train too briefly to be timed: all get equal shares, spread evenly over
            # steps.
            seconds = (time.thread_time() - started_s) / len(streams[block])
            result.cpu_time_s[block] = seconds * plan.points[:-1] / settings.budget
        is_lost = (result.greedy == 0).any(axis=2)  # (N, T), where values are not finite
        result.greedy[is_lost] = ALL_ACTIONS
        for i in np.flatnonzero(is_lost.any(axis=1)).tolist():
            result.diverged_at[i], result.q[i] = plan.points[is_lost[i].argmax()], np.nan
        return result


class TabularAlgorithm(ValueAlgorithm):
    """An algorithm that learns a table by an update rule, which has its settings and version."""

    family = "tabular"
    batch_size = 25  # an interrupt waits for the end of a call
    training = TabularTraining

    def __init__(self, update: UpdateRule) -> None:
        self.update = update
        self.settings = TabularTraceSettings if update.has_traces else Settings
        self.version = VERSION + update.version

    def loop(
        self,
        model: Model,
        settings: Settings,
        observation: str,  # noqa: ARG002
    ) -> tuple[Callable[..., None], int]:
        """Returns the loop of the update rule, and the size of its tables."""
        n_values = model.n_observations * len(ACTIONS)
        loop = partial(compile_kernel(self.update), process_of(model), settings.constants)
        return loop, n_values * (1 + self.update.has_two_tables)

    def records(self, n_agents: int, settings: Settings) -> dict[str, NDArray[Any]]:
        """Returns room for records; the table's maximum is recorded if there is more than one."""
        n_records = math.ceil(settings.budget / settings.record_every)
        steps_taken = np.empty(n_agents, int)
        return {
            "max_q": np.empty((n_agents, n_records)),
            "table_max_q": np.empty((n_agents, n_records if n_records > 1 else 0)),
            "steps_taken": steps_taken,
            "updates": steps_taken,
            "episodes_ended": np.empty(n_agents, int),
        }


Q_LEARNING = TabularAlgorithm(updates.Q_LEARNING)
SARSA = TabularAlgorithm(updates.SARSA)
EXPECTED_SARSA = TabularAlgorithm(updates.EXPECTED_SARSA)
DOUBLE_Q_LEARNING = TabularAlgorithm(updates.DOUBLE_Q_LEARNING)
WATKINS_Q_LAMBDA = TabularAlgorithm(updates.WATKINS_Q_LAMBDA)
