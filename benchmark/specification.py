"""A run: everything that its result depends on, and when it is evaluated."""

import hashlib
import json
import math
import re
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from agents import LearnerSettings, Schedule
from envs import ACTIONS, Scenario
from envs.observations import seen_as
from envs.sources import digest_when_loaded

DEFAULT_CONDITION = "default"
# What a run's result does not depend on, and its seed
_NO_IDENTITY = ("condition", "seed", "keep")


@dataclass(frozen=True, eq=False)
class RunSpecification:
    """One run, fully resolved: everything that its result depends on."""

    stream: str
    condition: str  # only its name: the identity has what the condition changes
    scenario: Scenario
    variant: str
    algorithm: str
    versions: Mapping[str, int]  # of the algorithm, the model and the evaluation
    observation: str
    settings: LearnerSettings
    horizon: int
    evaluation_every: int
    map_every: int
    seed: int
    # Of a run that is measured until it has learned: `Solved`, and the policy that counts
    solved: Mapping[str, Any] | None = None
    # What else its `Schedule` has; not part of its identity
    keep: Callable[[Any], object] | None = None

    @cached_property
    def population(self) -> str:
        """All but its seed, as canonical JSON: runs that share it train together."""
        names = {each.name for each in fields(self)}.difference(_NO_IDENTITY)
        values = {name: getattr(self, name) for name in names}
        as_json = partial(json.dumps, default=lambda table: table.model_dump(mode="json"))
        # Users' modules that it names as `module:attribute`, but not in what readers are told
        feedback = [its.kind for its in self.scenario.own_feedback]
        naming = as_json([self.algorithm, self.settings, feedback], ensure_ascii=False)
        named = sorted({*re.findall(r'"([\w.]+):[\w.]+"', naming)})
        if code := {name: digest for name in named if (digest := digest_when_loaded(name))}:
            values["code"] = code
        return as_json(values, sort_keys=True, separators=(",", ":"))

    def with_seed(self, seed: int) -> "RunSpecification":
        """Returns another run of the same population."""
        run = replace(self, seed=seed)
        run.__dict__["population"] = self.population  # cached
        return run

    @property
    def content(self) -> str:
        """The whole specification as canonical JSON."""
        return f'{self.population[:-1]},"seed":{self.seed}}}'

    @cached_property
    def digest(self) -> str:
        """The run's identity: SHA-256 of its content."""
        return hashlib.sha256(self.content.encode()).hexdigest()

    @property
    def folder(self) -> str:
        """A readable path for files about this run; it names any condition but the default one."""
        condition = "" if self.condition == DEFAULT_CONDITION else f"{self.condition}/"
        learner = f"{self.scenario.name}/{self.variant}_{self.observation}"
        return f"{self.stream}/{learner}/{condition}seed_{self.seed}"

    @property
    def record_size(self) -> int:
        """At most about how many bytes its record has before compression."""
        schedule, seen = self.schedule, seen_as(self.scenario, self.observation)
        n_values = 4 * len(ACTIONS) * len(schedule.map_steps)
        return seen.n_observations * (len(schedule.evaluation_steps) + n_values)

    @property
    def schedule(self) -> Schedule:
        """When the learner's policy and values are recorded."""
        budget, growth, maps = self.settings.budget, 1.0, list[int]()
        if self.solved is None:
            maps = evaluation_steps(budget, self.map_every)
        else:
            growth = self.solved["growth"]
        steps = evaluation_steps(budget, self.evaluation_every, growth)
        return Schedule(budget, tuple(steps), tuple(maps), keep=self.keep)

    @property
    def seed_sequence(self) -> np.random.SeedSequence:
        """The run's random stream, derived from names and never from a position in a list.

        Conditions share their streams: the scenario enters by its name alone, settings not at all.
        """
        names = [self.stream, self.scenario.name, self.variant, self.observation, self.seed]
        entropy = hashlib.sha256(json.dumps(names).encode()).digest()
        return np.random.SeedSequence(int.from_bytes(entropy))


def evaluation_steps(budget: int, every: int, growth: float = 1.0) -> list[int]:
    """Lists when policies are evaluated: from 0 to the budget, the end always included.

    All but the budget are multiples of `every`. Each is about `growth` times as late as the one
    before.

    >>> evaluation_steps(600, 250), evaluation_steps(1600, 100, 1.5)
    ([0, 250, 500, 600], [0, 100, 200, 300, 500, 800, 1200, 1600])
    """
    steps = [0]
    while steps[-1] < budget:
        following = max(steps[-1] + every, math.ceil(steps[-1] * growth / every) * every)
        steps.append(min(following, budget))
    return steps


def solved(success: Sequence[float], steps: Sequence[int], enough: float) -> tuple[int, bool]:
    """Returns from which evaluation on success stays at or above a level, and if that is final.

    It has to stay there until the first evaluation at or after twice as many steps, or to the end
    of the curve so far. The result is an index into `steps`, or the curve's length if it
    never stays there.

    >>> steps = [0, 100, 200, 300, 400, 500]
    >>> solved([0, 1, 0, 1, 1], steps, 0.9), solved([0, 1, 1, 0], steps, 0.9)
    ((3, False), (1, True))
    """
    first = 0
    for i, value in enumerate(success):
        if value < enough:
            first = i + 1
        elif i > first and steps[i] >= 2 * steps[first]:
            return first, True
    return first, False


def given_up(success: Sequence[float], steps: Sequence[int], enough: float, after: float) -> bool:
    """Returns whether a run is given up, by its curve so far, see `Solved.given_up_after`.

    >>> steps = [0, 100, 200, 300, 400]
    >>> curves = [0, 0.4, 0], [0, 0.4, 0, 0], [0, 0.5, 0, 0]
    >>> [given_up(success, steps, 0.9, 0.6) for success in curves]
    [False, True, False]
    """
    first = bisect_left(steps, after * steps[-1])
    return len(success) > first and max(success[: first + 1]) < enough / 2
