"""Old names, until nothing imports them."""

from benchmark.experiment import EXPERIMENT_DIRECTORY as EXPERIMENT_DIRECTORY
from benchmark.experiment import Condition as Condition
from benchmark.experiment import Variant as Variant
from benchmark.experiment import experiment_names as experiment_names
from benchmark.experiment import read_experiment as read_experiment
from benchmark.specification import DEFAULT_CONDITION as DEFAULT_CONDITION
