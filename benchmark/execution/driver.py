"""Runs what an experiment still lacks, and keeps what comes of it.

The unit of work is a job: runs that differ by their seed alone and are trained by one call. Training
together equals training alone, so how runs fall into jobs changes no result. Jobs of an algorithm that
leaves Python's lock alone run in this process's threads; others, one run each, in worker processes. Only
this process writes to the store.
"""

import multiprocessing
import os
import platform
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import check_training, load_algorithm
from agents.dynamic_programming import Evaluation, evaluate, every_cell
from agents.policy import Policy, mask_policy
from benchmark.execution.store import Record, Store, evaluated
from benchmark.experiments.specification import RunSpecification
from envs import InputError, Model, compile_scenario

Job = list[RunSpecification]

JOB_WORK = 10_000_000  # budget units at most, unless one run has more: an interrupt waits for running jobs
_PACKAGES = ("gymnasium", "matplotlib", "numba", "numpy", "pandas", "scipy", "seaborn")


def run(
    runs: Sequence[RunSpecification],
    store: Store,
    jobs: int,
    on_progress: Callable[[list[Record]], None] = lambda _: None,
    on_start: Callable[[Job], None] = lambda _: None,
    logs: Path | None = None,
) -> list[str]:
    """Executes the runs that are not done, and keeps their records as they come.

    An interrupt waits for threads, whose jobs are short, and stops worker processes, whose runs are lost.

    Args:
      runs: Wanted runs.
      store: Where records are kept; a failed run is kept with its error and tried again next time.
      jobs: How many to have under way at a time.
      on_progress: Called with the records of every job that has just ended.
      on_start: Called with every job that begins, in whatever thread begins it.
      logs: Where algorithms that can shall tell TensorBoard of their training; no result depends on it.

    Returns:
      The errors of the runs that failed, none in the ordinary case.

    Raises:
      InputError: A package is missing that an algorithm needs.
    """
    todo = plan(pending(runs, store))
    provenance = _provenance(todo)
    workers = Workers()
    errors: list[str] = []

    def keep(future: Future[list[Record]]) -> None:
        records = future.result()
        store.add(records)
        errors.extend(record.error for record in records if record.error is not None)
        on_progress(records)

    def execute(job: Job) -> list[Record]:
        on_start(job)
        in_thread = load_algorithm(job[0].algorithm).placement == "thread"
        return (execute_job if in_thread else workers.execute)(job, provenance, logs)

    with ThreadPoolExecutor(jobs) as pool:
        waiting: set[Future[list[Record]]] = set()
        try:
            waiting.update(pool.submit(execute, job) for job in todo)
            for future in as_completed(list(waiting)):
                keep(future)
                waiting.discard(future)  # or its arrays would stay in memory
        except KeyboardInterrupt:
            workers.stop()
            pool.shutdown(cancel_futures=True)  # waits for the jobs that are running
            for future in waiting:
                if not future.cancelled() and not isinstance(future.exception(), _StoppedError):
                    keep(future)
            raise
        except BaseException:
            workers.stop()
            pool.shutdown(cancel_futures=True)
            raise
        finally:
            workers.stop()
    return errors


def pending(runs: Sequence[RunSpecification], store: Store) -> list[RunSpecification]:
    """Returns the runs that have no valid record."""
    ended = store.ended()
    return [run for run in runs if run.digest not in ended]


