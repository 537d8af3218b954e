"""Makes an experiment's folder of results from the store: tables, figures and texts.

What is up to date is not made again.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

import pandas as pd
from matplotlib import pyplot as plt

from agents import load_algorithm
from benchmark.analysis.population import check_scores
from benchmark.analysis.stages import known_runs
from benchmark.drawing import tables
from benchmark.drawing.style import save_figure
from benchmark.execution.provenance import digest_of_source
from benchmark.execution.store import Store
from benchmark.experiments import (
    DEFAULT_CONDITION,
    Experiment,
    RunSpecification,
    changed_settings,
    family_of,
    specifications,
)
from benchmark.reports import document, files, load_items, load_report, sameness
from benchmark.reports.folder import MANIFEST
from benchmark.reports.item import PICTURES, Data, Frames, Item, Report, as_written
from benchmark.reports.learners import Names
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
    store: Store,
    directory: Path,
    seeds: Sequence[int] | None = None,
    *,
    partial: bool = False,
) -> Made:
    """Writes every table, figure and text of the experiment, unless they are up to date.

    The folder is replaced when all files are there, so a failure leaves it as it was. If they are
    identical to the published ones, and none holds measured times, the manifest is the published one, too.

    Args:
      experiment: As loaded, with a report.
      store: Where its records are.
      directory: The folder to write.
      seeds: Other seeds than the declared ones.
      partial: Whether to report on the runs that are there if some are missing.

    Raises:
      InputError: A run or a package is missing, or the folder cannot be written.
    """
    report, items = report_of(experiment)
    is_as_declared = seeds is None and not partial  # and so comparable with the published results
    measured = measured_files(items)
    every, ended = known_runs(experiment, store, seeds), store.ended()
    runs = [run for run in every if run.digest in ended]
    # Read once: there may be 100,000.
    provenance = [record.provenance for record in store.get([run.digest for run in runs], arrays=False)]
    inputs = _inputs(experiment, runs, provenance, seeds, partial=partial)
    if sameness.is_up_to_date(directory / STAMP, inputs):
        compared = sameness.compare(directory, experiment.name, measured) if is_as_declared else None
        return Made(is_new=False, certificate=compared)
    with files.alone(directory.parent), files.replaced(directory, was_made(directory, items)) as aside:
        check_scores(every)
        data = report.load(experiment, store, seeds, partial)
        manifest = _manifest(experiment, runs, provenance, seeds, data)
        manifest["looks"] = _looks(directory / MANIFEST, manifest)
        publish(items, data, aside, manifest)
        if is_as_declared:
            sameness.keep_published(aside, experiment.name)
        compared = sameness.compare(aside, experiment.name, measured) if is_as_declared else None
        if compared is not None and compared.is_identical and not compared.measured:
            published = sameness.published_file(experiment.name, MANIFEST)
            (aside / MANIFEST).write_bytes(published or (aside / MANIFEST).read_bytes())
        sameness.write_stamp(aside / STAMP, inputs, list(aside.iterdir()))
    return Made(is_new=True, certificate=compared)


def publish(items: Sequence[Item], data: Data, directory: Path, manifest: Mapping[str, Any]) -> None:
    """Writes manifest, tables, figures and other files into an empty folder, and README, made of these."""
    frames = tables_of(items, data)
    (directory / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    for name, frame in frames.items():
        tables.write_csv(frame, directory / f"{name}.csv")
    for item in items:
        draw_figure(item, frames, data, *(directory / f"{item.name}.{form}" for form in PICTURES))
        if item.write is not None:
            item.write(data, directory)
    document.write(directory)


def export(
    experiment: Experiment, store: Store, directory: Path, seeds: Sequence[int] | None, form: str
) -> None:
    """Writes an experiment's figures or tables, in one of `FORMATS`, into a folder of their own."""
    report, items = report_of(experiment)
    data = report.load(experiment, store, seeds, False)
    frames = tables_of(items, data)
    with files.alone(directory.parent), files.replaced(directory, lambda _: True) as aside:
        for item in items:
            path = aside / f"{item.name}.{form}"
            if form != "tex":
                draw_figure(item, frames, data, path)
            elif item.name in frames:
                frame = item.display(Names.of(experiment).in_table(frames[item.name])).map(as_written)
                path.write_text(tables.to_latex(frame), encoding="utf-8")


def report_of(experiment: Experiment, *, is_drawn: bool = True) -> tuple[Report, tuple[Item, ...]]:
    """Returns the report of an experiment, and its items.

    Args:
      experiment: As loaded.
      is_drawn: Whether it is drawn now, so that its packages have to be there.

    Raises:
      InputError: It has none, or asks for something else than the experiment has, or a package is missing,
        or two learners have the same name.
    """
    declared = experiment.report
    if declared is None:
        raise InputError(f"{experiment.argument}: there is no key report; accepted: an experiment with one.")
    report = load_report(declared.kind, experiment.argument)
    items = load_items(report, declared.model_dump(), experiment.argument)
    for package in report.packages:
        if is_drawn and find_spec(package) is None:
            raise missing_package(f"{experiment.name}: its report", package)
    for key, is_there in (
        ("solved", experiment.solved),
        ("grids", experiment.grids),
        ("looks", declared.looks),
    ):
        if is_there and not report.reads_curves:
            where = f"{experiment.argument}: {key} with report.kind = {declared.kind}"
            raise InputError(f"{where}: accepted: report.kind = map.")
    report.check(experiment)
    Names.of(experiment)  # which have to differ
    return report, items


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
    return {item.name: frame for item in items if (frame := item.table(data)) is not None}


