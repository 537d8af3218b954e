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
from benchmark.job import Job, execute_job
from benchmark.provenance import environment
from benchmark.store import Record
from envs import InputError
from envs.sources import SEARCHED, find_modules_in

_ANSWER_S: Final = 10  # to wait for the scheduler: at the start, and when the connection is lost
_WORKER_S: Final = 60  # to wait for the first worker


class Cluster:
    """Executes jobs on the workers of a cluster, see `benchmark.executors.Executor`.

    Dask executes a job again if its worker dies, unless it has already killed three workers.
    Workers may join at any time, so each job checks its own.
    """

    def __init__(self, address: str, algorithms: Collection[str]) -> None:
        """Connects to a scheduler, `tcp://HOST:PORT`, and checks all workers, at least one."""
        self._address, self._where = address, f"--cluster {address}"
        self._jobs: set[Future[list[Record]]] = set()
        here = {name: environment(name) for name in algorithms}
        for name in ("distributed", "distributed.client"):  # whatever they log is an exception, too
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, OverflowError, ValueError) as error:  # no answer, port or protocol
            reason = f"no Dask scheduler answered within {_ANSWER_S} s; 'dask scheduler' starts one"
            raise InputError(f"{self._where}: {reason}; accepted: tcp://HOST:PORT.") from error
        try:
            self.workers: Final = self._checked_workers(here)
        except BaseException:
            self.cancel()
            raise

    def submit(self, job: Job) -> Future[list[Record]]:
        """Executes a job on some worker."""
        # The futures of `Client.get_executor` wait forever if the scheduler dies at the wrong time.
        loop: Any = self._client.loop  # its annotation hides what it is
        future = asyncio.run_coroutine_threadsafe(self._execute(job), loop.asyncio_loop)
        self._jobs.add(future)
        future.add_done_callback(self._jobs.discard)
        return future

    def cancel(self) -> None:
        """Cancels all jobs and disconnects; workers finish what they run, and it is discarded."""
        for future in tuple(self._jobs):
            future.cancel()
        with suppress(TimeoutError):
            self._client.close(_ANSWER_S)

    def _checked_workers(self, here: Mapping[str, Mapping[str, str]]) -> int:
        """Waits for the first worker, checks all by `refusal`, and returns how many there are."""
        if not self._client.scheduler_info()["workers"]:
            waiting = f"waiting up to {_WORKER_S} s for a worker at {self._address}"
            print(waiting, file=sys.stderr)
        try:
            self._client.wait_for_workers(1, _WORKER_S)
        except TimeoutError:
            advice = f"dask worker {self._address} --nthreads 1 starts one"
            raise InputError(f"{self._where}: there is no worker; {advice}.") from None
        answers = self._client.run(refusal, here, folders=SEARCHED, on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, Exception):
                what = "does not have this project's code, or has died"
                answer = f"worker {worker} {what}: {answer}."
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
            found = await self._client.submit(pickle.loads, pickle.dumps(call), pure=False)
        except (FutureCancelledError, ClosedClientError, OSError) as error:
            what = f"the scheduler {self._address} is gone, or has dropped the job"
            raise ConnectionError(what) from error
        except (ImportError, AttributeError) as error:
            what = "a new worker does not have this project's code"
            raise InputError(f"{what}: {error}") from error
        if isinstance(found, str):
            raise InputError(found)
        return list(found)


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

    Returns the records, or why the worker is refused: an exception might not reach the driver. The
    job is pickled, since code that differs from the driver's may be unable to read it.
    """
    reason = refusal({algorithm: expected}, get_worker(), folders)
    return execute_job(pickle.loads(packed)) if reason is None else reason


def refusal(
    expected: Mapping[str, Mapping[str, str]], dask_worker: Worker, folders: Collection[str]
) -> str | None:
    """Returns why a worker, which must have the driver's `environment`, is refused, if it is.

    Modules are also found in the folders of experiments, if the worker has them at the same path.
    """
    use_same_instructions()  # an algorithm that is imported may use torch
    for folder in folders:
        find_modules_in(folder)
    worker, n = f"worker {dask_worker.address}", dask_worker.state.nthreads
    if n != 1:  # torch's settings and peak memory are those of the process
        return f"{worker} has {n} threads; accepted: 1, as with --nthreads 1."
    for algorithm, values in expected.items():
        try:
            there = environment(algorithm)
        except InputError as error:
            return f"{worker}: {error}"
        for key, value in values.items():
            if there.get(key) != value:
                what = f"{key} {there.get(key)}, but here it is {value}"
                return f"{worker} has {what}; install the same and restart it."
    return None
