"""The agents of a replication, and what a replication demands of an experiment."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

import pandas as pd

from benchmark.analysis.frames import RecordsOf
from benchmark.analysis.records import Records
from benchmark.experiments import DEFAULT_CONDITION, Experiment, Reporting
from benchmark.reports.replication.claims import SCENARIOS, judge
from envs import InputError, compile_scenario

Agents = Mapping[str, Records]  # of one reading of the paper, by scenario
_CURVES: Final = {"visited": "max_q", "table": "table_max_q"}  # array of each curve that claims can be about
_DECLARED: Final = ("kind", "question", "items", "omit")  # of the keys of report


def check(experiment: Experiment) -> None:
    """Checks that an experiment has a single tabular learner that records the maximum Q, and no sweep.

    Raises:
      InputError: It has something else, or declares what a comparison decides.
    """
    source = experiment.argument
    first, *others = experiment.learners.values()
    if others or first.family != "tabular" or "record_every" not in first.algorithm.settings.model_fields:
        raise InputError(
            f"{source}: algorithms: a replication takes one: a table that records the maximum Q."
        )
    for population in experiment.populations:
        scenario = population.scenario
        model = compile_scenario(scenario)
        if not model.has_cell_maps or len(model.starts) > 1 or scenario.regions.target_radius is None:
            raise InputError(
                f"{source}: scenarios: {scenario.name} ({population.condition.name}): a replication "
                "takes scenarios like the paper's: the agent observes its cell alone, there is one start "
                "and one phase, no wall, and the regions are squares by their radii."
            )
    if experiment.declared.sweep:
        raise InputError(f"{source}: sweep: accepted: none, since a replication varies its readings alone.")
    for key, field in Reporting.model_fields.items():
        if key not in _DECLARED and getattr(experiment.report, key, field.default) != field.default:
            raise InputError(f"{source}: report.{key}: a replication takes none; accepted: in a comparison.")


@lru_cache(maxsize=1)  # most tables and figures are of the default reading
def all_agents(experiment: Experiment, records: RecordsOf, reading: str) -> Agents:
    """Returns all agents of a reading."""
    return {
        population.scenario.name: records(population)
        for population in experiment.populations
        if population.condition.name == reading
    }


def few_agents(experiment: Experiment, records: RecordsOf, reading: str = DEFAULT_CONDITION) -> Agents:
    """Returns as many agents of a reading as the paper has: those of the first seeds."""
    agents = all_agents(experiment, records, reading)
    return {name: group.subset(0, _size(experiment)) for name, group in agents.items()}


def disjoint_sets(experiment: Experiment, records: RecordsOf) -> list[Agents]:
    """Returns disjoint sets of agents by default, each as many as the paper has, by consecutive seeds.

    The first is `few_agents`. If there is no second one, there are none.
    """
    agents, size = all_agents(experiment, records, DEFAULT_CONDITION), _size(experiment)
    total = min(len(group.seeds) for group in agents.values())
    starts = range(0, total - size + 1, size)
    return [
        {name: group.subset(start, start + size) for name, group in agents.items()}
        for start in (starts if len(starts) > 1 else ())
    ]


def judged(experiment: Experiment, agents: Agents, reading: str = DEFAULT_CONDITION) -> pd.DataFrame:
    """Judges the paper's claims by agents of a reading."""
    return judge(agents, _CURVES[experiment.declared.readings[reading].curve])


@lru_cache(maxsize=1)  # two tables are made of them
def judged_sets(experiment: Experiment, records: RecordsOf) -> Sequence[pd.DataFrame]:
    """Judges the paper's claims, if any, by each of the disjoint sets, whose first and last seeds it adds."""
    if not has_claims(experiment):
        return []
    return [
        judged(experiment, agents).assign(first_seed=seeds[0], last_seed=seeds[-1])
        for agents in disjoint_sets(experiment, records)
        for seeds in [next(iter(agents.values())).seeds]
    ]


def has_claims(experiment: Experiment) -> bool:
    """Returns whether there are the paper's scenarios, which its claims are about."""
    return set(SCENARIOS) <= set(experiment.scenarios)


def _size(experiment: Experiment) -> int:
    """Returns how many agents the paper has in a scenario: as many as the algorithm declares."""
    (learner,) = experiment.learners.values()
    return learner.declared.seeds
