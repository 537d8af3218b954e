"""Executors: where jobs run. `EXECUTORS` maps an algorithm's placement to one; others come from outside."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Final, Protocol

from benchmark.execution.plan import Job
from benchmark.execution.store import Record
from envs import InputError
from envs.inputs import imported, unknown_name


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


# Makes an executor from the largest number of jobs that it will be given at a time.
ExecutorFactory = Callable[[int], Executor]

EXECUTORS: Final = {
    "process": "benchmark.execution.executors.processes:Processes",
    "thread": "benchmark.execution.executors.threads:Threads",
}


def load_executor(name: str, source: str = "executors") -> ExecutorFactory:
    """Returns what makes an executor, by a key of `EXECUTORS`, or `module:attribute` of one from elsewhere.

    Raises:
      InputError: Unknown name, a module that cannot be imported, or an object that cannot be called.
    """
    if name not in EXECUTORS and ":" not in name:
        unknown_name(source, "executor", name, EXECUTORS, "module:attribute")
    factory = imported(EXECUTORS.get(name, name), source, "executor")
    if not callable(factory):
        accepted = "a class or function that takes the number of jobs"
        raise InputError(f"{source}: {name} is not an executor; accepted: {accepted}.")
    return factory
