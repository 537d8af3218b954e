"""Executes the missing runs of an experiment."""

import argparse
import os
import sys
from collections.abc import Collection
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from agents import load_algorithm
from benchmark.commands import parse_seeds, report
from benchmark.execution import driver
from benchmark.execution.executors import load_executor
from benchmark.execution.plan import plan
from benchmark.execution.progress import Display
from benchmark.execution.store import Record, Store
from benchmark.experiments import Experiment, all_specifications, load_experiment
from envs import InputError

if TYPE_CHECKING:
    from benchmark.execution.executors.cluster import Cluster


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs {options.jobs}: accepted: at least 1.")
    experiment = load_experiment(options.experiment)
    seeds = parse_seeds(options.seeds)
    report.check(experiment, is_required=options.report)
    fewest = min(
        len(experiment.declared_seeds(arm, condition)) if seeds is None else len(seeds)
        for arm in experiment.algorithms
        for condition in experiment.conditions
    )
    if options.report and fewest < 2:
        raise InputError("--report: one seed gives no interval; accepted: at least two seeds for every arm.")
    executor = None if options.executor is None else load_executor(options.executor, "--executor")
    if options.tensorboard is not None:
        _check_logs(experiment, options.tensorboard)
    runs = all_specifications(experiment, seeds)
    diverged: list[str] = []
    with Store(options.results / "runs.db") as store:
        todo = driver.pending(runs, store)
        if options.tensorboard is not None and len(todo) < len(runs):
            done = f"{len(runs) - len(todo)} of {len(runs)} runs are done already"
            print(f"{experiment.name}: {done}; they are not trained again for --tensorboard.")
        if not todo:
            print(f"{experiment.name}: all {len(runs)} runs are done already.")
            return report.main(options) if options.report else 0
        with ExitStack() as stack:
            jobs = options.jobs or os.cpu_count() or 1
            if options.cluster is not None:
                cluster = _connect(options.cluster, {run.algorithm for run in todo})
                stack.callback(cluster.cancel)
                # A worker finds its next job waiting.
                jobs, executor = options.jobs or 2 * cluster.workers, lambda _: cluster
            display = stack.enter_context(Display(experiment, seeds, store.ended(), plan(todo)))

            def advance(records: list[Record]) -> None:
                display.advance(records)
                diverged.extend(record.digest for record in records if record.status == "diverged")

            errors = driver.run(
                runs,
                store,
                jobs,
                on_progress=advance,
                on_start=display.start,
                logs=options.tensorboard,
                executor=executor,
            )
    if errors:
        print(
            f"error: {len(errors)} runs failed; the same command tries them again. First error: {errors[0]}",
            file=sys.stderr,
        )
        return 1
    which = f", {len(diverged)} of them diverged" if diverged else ""
    print(f"{experiment.name}: {len(todo)} runs done{which}, {len(runs) - len(todo)} were done already.")
    return report.main(options) if options.report else 0


def _connect(address: str, algorithms: Collection[str]) -> "Cluster":
    """Returns a cluster that can execute runs of these algorithms."""
    if find_spec("distributed") is None:
        raise InputError(
            "--cluster: the package distributed is not installed; "
            "pip install 'proxemic-benchmark[cluster]' installs it."
        )
    from benchmark.execution.executors.cluster import Cluster

    return Cluster(address, algorithms)


def _check_logs(experiment: Experiment, directory: Path) -> None:
    """Refuses TensorBoard logs that no algorithm writes, or that cannot be written."""
    if not any(load_algorithm(arm.algorithm).writes_logs for arm in experiment.algorithms.values()):
        raise InputError(
            f"--tensorboard: no algorithm of {experiment.name} writes logs; accepted: an experiment with "
            "algorithms of Stable-Baselines3."
        )
    if find_spec("tensorboard") is None:
        raise InputError(
            "--tensorboard: the package tensorboard is not installed; "
            ".venv/bin/pip install tensorboard installs it."
        )
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--tensorboard {directory}: cannot be created: {error.strerror}.") from error
