"""Makes an experiment's folder of results from the store: tables, figures and texts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.drawing import tables
from benchmark.execution.store import Store
from benchmark.folder import MANIFEST, README, write_manifest
from benchmark.publish import document, files, sameness
from benchmark.publish.manifest import manifest_of
from benchmark.studies import Report


class Made(NamedTuple):
    """What became of a folder of results."""

    analysis: Any
    certificate: sameness.Certificate | None  # None if nothing comparable is published


def draw(report: Report, store: Store, directory: Path, seeds: Sequence[int] | None = None) -> Made:
    """Writes every table, figure and text of an experiment.

    They replace earlier ones when all are there, so a failure leaves the folder as it was. If they are
    identical to the published ones, and none holds measured times, the manifest is the published one, too.
    `seeds` replace the declared ones. Missing runs raise an InputError.
    """
    study, name = report.study, directory.name
    data = report.data(store, seeds)
    measured = [file for item in study.items if item.is_measured for file in item.files()]
    measured += [README] if measured else []  # it repeats measured numbers
    with files.alone(directory.parent), files.replaced(directory, sameness.listed(directory)) as aside:
        analysis = study.analyse(data)
        made = {item.name: item.tabulate(analysis) for item in study.items}
        frames = {table: frame for table, frame in made.items() if frame is not None}
        for table, frame in frames.items():
            tables.write_csv(frame, aside / f"{table}.csv")
        for item in study.items:
            item.save(analysis, frames, aside)
        sameness.keep_published(aside, name)
        write_manifest(aside, manifest_of(data, seeds))
        document.write(aside, study)
        certificate = sameness.compare(aside, name, measured)
        published = sameness.published_file(name, MANIFEST)
        if published and certificate is not None and certificate.is_identical and not measured:
            (aside / MANIFEST).write_bytes(published)
    return Made(analysis, certificate)
