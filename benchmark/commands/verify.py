"""Verifies what is stored and published: checksums, some runs repeated, results drawn again."""

import argparse
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.analysis.stages import known_runs
from benchmark.commands import parse_jobs
from benchmark.commands.report import folder_name
from benchmark.execution import driver
from benchmark.execution.store import REPAIR_ADVICE, DamagedError, Record, Store
from benchmark.experiments import (
    Experiment,
    RunSpecification,
    experiment_names,
    load_experiment,
)
from benchmark.page import build as page
from benchmark.reports import document, draw, files, sameness
from benchmark.reports.folder import MANIFEST
from envs import InputError


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if everything is as it should be, else 1."""
    options.jobs = parse_jobs(options.jobs)
    for option in ("runs", "seed"):
        if (getattr(options, option) or 0) < 0:
            raise InputError(f"--{option} {getattr(options, option)}: accepted: at least 0.")
    names = experiment_names() if options.experiment is None else [options.experiment]
    experiments = [load_experiment(name) for name in names]
    problems = []
    try:
        with (
            Store(options.results / "runs.db", read_only=True) as store,
            files.alone(options.results),
            tempfile.TemporaryDirectory() as scratch,  # elsewhere, as the folder may be read-only
        ):
            for problem in _problems(experiments, store, options, Path(scratch)):
                print(problem, file=sys.stderr)
                problems.append(problem)
    except DamagedError as error:
        print(error, file=sys.stderr)
        problems.append(str(error))
    if problems:
        print(f"problems found: {len(problems)}.")
    return 1 if problems else 0


def _problems(
    experiments: list[Experiment], store: Store, options: argparse.Namespace, scratch: Path
) -> Iterator[str]:
    """Yields what is wrong, a sentence each; prints what is right."""
    path = options.results / "runs.db"
    if structure := store.problem():
        yield f"{path} is damaged: {structure}; {REPAIR_ADVICE}."
    ended = store.ended()
    runs = {experiment.name: known_runs(experiment, store) for experiment in experiments}
    wanted = {run.digest: run for of_experiment in runs.values() for run in of_experiment}
    every = [*store.statuses()] if options.experiment is None else sorted(wanted.keys() & ended)
    if options.experiment is not None and not (every or structure):
        raise InputError(f"{path}: no run of {options.experiment} is stored; accepted: a store with some.")
    damaged = store.damaged(every)
    ended -= {*damaged}
    if damaged:
        first = damaged[0][:12]
        yield (
            f"checksums: {len(damaged)} of {len(every)} records are damaged (the first: {first}); run their "
            f"experiments again, which repeats them ({len({*damaged} - wanted.keys())} are of other "
            f"experiments; sqlite3 {path} \"DELETE FROM runs WHERE digest LIKE '{first}%'\" removes one)."
        )
    else:
        print(f"checksums: correct in all {len(every)} records.")
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    stored = [run for digest, run in wanted.items() if digest in ended]
    chosen = np.random.default_rng(seed).permutation(len(stored))[: options.runs]
    sample = [stored[i] for i in sorted(chosen)]
    print(f"repeating {len(sample)} runs ...", file=sys.stderr)
    differences = [*_differences(sample, store, scratch / "runs.db", options.jobs)]
    yield from differences
    n_same, drawn = len(sample) - len(differences), f"drawn from {len(stored)} with --seed {seed}"
    print(f"runs: {n_same} of {len(sample)} repeated runs are identical ({drawn}).")
    pages = set[str | None]()
    for experiment in experiments:
        folder = options.results / folder_name(experiment, None, partial=False)
        is_published = bool(experiment.report) and (folder / MANIFEST).is_file()
        if is_published and all(run.digest in ended for run in runs[experiment.name]):
            yield from _redrawn(experiment, store, folder, scratch)
        elif is_published or any(run.digest in ended for run in runs[experiment.name]):
            what = "runs are missing" if is_published else "there is no report"
            print(f"{experiment.name}: not drawn again, since {what}.")
        if is_published:
            pages.add(None if experiment.name in page.CHAPTERS else experiment.name)
    yield from rewritten(pages, options.results)


def _differences(runs: Sequence[RunSpecification], store: Store, path: Path, jobs: int) -> Iterator[str]:
    """Executes stored runs again, into another store; yields a sentence for each that differs."""
    with Store(path) as repeated:
        driver.run(runs, repeated, jobs)
        for run in runs:
            (before,), (after,) = store.get([run.digest]), repeated.get([run.digest])
            if what := _difference(before, after):
                yield f"{run.folder} ({run.digest[:12]}): {what}."


def _difference(before: Record, after: Record) -> str:
    """Returns what differs between two records of a run; empty if nothing but times and machines does."""
    if before.status != after.status:
        return f"it was {before.status}, but is {after.status} now{f': {after.error}' * bool(after.error)}"

    def bits(arrays: Mapping[str, Any], name: str) -> object:
        return name in arrays and (arrays[name].dtype, arrays[name].shape, arrays[name].tobytes())

    names = sorted(before.arrays.keys() | after.arrays.keys())
    differing = [name for name in names if bits(before.arrays, name) != bits(after.arrays, name)]
    old, new = (
        record.provenance["versions"] | {"machine": record.provenance["machine"]}
        for record in (before, after)
    )
    others = [f"{key} {old[key]}, here {new.get(key)}" for key in old if old[key] != new.get(key)]
    made = f" (recorded with {'; '.join(others)})" if others else ""
    return f"differs in {', '.join(differing)}{made}" if differing else ""


def _redrawn(experiment: Experiment, store: Store, folder: Path, scratch: Path) -> Iterator[str]:
    """Draws an experiment again; yields what differs from its folder."""
    made = scratch / experiment.name
    print(f"{experiment.name}: drawing tables and figures again ...", file=sys.stderr)
    made.mkdir()
    with suppress(OSError):  # it notes what earlier reports showed, which the store does not know
        shutil.copy(folder / MANIFEST, made)
    draw.draw(experiment, draw.report_of(experiment), store, made)
    # Measured times, too, are those that the store has.
    found = sameness.compare(made, experiment.name, (), folder)
    assert found is not None  # there is a manifest
    if found.is_identical:
        print(found)
    else:
        yield f"{found}\n{experiment.name}: 'report {experiment.argument}' makes them from the stored runs."


def rewritten(pages: set[str | None], results: Path) -> Iterator[str]:
    """Yields which texts of measurements, and outside of folders, are not what the tables make."""
    try:
        texts = {path: text for name in pages for path, text in page.texts(results, name)}
        if (results / page.SPEED / MANIFEST).is_file():  # which no experiment makes
            texts[results / page.SPEED / "README.md"] = document.readme(results / page.SPEED)
        if None in pages and results.resolve() == sameness.REPOSITORY / "results":
            texts[sameness.REPOSITORY / "README.md"] = document.front(results)
    except InputError as error:  # a table of one of them is damaged
        yield str(error)
        return
    for path, text in texts.items():
        if path.exists() and path.read_bytes() != text.encode():
            yield f"{path}: different from what the tables make; 'report' writes it again."
