"""Makes an experiment's folder of results from the store: tables, figures and texts."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pandas as pd

from agents import load_algorithm
from benchmark.drawing import tables
from benchmark.execution.store import Store
from benchmark.experiments import (
    DEFAULT_CONDITION,
    Experiment,
    all_specifications,
    specifications,
)
from benchmark.reports import load_items, load_report, texts
from benchmark.reports.item import Data, Frames, Item, Report
from benchmark.reports.published import MANIFEST
from envs import InputError


def draw(
    experiment: Experiment,
    store: Store,
    directory: Path,
    seeds: Sequence[int] | None = None,
    *,
    partial: bool = False,
) -> None:
    """Writes every table, figure and text of the experiment.

    Files are made aside and moved when all are there, so a failure leaves the folder as it was.

    Args:
      experiment: As loaded.
      store: Where its records are.
      directory: The folder to write.
      seeds: Other seeds than the declared ones.
      partial: Whether to report on the runs that are there if some are missing.

    Raises:
      InputError: A run or a package is missing, or the folder cannot be written.
    """
    report = load_report(experiment.report, experiment.argument)
    items = load_items(report, experiment.items, experiment.argument)
    check_packages(report, experiment.name)
    report.check(experiment)
    data = report.load(experiment, store, seeds, partial)
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(prefix=f".{directory.name}-", dir=directory.parent))
    except OSError as error:
        raise _unwritable(directory, error) from error
    try:
        frames = compute(items, data)
        write_tables(items, frames, data, aside)
        for item in items:
            draw_figure(item, frames, data.context, aside, is_partial=data.is_incomplete)
        manifest = _manifest(experiment, store, seeds, data)
        (aside / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        texts.write(aside)
        directory.mkdir(exist_ok=True)
        for path in aside.iterdir():
            path.replace(directory / path.name)
    except OSError as error:
        raise _unwritable(directory, error) from error
    finally:
        shutil.rmtree(aside)


def check_packages(report: Report, source: str) -> None:
    """Checks that the packages of a report are installed.

    Raises:
      InputError: Names the first that is not.
    """
    for package in report.packages:
        if find_spec(package) is None:
            raise InputError(
                f"{source}: its report needs the package {package}, which is not installed; "
                "make compare-deep installs it."
            )


def compute(items: Sequence[Item], data: Data) -> dict[str, pd.DataFrame]:
    """Returns the tables of all items that have one, by name."""
    frames: dict[str, pd.DataFrame] = {}
    for item in items:
        frame = item.compute(data, frames) if item.compute is not None else None
        if frame is not None:
            frames[item.name] = frame
    return frames


def write_tables(items: Sequence[Item], frames: Frames, data: Data, directory: Path) -> None:
    """Writes the tables of all items, and their files of another form."""
    note = data.note if data.is_incomplete else ""
    for item in items:
        if item.name in frames:
            frame, stem = frames[item.name], directory / item.name
            if item.display is None:
                tables.write_csv(frame, stem.with_suffix(".csv"))
            else:
                tables.write_table(frame, stem, item.display(frame), note=note)
        if item.write is not None:
            item.write(data, frames, directory)


def draw_figure(item: Item, frames: Frames, context: Any, directory: Path, *, is_partial: bool) -> None:
    """Draws an item's figure if it has one; needs nothing but its arguments.

    Args:
      item: Of a report.
      frames: The tables of all items.
      context: Of the report's data.
      directory: Where to write it.
      is_partial: Whether it is marked as drawn from some of the runs.
    """
    if item.draw is None:
        return
    from benchmark.drawing.style import write_figure

    figure = item.draw(frames, context)
    if figure is not None:
        if is_partial:
            figure.suptitle("PARTIAL: runs are missing", color="firebrick")
        write_figure(figure, directory / item.name)


def _unwritable(directory: Path, error: OSError) -> InputError:
    """Returns the sentence for a folder that cannot be written."""
    return InputError(
        f"{directory}: cannot be written: {error.strerror or error}; choose another folder with --results."
    )


def _manifest(
    experiment: Experiment, store: Store, seeds: Sequence[int] | None, data: Data
) -> Mapping[str, object]:
    """Returns what was run, and from the records what ran it: drawing again gives the same.

    Args:
      experiment: As loaded.
      store: Where its records are.
      seeds: Other seeds than the declared ones.
      data: Of the report.
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
        "partial": data.note,
        "report": experiment.report,
        "items": list(experiment.items),
        "facts": data.facts,
        "horizon": experiment.horizon,
        "scenarios": {run.scenario.name: run.scenario.model_dump(mode="json") for run in default},
        "algorithms": {
            run.arm: {
                "algorithm": run.algorithm,
                "family": load_algorithm(run.algorithm).family,
                "settings": run.settings.model_dump(mode="json"),
            }
            for run in default
        },
        "note": experiment.note.strip(),
        "readings": {
            name: {"question": reading.question, "answer": reading.answer}
            for name, reading in experiment.readings.items()
        },
        "runs": len(runs),
        "digest": digest_of([run.digest for run in runs]),
        "commits": every("commit"),
        "machines": every("machine"),
        "versions": every("versions"),
        "first_started_at": min(p["started_at"] for p in provenance),
        "last_started_at": max(p["started_at"] for p in provenance),
        "busy_time_s": round(sum(p["wall_time_s"] for p in provenance), 3),
    }


def digest_of(digests: Sequence[str]) -> str:
    """Returns the identity of a set of runs."""
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()
