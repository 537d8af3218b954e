"""What is measured at the points of the curves.

Every point has a process of its own, so its peak memory is its own: `command` runs a real command there, and
`fresh` one of the functions that follow it.
"""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
import timeit
from collections.abc import Callable, Sequence
from concurrent.futures import wait
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

from numpy.random import SeedSequence

from agents import Schedule
from agents.dynamic_programming import evaluate, solve
from agents.policy import uniform_policy
from agents.tabular import learner
from benchmark.execution import driver
from benchmark.execution.executors import Executor
from benchmark.execution.executors.processes import Processes
from benchmark.execution.executors.threads import Threads
from benchmark.execution.provenance import peak_memory_mb
from benchmark.execution.store import Record, Store
from benchmark.experiments import (
    DEFAULT_CONDITION,
    RunSpecification,
    all_specifications,
    load_experiment,
    specifications,
)
from envs import InputError, Model, compile_scenario, load_scenario

# What a point took: `seconds`, `peak_memory_mb` (NaN where the system does not say), and sometimes more.
Values = dict[str, float]

HORIZON: Final = 200  # steps of an exact evaluation in a grid
STEPS: Final = 1_000_000  # of a table in a grid
_CALLS: Final = 3  # of what is computed for a grid; the fastest counts
# Calls a function, which returns values, nothing, or an exit code. Its last line of output is JSON. It and
# all its processes end with its parent, which may be killed and then cannot end them.
_PROGRAM: Final = """
import json, os, signal, sys, threading, time
from importlib import import_module
def end_with(parent):
    while os.getppid() == parent:
        time.sleep(1)
    os.killpg(0, signal.SIGKILL)
if __name__ == "__main__":
    parent, module, name, arguments = sys.argv[1:]
    threading.Thread(target=end_with, args=(int(parent),), daemon=True).start()
    done = getattr(import_module(module), name)(*json.loads(arguments))
    if done and isinstance(done, int):
        sys.exit(done)
    from benchmark.execution.provenance import peak_memory_mb
    print(json.dumps({"peak_memory_mb": peak_memory_mb() or float("nan")} | (done or {})))
"""


def command(*arguments: str | Path) -> Values:
    """Runs a command of this project, and measures it from the start of its process to the end.

    Raises:
      InputError: It failed.
    """
    return _run(f"the command {arguments[0]}", "benchmark.__main__", "main", [arguments])


def fresh(function: Callable[..., object], *arguments: object) -> Values:
    """Calls a function of a module in a fresh process, with arguments that JSON has, and paths as texts.

    Returns:
      The seconds and the peak memory of the process, unless the values that the function returns have others.

    Raises:
      InputError: It raised an exception, or its process died.
    """
    return _run(function.__name__, function.__module__, function.__name__, arguments)


def _run(label: str, module: str, name: str, arguments: Sequence[object]) -> Values:
    started = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-c", _PROGRAM, str(os.getpid()), module, name, json.dumps(arguments, default=str)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # all its processes can be ended together
    ) as process:
        try:
            output, errors = process.communicate()
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    seconds = time.perf_counter() - started
    if process.returncode:
        reason = errors.splitlines()[-1].removeprefix("error: ") if errors else "it printed no error"
        raise InputError(f"growth: {label} failed with exit code {process.returncode}: {reason}")
    values: Values = json.loads(output.splitlines()[-1])
    return {"seconds": seconds} | values


# Training and storing, by the real runner; `jobs` and their `own_seconds` are values, too


def tables(experiment: str, size: int, results: str) -> Values:
    """Trains and stores so many agents per population of an experiment, one job at a time in a thread."""
    return _train(Threads(1), 1, partial(all_specifications, load_experiment(experiment)), size, results)


def nets(size: int, budget: int, results: str) -> Values:
    """Does the same with so many nets: DQN from one-hot observations in S1."""
    return _train(Threads(1), 1, partial(deep_runs, "dqn", "one_hot", budget), size, results)


