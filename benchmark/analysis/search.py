"""The stages of a search for settings: which runs it has, given those that are stored.

First, every trial of every learner, in all scenarios. Then, with fresh seeds, the trials of the largest mean
area under the curve of exact success; that with the largest mean on these seeds is chosen, so one that was
merely lucky is not. Beside them trial 0, and in each scenario the trial that is best there. Last, with other
seeds, the chosen settings, and the same with one of them at other values.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.execution import driver
from benchmark.execution.store import Store, evaluated
from benchmark.experiments import (
    DEFAULT_CONDITION,
    Experiment,
    RunSpecification,
    evaluation_steps,
    specifications,
)
from benchmark.experiments.search import Chosen
from envs import InputError
from envs.inputs import override, parse

Runs = list[RunSpecification]


def area(success: NDArray[np.float64], steps: Sequence[int]) -> NDArray[np.float64]:
    """Returns the area under curves of success, (..., T), relative to that of a success of 1 from the start.

    >>> float(area(np.array([0.0, 1.0, 1.0]), [0, 10, 20]))
    0.75
    """
    return np.asarray(np.trapezoid(success, steps) / (steps[-1] - steps[0]))


@dataclass(frozen=True, eq=False)
class Searched:
    """What a search has found for a learner so far. I scenarios."""

    experiment: Experiment
    variant: str
    observation: str
    store: Store

    @property
    def name(self) -> str:
        """The learner's name."""
        return f"{self.variant}, {self.observation}"

    @cached_property
    def n_trials(self) -> int:
        """How many there are, with trial 0."""
        assert self.experiment.search is not None
        return self.experiment.search.trials + 1

    def runs(self, trial: int, scenario: str, seeds: Sequence[int] | None = None) -> Runs:
        """Lists the runs of a trial in a scenario, with the declared seeds or others."""
        condition = f"{DEFAULT_CONDITION}/trial={trial}"
        return specifications(self.experiment, condition, scenario, self.variant, self.observation, seeds)

    def areas(self, runs: Sequence[RunSpecification]) -> NDArray[np.float64]:
        """Returns the area under the curve of success of stored runs, (N,)."""
        name = evaluated("success", self.experiment.algorithms[self.variant].policy, "start")
        steps = evaluation_steps(runs[0].settings.budget, runs[0].evaluation_every)
        found = np.stack([record.arrays[name] for record in self.store.get([run.digest for run in runs])])
        if not found.size:
            raise InputError(
                f"{self.experiment.argument}: algorithms.{self.variant}.policy = stochastic: its training "
                "returns no such policy; accepted: greedy."
            )
        return area(found, steps)

    @cached_property
    def searched(self) -> NDArray[np.float64]:
        """(trials, I, N) the areas of every trial."""
        names = self.experiment.scenarios
        return np.array([[self.areas(self.runs(t, each)) for each in names] for t in range(self.n_trials)])

    @cached_property
    def finalists(self) -> list[int]:
        """The best trials, the best first; of equal ones the first."""
        assert self.experiment.search is not None
        order = np.argsort(-self.searched.mean(axis=(1, 2)), kind="stable")
        return [int(trial) for trial in order[: self.experiment.search.finalists]]

    @cached_property
    def best(self) -> list[int]:
        """(I,) the best trial of each scenario."""
        return [int(trial) for trial in self.searched.mean(axis=2).argmax(axis=0)]

    @cached_property
    def fresh_runs(self) -> Mapping[tuple[int, str], Runs]:
        """The runs of the second stage, by trial and scenario."""
        assert self.experiment.search is not None
        names = self.experiment.scenarios
        cells = [(trial, name) for trial in [*self.finalists, 0] for name in names]
        cells += zip(self.best, names, strict=True)
        return {cell: self.runs(*cell, self.experiment.search.fresh) for cell in cells}

    @cached_property
    def fresh(self) -> Mapping[tuple[int, str], NDArray[np.float64]]:
        """The areas of the second stage, (N,) each."""
        return {cell: self.areas(runs) for cell, runs in self.fresh_runs.items()}

    def everywhere(self, trial: int) -> list[NDArray[np.float64]]:
        """Returns the fresh areas of a finalist or of trial 0 in every scenario."""
        return [self.fresh[trial, scenario] for scenario in self.experiment.scenarios]

    @cached_property
    def chosen(self) -> int:
        """The finalist with the largest mean on fresh seeds."""
        return max(self.finalists, key=lambda trial: float(np.mean(self.everywhere(trial))))

    def settings(self, trial: int) -> dict[str, Any]:
        """Returns the settings that a trial has, but for the budget and the time limit."""
        changes = self.experiment.conditions[f"{DEFAULT_CONDITION}/trial={trial}"]
        drawn = {k: v for change in changes.values() for k, v in change.settings_of(self.variant).items()}
        own = self.experiment.settings | self.experiment.algorithms[self.variant].settings
        fixed = ("budget", "time_limit")
        return override({key: own[key] for key in own if key not in fixed}, drawn, self.name)

    @cached_property
    def around(self) -> Mapping[tuple[str, str], Runs]:
        """The runs of the chosen settings, by ("", ""), and with one at another value, by key and value."""
        assert self.experiment.search is not None
        declared = self.experiment.algorithms[self.variant]
        n = len(self.experiment.declared_seeds(self.variant, DEFAULT_CONDITION))
        seeds = self.experiment.search.around(n)
        own = [self.runs(self.chosen, scenario, seeds) for scenario in self.experiment.scenarios]
        found = {("", ""): [run for runs in own for run in runs]}
        for key, axis in declared.search.items():
            for value in axis.marks:
                changed = override(own[0][0].settings.model_dump(mode="json"), {key: value}, self.name)
                settings = parse(type(own[0][0].settings), changed, f"{self.name}: {key} = {value}")
                if settings != own[0][0].settings:
                    first = [replace(runs[0], settings=settings) for runs in own]
                    found[key, json.dumps(value)] = [each.with_seed(seed) for each in first for seed in seeds]
        return found

    def result(self) -> Chosen:
        """Returns the chosen settings, and the effort."""
        cells = np.ndindex(self.n_trials, len(self.experiment.scenarios))
        every = [self.runs(trial, self.experiment.scenarios[i]) for trial, i in cells]
        runs = [run for runs in (*every, *self.fresh_runs.values()) for run in runs]
        records = self.store.get([run.digest for run in runs], arrays=False)
        return Chosen(
            trial=self.chosen,
            settings=self.settings(self.chosen),
            score=round(float(np.mean(self.everywhere(self.chosen))), 6),
            trials=self.n_trials - 1,
            runs=len(runs),
            steps=sum(run.settings.budget for run in runs),
            cpu_time_s=round(sum(each.provenance["cpu_time_s"][-1] for each in records), 3),
        )


def searched(experiment: Experiment, store: Store) -> list[Searched]:
    """Returns what a search has found for every learner; nothing of an experiment without a search."""
    if experiment.search is None:
        return []
    return [
        Searched(experiment, name, observation, store)
        for name, declared in experiment.algorithms.items()
        for observation in declared.observations
    ]


def later_stages(experiment: Experiment, store: Store) -> Iterator[Runs]:
    """Yields the runs of the second and third stage, each as long as those before are stored."""
    learners = searched(experiment, store)
    runs = _distinct(run for each in learners for runs in each.fresh_runs.values() for run in runs)
    yield runs
    if not driver.pending(runs, store):
        yield _distinct(run for each in learners for runs in each.around.values() for run in runs)


def _distinct(runs: Iterable[RunSpecification]) -> Runs:
    return list({run.digest: run for run in runs}.values())
