"""Makes an experiment's folder of results from the store: tables, figures and texts.

What is up to date is not made again.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from benchmark.drawing import tables
from benchmark.execution.store import Store
from benchmark.experiments import Experiment
from benchmark.folder import MANIFEST, write_manifest
from benchmark.publish import document, files, sameness
from benchmark.publish.manifest import manifest_of
from benchmark.studies import load_items, load_report
from benchmark.studies.data import Data, load
from benchmark.studies.item import Item, Report
from envs import InputError
from envs.packages import missing_package
from envs.sources import digest_of_source


class Made(NamedTuple):
    """What became of a folder of results."""

    is_new: bool  # else it was up to date
    certificate: sameness.Certificate | None  # None if nothing comparable is published


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
    `seeds` replace the declared ones. Missing runs raise an InputError, unless the report is `partial`.
    """
    if partial and not report.can_be_partial:
        raise InputError(f"--partial: {directory.name}: accepted: a comparison or a map.")
    data = load(experiment, store, seeds, partial=partial, columns=report.columns)
    inputs, name = _inputs(data, seeds), directory.name
    measured = [file for item in report.items if item.is_measured for file in item.files()]
    measured += ["README.md"] if measured else []  # which repeats the sentences
    if sameness.is_up_to_date(directory, inputs):
        with files.alone(directory.parent):
            document.write(directory, report)
        return Made(is_new=False, certificate=sameness.compare(directory, name, measured))
    stale = {*sameness.listed(directory), *(file for item in report.items for file in item.files())}
    with files.alone(directory.parent), files.replaced(directory, stale) as aside:
        frames = tables_of(report.items, data)
        for table, frame in frames.items():
            tables.write_csv(frame, aside / f"{table}.csv")
        for item in report.items:
            item.save(data, frames, aside)
        sameness.keep_published(aside, name)
        write_manifest(aside, manifest_of(data, seeds))
        document.write(aside, report)
        certificate = sameness.compare(aside, name, measured)
        if certificate is not None and certificate.is_identical and not measured:
            published = sameness.published_file(name, MANIFEST)
            (aside / MANIFEST).write_bytes(published or (aside / MANIFEST).read_bytes())
        (aside / sameness.STAMP).write_text(inputs, encoding="utf-8")
    return Made(is_new=True, certificate=certificate)


def report_of(experiment: Experiment, *, is_drawn: bool = True) -> Report:
    """Returns the report of an experiment, with the items that it declares.

    Raises an InputError if it has none, if the report does not fit the experiment or, if it is drawn now, a
    package is missing.
    """
    declared, where = experiment.report, experiment.argument
    if declared is None:
        raise InputError(f"{where}: report is missing; add a [report] table.")
    report = load_report(declared.kind, where)
    items = load_items(report, declared.model_dump(), where)
    for name in report.needed:
        if name in declared.omit:
            raise InputError(f"{where}: report.omit: {name}: other parts of this report need it; keep it.")
    missing = [package for package in report.packages if find_spec(package) is None]
    if is_drawn and missing:
        raise missing_package(f"{experiment.name}: its report", missing[0])
    of_maps = {"solved": experiment.declared.solved}
    of_maps |= {key: getattr(declared, key) for key in ("looks", "panels", "answer")}
    for key, value in of_maps.items():
        if value and not report.reads_curves:
            accepted = "kind = map" + " or search" * (key == "solved")
            raise InputError(f"{where}: {key} with report.kind = {declared.kind}: accepted: {accepted}.")
    report.check(experiment)
    finding, columns = experiment.path.with_suffix(".md.jinja"), () if declared.items else report.columns
    return replace(report, items=items, finding=finding, columns=columns)


def tables_of(items: Sequence[Item], data: Data) -> dict[str, pd.DataFrame]:
    """Returns the tables of all items that have one, by name."""
    return {item.name: frame for item in items if (frame := item.tabulate(data)) is not None}


def _inputs(data: Data, seeds: Sequence[int] | None) -> str:
    declared = data.experiment.declared
    measured = [json.dumps(dict(run), sort_keys=True) for run in data.provenance]
    named = [variant.algorithm for variant in declared.algorithms.values()]
    if declared.report is not None:
        named += [declared.report.kind, *declared.report.items]
    sources = [digest_of_source(name.partition(":")[0]) for name in named if ":" in name]
    digests = [run.digest for run in data.specifications]
    texts = declared.model_dump_json(), str(seeds), data.note
    return sameness.digest_of_inputs(*texts, *digests, *measured, *sources)