def deep_runs(variant: str, observation: str, budget: int, seeds: Sequence[int]) -> list[RunSpecification]:
    """Lists runs of the nets that are measured, with a budget."""
    declared = _load(Path(__file__).with_name("nets.toml"))
    changed = declared.model_copy(update={"settings": declared.settings | {"budget": budget}})
    return specifications(changed, DEFAULT_CONDITION, "S1", variant, observation, seeds)


_load = cache(load_experiment)


def workers(kind: str, n: int, size: int, results: str) -> Values:
    """Trains the compiled nets of `compare_deep_smoke`, so many of each population, in n workers.

    They are "processes" of this machine, or "dask": a cluster on this machine, as `run --cluster` has it.
    """

    def listed(seeds: Sequence[int]) -> list[RunSpecification]:
        runs = all_specifications(_load("compare_deep_smoke"), seeds)
        return [run for run in runs if run.algorithm.startswith("compiled_")]

    if kind == "processes":
        return _train(Processes(n), n, listed, size, results)
    from distributed import LocalCluster

    from benchmark.execution.executors.cluster import Cluster

    address = "127.0.0.1"
    places = {"host": address, "dashboard_address": f"{address}:0", "local_directory": f"{results}_dask"}
    with LocalCluster(n_workers=n, threads_per_worker=1, **places) as local:
        local.wait_for_workers(n)
        cluster = Cluster(local.scheduler_address, {run.algorithm for run in listed([0])})
        return _train(cluster, 2 * n, listed, size, results)


def _train(
    executor: Executor,
    jobs: int,
    listed: Callable[[Sequence[int]], list[RunSpecification]],
    size: int,
    results: str,
) -> Values:
    """Lists, trains and stores the runs of so many seeds in a new store; so many jobs are under way.

    The workers have imported and compiled before, and the executor is released.
    """
    shutil.rmtree(results, ignore_errors=True)
    peaks: list[float] = []
    own: list[float] = []  # of each job, its own seconds

    def start(_: object) -> None:
        peaks.append(peak_memory_mb() or math.nan)  # a job begins by measuring the peak anew

    def progress(records: list[Record]) -> None:
        own.append(sum(record.provenance["wall_time_s"] for record in records))

    wait([executor.submit([run]) for run in listed([0]) for _ in range(jobs)])
    started = time.perf_counter()
    with Store(Path(results) / "runs.db") as store:
        errors = driver.run(listed(range(size)), store, jobs, progress, start, executor=lambda _: executor)
    seconds = time.perf_counter() - started
    if errors:
        raise RuntimeError(errors[0])
    peak = max(*peaks, peak_memory_mb() or math.nan)
    return {"seconds": seconds, "jobs": len(own), "own_seconds": sum(own), "peak_memory_mb": peak}


def grid(work: str, rows: int, columns: int) -> Values:
    """Measures the fastest of several calls in a grid, after one that loads compiled code.

    The grid is S1 of another size, in which the first wrong PING ends the episode. The work is to "compile"
    it, to "solve" it with the paper's discount, to "evaluate" the random policy, or to "train" a table.
    """
    settings = learner.Settings(budget=STEPS, record_every=STEPS)
    changes = {"grid.rows": rows, "grid.columns": columns, "ping_limit": 1}

    def compiled() -> Model:
        compile_scenario.cache_clear()
        return compile_scenario(load_scenario("S1", changes))

    calls: dict[str, Callable[[Model], Any]] = {
        "solve": lambda model: solve(model, settings.discount),
        "evaluate": lambda model: evaluate(model, uniform_policy(model), HORIZON),
        "train": lambda model: learner.train(model, settings, [SeedSequence(0)], Schedule(STEPS)),
    }
    # Compiling does not hold a model meanwhile.
    call = compiled if work == "compile" else partial(calls[work], compiled())
    call()
    return {"seconds": min(timeit.repeat(call, number=1, repeat=_CALLS))}
