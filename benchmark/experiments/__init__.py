"""Experiments: declared sets of runs, read from TOML and enumerated."""

from benchmark.experiments.schema import (
    DEFAULT_CONDITION,
    EXPERIMENT_DIRECTORY,
    Experiment,
    Reporting,
    experiment_names,
)
from benchmark.experiments.specification import (
    RunSpecification,
    all_specifications,
    changed_settings,
    check_size,
    evaluation_steps,
    family_of,
    load_experiment,
    population_of,
    specifications,
)

__all__ = [
    "DEFAULT_CONDITION",
    "EXPERIMENT_DIRECTORY",
    "Experiment",
    "Reporting",
    "RunSpecification",
    "all_specifications",
    "changed_settings",
    "check_size",
    "evaluation_steps",
    "experiment_names",
    "family_of",
    "load_experiment",
    "population_of",
    "specifications",
]
