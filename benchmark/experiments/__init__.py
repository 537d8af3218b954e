"""Experiments: declared sets of runs, read from TOML and resolved."""

from collections.abc import Mapping
from typing import Final

from benchmark.experiments.experiment import (
    Experiment,
    Learner,
    Population,
    all_specifications,
    interleaved,
    load_experiment,
    title_of,
)
from benchmark.experiments.run import RunSpecification
from benchmark.experiments.schema import DEFAULT_CONDITION, EXPERIMENT_DIRECTORY, Reporting, experiment_names

# The experiments whose results are published, the most important first, and whether each has a chapter, its
# whole document, on the page of all results. The results of other experiments are ignored by git.
PUBLISHED: Final[Mapping[str, bool]] = {
    "when": True,
    "groups": True,
    "compare_deep": True,
    "sb3": True,
    "beyond": True,
    "reproduce": True,
    "tuning": False,
    "tuning_map": False,
    "tuning_noise": False,
    "tuning_groups": False,
    "equivalence": False,
    "ablation": False,
}

__all__ = [
    "DEFAULT_CONDITION",
    "EXPERIMENT_DIRECTORY",
    "PUBLISHED",
    "Experiment",
    "Learner",
    "Population",
    "Reporting",
    "RunSpecification",
    "all_specifications",
    "experiment_names",
    "interleaved",
    "load_experiment",
    "title_of",
]
