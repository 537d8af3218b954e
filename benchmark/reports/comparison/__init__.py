"""The comparison of tabular and deep learners."""

from benchmark.experiments import DEFAULT_CONDITION, Experiment
from benchmark.reports import Report
from envs import InputError


def _check(experiment: Experiment) -> None:
    if list(experiment.conditions) != [DEFAULT_CONDITION]:
        raise InputError(
            f"{experiment.argument}: readings: a comparison takes the {DEFAULT_CONDITION} condition alone."
        )


REPORT = Report(_check)
