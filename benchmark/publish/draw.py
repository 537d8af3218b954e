"""Makes an experiment's folder of results from the store: tables, figures and texts.

What is up to date is not made again.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.drawing import tables
from benchmark.execution.store import Store
from benchmark.folder import MANIFEST, write_manifest
from benchmark.publish import document, files, sameness
from benchmark.publish.manifest import manifest_of
from benchmark.studies import AnyReport, Data, Declared
from benchmark.studies.item import called
from envs.sources import digest_of_source


class Made(NamedTuple):
    """What became of a folder of results."""

    is_new: bool  # else it was up to date
    certificate: sameness.Certificate | None  # None if nothing comparable is published
    analysis: Any = None  # None if it was up to date


def draw(report: AnyReport, store: Store, directory: Path, seeds: Sequence[int] | None = None) -> Made:
    """Writes every table, figure and text of an experiment, unless they are up to date.

    The folder is replaced when all files are there, so a failure leaves it as it was. If they are
    identical to the published ones, and none holds measured times, the manifest is the published one, too.
    `seeds` replace the declared ones. Missing runs raise an InputError.
    """
    study = report.study
    data = report.data(store, seeds)
    inputs, name = _inputs(data, seeds), directory.name
    measured = [file for item in study.items if item.is_measured for file in item.files()]
    measured += ["README.md"] if measured else []  # it repeats measured numbers
    if sameness.is_up_to_date(directory, inputs):
        with files.alone(directory.parent):
            document.write(directory, study)
        return Made(is_new=False, certificate=sameness.compare(directory, name, measured))
    stale = {*sameness.listed(directory), *(file for item in study.items for file in item.files())}
    with files.alone(directory.parent), files.replaced(directory, stale) as aside:
        analysis = called(study.analyse, data)
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
        if certificate is not None and certificate.is_identical and not measured:
            published = sameness.published_file(name, MANIFEST)
            (aside / MANIFEST).write_bytes(published or (aside / MANIFEST).read_bytes())
        (aside / sameness.STAMP).write_text(inputs, encoding="utf-8")
    return Made(is_new=True, certificate=certificate, analysis=analysis)


def _inputs(data: Data[Declared], seeds: Sequence[int] | None) -> str:
    declared = data.experiment.declared
    measured = [json.dumps(dict(run), sort_keys=True) for run in data.provenance]
    named = [variant.algorithm for variant in declared.algorithms.values()]
    named += [data.declared.kind, *data.declared.items]
    sources = [digest_of_source(name.partition(":")[0]) for name in named if ":" in name]
    digests = [run.digest for run in data.specifications]
    texts = declared.model_dump_json(), str(seeds), data.note
    return sameness.digest_of_inputs(*texts, *digests, *measured, *sources)
