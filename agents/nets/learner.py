"""What DQN and PPO have in common: agents learn one after the other, and are recorded."""

import hashlib
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any, ClassVar, Self

import numpy as np
from numpy.random import SeedSequence
from pydantic import model_validator

from agents.contract import DeepTraining, Fields, Schedule, SequentialAlgorithm, snapshots
from agents.nets.arithmetic import Kind, Numbers
from agents.nets.net import Net, Parameters, inputs_of, net_of, read, unpadded
from agents.nets.stepping import envs_of
from agents.people import PeopleArguments
from agents.process import N_ACTIONS
from agents.sb3.settings import Sb3Settings
from envs import Model
from envs.arrays import Ints
from envs.inputs import parse, require
from envs.observations import VECTORS


class NetSettings(Sb3Settings):
    """Settings of Stable-Baselines3's algorithms, with few features extractors."""

    extractors: ClassVar[tuple[str, ...]] = ()  # the accepted ones

    @cached_property
    def people(self) -> PeopleArguments | None:
        """How people are embedded, if they are."""
        if self.policy_kwargs.features_extractor_class is None:
            return None
        given = self.policy_kwargs.features_extractor_kwargs
        return parse(PeopleArguments, given, "policy_kwargs.features_extractor_kwargs")

    @model_validator(mode="after")
    def _has_known_features_extractor(self) -> Self:
        name = self.policy_kwargs.features_extractor_class
        accepted = " or ".join([*self.extractors, "others only with sb3_dqn or sb3_ppo"])
        is_known = name is None or name in self.extractors
        require(is_known, "policy_kwargs.features_extractor_class", accepted)
        _ = self.people  # whose arguments are checked
        return self


class Agent(ABC):
    """An agent while it is trained."""

    is_value: ClassVar[bool]  # whether its table has action values; else it has probabilities
    outputs: ClassVar[tuple[int, ...]]  # how many each net has; the acting net comes first
    loop: "ClassVar[staticmethod[[Any, int], None]]"  # the compiled loop

    def __init__(
        self,
        model: Model,
        settings: Any,
        observation: str,
        points: Ints,
        seed: SeedSequence,
        kind: Kind,
    ) -> None:
        """Makes an agent with its first weights; `points` (T,) are the evaluation steps."""
        streams = np.asarray(seed.generate_state(12, np.uint64), np.uint64).reshape(3, 4)
        acting, self.learning, self.drawing = streams
        self.envs = envs_of(model, settings, acting, points)
        n_rows = max(min(settings.batch_size, model.n_observations), settings.n_envs)
        hidden, is_relu = settings.policy_kwargs.net_arch, self.is_value  # as in Stable-Baselines3
        people = settings.people
        inputs = inputs_of(model, observation, kind, people)
        end = 0
        shared = [people.width] * 2 if people else []
        self.nets: list[Net] = []
        for n in self.outputs:
            layers = [*shared, *hidden, n]
            net = net_of(inputs, layers, end, n_rows, is_relu=is_relu, n_shared=len(shared))
            self.nets.append(net)
            end = net.end
        values, gradient, first, second = np.zeros((4, end), kind)
        memory = first, second, np.zeros(256, kind), np.ones(2), np.zeros(1, np.int64)
        adam = settings.learning_rate, settings.adam_epsilon, settings.max_grad_norm
        self.parameters = Parameters(values, gradient, *memory, *adam)
        self.state = self.begin(model, settings, kind)

    @abstractmethod
    def begin(self, model: Model, settings: Any, kind: Kind) -> Any:
        """Draws the first weights; returns all that the compiled loop reads and changes."""

    def advance(self, until: int) -> None:
        """Trains, in whole rollouts, until so many steps are done or the agent diverges."""
        self.loop(self.state, until)

    def table(self) -> Numbers:
        """Returns what its first net says about all observations, (O, A)."""
        table = np.empty(
            (self.envs.process.n_observations, N_ACTIONS), self.parameters.values.dtype
        )
        read(self.nets[0], self.parameters.values, table)
        return table

    def weights(self) -> list[Numbers]:
        """Returns weights (inputs, outputs) and biases (outputs,) of each layer, net after net."""
        return [part for net in self.nets for part in unpadded(net, self.parameters.values)]


@dataclass(frozen=True)
class NetAlgorithm(SequentialAlgorithm):
    """An algorithm that learns a net."""

    agent: Callable[..., Agent]
    settings: type[Sb3Settings]
    policies: tuple[str, ...] = SequentialAlgorithm.policies

    family = "deep"
    version = 2
    observations = VECTORS
    packages = ("numba",)
    placement = "thread"
    training = DeepTraining

    def train_agent(
        self, model: Model, settings: Any, observation: str, seed: SeedSequence, schedule: Schedule
    ) -> Fields:
        """Trains an agent; its policy changes only between rollouts, and is read there."""
        points = schedule.evaluation_steps
        rollout = settings.rollout
        agent = self.agent(
            model, settings, observation, np.array(points, np.int64), seed, np.float32
        )
        tables = np.full((len(points), model.n_observations, N_ACTIONS), np.nan)
        cpu_time_s = np.zeros(len(points))
        agent.advance(0)  # compiles before the clock runs
        for start, group in groupby(range(len(points)), lambda i: points[i] // rollout * rollout):
            indices = list(group)
            started_s = time.thread_time()
            agent.advance(start)
            cpu_time_s[indices[0] :] += time.thread_time() - started_s
            table = agent.table().astype(np.float64)
            has_diverged = not np.isfinite(table).all()
            if not has_diverged:
                tables[indices] = (
                    table if agent.is_value else table / table.sum(axis=1, keepdims=True)
                )
            if has_diverged or (
                schedule.may_end and any(schedule.may_end(i, tables[i]) for i in indices)
            ):
                tables[indices[-1] :] = tables[indices[-1]]
                agent.envs.counts[indices[0] :] = agent.envs.disagreements[0]
                break
        else:
            agent.advance(schedule.budget)
        if schedule.keep:
            schedule.keep(agent)
        weights = agent.weights()
        digest = hashlib.sha256(b"".join(part.tobytes() for part in weights)).digest()
        return {
            **snapshots(
                tables, agent.table().astype(np.float64), schedule, is_value=agent.is_value
            ),
            "disagreements": agent.envs.counts,
            "cpu_time_s": cpu_time_s,
            "updates": agent.parameters.n_steps[0],
            "parameters": sum(part.size for part in weights),
            "weights": np.frombuffer(digest, np.uint8),
        }
