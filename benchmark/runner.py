"""Runs what an experiment still lacks, and keeps what comes of it.

Runs that differ by their seed alone are trained together, in jobs. Training together equals training
alone, so how runs fall into jobs changes no result.
"""

import os
import platform
import subprocess
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import fields
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from agents import load_algorithm
from agents.dynamic_programming import Evaluation, evaluate
from agents.policy import mask_policy
from benchmark.experiment import RunSpecification
from benchmark.store import Record, Store
from envs import compile_scenario

JOB_SIZE = 25  # runs at most
JOB_WORK = 10_000_000  # budget units at most, unless one run has more: an interrupt waits for running jobs
_PACKAGES = ("gymnasium", "matplotlib", "numba", "numpy", "pandas", "scipy", "seaborn")


def run(
    runs: Sequence[RunSpecification],
    store: Store,
    jobs: int,
    on_progress: Callable[[int], None] = lambda _: None,
) -> list[str]:
    """Executes the runs that are not done, and keeps their records as they come.

    Args:
      runs: Wanted runs.
      store: Where records are kept; a failed run is kept with its error and tried again next time.
      jobs: Threads to use.
      on_progress: Called with the number of runs that have just ended.

    Returns:
      The errors of the runs that failed, none in the ordinary case.
    """
    todo = pending(runs, store)
    provenance = _provenance()
    errors: list[str] = []

    def keep(future: Future[list[Record]]) -> None:
        records = future.result()
        store.add(records)
        errors.extend(record.error for record in records if record.error is not None)
        on_progress(len(records))

    with ThreadPoolExecutor(jobs) as pool:
        waiting = {pool.submit(_execute, group, provenance) for group in _group(todo)}
        try:
            for future in as_completed(waiting):
                waiting.discard(future)  # or its arrays would stay in memory
                keep(future)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)  # waits for the jobs that are running
            for future in waiting:
                if not future.cancelled():
                    keep(future)
            raise
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return errors


def pending(runs: Sequence[RunSpecification], store: Store) -> list[RunSpecification]:
    """Returns the runs that have no valid record."""
    statuses = store.statuses()
    return [run for run in runs if statuses.get(run.digest) != "done"]


def _group(runs: Sequence[RunSpecification]) -> list[list[RunSpecification]]:
    """Splits runs into jobs."""
    groups = []
    for _, members in groupby(runs, key=lambda run: run.population):
        together = list(members)
        budget: int = together[0].settings.budget  # type: ignore[attr-defined]
        size = max(1, min(JOB_SIZE, JOB_WORK // budget))
        groups += [together[i : i + size] for i in range(0, len(together), size)]
    return groups


def _execute(runs: list[RunSpecification], provenance: dict[str, Any]) -> list[Record]:
    """Trains the runs of one job together and judges every snapshot of them exactly."""
    started = time.perf_counter()
    started_at = datetime.now(UTC).isoformat(timespec="seconds")
    try:
        arrays = _train_and_evaluate(runs)
        error = None
    except Exception as exception:  # a run's failure is its result: kept, told, and tried next time
        arrays = [{} for _ in runs]
        error = f"{type(exception).__name__}: {exception}"
    provenance = provenance | {
        "started_at": started_at,
        "wall_time_s": (time.perf_counter() - started) / len(runs),
    }
    return [
        Record(
            digest=run.digest,
            specification=run.content,
            status="done" if error is None else "failed",
            provenance=provenance,
            arrays=own,
            error=error,
        )
        for run, own in zip(runs, arrays, strict=True)
    ]


def _train_and_evaluate(runs: list[RunSpecification]) -> list[dict[str, Any]]:
    """Returns each run's arrays."""
    first = runs[0]
    model = compile_scenario(first.scenario)
    training = load_algorithm(first.algorithm).train(
        model,
        first.settings,
        [run.seed_sequence for run in runs],
        first.evaluation_steps,
        record_table=True,
    )
    # Equal policies, as all are before the first step, are evaluated once.
    masks, where = np.unique(training.greedy.reshape(-1, model.n_observations), axis=0, return_inverse=True)
    evaluation = evaluate(model, mask_policy(masks), first.horizon)
    shape = training.greedy.shape[:2]  # (N, T)
    columns = {field.name: getattr(training, field.name) for field in fields(training)}
    assert columns.keys().isdisjoint(field.name for field in fields(Evaluation))
    for field in fields(Evaluation):
        values = getattr(evaluation, field.name)[where.ravel()]
        columns[field.name] = values.reshape(*shape, *values.shape[1:])
    return [{name: values[i] for name, values in columns.items()} for i in range(len(runs))]


def _provenance() -> dict[str, Any]:
    """Returns what a run's record says of the code and machine it ran on."""
    return {
        "commit": _commit(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
    }


def _commit() -> str | None:
    """Returns the commit of the code, marked where files beside results differ from it."""
    root = Path(__file__).parents[1]
    try:
        describe = ["git", "-C", str(root), "rev-parse", "--short=12", "HEAD"]
        commit = subprocess.run(describe, check=True, capture_output=True, text=True).stdout.strip()
        changes = ["git", "-C", str(root), "status", "--porcelain", "--", "envs", "agents", "benchmark"]
        changed = subprocess.run(changes, check=True, capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit + ("-changed" if changed else "")
