"""Executes the runs that an experiment lacks, and stores their records; only the driver does that."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from itertools import islice

from agents import load_algorithm
from benchmark.execution.executors import EXECUTORS, Executor
from benchmark.execution.job import failures
from benchmark.execution.plan import Job, plan
from benchmark.execution.provenance import versions
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification


def run(
    runs: Sequence[RunSpecification],
    store: Store,
    jobs: int,
    on_progress: Callable[[list[str], int], None] = lambda *_: None,
    executor: Executor | None = None,
) -> list[str]:
    """Executes the runs that have no valid record, and stores their records as they come.

    A failed run is stored with its error, and executed again next time. On an interrupt, executors end what
    is running; the records of jobs that have finished by then are stored.

    Args:
      runs: The wanted runs.
      store: Where records are stored.
      jobs: How many jobs are submitted at a time.
      on_progress: Called whenever a job has ended, with the digests of its runs, and how many have failed.
      executor: Executes all jobs, and is cancelled at the end; by default, their placements decide.

    Returns:
      The errors of the runs that failed.

    Raises:
      InputError: A package is missing that an algorithm needs.
    """
    todo = pending(runs, store)
    for algorithm in sorted({run.algorithm for run in todo}):
        versions(algorithm)  # refuses a missing package before any work
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
        with _Executors(jobs, executor) as executors:
            done: set[Future[list[Record]]] = set()
            while True:
                for job in islice(waiting, jobs - len(under_way) + len(done)):
                    under_way[executors.of(job).submit(job)] = job, time.perf_counter()
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


class _Executors(ExitStack):
    """The executors of jobs, each made when it is first needed; they are cancelled at the end."""

    def __init__(self, jobs: int, given: Executor | None) -> None:
        super().__init__()
        self._jobs, self._given = jobs, given
        self._made: dict[str, Executor] = {}

    def of(self, job: Job) -> Executor:
        placement = load_algorithm(job[0].algorithm).placement
        if placement not in self._made:
            executor = self._given or EXECUTORS[placement](self._jobs)
            self._made[placement] = executor
            self.callback(executor.cancel)
        return self._made[placement]


def _records(future: Future[list[Record]], job: Job, started: float) -> list[Record]:
    try:
        return future.result()
    except Exception as error:
        return failures(job, error, started)


def pending(runs: Sequence[RunSpecification], store: Store) -> list[RunSpecification]:
    """Returns the runs that have no valid record."""
    ended = store.ended()
    return [run for run in runs if run.digest not in ended]
