"""Experiments: a TOML file each, and beside it the function that says what was found."""

from benchmark.experiment import EXPERIMENT_DIRECTORY as EXPERIMENT_DIRECTORY
from benchmark.experiment import PUBLISHED as PUBLISHED
from benchmark.experiment import Experiment as Experiment
from benchmark.experiment import Learner as Learner
from benchmark.experiment import Population as Population
from benchmark.experiment import all_specifications as all_specifications
from benchmark.experiment import experiment_names as experiment_names
from benchmark.experiment import interleaved as interleaved
from benchmark.experiment import load_experiment as load_experiment
from benchmark.specification import DEFAULT_CONDITION as DEFAULT_CONDITION
from benchmark.specification import RunSpecification as RunSpecification
