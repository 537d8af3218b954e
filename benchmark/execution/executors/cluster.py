"""Other machines: a Dask cluster with a running scheduler, and workers that come and go."""

import asyncio
import logging
import pickle
import sys
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Final

from distributed import Client, Worker, get_worker
from distributed.client import ClosedClientError, FutureCancelledError

from agents.sb3 import use_same_instructions
from benchmark.execution.job import execute_job
from benchmark.execution.plan import Job
from benchmark.execution.provenance import environment
from benchmark.execution.store import Record
from envs import InputError
from envs.sources import SEARCHED, find_modules_in

_ANSWER_S: Final = 10  # how long to wait for the scheduler: at the start, and when the connection is lost
_WORKER_S: Final = 60  # how long to wait for the first worker


class Cluster:
    """Executes jobs on the workers of a cluster, see `benchmark.execution.executors.Executor`.

    Dask executes a job again if its worker dies, unless it has already killed three workers. Workers may join
    at any time, so each job checks its own.
    """

    def __init__(self, address: str, algorithms: Collection[str]) -> None:
        """Connects to a scheduler, `tcp://HOST:PORT`, waits for its first worker, and checks all workers."""
        self._address, self._where = address, f"--cluster {address}"
        self._jobs: set[Future[list[Record]]] = set()
        here = {name: environment(name) for name in algorithms}
        for name in ("distributed", "distributed.client"):  # whatever they log is an exception, too
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, OverflowError, ValueError) as error:  # no answer, or no such port or protocol
            reason = f"no Dask scheduler answered within {_ANSWER_S} s; 'dask scheduler' starts one"
            raise InputError(f"{self._where}: {reason}; accepted: tcp://HOST:PORT.") from error
        try:
            self.workers: Final = self._checked_workers(here)
        except BaseException:
            self.cancel()
            raise

    def submit(self, job: Job) -> Future[list[Record]]:
        """Executes a job on some worker."""
        # `Client.get_executor` is not used: its futures wait forever if the scheduler dies at the wrong time.
        loop: Any = self._client.loop  # its annotation hides what it is
        future = asyncio.run_coroutine_threadsafe(self._execute(job), loop.asyncio_loop)
        self._jobs.add(future)
        future.add_done_callback(self._jobs.discard)
        return future

    def cancel(self) -> None:
        """Cancels all jobs and disconnects; workers finish what they run, and the results are discarded."""
        for future in tuple(self._jobs):
            future.cancel()
        with suppress(TimeoutError):
            self._client.close(_ANSWER_S)

    def _checked_workers(self, here: Mapping[str, Mapping[str, str]]) -> int:
        """Waits for the first worker, checks all by `refusal`, and returns how many there are."""
        if not self._client.scheduler_info()["workers"]:
            print(f"waiting up to {_WORKER_S} s for a worker at {self._address}", file=sys.stderr)
        try:
            self._client.wait_for_workers(1, _WORKER_S)
        except TimeoutError:
            advice = f"dask worker {self._address} --nthreads 1 starts one"
            raise InputError(f"{self._where}: there is no worker; {advice}.") from None
        answers = self._client.run(refusal, here, folders=SEARCHED, on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, Exception):
                answer = f"worker {worker} does not have this project's code, or has died: {answer}."
            if answer is not None:
                raise InputError(f"--cluster: {answer}")
        return len(answers)

    async def _execute(self, job: Job) -> list[Record]:
        name = job[0].algorithm
        call = _Call(name, environment(name), pickle.dumps(job), SEARCHED)
        try:
            if self._client.status != "running":
                raise ClosedClientError  # Dask might wait forever instead
            # The scheduler unpickles tasks but not bytes, so it needs no code of this project.
            records = await self._client.submit(pickle.loads, pickle.dumps(call), pure=False)
        except (FutureCancelledError, ClosedClientError, OSError) as error:
            raise ConnectionError(f"the scheduler {self._address} is gone, or has dropped the job") from error
        except (ImportError, AttributeError) as error:
            raise InputError(f"a new worker does not have this project's code: {error}") from error
        if isinstance(records, str):
            raise InputError(records)
        return list(records)


class _Call:
    """A placeholder for records: unpickling it calls `execute`."""

    def __init__(self, *arguments: object) -> None:
        self._arguments = arguments

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return execute, self._arguments


def execute(
    algorithm: str, expected: Mapping[str, str], packed: bytes, folders: Collection[str]
) -> list[Record] | str:
    """Executes a job on the worker that this is called on, if that has the driver's `environment`.

    Returns the records, or why the worker is refused: an exception might not reach the driver. The job is
    pickled, since code that differs from the driver's may be unable to read it.
    """
    reason = refusal({algorithm: expected}, get_worker(), folders)
    return execute_job(pickle.loads(packed)) if reason is None else reason


def refusal(
    expected: Mapping[str, Mapping[str, str]], dask_worker: Worker, folders: Collection[str]
) -> str | None:
    """Returns why a worker, which must have the driver's `environment`, is refused; None if it is not.

    Modules are also found in the folders of experiments, if the worker has them at the same path.
    """
    use_same_instructions()  # an algorithm that is imported may use torch
    for folder in folders:
        find_modules_in(folder)
    worker = f"worker {dask_worker.address}"
    if dask_worker.state.nthreads != 1:  # torch's settings and peak memory are those of the process
        return f"{worker} has {dask_worker.state.nthreads} threads; accepted: 1, as with --nthreads 1."
    for algorithm, values in expected.items():
        try:
            there = environment(algorithm)
        except InputError as error:
            return f"{worker}: {error}"
        for key, value in values.items():
            if there.get(key) != value:
                advice = "install the same and restart it"
                return f"{worker} has {key} {there.get(key)}, but here it is {value}; {advice}."
    return None
