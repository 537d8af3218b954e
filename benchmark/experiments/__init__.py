"""Experiments: declared sets of runs, read from TOML and resolved."""

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

# The experiments whose results are published, in the order of README. .gitignore lists them, too.
PUBLISHED: Final = (
    "reproduce",
    "compare_deep",
    "when",
    "groups",
    "sb3",
    "tuning",
    "tuning_map",
    "tuning_tables",
    "equivalence",
)
