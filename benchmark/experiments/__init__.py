"""Experiments: declared sets of runs, read from TOML and resolved."""

from benchmark.experiments.experiment import (
    Experiment,
    Learner,
    Population,
    all_specifications,
    check_size,
    load_experiment,
    title_of,
)
from benchmark.experiments.run import RunSpecification, evaluation_steps, population_of
from benchmark.experiments.schema import (
    DEFAULT_CONDITION,
    EXPERIMENT_DIRECTORY,
    Condition,
    Reporting,
    experiment_names,
)

__all__ = [
    "DEFAULT_CONDITION",
    "EXPERIMENT_DIRECTORY",
    "Condition",
    "Experiment",
    "Learner",
    "Population",
    "Reporting",
    "RunSpecification",
    "all_specifications",
    "check_size",
    "evaluation_steps",
    "experiment_names",
    "load_experiment",
    "population_of",
    "title_of",
]
