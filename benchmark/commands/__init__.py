"""The commands of the command line: one module each, whose `main` takes the parsed options."""

from typing import Final

from benchmark.execution.machine import usable_cores
from benchmark.experiments import Experiment, RunSpecification
from envs.inputs import InputError, shortened, unknown_name, whole_number

MAX_SEEDS: Final = 1_000_000


def parse_jobs(jobs: str | None) -> int:
    """Returns the number that `--jobs` gives, by default that of usable cores; may raise an `InputError`."""
    return usable_cores() if jobs is None else whole_number(jobs, "--jobs", 1, 1024)


def parse_seeds(text: str | None) -> range | None:
    """Returns the seeds that `--seeds` names; None if the option is not given.

    >>> list(parse_seeds("7-9"))
    [7, 8, 9]
    """
    if text is None:
        return None
    first, dash, last = text.partition("-")
    try:
        low = whole_number(first, "--seeds", 0, MAX_SEEDS - 1)
        high = whole_number(last, "--seeds", low, MAX_SEEDS - 1) if dash else low
    except InputError:
        accepted = "A-B with A at most B, as in 0-29, or one seed, as in 7; seeds below"
        raise InputError(f"--seeds {shortened(text)}: accepted: {accepted} {MAX_SEEDS:,}.") from None
    return range(low, high + 1)


def find_run(
    experiment: Experiment, learner: str, seed: str, scenario: str | None, condition: str | None
) -> RunSpecification:
    """Returns a run with any seed of a learner, or of a variant with its first form of observation.

    By default, the scenario is the experiment's first, and the condition the learner's first.
    """
    number = whole_number(seed, "--seed", 0, MAX_SEEDS - 1)
    alike = [p for p in experiment.populations if learner in (p.learner.name, p.learner.variant)]
    if not alike:
        names = {f'"{population.learner.name}"' for population in experiment.populations}
        unknown_name(experiment.name, "learner", learner, names)
    name, condition = alike[0].learner.name, condition or alike[0].condition.name
    conditions = {population.condition.name for population in alike if population.learner.name == name}
    if condition not in conditions:
        unknown_name(f"{experiment.name}: {name}", "condition", condition, conditions)
    scenario = scenario or next(iter(experiment.scenarios))
    return experiment.population(condition, scenario, name).runs([number])[0]
