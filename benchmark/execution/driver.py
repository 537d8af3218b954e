"""Executes the runs that an experiment lacks, and stores their records; only the driver does that."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from functools import partial
from itertools import islice

from agents import load_algorithm
from benchmark.execution.executors import EXECUTORS, Executor
from benchmark.execution.job import failures
from benchmark.execution.plan import Job, plan
from benchmark.execution.provenance import versions
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification
from envs.inputs import check_all


def run(
    runs: Sequence[RunSpecification],
    store: Store,
    jobs: int,
    on_progress: Callable[[list[str], int], None] = lambda *_: None,
    executor: Executor | None = None,
) -> list[str]:
    """Executes the runs that have no valid record; returns the errors of those that failed.

    Records are stored as they come. A failed run is stored with its error, and executed again next time. On
    an interrupt, executors end what is running; the records of jobs that have finished by then are stored.
    A missing package is an InputError.

    At most `jobs` jobs are submitted at a time, by default to the executor of each one's placement; executors
    are cancelled at the end. `on_progress` gets the digests of the runs of every job that has ended, and how
    many have failed.
    """
    todo = pending(runs, store)
    # Missing packages are refused before any work.
    check_all(*(partial(versions, name) for name in sorted({run.algorithm for run in todo})))
    waiting = iter(plan(todo))
    under_way: dict[Future[list[Record]], tuple[Job, float]] = {}  # with the time when it was submitted
    errors: list[str] = []

    def keep(future: Future[list[Record]]) -> None:
        records = _records(future, *under_way[future])
        store.add(records)
        failed = [record.error for record in records if record.error is not None]
        errors.extend(failed)
        on_progress([record.digest for record in records], len(failed))
        del under_way[future]  # or its arrays would stay in memory

    try:
        with ExitStack() as stack:
            executors = _executors(todo, jobs, executor, stack)
            done: set[Future[list[Record]]] = set()
            while True:
                for job in islice(waiting, jobs - len(under_way) + len(done)):
                    used = executors[load_algorithm(job[0].algorithm).placement]
                    under_way[used.submit(job)] = job, time.perf_counter()
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


def _executors(
    runs: Sequence[RunSpecification], jobs: int, executor: Executor | None, stack: ExitStack
) -> dict[str, Executor]:
    """Returns the executor of each placement, or a given one for all; the stack cancels them."""
    executors = dict[str, Executor]()
    for placement in {load_algorithm(name).placement for name in {run.algorithm for run in runs}}:
        executors[placement] = executor or EXECUTORS[placement](jobs)
        stack.callback(executors[placement].cancel)
    return executors


def _records(future: Future[list[Record]], job: Job, started: float) -> list[Record]:
    """Returns what an ended future has, or records of failure if its job was lost."""
    try:
        return future.result()
    except Exception as error:
        return failures(job, error, started)


def pending(runs: Sequence[RunSpecification], store: Store) -> list[RunSpecification]:
    """Returns the runs that have no valid record."""
    ended = store.ended()
    return [run for run in runs if run.digest not in ended]
