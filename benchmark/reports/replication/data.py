"""What a replication is computed from, and what it demands of an experiment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product
from typing import Final

import numpy as np
import pandas as pd

from agents import load_algorithm
from benchmark.analysis.intervals import RESAMPLES
from benchmark.analysis.population import Population, load_population
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, Experiment, Reporting, specifications
from benchmark.reports.replication.claims import SCENARIOS, judge
from envs import InputError, Model, compile_scenario

_CURVES: Final = {"visited": "max_q", "table": "table_max_q"}  # array of each curve that claims can be about
_TAKEN: Final = ("kind", "question", "items", "omit")  # of the keys of report


@dataclass(frozen=True, eq=False)
class Data:
    """The agents of a replication, under every reading: as many as the paper has, and all of the default."""

    readings: Mapping[str, Mapping[str, Population]]  # reading to scenario to as many agents as the paper has
    everyone: Mapping[str, Population]  # scenario to all agents under the default reading
    curves: Mapping[str, str]  # reading to the array of maximum Q that the claims on curves are about
    variant: str
    observation: str
    note: str
    is_incomplete: bool = False  # a replication is reported whole or not at all

    @property
    def default(self) -> Sequence[Population]:
        """As many agents as the paper has, under the default reading, in the order of the scenarios."""
        return list(self.readings[DEFAULT_CONDITION].values())

    @cached_property
    def sets(self) -> Sequence[Mapping[str, Population]]:
        """Disjoint sets of agents under the default reading, as large as the paper's, by consecutive seeds.

        The first is that of the tables and figures. If there is no second one, there are no sets.
        """
        size, total = (len(each[0].seeds) for each in (self.default, [*self.everyone.values()]))
        sets = [
            {name: population.subset(start, start + size) for name, population in self.everyone.items()}
            for start in range(0, total - size + 1, size)
        ]
        return sets if len(sets) > 1 else []

    @cached_property
    def judged_readings(self) -> Mapping[str, pd.DataFrame]:
        """The claims under every reading, each with as many agents as the paper has.

        There are none without the paper's scenarios, which its claims are about.
        """
        if not set(SCENARIOS) <= set(self.everyone):
            return {}
        return {name: judge(populations, self.curves[name]) for name, populations in self.readings.items()}

    @cached_property
    def judged_sets(self) -> Sequence[pd.DataFrame]:
        """The claims in each of `sets`, if there are claims."""
        return [judge(each, self.curves[DEFAULT_CONDITION]) for each in self.sets if self.judged_readings]

    @property
    def models(self) -> Mapping[str, Model]:
        """The compiled scenarios by their names."""
        return {population.scenario: population.model for population in self.default}

    @property
    def facts(self) -> dict[str, object]:
        """Which readings leave what the agents learn as it is by default; and how intervals are resampled."""
        learned = {
            reading: [population.arrays["q"] for population in populations.values()]
            for reading, populations in self.readings.items()
        }
        default = learned.pop(DEFAULT_CONDITION)
        equal = [name for name, each in learned.items() if all(map(np.array_equal, each, default))]
        return {"learned_as_default": equal, "resamples": RESAMPLES}


def check(experiment: Experiment) -> None:
    """Checks that an experiment has a single tabular variant that records the maximum Q, and no sweep.

    Raises:
      InputError: It has something else, or declares what a comparison decides.
    """
    source = experiment.argument
    first, *others = (load_algorithm(variant.algorithm) for variant in experiment.algorithms.values())
    if others or first.family != "tabular" or "record_every" not in first.settings.model_fields:
        raise InputError(
            f"{source}: algorithms: a replication takes one: a table that records the maximum Q."
        )
    for condition in experiment.conditions:
        for run in chain(
            *(specifications(experiment, condition, *each, [0]) for each in experiment.populations)
        ):
            model = compile_scenario(run.scenario)
            if not model.has_cell_maps or len(model.starts) > 1 or run.scenario.regions.target_radius is None:
                raise InputError(
                    f"{source}: scenarios: {run.scenario.name} ({condition}): a replication "
                    "takes scenarios like the paper's: the agent observes its cell alone, there is one start "
                    "and one phase, no wall, and the regions are squares by their radii."
                )
    if experiment.sweep:
        raise InputError(f"{source}: sweep: accepted: none, since a replication varies its readings alone.")
    for key, field in Reporting.model_fields.items():
        if key not in _TAKEN and getattr(experiment.report, key, field.default) != field.default:
            raise InputError(f"{source}: report.{key}: a replication takes none; accepted: in a comparison.")


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Data:
    """Reads all agents of a replication; claims are judged of all runs or not at all, so never in part.

    Raises:
      InputError: A run is missing, or lacks what the claims need.
    """
    if partial:
        raise InputError(f"--partial: {experiment.name} is a replication; accepted: a comparison.")
    variant, declared = next(iter(experiment.algorithms.items()))
    observation = declared.observations[0]
    agents: dict[str, dict[str, Population]] = {reading: {} for reading in experiment.readings}
    for reading, scenario in product(experiment.readings, experiment.scenarios):
        runs = specifications(experiment, reading, scenario, variant, observation, seeds)
        population = load_population(runs, store)
        agents[reading][population.scenario] = population
    everyone = agents[DEFAULT_CONDITION]
    first = next(iter(everyone.values()))
    for name in _CURVES.values():
        if name not in first.arrays:
            raise InputError(f"{experiment.name}: algorithms.{variant}: its training returns no {name}.")
    note = ""
    if seeds is not None:
        n_agents, n_declared = len(first.seeds), len(experiment.declared_seeds(variant, DEFAULT_CONDITION))
        note = f"Agents have the seeds {min(seeds)} to {max(seeds)} instead of those declared."
        if n_agents < n_declared:
            note = f"Partial: {n_agents} of the {n_declared} agents declared per scenario."
    few = {
        reading: {name: each.subset(0, declared.seeds) for name, each in populations.items()}
        for reading, populations in agents.items()
    }
    curves = {name: _CURVES[reading.curve] for name, reading in experiment.readings.items()}
    return Data(few, everyone, curves, variant, observation, note)
