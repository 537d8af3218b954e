"""Where jobs run: threads or worker processes, by the algorithm's placement."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Protocol

from agents.sb3 import use_same_instructions
from benchmark.job import Job, execute_job
from benchmark.store import Record
from envs.sources import FOUND, use_modules

_PR_SET_PDEATHSIG = 1  # of prctl: send a signal when the parent thread ends


def usable_cores() -> int:
    """Returns how many cores this process may keep busy, at least 1."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Executor(Protocol):
    """A place where jobs run. Only the driver calls it, from one thread."""

    def submit(self, job: Job) -> Future[list[Record]]:
        """Starts `execute_job(job)`, and returns a future of its records.

        If the job is lost, for example because its machine fails, the future has an exception. The
        driver then records the job's runs as failed, with this exception as their error.
        """

    def cancel(self) -> None:
        """Ends whatever is running, by waiting or by stopping it, and releases all resources.

        Afterwards every future is done or cancelled, and nothing is submitted any more.
        """


class Threads:
    """Threads of this process: for jobs that release Python's global lock while they train."""

    def __init__(self, jobs: int) -> None:
        self._pool = ThreadPoolExecutor(jobs)

    def submit(self, job: Job) -> Future[list[Record]]:
        """Executes a job in the next free thread."""
        return self._pool.submit(execute_job, job)

    def cancel(self) -> None:
        """Waits for the jobs that are running, which are short; a thread cannot be stopped."""
        self._pool.shutdown(cancel_futures=True)


class Processes:
    """Worker processes: for jobs that hold Python's global lock, as those of Stable-Baselines3 do.

    Every thread of a pool has a worker of its own, which it starts when it first needs one, keeps
    for its following jobs, and replaces when it has died.
    """

    # A killed worker must cost only its own job. `ProcessPoolExecutor` waits forever for the rest
    # of a result if a worker is killed while it writes one, as the driver, too, has the writing end
    # of the pipe open.

    def __init__(self, jobs: int) -> None:
        # Workers inherit the blocked SIGINT, since `cancel` ends them. The resource tracker, which
        # would otherwise start with the first worker, unblocks it.
        resource_tracker.ensure_running()
        blocked = signal.SIG_BLOCK, [signal.SIGINT]
        self._pool = ThreadPoolExecutor(jobs, initializer=signal.pthread_sigmask, initargs=blocked)
        self._worker = threading.local()
        self._processes: list[BaseProcess] = []
        self._lock = threading.Lock()
        self._is_cancelled = False

    def submit(self, job: Job) -> Future[list[Record]]:
        """Executes a job in the worker of the next free thread."""
        return self._pool.submit(self._execute, job)

    def cancel(self) -> None:
        """Kills every worker at once; there is nothing in them to be saved."""
        with self._lock:
            self._is_cancelled = True
            for process in self._processes:
                process.kill()
                process.join()
        self._pool.shutdown(cancel_futures=True)

    def _execute(self, job: Job) -> list[Record]:
        if getattr(self._worker, "connection", None) is None:
            self._worker.process, self._worker.connection = self._start()
        try:
            self._worker.connection.send(job)
            return list(self._worker.connection.recv())
        except (EOFError, OSError):
            if self._is_cancelled:
                raise CancelledError from None
            self._worker.connection = None
            self._worker.process.join()
            code = self._worker.process.exitcode
            how = f"signal {-code}" if code < 0 else f"exit code {code}"
            raise RuntimeError(f"its process ended with {how}") from None

    def _start(self) -> tuple[BaseProcess, Connection]:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, {**FOUND}), daemon=True)
        with self._lock:
            if self._is_cancelled:
                raise CancelledError
            process.start()
            self._processes.append(process)
        theirs.close()
        return process, ours


def _serve(connection: Connection, modules: Mapping[str, str]) -> None:
    """Executes jobs as they come, until the driver closes its end or ends in whatever way."""
    if sys.platform == "linux":  # elsewhere, a killed driver's workers end after their job
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    use_same_instructions()  # a job that is received may use torch
    use_modules(modules)
    with suppress(EOFError, ConnectionError):
        while True:
            connection.send(execute_job(connection.recv()))


# Each is called with the largest number of jobs that the executor will be given at a time.
EXECUTORS: dict[str, type[Processes] | type[Threads]] = {"process": Processes, "thread": Threads}
