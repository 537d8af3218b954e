"""Draws an experiment's folder of results from the store."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmark.execution.store import Store
from benchmark.experiments import (
    DEFAULT_CONDITION,
    Experiment,
    all_specifications,
    specifications,
)
from envs import InputError

_REPORTS = {
    "replication": "benchmark.reports.replication.report",
    "comparison": "benchmark.reports.comparison.report",
}


def draw(
    experiment: Experiment,
    store: Store,
    directory: Path,
    seeds: Sequence[int] | None = None,
    *,
    partial: bool = False,
) -> None:
    """Writes every table and figure of the experiment.

    Files are made aside and moved when all are there, so a failure leaves the folder as it was.

    Args:
      experiment: As loaded.
      store: Where its records are.
      directory: The folder to write.
      seeds: Other seeds than the declared ones.
      partial: Whether to draw what is there where runs are missing.

    Raises:
      InputError: A run or a package is missing, or the folder cannot be written.
    """
    try:
        report: Any = import_module(_REPORTS[experiment.report])
    except ModuleNotFoundError as error:
        raise InputError(
            f"{experiment.name}: its report needs the package {error.name}, which is not installed; "
            "make compare-deep installs it."
        ) from error
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(prefix=f".{directory.name}-", dir=directory.parent))
    except OSError as error:
        raise _unwritable(directory, error) from error
    try:
        note = report.write(experiment, store, aside, seeds, partial=partial)
        manifest = _manifest(experiment, store, seeds, note)
        (aside / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        directory.mkdir(exist_ok=True)
        for path in aside.iterdir():
            path.replace(directory / path.name)
    except OSError as error:
        raise _unwritable(directory, error) from error
    finally:
        shutil.rmtree(aside)


def _unwritable(directory: Path, error: OSError) -> InputError:
    """Returns the sentence for a folder that cannot be written."""
    return InputError(
        f"{directory}: cannot be written: {error.strerror or error}; choose another folder with --results."
    )


def _manifest(
    experiment: Experiment, store: Store, seeds: Sequence[int] | None, note: str
) -> dict[str, object]:
    """Returns what was run, and from the records what ran it: drawing again gives the same.

    Args:
      experiment: As loaded.
      store: Where its records are.
      seeds: Other seeds than the declared ones.
      note: What is missing; empty if nothing is.
    """
    ended = store.ended()
    runs = [run for run in all_specifications(experiment, seeds) if run.digest in ended]
    default = [
        run
        for cell in experiment.populations
        for run in specifications(experiment, DEFAULT_CONDITION, *cell, seeds)
        if run.digest in ended
    ]
    records = store.get([run.digest for run in runs], arrays=False)
    provenance = [record.provenance for record in records]

    chosen = "" if seeds is None else f" --seeds {seeds[0]}-{seeds[-1]}"

    def every(key: str) -> list[object]:
        return [json.loads(text) for text in sorted({json.dumps(p[key], sort_keys=True) for p in provenance})]

    return {
        "experiment": experiment.name,
        "description": experiment.description,
        "command": f"python -m benchmark run {experiment.argument}{chosen} --report",
        "partial": note,
        "report": experiment.report,
        "horizon": experiment.horizon,
        "scenarios": {run.scenario.name: run.scenario.model_dump(mode="json") for run in default},
        "algorithms": {
            run.arm: {"algorithm": run.algorithm, "settings": run.settings.model_dump(mode="json")}
            for run in default
        },
        "note": experiment.note.strip(),
        "readings": {
            name: {"question": reading.question, "answer": reading.answer}
            for name, reading in experiment.readings.items()
        },
        "runs": len(runs),
        "digest": _digest([run.digest for run in runs]),
        "commits": every("commit"),
        "machines": every("machine"),
        "versions": every("versions"),
        "first_started_at": min(p["started_at"] for p in provenance),
        "last_started_at": max(p["started_at"] for p in provenance),
        "busy_time_s": round(sum(p["wall_time_s"] for p in provenance), 3),
    }


def _digest(digests: Sequence[str]) -> str:
    """Returns the identity of a set of runs."""
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()
