"""Makes an experiment's folder of results from the store: tables, figures and texts.

What is up to date is not made again.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

import pandas as pd
from matplotlib import pyplot as plt

from benchmark.drawing import tables
from benchmark.drawing.style import save_figure
from benchmark.execution.provenance import digest_of_source
from benchmark.execution.store import Store
from benchmark.experiments import Experiment
from benchmark.reports import document, files, load_items, load_report, sameness
from benchmark.reports.data import Data, load
from benchmark.reports.folder import MANIFEST, with_titles
from benchmark.reports.item import PICTURES, Frames, Item, Report, as_written, called
from benchmark.reports.manifest import manifest_of
from benchmark.reports.sameness import STAMP, Certificate
from envs import InputError
from envs.inputs import missing_package

FORMATS: Final = ("svg", "pdf", "tex")  # beside those that every folder of results has: csv, and svg or png


class Made(NamedTuple):
    """What became of a folder of results."""

    is_new: bool  # else it was up to date
    certificate: Certificate | None  # None if nothing comparable is published


def draw(
    experiment: Experiment,
    report: Report,
    store: Store,
    directory: Path,
    seeds: Sequence[int] | None = None,
    *,
    partial: bool = False,
) -> Made:
    """Writes every table, figure and text of an experiment, unless they are up to date.

    The folder is replaced when all files are there, so a failure leaves it as it was. If they are
    identical to the published ones, and none holds measured times, the manifest is the published one, too.

    Args:
      experiment: As loaded.
      report: That of the experiment, see `report_of`.
      store: Where its records are.
      directory: The folder to write.
      seeds: Other seeds than the declared ones.
      partial: Whether to report on the runs that are there if some are missing.

    Raises:
      InputError: A run is missing, or the folder cannot be written.
    """
    if partial and not report.can_be_partial:
        raise InputError(f"--partial: {directory.name}: accepted: a comparison or a map.")
    data = load(experiment, store, seeds, partial=partial, columns=report.columns)
    is_as_declared = seeds is None and not partial  # and so comparable with the published results
    name, measured = directory.name, measured_files(report.items)
    inputs = _inputs(data, seeds)
    if sameness.is_up_to_date(directory / STAMP, inputs):
        compared = sameness.compare(directory, name, measured) if is_as_declared else None
        return Made(is_new=False, certificate=compared)
    with files.alone(directory.parent), files.replaced(directory, was_made(directory, report.items)) as aside:
        publish(report.items, data, aside, manifest_of(data, seeds, directory / MANIFEST))
        compared = None
        if is_as_declared:
            sameness.keep_published(aside, name)
            compared = sameness.compare(aside, name, measured)
        if compared is not None and compared.is_identical and not compared.measured:
            published = sameness.published_file(name, MANIFEST)
            (aside / MANIFEST).write_bytes(published or (aside / MANIFEST).read_bytes())
        sameness.write_stamp(aside / STAMP, inputs, list(aside.iterdir()))
    return Made(is_new=True, certificate=compared)


def publish(items: Sequence[Item], data: Data, directory: Path, manifest: Mapping[str, object]) -> None:
    """Writes manifest, tables, figures and other files into an empty folder, and README, made of these."""
    frames = tables_of(items, data)
    (directory / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    for name, frame in frames.items():
        tables.write_csv(frame, directory / f"{name}.csv")
    for item in items:
        draw_figure(item, frames, data, *(directory / f"{item.name}.{form}" for form in PICTURES))
        if item.write is not None:
            called(item.write, data, path=directory / item.file)
    document.write(directory)


def export(data: Data, report: Report, directory: Path, form: str) -> None:
    """Writes an experiment's figures or tables, in one of `FORMATS`, into a folder of their own."""
    frames = tables_of(report.items, data)
    titles = {learner.name: learner.title for learner in data.experiment.learners.values()}
    with files.alone(directory.parent), files.replaced(directory, lambda _: True) as aside:
        for item in report.items:
            path = aside / f"{item.name}.{form}"
            if form != "tex":
                draw_figure(item, frames, data, path)
            elif item.name in frames:
                frame = item.display(with_titles(frames[item.name], titles)).map(as_written)
                path.write_text(tables.to_latex(frame), encoding="utf-8")


def report_of(experiment: Experiment, *, is_drawn: bool = True) -> Report:
    """Returns the report of an experiment, with the items that it declares.

    Args:
      experiment: As loaded.
      is_drawn: Whether it is drawn now, so that its packages have to be there.

    Raises:
      InputError: It has none, or asks for something else than the experiment has, or a package is missing.
    """
    declared, where = experiment.report, experiment.argument
    if declared is None:
        raise InputError(f"{where}: there is no key report; accepted: an experiment with one.")
    report = load_report(declared.kind, where)
    items = load_items(report, declared.model_dump(), where)
    for package in report.packages:
        if is_drawn and find_spec(package) is None:
            raise missing_package(f"{experiment.name}: its report", package)
    of_maps = {"solved": experiment.declared.solved, "grids": experiment.declared.grids}
    for key, value in (of_maps | {"looks": declared.looks}).items():
        if value and not report.reads_curves:
            raise InputError(f"{where}: {key} with report.kind = {declared.kind}: accepted: kind = map.")
    report.check(experiment)
    return replace(report, items=items, columns=() if declared.items else report.columns)


def measured_files(items: Sequence[Item]) -> tuple[str, ...]:
    """Lists patterns of the files that hold measured times or memory, and so differ every time.

    README repeats the sentences, and so is among them if there are such items.
    """
    patterns = [pattern for item in items if item.is_measured for pattern in item.patterns()]
    return (*patterns, "README.md") if patterns else ()


def was_made(directory: Path, items: Sequence[Item]) -> Callable[[str], bool]:
    """Returns whether a file of this name was made before, or may have been; no other is removed."""
    made = [pattern for item in items for pattern in item.patterns()]
    patterns = [*sameness.stamped(directory / STAMP), *made]
    return lambda name: any(fnmatchcase(name, pattern) for pattern in patterns)


def tables_of(items: Sequence[Item], data: Data) -> dict[str, pd.DataFrame]:
    """Returns the tables of all items that have one, by name."""
    return {item.name: frame for item in items if (frame := item.tabulate(data)) is not None}


def draw_figure(item: Item, frames: Frames, data: Data, *paths: Path) -> None:
    """Draws an item's figure, if there is one; of a partial report it is marked.

    Of several files, in different forms, the smallest one stays.
    """
    figure = item.picture(data, frames)
    if figure is not None:
        if data.is_partial:
            figure.suptitle("PARTIAL: runs are missing", color="firebrick")
        for path in paths:
            save_figure(figure, path)
        plt.close(figure)
        for path in sorted(paths, key=lambda each: each.stat().st_size)[1:]:
            path.unlink()


def _inputs(data: Data, seeds: Sequence[int] | None) -> str:
    """Returns the digest of what a folder of results depends on: what is declared, and the records."""
    declared = data.experiment.declared
    measured = [json.dumps(dict(run), sort_keys=True) for run in data.provenance]
    named = [variant.algorithm for variant in declared.algorithms.values()]
    if declared.report is not None:
        named += [declared.report.kind, *declared.report.items]
    sources = [digest_of_source(name.partition(":")[0]) for name in named if ":" in name]
    digests = [run.digest for run in data.specifications]
    return sameness.digest_of_inputs(
        declared.model_dump_json(), str(seeds), data.note, *digests, *measured, *sources
    )