def draw_figure(item: Item, frames: Frames, data: Data, *paths: Path) -> None:
    """Draws an item's figure, if there is one; of a partial report it is marked.

    Of several files, in different forms, the smallest one stays.
    """
    figure = None if item.draw is None else item.draw(frames, data)
    if figure is not None:
        if data.is_incomplete:
            figure.suptitle("PARTIAL: runs are missing", color="firebrick")
        for path in paths:
            save_figure(figure, path)
        plt.close(figure)
        for path in sorted(paths, key=lambda each: each.stat().st_size)[1:]:
            path.unlink()


# What a folder is made of


def _inputs(
    experiment: Experiment,
    runs: Sequence[RunSpecification],
    provenance: Sequence[Mapping[str, Any]],
    seeds: Sequence[int] | None,
    *,
    partial: bool,
) -> str:
    """Returns the digest of what a folder of results depends on: what is declared, and the records."""
    assert experiment.report is not None
    measured = [json.dumps(dict(each), sort_keys=True) for each in provenance]
    algorithms = [declared.algorithm for declared in experiment.algorithms.values()]
    names = [experiment.report.kind, *experiment.report.items, *algorithms]
    sources = [digest_of_source(name.partition(":")[0]) for name in names if ":" in name]
    declared = experiment.model_dump_json(), str(seeds), str(partial)
    return sameness.digest_of_inputs(*declared, *(run.digest for run in runs), *measured, *sources)


def _looks(path: Path, manifest: Mapping[str, Any]) -> list[int]:
    """Returns how many seeds earlier reports in this folder had, if fewer of the same than there are now."""
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        if any(before[key] != manifest[key] for key in ("experiment", "first_seed")):
            return []
        return sorted(n for n in {*before["looks"], before["seeds"]} if n < manifest["seeds"])
    except (OSError, ValueError, LookupError, TypeError):
        return []


def _manifest(
    experiment: Experiment,
    runs: Sequence[RunSpecification],
    provenance: Sequence[Mapping[str, Any]],
    seeds: Sequence[int] | None,
    data: Data,
) -> dict[str, Any]:
    """Returns what was run, and from the records what ran it: drawing again gives the same."""
    done, sizes = {run.digest for run in runs}, Counter(run.population for run in runs)
    largest = max(sizes, key=lambda each: sizes[each])
    conditions = sorted(experiment.conditions, key=lambda name: name != DEFAULT_CONDITION)
    populations = (
        (population, specifications(experiment, condition, *population, seeds))
        for condition in conditions
        for population in experiment.populations_of(condition)
    )
    # One run of each learner in each scenario, under the first condition that has it.
    first: dict[tuple[str, str, str], RunSpecification] = {}
    for population, each in populations:
        if population not in first and (there := next((run for run in each if run.digest in done), None)):
            first[population] = there
    default = [first[population] for population in experiment.populations if population in first]
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
        "argument": experiment.argument,
        "report": experiment.report and experiment.report.model_dump(mode="json"),
        "facts": data.facts,
        "horizon": experiment.horizon,
        "scenarios": {run.scenario.name: run.scenario.model_dump(mode="json") for run in default},
        "algorithms": {
            run.variant: {
                "algorithm": run.algorithm,
                "title": experiment.algorithms[run.variant].title,
                "family": family_of(experiment, run.variant),
                "packages": load_algorithm(run.algorithm).packages,
                "reference_for": experiment.algorithms[run.variant].reference_for,
                "policy": experiment.algorithms[run.variant].policy,
                "tuned_by": experiment.algorithms[run.variant].tuned_by,
                "changed": changed_settings(experiment, run.variant),
                "runs": sizes[run.population],  # in a scenario
                "settings": {
                    each.observation: each.settings.model_dump(mode="json")
                    for each in default
                    if each.variant == run.variant
                },
            }
            for run in default
        },
        "note": experiment.note.strip(),
        "readings": {
            name: {"question": reading.question, "answer": reading.answer}
            for name, reading in experiment.readings.items()
        },
        "runs": len(runs),
        "seeds": sizes[largest],
        "first_seed": min(run.seed for run in runs if run.population == largest),
        "digest": hashlib.sha256("".join(sorted(run.digest for run in runs)).encode()).hexdigest(),
        "commits": every("commit"),
        "machines": every("machine"),
        "processors": every("processor"),
        "versions": every("versions"),
        "first_started_at": min(p["started_at"] for p in provenance),
        "last_started_at": max(p["started_at"] for p in provenance),
        "busy_time_s": round(sum(p["wall_time_s"] for p in provenance), 3),
    }
