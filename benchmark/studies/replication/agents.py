"""The agents of a replication, and what a replication demands of an experiment."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from benchmark.analysis.frames import RecordsOf
from benchmark.analysis.records import Records
from benchmark.experiments import DEFAULT_CONDITION, Experiment, load_experiment
from benchmark.studies.replication.claims import SCENARIOS
from envs import InputError, compile_scenario
from envs.words import listed

Agents = Mapping[str, Records]  # of one reading of the paper, by scenario


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, all but the paper's scenarios and one table that records the maximum Q."""
    source = experiment.argument
    first, *others = experiment.learners.values()
    if others or first.family != "tabular" or "record_every" not in first.algorithm.settings.model_fields:
        accepted = "one: a table that records the maximum Q"
        raise InputError(f"{source}: algorithms: a replication takes {accepted}.")
    if experiment.declared.grids:
        raise InputError(f"{source}: grids: accepted in a replication: none, only readings.")
    if {*experiment.scenarios} != {*SCENARIOS}:
        raise InputError(f"{source}: scenarios: a replication takes the paper's: {listed(SCENARIOS)}.")
    for population in experiment.populations:
        settings = population.first.settings.model_dump()
        if settings["budget"] <= settings["record_every"]:
            found = f"algorithms.{first.variant}: record_every = {settings['record_every']}"
            raise InputError(f"{source}: {found}: accepted: less than budget = {settings['budget']}.")
        model, name = compile_scenario(population.scenario), population.scenario.name
        is_square = model.scenario.regions.target_radius is not None
        if not (model.has_cell_maps and len(model.starts) == 1 and is_square):
            where = f"{source}: scenarios: {name} ({population.condition.name})"
            needed = "the agent observes its cell alone, there is one start and one phase, no wall"
            squares = "the regions are squares by their radii"
            raise InputError(f"{where}: in a replication {needed}, and {squares}.")


def is_of_paper(manifest: Mapping[str, Any]) -> bool:
    """Returns whether scenes and settings are the paper's by default: those of `reproduce`."""
    paper = load_experiment("reproduce")
    runs = [each.first for each in paper.populations if each.condition.name == DEFAULT_CONDITION]
    scenes = {run.scenario.name: run.scenario.model_dump(mode="json") for run in runs}
    own = manifest["scenarios"].items()
    found = {name: {**scene, "description": scenes[name]["description"]} for name, scene in own}
    (about,) = manifest["algorithms"].values()
    return (
        found == scenes
        and about["algorithm"] == runs[0].algorithm
        and about["settings"] == {runs[0].observation: runs[0].settings.model_dump(mode="json")}
        and manifest["horizon"] == paper.declared.horizon
        and "curve" not in manifest["readings"][DEFAULT_CONDITION]
    )


@lru_cache(maxsize=1)  # most tables and figures are of the default reading
def agents_of(
    experiment: Experiment, records: RecordsOf, reading: str = DEFAULT_CONDITION
) -> Sequence[Agents]:
    """Returns disjoint sets of a reading's agents by consecutive seeds, each of as many as the paper has.

    If there are two or more, all agents of the reading follow.
    """
    everyone = {
        population.scenario.name: records(population)
        for population in experiment.populations
        if population.condition.name == reading
    }
    (learner,) = experiment.learners.values()
    size, total = learner.declared.seeds, len(everyone[SCENARIOS[0]].seeds)
    sets: list[Agents] = [
        {name: agents.subset(start, start + size) for name, agents in everyone.items()}
        for start in range(0, max(total - size, 0) + 1, size)
    ]
    return [*sets, everyone] if len(sets) > 1 else sets


def few_agents(experiment: Experiment, records: RecordsOf) -> Agents:
    """Returns as many agents of the default reading as the paper has: those of the first seeds."""
    return agents_of(experiment, records)[0]
