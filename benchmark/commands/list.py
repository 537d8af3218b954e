"""Shows scenarios, algorithms and experiments, and how many runs are done."""

import argparse
from collections.abc import Callable, Iterable

from agents import ALGORITHMS
from benchmark.execution.store import NoRunsError, Store
from benchmark.experiments import all_specifications, experiment_names, load_experiment
from benchmark.studies import report_of
from envs import InputError, load_scenario, scenario_names


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    try:
        with Store(options.results / "runs.db", read_only=True) as store:
            ended = store.ended()
    except NoRunsError:
        ended = set()

    def about(name: str) -> str:
        experiment = load_experiment(name)
        runs = all_specifications(experiment)
        n_done = sum(run.digest in ended for run in runs)
        which = "runs of the first stage" if report_of(experiment).study.stages else "runs"
        return f"{n_done} of {len(runs)} {which} done. {experiment.declared.description}"

    _print("scenarios", scenario_names(), lambda name: load_scenario(name).description)
    _print("algorithms", ALGORITHMS, lambda name: ALGORITHMS[name])
    _print("experiments", experiment_names(), about)
    return 0


def _print(title: str, names: Iterable[str], about: Callable[[str], str]) -> None:
    print(title)
    for name in names:
        try:
            print(f"  {name:24} {about(name)}")
        except InputError as error:
            print(f"  {name:24} not usable: {error}")
