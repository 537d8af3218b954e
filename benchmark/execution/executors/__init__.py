"""Executors: where jobs run. `EXECUTORS` maps an algorithm's placement to one."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final, Protocol

from benchmark.execution import job as execution
from benchmark.execution.executors.processes import Processes
from benchmark.execution.plan import Job
from benchmark.execution.store import Record


class Executor(Protocol):
    """A place where jobs run. Only the driver calls it, from one thread."""

    def submit(self, job: Job) -> Future[list[Record]]:
        """Starts `benchmark.execution.job.execute_job(job)`, and returns a future of what it returns.

        If the job is lost, for example because its machine fails, the future has an exception. The driver
        then records the job's runs as failed, with this exception as their error.
        """

    def cancel(self) -> None:
        """Ends whatever is running, by waiting for it or by stopping it, and releases all resources.

        Afterwards every future is done or cancelled, and nothing is submitted any more.
        """


class Threads:
    """Threads of this process: for jobs that release Python's global lock while they train."""

    def __init__(self, jobs: int) -> None:
        self._pool = ThreadPoolExecutor(jobs)

    def submit(self, job: Job) -> Future[list[Record]]:
        """Executes a job in the next free thread."""
        return self._pool.submit(execution.execute_job, job)

    def cancel(self) -> None:
        """Waits for the jobs that are running, which are short; a thread cannot be stopped."""
        self._pool.shutdown(cancel_futures=True)


# Each is called with the largest number of jobs that the executor will be given at a time.
EXECUTORS: Final[Mapping[str, Callable[[int], Executor]]] = {"process": Processes, "thread": Threads}
