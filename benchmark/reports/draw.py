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

from benchmark.analysis.records import check_scores
from benchmark.analysis.stages import known_runs
from benchmark.drawing import tables
from benchmark.drawing.style import save_figure
from benchmark.execution.provenance import digest_of_source
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, RunSpecification
from benchmark.experiments.choices import changed_settings
from benchmark.reports import document, files, load_items, load_report, sameness
from benchmark.reports.data import Data, load
from benchmark.reports.folder import MANIFEST, with_titles
from benchmark.reports.item import PICTURES, Frames, Item, Report, as_written, called
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
    if partial and not report.can_be_partial:
        raise InputError(f"--partial: {experiment.name}: accepted: only of a comparison or a map.")
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
        data = load(experiment, store, seeds, partial=partial, columns=report.columns)
        manifest = _manifest(experiment, runs, provenance, seeds, data.note)
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
            called(item.write, data, path=directory / item.file)
    document.write(directory)


def export(
    experiment: Experiment, store: Store, directory: Path, seeds: Sequence[int] | None, form: str
) -> None:
    """Writes an experiment's figures or tables, in one of `FORMATS`, into a folder of their own."""
    report, items = report_of(experiment)
    data = load(experiment, store, seeds, columns=report.columns)
    frames = tables_of(items, data)
    titles = {learner.name: learner.title for learner in experiment.learners.values()}
    with files.alone(directory.parent), files.replaced(directory, lambda _: True) as aside:
        for item in items:
            path = aside / f"{item.name}.{form}"
            if form != "tex":
                draw_figure(item, frames, data, path)
            elif item.name in frames:
                frame = item.display(with_titles(frames[item.name], titles)).map(as_written)
                path.write_text(tables.to_latex(frame), encoding="utf-8")


def report_of(experiment: Experiment, *, is_drawn: bool = True) -> tuple[Report, tuple[Item, ...]]:
    """Returns the report of an experiment, and its items.

    Args:
      experiment: As loaded.
      is_drawn: Whether it is drawn now, so that its packages have to be there.

    Raises:
      InputError: It has none, or asks for something else than the experiment has, or a package is missing.
    """
    declared = experiment.report
    if declared is None:
        raise InputError(f"{experiment.argument}: there is no key report; accepted: an experiment with one.")
    report = load_report(declared.kind, experiment.argument)
    items = load_items(report, declared.model_dump(), experiment.argument)
    for package in report.packages:
        if is_drawn and find_spec(package) is None:
            raise missing_package(f"{experiment.name}: its report", package)
    of_maps = {
        "solved": experiment.declared.solved,
        "grids": experiment.declared.grids,
        "looks": declared.looks,
    }
    for key, value in of_maps.items():
        if value and not report.reads_curves:
            where = f"{experiment.argument}: {key} with report.kind = {declared.kind}"
            raise InputError(f"{where}: accepted: report.kind = map.")
    report.check(experiment)
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
    figure = item.picture(data, frames)
    if figure is not None:
        if data.is_partial:
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
    measured = [json.dumps(dict(each), sort_keys=True) for each in provenance]
    named = [variant.algorithm for variant in experiment.declared.algorithms.values()]
    if experiment.report is not None:
        named += [experiment.report.kind, *experiment.report.items]
    sources = [digest_of_source(name.partition(":")[0]) for name in named if ":" in name]
    declared = experiment.declared.model_dump_json(), str(seeds), str(partial)
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
    note: str,
) -> dict[str, Any]:
    """Returns what was run, and from the records what ran it: drawing again gives the same."""
    declared = experiment.declared
    sizes = Counter(run.population for run in runs)
    largest = max(sizes, key=lambda each: sizes[each])
    # One run of each learner in each scenario, under the first condition that has it.
    first: dict[tuple[str, str], RunSpecification] = {}
    for population in experiment.populations:
        if population.first.population in sizes:
            first.setdefault((population.scenario.name, population.learner.name), population.first)
    variants: dict[str, dict[str, Any]] = {}
    for learner in experiment.learners.values():
        shown = [run for (_, name), run in first.items() if name == learner.name]
        if not shown:
            continue
        variant = variants.setdefault(
            learner.variant,
            {
                "algorithm": learner.declared.algorithm,
                "title": learner.declared.title,
                "family": learner.family,
                "packages": learner.algorithm.packages,
                "reference_for": learner.declared.reference_for,
                "policy": learner.declared.policy,
                "tuned_by": learner.declared.tuned_by,
                "changed": changed_settings(declared, learner.variant),
                "runs": sizes[shown[-1].population],  # in a scenario
                "settings": {},
            },
        )
        variant["settings"][learner.observation] = shown[-1].settings.model_dump(mode="json")
    return {
        "experiment": experiment.name,
        "description": experiment.description,
        "command": f"python -m benchmark run {experiment.argument}{_option(seeds)} --report",
        "partial": note,
        "argument": experiment.argument,
        "report": declared.report and declared.report.model_dump(mode="json"),
        "solved": declared.solved and declared.solved.model_dump(mode="json"),
        "search": declared.search and declared.search.model_dump(mode="json"),
        "grids": {name: [*grid.axes] for name, grid in declared.grids.items()},
        "horizon": declared.horizon,
        "scenarios": {run.scenario.name: run.scenario.model_dump(mode="json") for run in first.values()},
        "algorithms": variants,
        "note": declared.note.strip(),
        "readings": {
            name: {"question": reading.question, "answer": reading.answer}
            for name, reading in declared.readings.items()
        },
        "runs": len(runs),
        "seeds": sizes[largest],
        "first_seed": min(run.seed for run in runs if run.population == largest),
        "digest": hashlib.sha256("".join(sorted(run.digest for run in runs)).encode()).hexdigest(),
        **_made_by(provenance),
    }


def _option(seeds: Sequence[int] | None) -> str:
    return "" if seeds is None else f" --seeds {seeds[0]}-{seeds[-1]}"


def _made_by(provenance: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Returns what made the runs, and when."""

    def every(key: str) -> list[object]:
        # Records that were made before the processor was noted do not have it.
        texts = {json.dumps(run[key], sort_keys=True) for run in provenance if key in run}
        return [json.loads(text) for text in sorted(texts)]

    return {
        "commits": every("commit"),
        "machines": every("machine"),
        "processors": every("processor"),
        "versions": every("versions"),
        "first_started_at": min(run["started_at"] for run in provenance),
        "last_started_at": max(run["started_at"] for run in provenance),
        "busy_time_s": round(sum(run["wall_time_s"] for run in provenance), 3),
    }
