"""Worker processes: for jobs that hold Python's global lock, such as those of Stable-Baselines3."""

import ctypes
import multiprocessing
import signal
import sys
import threading
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Final

from agents.sb3 import use_same_instructions
from benchmark.execution.job import execute_job
from benchmark.execution.plan import Job
from benchmark.execution.store import Record

_PR_SET_PDEATHSIG: Final = 1  # of prctl: send a signal when the parent thread ends


class WorkerDiedError(Exception):
    """A worker process ended before its job did."""


class Processes:
    """Executes jobs in worker processes, see `benchmark.execution.executors.Executor`.

    Every thread of a pool has a worker of its own, which it starts when it first needs one, keeps for its
    following jobs, and replaces when it has died.
    """

    # A killed worker must cost only its own job. `ProcessPoolExecutor` waits forever for the rest of a result
    # if a worker is killed while it writes one, as the driver, too, has the writing end of the pipe open.

    def __init__(self, jobs: int) -> None:
        # Workers inherit the blocked SIGINT, since `cancel` ends them. The resource tracker, which would
        # otherwise start with the first worker, unblocks it.
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
            reason = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
            raise WorkerDiedError(f"its process {reason}") from None

    def _start(self) -> tuple[BaseProcess, Connection]:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with self._lock:
            if self._is_cancelled:
                raise CancelledError
            process.start()
            self._processes.append(process)
        theirs.close()
        return process, ours


def _serve(connection: Connection) -> None:
    """Executes jobs as they come, until the driver closes its end or ends in whatever way."""
    if sys.platform == "linux":  # elsewhere, a killed driver's workers end after their job
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    use_same_instructions()  # a job that is received may use torch
    with suppress(EOFError, ConnectionError):
        while True:
            connection.send(execute_job(connection.recv()))