def plan(runs: Sequence[RunSpecification]) -> list[Job]:
    """Splits runs into jobs, in the order in which each has its first run."""
    populations: dict[str, Job] = {}
    for one in runs:
        populations.setdefault(one.population, []).append(one)
    place = {one.digest: i for i, one in enumerate(runs)}
    jobs = []
    for together in populations.values():
        preferred = load_algorithm(together[0].algorithm).batch_size
        size = max(1, min(preferred, JOB_WORK // together[0].settings.budget))
        jobs += [together[i : i + size] for i in range(0, len(together), size)]
    return sorted(jobs, key=lambda job: place[job[0].digest])


def execute_job(job: Job, provenance: dict[str, Any], logs: Path | None = None) -> list[Record]:
    """Trains the runs of one job and judges every snapshot of them exactly.

    Args:
      job: Runs that differ by their seed alone.
      provenance: What their records shall say of code and machine.
      logs: See `run`.
    """
    started = time.perf_counter()
    started_at = datetime.now(UTC).isoformat(timespec="seconds")
    _reset_peak_memory()
    try:
        arrays = _train_and_evaluate(job, logs)
        error = None
    except Exception as exception:  # a run's failure is its result: kept, told, and tried next time
        arrays = [{} for _ in job]
        error = f"{type(exception).__name__}: {exception}"
    provenance = provenance | {
        "started_at": started_at,
        "wall_time_s": (time.perf_counter() - started) / len(job),
        "peak_memory_mb": _peak_memory_mb(),
    }
    records = []
    for one, own in zip(job, arrays, strict=True):
        # Measured, and so no result: arrays are the same whenever a run is repeated.
        seconds = own.pop("cpu_time_s", np.empty(0)).tolist()
        records.append(_record(one, own, provenance | {"cpu_time_s": seconds}, error))
    return records


def _record(
    one: RunSpecification, arrays: dict[str, NDArray[Any]], provenance: dict[str, Any], error: str | None
) -> Record:
    """Makes a run's record."""
    status = "failed" if error is not None else "done" if arrays["diverged_at"] < 0 else "diverged"
    return Record(
        digest=one.digest,
        specification=one.content,
        status=status,
        provenance=provenance,
        arrays=arrays,
        error=error,
    )


def _train_and_evaluate(job: Job, logs: Path | None) -> list[dict[str, NDArray[Any]]]:
    """Returns each run's arrays."""
    first = job[0]
    model = compile_scenario(first.scenario)
    training = load_algorithm(first.algorithm).train(
        model,
        first.settings,
        first.observation,
        [one.seed_sequence for one in job],
        first.schedule,
        [] if logs is None else [logs / one.folder for one in job],
    )
    check_training(training, model, len(job), first.schedule)
    columns = {field.name: getattr(training, field.name) for field in fields(training)}
    # Equal policies, as all are before the first step, are evaluated once.
    masks, where = np.unique(training.greedy.reshape(-1, model.n_observations), axis=0, return_inverse=True)
    shape = training.greedy.shape[:2]  # (N, T)
    for start in first.evaluated_from:
        for name, values in _evaluate(model, mask_policy(masks), first.horizon, start).items():
            columns[evaluated(name, "greedy", start)] = values[where.ravel()].reshape(
                *shape, *values.shape[1:]
            )
        for name, values in _evaluate(model, training.stochastic, first.horizon, start).items():
            columns[evaluated(name, "stochastic", start)] = values
    return [{name: values[i] for name, values in columns.items()} for i in range(len(job))]


def _evaluate(model: Model, policy: Policy, horizon: int, start: str) -> dict[str, NDArray[np.float64]]:
    """Returns the fields of an evaluation; policies may be none."""
    evaluation = evaluate(model, policy, horizon, every_cell(model) if start == "every_cell" else None)
    return {field.name: getattr(evaluation, field.name) for field in fields(Evaluation)}


class _StoppedError(Exception):
    """The worker was stopped on purpose."""


class Workers:
    """One process for every thread that asks, made when it first asks, and anew when it has died."""

    def __init__(self) -> None:
        self._own = threading.local()
        self._all: list[multiprocessing.process.BaseProcess] = []
        self._lock = threading.Lock()
        self._stopped = False

    def execute(self, job: Job, provenance: dict[str, Any], logs: Path | None = None) -> list[Record]:
        """Executes a job in this thread's process; if that dies, the job failed and nothing else did.

        Raises:
          _StoppedError: `stop` was called meanwhile.
        """
        started_at = datetime.now(UTC).isoformat(timespec="seconds")
        started = time.perf_counter()
        if getattr(self._own, "connection", None) is None:
            self._start()
        try:
            self._own.connection.send((job, provenance, logs))
            records: list[Record] = self._own.connection.recv()
        except (EOFError, OSError):
            if self._stopped:
                raise _StoppedError from None
            self._own.process.join()
            self._own.connection = None
            code = self._own.process.exitcode  # None if another thread has asked the system first
            killed = code is not None and code < 0
            reason = f"was killed by signal {-code}" if killed else f"ended with exit code {code}"
            error = f"WorkerDied: its process {reason}"
            provenance = provenance | {
                "started_at": started_at,
                "wall_time_s": time.perf_counter() - started,
                "peak_memory_mb": None,
                "cpu_time_s": [],
            }
            return [_record(one, {}, provenance, error) for one in job]
        return records

    def _start(self) -> None:
        """Starts this thread's process, out of reach of the terminal's interrupt: the driver stops it."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs,), daemon=True)
        resource_tracker.ensure_running()  # or the first start would begin it, and it unblocks the interrupt
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            with self._lock:
                if self._stopped:
                    raise _StoppedError
                process.start()
                self._all.append(process)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        theirs.close()
        self._own.process, self._own.connection = process, ours

    def stop(self) -> None:
        """Kills every process, whatever it is at; there is nothing in them to be saved."""
        with self._lock:
            self._stopped = True
            for process in self._all:
                process.kill()
                process.join()


def _serve(connection: Connection) -> None:
    """Executes jobs as they come, in a process of its own, and ends with the driver."""
    driver = multiprocessing.parent_process()
    assert driver is not None

    def end_with_the_driver() -> None:
        driver.join()
        os._exit(1)

    threading.Thread(target=end_with_the_driver, daemon=True).start()
    with suppress(EOFError):  # the driver has closed its end
        while True:
            connection.send(execute_job(*connection.recv()))


def _provenance(jobs: Sequence[Job]) -> dict[str, Any]:
    """Returns what runs' records say of the code and machine they ran on, or what is not installed."""
    packages = dict.fromkeys(_PACKAGES)
    for name in sorted({job[0].algorithm for job in jobs}):
        packages |= dict.fromkeys(load_algorithm(name).packages)
    versions = {"python": platform.python_version()}
    for package in packages:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            raise InputError(
                f"{package} is not installed, which the experiment needs; make compare-deep installs it."
            ) from None
    return {
        "commit": _commit(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "versions": versions,
    }


def _reset_peak_memory() -> None:
    """Makes this process's peak memory that of now, where the system can: Linux."""
    with suppress(OSError):  # the peak is then that of all runs of the process so far
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def _peak_memory_mb() -> float | None:
    """Returns the most memory that this process held, in MB, where the system tells."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return None
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def _commit() -> str | None:
    """Returns the commit of the code, marked where files beside results differ from it."""
    root = Path(__file__).parents[2]
    try:
        describe = ["git", "-C", str(root), "rev-parse", "--short=12", "HEAD"]
        commit = subprocess.run(describe, check=True, capture_output=True, text=True).stdout.strip()
        changes = ["git", "-C", str(root), "status", "--porcelain", "--", "envs", "agents", "benchmark"]
        changed = subprocess.run(changes, check=True, capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit + ("-changed" if changed else "")
