"""Repeats stored runs, and compares what comes of them with their records, bit for bit."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmark.execution import driver
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification


def sample(runs: Sequence[RunSpecification], size: int, seed: int) -> list[RunSpecification]:
    """Draws runs without replacement; all of them, if there are no more.

    Args:
      runs: To draw from.
      size: How many.
      seed: Of the draw; the same runs and seed give the same sample.
    """
    chosen = np.random.default_rng(seed).permutation(len(runs))[:size]
    return [runs[i] for i in sorted(chosen)]


def repeat(
    runs: Sequence[RunSpecification],
    store: Store,
    scratch: Path,
    jobs: int,
    on_progress: Callable[[list[Record]], None] = lambda _: None,
) -> dict[str, str]:
    """Executes stored runs again.

    Args:
      runs: Have valid records.
      store: Where these are.
      scratch: Where the new records are stored; the file must not exist.
      jobs: How many jobs to have under way at a time.
      on_progress: Called with the new records of every job that has ended.

    Returns:
      What differs, by the digest of the run; empty if everything is the same.

    Raises:
      InputError: A package is missing.
    """
    found = {}
    with Store(scratch) as repeated:
        driver.run(runs, repeated, jobs, on_progress)
        for run in runs:
            (before,), (after,) = store.get([run.digest]), repeated.get([run.digest])
            difference = _difference(before, after)
            if difference:
                found[run.digest] = difference
    return found


def _difference(before: Record, after: Record) -> str:
    """Returns what differs between two records of a run; empty if nothing but times and machines does."""
    if after.status == "failed":
        return f"it fails now: {after.error}"
    if before.status != after.status:
        return f"it was {before.status}, but is {after.status} now"
    names = sorted(before.arrays.keys() | after.arrays.keys())
    differing = [
        name
        for name in names
        if name not in before.arrays
        or name not in after.arrays
        or not _are_same(before.arrays[name], after.arrays[name])
    ]
    if not differing:
        return ""
    versions, now = before.provenance["versions"], after.provenance["versions"]
    others = [
        f"{key} {versions.get(key)}, here {now.get(key)}" for key in versions if versions[key] != now.get(key)
    ]
    if before.provenance["machine"] != after.provenance["machine"]:
        others.append(f"{before.provenance['machine']}, here {after.provenance['machine']}")
    made = f" (recorded with {'; '.join(others)})" if others else ""
    return f"differs in {', '.join(differing)}{made}"


def _are_same(x: np.ndarray, y: np.ndarray) -> bool:
    """Returns whether two arrays are equal bit for bit."""
    return x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes()
