"""Experiments: declared sets of runs, read from TOML and resolved."""

from collections.abc import Mapping
from typing import Final

from benchmark.experiments.experiment import Experiment as Experiment
from benchmark.experiments.experiment import Learner as Learner
from benchmark.experiments.experiment import Population as Population
from benchmark.experiments.experiment import all_specifications as all_specifications
from benchmark.experiments.experiment import interleaved as interleaved
from benchmark.experiments.experiment import load_experiment as load_experiment
from benchmark.experiments.experiment import title_of as title_of
from benchmark.experiments.run import RunSpecification as RunSpecification
from benchmark.experiments.schema import DEFAULT_CONDITION as DEFAULT_CONDITION
from benchmark.experiments.schema import EXPERIMENT_DIRECTORY as EXPERIMENT_DIRECTORY
from benchmark.experiments.schema import experiment_names as experiment_names

# The experiments whose results are published, in the order of README, and whether each has a chapter, its
# whole document, on the page of all results. The results of other experiments are ignored by git.
PUBLISHED: Final[Mapping[str, bool]] = {
    "reproduce": True,
    "compare_deep": True,
    "when": True,
    "groups": True,
    "sb3": True,
    "tuning": False,
    "tuning_map": False,
    "tuning_tables": False,
    "equivalence": False,
}
