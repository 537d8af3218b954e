"""Makes an experiment's folder of results from the store: tables, figures and texts.

What is up to date is not made again.
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

import pandas as pd

from agents import load_algorithm
from benchmark.analysis.population import check_scores
from benchmark.drawing import tables
from benchmark.execution.provenance import digest_of_file, digest_of_source
from benchmark.execution.store import Store
from benchmark.experiments import (
    DEFAULT_CONDITION,
    Experiment,
    RunSpecification,
    all_specifications,
    specifications,
)
from benchmark.experiments.schema import Arm
from benchmark.reports import certificate, files, load_items, load_report, stamp, texts
from benchmark.reports.certificate import Certificate
from benchmark.reports.figures import Drawing
from benchmark.reports.item import Data, Frames, Item, Report, measured_files
from benchmark.reports.published import MANIFEST
from envs import InputError
from envs.inputs import missing_package

STAMP: Final = ".stamp"  # beside the files, see `benchmark.reports.stamp`


class Made(NamedTuple):
    """What became of a folder of results."""

    is_new: bool  # else it was up to date
    certificate: Certificate | None  # None if nothing comparable is published


def draw(
    experiment: Experiment,
    store: Store,
    directory: Path,
    seeds: Sequence[int] | None = None,
    *,
    partial: bool = False,
    jobs: int = 1,
) -> Made:
    """Writes every table, figure and text of the experiment, unless they are up to date.

    The folder is replaced when all files are there, so a failure leaves it as it was. If they are
    identical to the published ones, and none holds measured times, the manifest is the published one, too.

    Args:
      experiment: As loaded.
      store: Where its records are.
      directory: The folder to write.
      seeds: Other seeds than the declared ones.
      partial: Whether to report on the runs that are there if some are missing.
      jobs: How many processes draw; no result depends on it.

    Raises:
      InputError: A run or a package is missing, or the folder cannot be written.
    """
    report = load_report(experiment.report, experiment.argument)
    items = load_items(report, experiment.items, experiment.argument)
    check_packages(report, experiment.name)
    report.check(experiment)
    is_as_declared = seeds is None and not partial  # and so comparable with the published results
    measured = measured_files(items)
    every, ended = all_specifications(experiment, seeds), store.ended()
    runs = [run for run in every if run.digest in ended]
    # Read once: there may be 100,000.
    provenance = [record.provenance for record in store.get([run.digest for run in runs], arrays=False)]
    inputs = _inputs(experiment, runs, provenance, seeds, partial=partial)
    if stamp.is_up_to_date(directory / STAMP, inputs):
        compared = certificate.compare(directory, experiment.name, measured) if is_as_declared else None
        return Made(is_new=False, certificate=compared)
    with files.alone(directory.parent), files.replaced(directory, was_made(directory, items)) as aside:
        try:
            with Drawing(jobs) as drawing:
                check_scores(every)
                data = report.load(experiment, store, seeds, partial)
                frames = compute(items, data)
                drawing.start(items, frames, data.context, aside, is_partial=data.is_incomplete)
                write_tables(items, frames, data, aside)
                manifest = _manifest(experiment, runs, provenance, seeds, data)
                (aside / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
                drawing.finish()
            texts.write(aside)
            compared = certificate.compare(aside, experiment.name, measured) if is_as_declared else None
            if compared is not None and compared.is_identical and not compared.measured:
                published = certificate.published_file(experiment.name, MANIFEST)
                (aside / MANIFEST).write_bytes(published or (aside / MANIFEST).read_bytes())
            stamp.write(aside / STAMP, inputs, list(aside.iterdir()))
        except OSError as error:
            raise InputError(
                f"{directory}: cannot be written: {error.strerror or error}; choose another folder with "
                "--results."
            ) from error
    return Made(is_new=True, certificate=compared)


def was_made(directory: Path, items: Sequence[Item]) -> Callable[[str], bool]:
    """Returns whether a file of this name was made before, or may have been; no other is removed."""
    patterns = [*stamp.files(directory / STAMP), *(pattern for item in items for pattern in item.patterns())]
    return lambda name: any(fnmatchcase(name, pattern) for pattern in patterns)


def _inputs(
    experiment: Experiment,
    runs: Sequence[RunSpecification],
    provenance: Sequence[Mapping[str, Any]],
    seeds: Sequence[int] | None,
    *,
    partial: bool,
) -> str:
    """Returns the digest of what a folder of results depends on: what is declared, and the records."""
    digests = [run.digest for run in runs]
    measured = [json.dumps(dict(each), sort_keys=True) for each in provenance]
    algorithms = [arm.algorithm for arm in experiment.algorithms.values()]
    names = [experiment.report, *experiment.items, *algorithms]
    sources = [digest_of_source(name.partition(":")[0]) for name in names if ":" in name]
    sources.append(digest_of_file(load_report(experiment.report, experiment.name).template))
    declared = experiment.model_dump_json(), str(seeds), str(partial)
    return stamp.digest_of(*declared, *digests, *measured, *sources)


def check_packages(report: Report, source: str) -> None:
    """Checks that the packages of a report are installed.

    Raises:
      MissingPackageError: Names the first that is not.
    """
    for package in report.packages:
        if find_spec(package) is None:
            raise missing_package(f"{source}: its report", package)


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


def _manifest(
    experiment: Experiment,
    runs: Sequence[RunSpecification],
    provenance: Sequence[Mapping[str, Any]],
    seeds: Sequence[int] | None,
    data: Data,
) -> Mapping[str, object]:
    """Returns what was run, and from the records what ran it: drawing again gives the same.

    Args:
      experiment: As loaded.
      runs: Those that have a valid record.
      provenance: Of their records.
      seeds: Other seeds than the declared ones.
      data: Of the report.
    """
    done = {run.digest for run in runs}
    populations = (
        specifications(experiment, DEFAULT_CONDITION, *population, seeds)
        for population in experiment.populations
    )
    # One run of each population: the others differ by their seed alone.
    first = (next((run for run in each if run.digest in done), None) for each in populations)
    default = [run for run in first if run is not None]
    chosen = "" if seeds is None else f" --seeds {seeds[0]}-{seeds[-1]}"

    def every(key: str) -> list[object]:
        # Records that were made before the processor was noted do not have it.
        texts = {json.dumps(p[key], sort_keys=True) for p in provenance if key in p}
        return [json.loads(text) for text in sorted(texts)]

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
                "packages": load_algorithm(run.algorithm).packages,
                "check_of": experiment.algorithms[run.arm].check_of,
                "policy": experiment.algorithms[run.arm].policy,
                "tuning": _tuning(experiment.algorithms[run.arm]),
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
        "processors": every("processor"),
        "versions": every("versions"),
        "first_started_at": min(p["started_at"] for p in provenance),
        "last_started_at": max(p["started_at"] for p in provenance),
        "busy_time_s": round(sum(p["wall_time_s"] for p in provenance), 3),
    }


def _tuning(arm: Arm) -> dict[str, int] | None:
    """Returns how much search an arm's settings took; None if that is not declared."""
    return None if arm.tuning is None else arm.tuning.model_dump()


def digest_of(digests: Sequence[str]) -> str:
    """Returns the identity of a set of runs."""
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()
