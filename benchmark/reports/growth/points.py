"""What is measured at the points of the curves.

Every point has a fresh process, so its peak memory is its own: `command` runs a real command, and `fresh`
calls one of the functions that follow it in a process of its own.
"""

import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import wait
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from numpy.random import SeedSequence

from agents import Schedule
from agents.dynamic_programming import evaluate, solve
from agents.policy import uniform_policy
from agents.tabular import learner
from benchmark.execution import driver
from benchmark.execution.executors import Executor
from benchmark.execution.executors.processes import Processes, end_with_the_driver, interrupts_blocked
from benchmark.execution.executors.threads import Threads
from benchmark.execution.plan import Job, plan
from benchmark.execution.provenance import peak_memory_mb
from benchmark.execution.store import Record, Store
from benchmark.experiments import Experiment, RunSpecification, all_specifications
from envs import InputError, Model, compile_scenario, load_scenario

# What a point took: `seconds`, most often `peak_memory_mb` (NaN where the system does not say), and more.
Values = dict[str, float]

HORIZON: Final = 200  # steps of an exact evaluation in a grid
STEPS: Final = 1_000_000  # of a table in a grid
_CALLS: Final = 3  # of what is computed for a grid; the fastest counts
# A command that says its peak memory in its last line of output.
_COMMAND: Final = """
import sys
from benchmark.__main__ import main
if __name__ == "__main__":
    code = main(sys.argv[1:])
    from benchmark.execution.provenance import peak_memory_mb
    print(peak_memory_mb() or "nan")
    sys.exit(code)
"""


def command(*arguments: str) -> Values:
    """Runs a command of this project, and measures it from the start of its process to the end.

    Raises:
      InputError: It failed.
    """
    started = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", _COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # all its processes can be ended together
    )
    try:
        output, errors = process.communicate()
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    seconds = time.perf_counter() - started
    if process.returncode:
        reason = errors.splitlines()[-1].removeprefix("error: ") if errors else "it printed no error"
        raise InputError(f"growth: the command {arguments[0]} failed: {reason}")
    return {"seconds": seconds, "peak_memory_mb": float(output.splitlines()[-1])}


def fresh(function: Callable[..., Values], *arguments: object) -> Values:
    """Calls a function in a fresh process.

    Raises:
      InputError: It raised an exception, or its process died.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(theirs, function, arguments))
    with interrupts_blocked():
        process.start()
    theirs.close()
    try:
        values: Values = ours.recv()
    except EOFError:
        process.join()
        raise InputError(
            f"growth: {function.__name__} failed: its process ended with exit code {process.exitcode}."
        ) from None
    finally:
        process.kill()
        process.join()
    return values


def _answer(connection: Connection, function: Callable[..., Values], arguments: Sequence[object]) -> None:
    """Sends what a function returns, unless the driver ends before."""
    end_with_the_driver()
    connection.send(function(*arguments))


def agents(experiment: Experiment, results: Path) -> Values:
    """Trains and stores all runs of an experiment by the real runner, one job at a time.

    Compiling and importing come before.
    """
    executor, peaks = Threads(1), [_peak()]
    _warm(executor, all_specifications(experiment, [0]), 1)

    def start(_: Job) -> None:
        peaks.append(_peak())  # a job begins by measuring the peak anew

    started = time.perf_counter()
    _run(all_specifications(experiment), results, 1, executor, on_start=start)
    seconds = time.perf_counter() - started
    return {"seconds": seconds, "peak_memory_mb": max(*peaks, _peak())}


def compiling(rows: int, columns: int) -> Values:
    """Reads, checks and compiles a grid."""

    def work() -> None:
        compile_scenario.cache_clear()
        _grid(rows, columns)

    return _fastest(work)


def solving(rows: int, columns: int) -> Values:
    """Computes the optimal values of a grid, with the paper's discount."""
    return _in_grid(rows, columns, lambda model: solve(model, learner.Settings(budget=1).discount))


def evaluating(rows: int, columns: int) -> Values:
    """Evaluates the random policy in a grid exactly."""
    return _in_grid(rows, columns, lambda model: evaluate(model, uniform_policy(model), HORIZON))


