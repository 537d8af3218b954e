"""Shows scenarios, algorithms and experiments, and how many runs are done."""

import argparse

from agents import ALGORITHMS
from benchmark.execution.driver import pending
from benchmark.execution.store import Store
from benchmark.experiments import all_specifications, experiment_names, load_experiment
from envs import InputError, load_scenario, scenario_names


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    print("scenarios")
    for name in scenario_names():
        try:
            print(f"  {name:24} {load_scenario(name).description}")
        except InputError as error:
            print(f"  {name:24} not usable: {error}")
    print("algorithms")
    for name, module in ALGORITHMS.items():
        print(f"  {name:24} {module}")
    print("experiments")
    database = options.results / "runs.db"
    for name in experiment_names():
        try:
            experiment = load_experiment(name)
        except InputError as error:
            print(f"  {name:24} not usable: {error}")
            continue
        runs = all_specifications(experiment)
        done = 0
        if database.exists():
            with Store(database, read_only=True) as store:
                done = len(runs) - len(pending(runs, store))
        print(f"  {name:24} {done} of {len(runs)} runs done. {experiment.description}")
    return 0
