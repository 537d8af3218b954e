"""Other machines: a Dask cluster with a running scheduler, and workers that come and go."""

import asyncio
import logging
import pickle
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from distributed import Client, Worker, get_worker
from distributed.client import ClosedClientError, FutureCancelledError

from agents.sb3 import use_same_instructions
from benchmark.job import Job, execute_job
from benchmark.provenance import environment
from benchmark.store import Record
from envs import InputError
from envs.sources import FOUND, use_modules

_ANSWER_S = 10  # to wait for the scheduler: at the start, and when the connection is lost
_WORKER_S = 60  # to wait for the first worker


class Cluster:
    """Executes jobs on the workers of a cluster, see `benchmark.executors.Executor`.

    Dask executes a job again if its worker dies, unless it has already killed three workers.
    Workers may join at any time, so each job checks its own.
    """

    def __init__(self, address: str) -> None:
        """Connects to a scheduler, `tcp://HOST:PORT`, and waits for the first worker."""
        self._address, where = address, f"--cluster {address}"
        self._jobs: set[Future[list[Record]]] = set()
        for name in ("distributed", "distributed.client"):  # whatever they log is an exception, too
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, OverflowError, ValueError) as error:  # no answer, port or protocol
            reason = f"no Dask scheduler answered within {_ANSWER_S} s; 'dask scheduler' starts one"
            raise InputError(f"{where}: {reason}; accepted: tcp://HOST:PORT.") from error
        try:
            self._client.wait_for_workers(1, _WORKER_S)
        except TimeoutError:
            self.cancel()
            advice = f"dask worker {address} --nthreads 1 starts one"
            raise InputError(f"{where}: there is no worker; {advice}.") from None
        self.workers = max(len(self._client.scheduler_info()["workers"]), 1)  # one may have died

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

    async def _execute(self, job: Job) -> list[Record]:
        name = job[0].algorithm
        call = _Call(name, environment(name), pickle.dumps(job), {**FOUND})
        try:
            if self._client.status != "running":
                raise ClosedClientError  # Dask might wait forever instead
            # The scheduler unpickles tasks but not bytes, so it needs no code of this project.
            return list(await self._client.submit(pickle.loads, pickle.dumps(call), pure=False))
        except (FutureCancelledError, ClosedClientError, OSError) as error:
            what = f"the scheduler {self._address} is gone, or has dropped the job"
            raise ConnectionError(what) from error
        except (ImportError, AttributeError) as error:
            what = "a new worker does not have this project's code"
            raise InputError(f"{what}: {error}") from error


class _Call:
    """A placeholder for records: unpickling it calls `execute`."""

    def __init__(self, *arguments: object) -> None:
        self._arguments = arguments

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return execute, self._arguments


def execute(
    algorithm: str, expected: Mapping[str, str], packed: bytes, modules: Mapping[str, str]
) -> list[Record]:
    """Executes a job on the worker that this is called on, if that has the driver's `environment`.

    The job is pickled, since code that differs from the driver's may be unable to read it. Users'
    modules must lie at the same paths as on the driver's machine.
    """
    use_same_instructions()  # an algorithm that is imported may use torch
    use_modules(modules)
    check_worker(get_worker(), algorithm, expected)
    return execute_job(pickle.loads(packed))


def check_worker(worker: Worker, algorithm: str, expected: Mapping[str, str]) -> None:
    """Refuses a worker by an InputError unless it has the driver's `environment`."""
    name, n = f"worker {worker.address}", worker.state.nthreads
    if n != 1:  # torch's settings and peak memory are those of the process
        raise InputError(f"{name} has {n} threads; accepted: 1, as with --nthreads 1.")
    there = environment(algorithm)
    for key, value in expected.items():
        if there[key] != value:
            what = f"{key} {there[key]}, but here it is {value}"
            raise InputError(f"{name} has {what}; install the same and restart it.")
