"""The replication of the paper: its figure, its claims, and how far learning got."""

from agents import load_algorithm
from benchmark.experiments import Experiment
from benchmark.reports import Report
from envs import InputError


def _check(experiment: Experiment) -> None:
    families = [load_algorithm(arm.algorithm).family for arm in experiment.algorithms.values()]
    if families != ["tabular"]:
        raise InputError(
            f"{experiment.argument}: algorithms: a replication takes exactly one, and a tabular one."
        )
    if experiment.sweep:
        raise InputError(f"{experiment.argument}: sweep: a replication takes readings alone.")


REPORT = Report(_check)
