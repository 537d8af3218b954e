"""The command `run`: trains the missing runs of an experiment, stores and publishes them."""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

from agents import load_algorithm
from benchmark.executors import EXECUTORS, Executor, usable_cores
from benchmark.experiment import Experiment, interleaved, load_experiment
from benchmark.folder import check_writable, damaged
from benchmark.job import Job, failures, plan
from benchmark.page import explorer
from benchmark.progress import Display
from benchmark.provenance import versions
from benchmark.records import check_scores
from benchmark.report import folder_name, other_seeds, study_of
from benchmark.report import main as report
from benchmark.specification import RunSpecification
from benchmark.store import Record, Store
from benchmark.tables import Group, publish, tables
from envs import InputError
from envs.inputs import check_all, whole_number
from envs.packages import needed_by


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    parse_jobs(options.jobs)  # refused before the store is made
    experiment = load_experiment(options.experiment, smoke=options.smoke)
    seeds = other_seeds(experiment, options.seeds)
    if options.report or experiment.declared.report is not None:
        study_of(experiment)  # what cannot be reported is refused before any run
    check_scores(population.first for population in experiment.populations)
    groups, folder = list[Group](), options.results / folder_name(experiment, seeds)
    check_writable(folder)
    with Store(options.results / "runs.db") as store:
        for stage in stages(experiment, store, seeds):
            runs = interleaved(group.runs for group in stage)
            if code := _train(experiment.name, runs, store, options):
                return code
            groups += stage
        agents = partial(explorer.write, experiment, store, seeds=seeds)
        with damaged(options.results / "runs.db"):
            made = tables(groups, store)
        publish(folder, *made, agents)
    print(f"{experiment.name}: the tables of all runs are in {folder}.")
    return report(options) if options.report else 0


def stages(experiment: Experiment, store: Store, seeds: range | None) -> Iterator[list[Group]]:
    """Yields the runs of each stage, of which a search has two; those before must be stored."""
    if experiment.declared.search is None:
        yield [Group(each, each.runs(each.taken(seeds))) for each in experiment.populations]
    elif seeds is None:
        yield from import_module("benchmark.search").stages(experiment, store)
    else:
        raise InputError(f"{experiment.name}: --seeds: a search uses only its declared seeds.")


def _train(name: str, runs: list[RunSpecification], store: Store, options: Any) -> int:
    """Trains missing runs when no other command trains; returns the exit code."""
    if n_damaged := store.discard_damaged(run.digest for run in runs):
        print(f"{name}: repeating runs whose records are damaged: {n_damaged}.", file=sys.stderr)
    with ExitStack() as stack:
        if pending(runs, store):
            stack.enter_context(store.alone())
        todo = pending(runs, store)  # another command may have trained some meanwhile
        n_done = len(runs) - len(todo)
        if not todo:
            print(f"{name}: all {n_done:,} runs are done already.")
            return 0
        n_jobs, n_workers, cluster = _workers(options, stack)
        jobs, published = plan(todo), options.results / Path(options.experiment).stem
        display = Display(name, jobs, n_done, published, n_workers)
        stack.callback(display.close)
        what = f"{len(todo):,} runs to train, {display.forecast()}"
        print(f"{name}: {what} (Ctrl-C keeps what is finished).", file=sys.stderr)
        errors = execute(todo, store, n_jobs, display.advance, cluster)
    if errors:
        failed = f"{len(errors)} runs failed; the same command tries them again"
        print(f"error: {failed}. First error: {errors[0]}", file=sys.stderr)
        return 1
    statuses = store.statuses()
    n_diverged = [statuses[run.digest] for run in todo].count("diverged")
    which = f", {n_diverged} of them diverged" if n_diverged else ""
    print(f"{name}: {len(todo)} runs done{which}, {n_done} were done already.")
    return 0


def _workers(options: Any, stack: ExitStack) -> tuple[int, int, Executor | None]:
    """Returns how many jobs to submit at a time, how many run, and the cluster, if there is one."""
    jobs = parse_jobs(options.jobs)
    if options.cluster is None:
        return jobs, min(jobs, usable_cores()), None
    with needed_by("--cluster"):
        from benchmark.cluster import Cluster
    cluster = Cluster(options.cluster)
    stack.callback(cluster.cancel)
    # A worker finds its next job waiting.
    return jobs if options.jobs else 2 * cluster.workers, cluster.workers, cluster


def parse_jobs(jobs: str | None) -> int:
    """Returns the number that `--jobs` gives, by default that of usable cores."""
    return usable_cores() if jobs is None else whole_number(jobs, "--jobs", 1, 1024)


def pending(runs: Sequence[RunSpecification], store: Store) -> list[RunSpecification]:
    """Returns the runs that have no valid record."""
    ended = store.ended()
    return [run for run in runs if run.digest not in ended]


def execute(
    runs: Sequence[RunSpecification],
    store: Store,
    jobs: int,
    on_progress: Callable[[list[str], int], None] = lambda *_: None,
    executor: Executor | None = None,
) -> list[str]:
    """Executes the runs that have no valid record; returns the errors of those that failed.

    Records are stored as they come. A failed run is stored with its error, and executed again next
    time. On an interrupt, executors end what is running; the records of jobs that have finished by
    then are stored. A missing package is an InputError.

    Args:
      runs: Any runs, none of them twice.
      store: Where records are stored.
      jobs: How many jobs are submitted at a time, by default to the executor of their placement.
      on_progress: Gets the digests of the runs of every job that has ended, and how many failed.
      executor: Gets all jobs instead. Executors are cancelled at the end.
    """
    todo = pending(runs, store)
    # Missing packages are refused before any work.
    check_all(*(partial(versions, name) for name in sorted({run.algorithm for run in todo})))
    waiting = iter(plan(todo))
    under_way: dict[Future[list[Record]], Job] = {}
    errors: list[str] = []

    def keep(future: Future[list[Record]]) -> None:
        # Its arrays would stay in memory if it stayed under way.
        records = _records(future, under_way.pop(future))
        store.add(records)
        failed = [record.error for record in records if record.error is not None]
        errors.extend(failed)
        on_progress([record.digest for record in records], len(failed))

    try:
        with ExitStack() as stack:
            executors = dict[str, Executor]()
            for name in {load_algorithm(run.algorithm).placement for run in todo}:
                executors[name] = executor or EXECUTORS[name](jobs)
                stack.callback(executors[name].cancel)
            done: set[Future[list[Record]]] = set()
            while True:
                for job in islice(waiting, jobs - len(under_way) + len(done)):
                    used = executors[load_algorithm(job[0].algorithm).placement]
                    under_way[used.submit(job)] = job
                for future in done:
                    keep(future)
                if not under_way:
                    return errors
                done = wait(under_way, return_when=FIRST_COMPLETED).done
    except KeyboardInterrupt:
        for future in [*under_way]:
            if future.done() and not future.cancelled() and future.exception() is None:
                keep(future)
        raise


def _records(future: Future[list[Record]], job: Job) -> list[Record]:
    """Returns what an ended future has, or records of failure if its job was lost."""
    try:
        return future.result()
    except Exception as error:
        return failures(job, error)
