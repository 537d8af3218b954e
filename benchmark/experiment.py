"""Experiments, resolved: the new home of what `benchmark.experiments` has."""

from benchmark.experiments import EXPERIMENT_DIRECTORY as EXPERIMENT_DIRECTORY
from benchmark.experiments import PUBLISHED as PUBLISHED
from benchmark.experiments import Experiment as Experiment
from benchmark.experiments import Learner as Learner
from benchmark.experiments import Population as Population
from benchmark.experiments import all_specifications as all_specifications
from benchmark.experiments import experiment_names as experiment_names
from benchmark.experiments import interleaved as interleaved
from benchmark.experiments import load_experiment as load_experiment
