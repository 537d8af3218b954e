"""Shows scenarios, algorithms and experiments, and how many runs are done."""

import argparse
from contextlib import ExitStack, suppress

from agents import ALGORITHMS
from benchmark.execution.store import NoRunsError, Store
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
    with ExitStack() as stack:
        store = None
        with suppress(NoRunsError):
            store = stack.enter_context(Store(options.results / "runs.db", read_only=True))
        for name in experiment_names():
            try:
                experiment = load_experiment(name)
            except InputError as error:
                print(f"  {name:24} not usable: {error}")
                continue
            runs = all_specifications(experiment)
            n_done = 0 if store is None else len(store.ended(run.digest for run in runs))
            print(f"  {name:24} {n_done} of {len(runs)} runs done. {experiment.description}")
    return 0
