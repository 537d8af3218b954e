"""The agents of a replication, and what a replication demands of an experiment."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from benchmark.analysis.frames import RecordsOf
from benchmark.analysis.records import Records
from benchmark.experiments import DEFAULT_CONDITION, Experiment
from benchmark.reports.replication.claims import SCENARIOS
from envs import InputError, compile_scenario
from envs.words import listed

Agents = Mapping[str, Records]  # of one reading of the paper, by scenario
_DECLARED: Final = {"kind", "question", "items", "omit"}  # of the keys of report


def check(experiment: Experiment) -> None:
    """Checks that an experiment has the paper's scenarios, and a single table that records the maximum Q.

    Raises:
      InputError: It has something else, or declares what a comparison decides.
    """
    source, report = experiment.argument, experiment.report
    first, *others = experiment.learners.values()
    if others or first.family != "tabular" or "record_every" not in first.algorithm.settings.model_fields:
        raise InputError(
            f"{source}: algorithms: a replication takes one: a table that records the maximum Q."
        )
    if {*experiment.scenarios} != {*SCENARIOS}:
        raise InputError(f"{source}: scenarios: a replication takes the paper's: {listed(SCENARIOS)}.")
    for population in experiment.populations:
        model, name = compile_scenario(population.scenario), population.scenario.name
        is_square = model.scenario.regions.target_radius is not None
        if not (model.has_cell_maps and len(model.starts) == 1 and is_square):
            raise InputError(
                f"{source}: scenarios: {name} ({population.condition.name}): in a replication the agent "
                "observes its cell alone, there is one start and one phase, no wall, and the regions are "
                "squares by their radii."
            )
    foreign = ["sweep"] if experiment.declared.sweep else []
    if report is not None:
        declared = report.model_dump(exclude_defaults=True, exclude=_DECLARED)
        foreign += [f"report.{key}" for key in declared]
    for key in foreign:
        raise InputError(f"{source}: {key}: a replication takes none; accepted: in a comparison.")


@lru_cache(maxsize=1)  # most tables and figures are of the default reading
def _all_agents(experiment: Experiment, records: RecordsOf, reading: str) -> Agents:
    return {
        population.scenario.name: records(population)
        for population in experiment.populations
        if population.condition.name == reading
    }


def sets_of_agents(
    experiment: Experiment, records: RecordsOf, reading: str = DEFAULT_CONDITION
) -> list[Agents]:
    """Returns a reading's agents in disjoint sets by consecutive seeds, each of as many as the paper has."""
    agents = _all_agents(experiment, records, reading)
    (learner,) = experiment.learners.values()
    size, total = learner.declared.seeds, len(agents[SCENARIOS[0]].seeds)
    return [
        {name: group.subset(start, start + size) for name, group in agents.items()}
        for start in range(0, max(total - size, 0) + 1, size)
    ]


def few_agents(experiment: Experiment, records: RecordsOf, reading: str = DEFAULT_CONDITION) -> Agents:
    """Returns as many agents of a reading as the paper has: those of the first seeds."""
    return sets_of_agents(experiment, records, reading)[0]


def few_and_all(experiment: Experiment, records: RecordsOf) -> list[Agents]:
    """Returns as many agents by default as the paper has, and all if there are twice as many or more."""
    first, *others = sets_of_agents(experiment, records)
    return [first, _all_agents(experiment, records, DEFAULT_CONDITION)] if others else [first]
