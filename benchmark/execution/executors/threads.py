"""Threads of this process: for jobs that release Python's global lock while they train."""

from concurrent.futures import Future, ThreadPoolExecutor

from benchmark.execution import job as execution
from benchmark.execution.plan import Job
from benchmark.execution.store import Record


class Threads:
    """Executes jobs in threads, see `benchmark.execution.executors.Executor`."""

    def __init__(self, jobs: int) -> None:
        """Makes room for this many jobs at a time."""
        self._pool = ThreadPoolExecutor(jobs)

    def submit(self, job: Job) -> Future[list[Record]]:
        """Executes a job in the next free thread."""
        return self._pool.submit(execution.execute_job, job)

    def cancel(self) -> None:
        """Waits for the jobs that are running, which are short; a thread cannot be stopped."""
        self._pool.shutdown(cancel_futures=True)
