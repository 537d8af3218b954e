"""Shows scenarios, algorithms and experiments."""

import argparse
from collections.abc import Callable, Iterable

from agents import ALGORITHMS
from benchmark.experiments import experiment_names
from benchmark.experiments.schema import read_experiment
from envs import InputError, load_scenario, scenario_names


def main(_: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    _print("scenarios", scenario_names(), lambda name: load_scenario(name).description)
    _print("algorithms", ALGORITHMS, lambda name: ALGORITHMS[name])
    # To load them would import torch and resolve thousands of trials.
    _print("experiments", experiment_names(), lambda name: read_experiment(name)[0].description)
    return 0


def _print(title: str, names: Iterable[str], about: Callable[[str], str]) -> None:
    print(title)
    for name in names:
        try:
            print(f"  {name:24} {about(name)}")
        except InputError as error:
            print(f"  {name:24} not usable: {error}")