def training(rows: int, columns: int) -> Values:
    """Trains one table in a grid, with the paper's constants."""
    settings = learner.Settings(budget=STEPS, record_every=STEPS)

    def train(model: Model) -> object:
        return learner.train(model, settings, [SeedSequence(0)], Schedule(STEPS), threads=1)

    return _in_grid(rows, columns, train)


def processes(n_workers: int, runs: Sequence[RunSpecification], results: Path) -> Values:
    """Trains runs in worker processes of this machine."""
    return _work(Processes(n_workers), n_workers, n_workers, runs, results)


def dask(n_workers: int, runs: Sequence[RunSpecification], results: Path) -> Values:
    """Trains runs in the workers of a Dask cluster on this machine, as `run --cluster` does."""
    with _cluster(n_workers, runs, results) as executor:
        return _work(executor, n_workers, 2 * n_workers, runs, results)


def overhead(experiment: Experiment, results: Path) -> Values:
    """Trains an experiment's nets in one thread.

    Returns:
      Beside the seconds, the number of jobs and the seconds of the jobs themselves.
    """
    runs, executor = all_specifications(experiment), Threads(1)
    _warm(executor, runs[:1], 1)
    own: list[float] = []

    def end(records: list[Record]) -> None:
        own.extend(record.provenance["wall_time_s"] for record in records)

    started = time.perf_counter()
    _run(runs, results, 1, executor, end)
    seconds = time.perf_counter() - started
    return {"seconds": seconds, "jobs": len(plan(runs)), "own_seconds": sum(own)}


def _work(
    executor: Executor, n_workers: int, jobs: int, runs: Sequence[RunSpecification], results: Path
) -> Values:
    """Trains runs in workers that have trained some, with so many jobs under way."""
    first = {run.population: run for run in runs}
    _warm(executor, list(first.values()), n_workers)
    started = time.perf_counter()
    _run(runs, results, jobs, executor)
    return {"seconds": time.perf_counter() - started, "jobs": len(plan(runs))}


def _warm(executor: Executor, runs: Sequence[RunSpecification], times: int) -> None:
    """Executes each of some runs several times, so that workers have imported and compiled what they need."""
    wait([executor.submit([run]) for run in runs for _ in range(times)])


def _run(
    runs: Sequence[RunSpecification],
    results: Path,
    jobs: int,
    executor: Executor,
    on_progress: Callable[[list[Record]], None] = lambda _: None,
    on_start: Callable[[Job], None] = lambda _: None,
) -> None:
    """Trains and stores runs by the real runner, and releases the executor.

    Raises:
      RuntimeError: A run failed.
    """
    with Store(results / "runs.db") as store:
        errors = driver.run(runs, store, jobs, on_progress, on_start, executor=lambda _: executor)
    if errors:
        raise RuntimeError(errors[0])


@contextmanager
def _cluster(n_workers: int, runs: Sequence[RunSpecification], results: Path) -> Iterator[Executor]:
    """Starts a Dask cluster on this machine, which ends with this process."""
    from distributed import LocalCluster

    from benchmark.execution.executors.cluster import Cluster

    address = "127.0.0.1"
    with LocalCluster(
        n_workers=n_workers,
        threads_per_worker=1,
        host=address,
        dashboard_address=f"{address}:0",
        local_directory=str(results),
    ) as local:
        local.wait_for_workers(n_workers)
        yield Cluster(local.scheduler_address, {run.algorithm for run in runs})


def _grid(rows: int, columns: int) -> Model:
    """Compiles S1 with another grid, in which the first wrong PING ends the episode."""
    changes = {"grid.rows": rows, "grid.columns": columns, "ping_limit": 1}
    return compile_scenario(load_scenario("S1", changes))


def _in_grid(rows: int, columns: int, work: Callable[[Model], Any]) -> Values:
    """Measures what is computed for a grid; compiling comes before."""
    model = _grid(rows, columns)
    return _fastest(lambda: work(model))


def _fastest(work: Callable[[], Any]) -> Values:
    """Measures the fastest of several calls, after one that loads compiled code."""
    work()
    seconds = []
    for _ in range(_CALLS):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return {"seconds": min(seconds), "peak_memory_mb": _peak()}


def _peak() -> float:
    """Returns this process's peak memory; NaN where the system does not say."""
    return peak_memory_mb() or math.nan
