"""Experiments: declared sets of runs, read from TOML and enumerated."""

from collections.abc import Mapping
from typing import Final

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

# The experiments whose results are published, the most important first, and whether each has a chapter on the
# page of all results. The results of other experiments are ignored by git.
PUBLISHED: Final[Mapping[str, bool]] = {
    "when": True,
    "compare_deep": True,
    "beyond": True,
    "reproduce": True,
    "tuning": False,
    "equivalence": False,
    "ablation": False,
}

__all__ = [
    "DEFAULT_CONDITION",
    "EXPERIMENT_DIRECTORY",
    "PUBLISHED",
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
