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
from collections.abc import Callable, Sequence
from concurrent.futures import wait
from contextlib import suppress
from functools import partial
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
from benchmark.execution.plan import plan
from benchmark.execution.provenance import peak_memory_mb
from benchmark.execution.store import Record, Store
from benchmark.experiments import Experiment, RunSpecification, all_specifications, load_experiment
from envs import InputError, Model, compile_scenario, load_scenario

# What a point took: `seconds`, most often `peak_memory_mb` (NaN where the system does not say), and more.
Values = dict[str, float]

HORIZON: Final = 200  # steps of an exact evaluation in a grid
STEPS: Final = 1_000_000  # of a table in a grid
_CALLS: Final = 3  # of what is computed for a grid; the fastest counts
# Programs whose last line of output is JSON.
_COMMAND: Final = """
import sys
from benchmark.__main__ import main
if __name__ == "__main__":
    code = main(sys.argv[1:])
    from benchmark.execution.provenance import peak_memory_mb
    print('{"peak_memory_mb": %s}' % (peak_memory_mb() or "NaN"))
    sys.exit(code)
"""
_FUNCTION: Final = """
import json, sys
from importlib import import_module
if __name__ == "__main__":
    module, name, arguments = sys.argv[1:]
    print(json.dumps(getattr(import_module(module), name)(*json.loads(arguments))))
"""


def command(*arguments: str | Path) -> Values:
    """Runs a command of this project, and measures it from the start of its process to the end.

    Raises:
      InputError: It failed.
    """
    return _run(f"the command {arguments[0]}", _COMMAND, *map(str, arguments))


def fresh(function: Callable[..., Values], *arguments: object) -> Values:
    """Calls a function of a module in a fresh process, with arguments that JSON has, and paths as texts.

    Raises:
      InputError: It raised an exception, or its process died.
    """
    name, texts = function.__name__, json.dumps(arguments, default=str)
    return _run(name, _FUNCTION, function.__module__, name, texts)


def _run(name: str, program: str, *arguments: str) -> Values:
    """Runs a program of Python; returns what it says in the end, and else how long its process took."""
    started = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # all its processes can be ended together
    )
    try:
        output, errors = process.communicate()
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    seconds = time.perf_counter() - started
    if process.returncode:
        reason = errors.splitlines()[-1].removeprefix("error: ") if errors else "it printed no error"
        raise InputError(f"growth: {name} failed with exit code {process.returncode}: {reason}")
    values: Values = json.loads(output.splitlines()[-1])
    return {"seconds": seconds} | values


def tables(experiment: str, results: str) -> Values:
    """Trains and stores all runs of an experiment, one job at a time in a thread; listing them counts."""
    return _one_at_a_time(load_experiment(experiment), results)


def nets(size: int, budget: int, results: str) -> Values:
    """Does the same with so many nets of `compare_deep`: DQN from one-hot observations in S1."""
    declared = load_experiment("compare_deep")
    arm = declared.algorithms["dqn"].model_copy(update={"observations": ("one_hot",), "seeds": size})
    changes = {"settings": declared.settings | {"budget": budget}, "scenarios": ("S1",)}
    experiment = declared.model_copy(update=changes | {"algorithms": {"dqn": arm}})
    return _one_at_a_time(experiment, results)


def _one_at_a_time(experiment: Experiment, results: str) -> Values:
    """Trains and stores all runs of an experiment in an empty store."""
    before = all_specifications(experiment, [0])
    started = time.perf_counter()
    runs = all_specifications(experiment)
    listing = time.perf_counter() - started
    values = _train(Threads(1), 1, runs, results, before)
    return values | {"seconds": listing + values["seconds"]}


def workers(kind: str, n: int, n_populations: int, n_seeds: int, results: str) -> Values:
    """Trains nets of `compare_deep_smoke` in several workers.

    Args:
      kind: "processes" of this machine, or "dask": a cluster on this machine, as `run --cluster` has it.
      n: The number of workers.
      n_populations: Of nets; each is one job.
      n_seeds: Of each population.
      results: The folder of the store, which is made anew.
    """
    runs = all_specifications(load_experiment("compare_deep_smoke"), range(n_seeds))
    runs = [run for run in runs if run.algorithm.startswith("compiled_")]
    first = dict(list({run.population: run for run in runs}.items())[:n_populations])
    runs = [run for run in runs if run.population in first]
    before = [run for run in first.values() for _ in range(n)]
    if kind == "processes":
        return _train(Processes(n), n, runs, results, before)
    from distributed import LocalCluster

    from benchmark.execution.executors.cluster import Cluster

    address, folder = "127.0.0.1", f"{results}_dask"
    options: dict[str, Any] = {
        "host": address,
        "dashboard_address": f"{address}:0",
        "local_directory": folder,
    }
    with LocalCluster(n_workers=n, threads_per_worker=1, **options) as local:
        local.wait_for_workers(n)
        cluster = Cluster(local.scheduler_address, {run.algorithm for run in runs})
        return _train(cluster, 2 * n, runs, results, before)


def _train(
    executor: Executor,
    jobs: int,
    runs: Sequence[RunSpecification],
    results: str,
    before: Sequence[RunSpecification],
) -> Values:
    """Trains and stores runs by the real runner, with so many jobs under way, and releases the executor.

    Args:
      executor: Runs the jobs.
      jobs: How many are under way.
      runs: To be trained.
      results: The folder of the store, which is made anew.
      before: Executed first and not measured, so that workers have imported and compiled what they need.

    Returns:
      The seconds, the number of jobs, the seconds of the jobs themselves, and this process's peak memory.

    Raises:
      RuntimeError: A run failed.
    """
    shutil.rmtree(results, ignore_errors=True)
    peaks, own = [_peak()], [0.0]

    def progress(records: list[Record]) -> None:
        own.extend(record.provenance["wall_time_s"] for record in records)

    wait([executor.submit([run]) for run in before])
    started = time.perf_counter()
    with Store(Path(results) / "runs.db") as store:
        # A job begins by measuring the peak anew.
        errors = driver.run(
            runs, store, jobs, progress, lambda _: peaks.append(_peak()), executor=lambda _: executor
        )
    seconds = time.perf_counter() - started
    if errors:
        raise RuntimeError(errors[0])
    peak = max(*peaks, _peak())
    return {"seconds": seconds, "jobs": len(plan(runs)), "own_seconds": sum(own), "peak_memory_mb": peak}


def grid(work: str, rows: int, columns: int) -> Values:
    """Measures the fastest of several calls in a grid, after one that loads compiled code.

    The grid is S1 of another size, in which the first wrong PING ends the episode.

    Args:
      work: "compile", or "solve" with the paper's discount, "evaluate" the random policy, "train" a table.
      rows: Of the grid.
      columns: Of the grid.
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
    seconds = []
    for _ in range(_CALLS):
        started = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - started)
    return {"seconds": min(seconds), "peak_memory_mb": _peak()}


def _peak() -> float:
    """Returns this process's peak memory; NaN where the system does not say."""
    return peak_memory_mb() or math.nan
