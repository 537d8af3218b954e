"""Verifies what is stored and published: checksums, some runs repeated, tables and figures drawn again."""

import argparse
import secrets
import sys
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from benchmark.commands import parse_jobs
from benchmark.commands.report import check, folder_name
from benchmark.execution.store import REPAIR_ADVICE, Record, Store
from benchmark.execution.verification import repeat, sample
from benchmark.experiments import (
    Experiment,
    RunSpecification,
    all_specifications,
    experiment_names,
    load_experiment,
)
from benchmark.reports import certificate, draw, files, load_items, load_report
from benchmark.reports.item import measured_files
from benchmark.reports.published import MANIFEST
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
    with (
        Store(options.results / "runs.db", read_only=True) as store,
        files.alone(options.results),
        files.scratch(options.results) as scratch,
    ):
        for problem in _problems(experiments, store, options, scratch):
            print(problem, file=sys.stderr)
            problems.append(problem)
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
    runs = {experiment.name: all_specifications(experiment) for experiment in experiments}
    wanted = {run.digest: run for of_experiment in runs.values() for run in of_experiment}
    stored = {digest: run for digest, run in wanted.items() if digest in ended}
    every = sorted(store.statuses() if options.experiment is None else stored, key=str)
    damaged = store.damaged(every)
    if damaged:
        advice = "run their experiments again, which repeats them"
        if unlisted := [digest for digest in damaged if digest not in wanted]:
            advice += (
                f" ({len(unlisted)} of them are of none that 'list' shows; to remove them: "
                f"sqlite3 {path} \"DELETE FROM runs WHERE digest LIKE '{unlisted[0][:12]}%'\" for each)"
            )
        yield (
            f"checksums: {len(damaged)} of {len(every)} records are damaged (the first: {damaged[0][:12]}); "
            f"{advice}."
        )
        ended -= {*damaged}
    else:
        print(f"checksums: correct in all {len(every)} records.")
    yield from _repeated([run for digest, run in stored.items() if digest in ended], store, options, scratch)
    for experiment in experiments:
        folder = options.results / folder_name(experiment, None, partial=False)
        is_published = bool(experiment.report) and (folder / MANIFEST).is_file()
        if is_published and all(run.digest in ended for run in runs[experiment.name]):
            yield from _redrawn(experiment, store, folder, scratch, options.jobs)
        elif is_published or any(run.digest in stored for run in runs[experiment.name]):
            what = "runs are missing" if is_published else "there is no report"
            print(f"{experiment.name}: not drawn again, since {what}.")


def _repeated(
    runs: list[RunSpecification], store: Store, options: argparse.Namespace, scratch: Path
) -> Iterator[str]:
    """Repeats a sample of runs; yields those that differ."""
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    chosen = sample(runs, options.runs, seed)
    if not chosen:
        print("runs: none were repeated.")
        return
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"repeating {len(chosen)} runs", total=len(chosen))

        def advance(records: list[Record]) -> None:
            progress.advance(task, len(records))

        differing = repeat(chosen, store, scratch / "runs.db", options.jobs, advance)
    for run in chosen:
        if run.digest in differing:
            yield f"{run.folder} ({run.digest[:12]}): {differing[run.digest]}."
    n_same = len(chosen) - len(differing)
    drawn = f"drawn from {len(runs)} with --seed {seed}"
    print(f"runs: {n_same} of {len(chosen)} repeated runs are identical ({drawn}).")


def _redrawn(experiment: Experiment, store: Store, folder: Path, scratch: Path, jobs: int) -> Iterator[str]:
    """Draws an experiment again; yields what differs from its folder."""
    check(experiment, is_required=True)
    made = scratch / experiment.name
    print(f"{experiment.name}: drawing tables and figures again ...", file=sys.stderr)
    draw.draw(experiment, store, made, jobs=jobs)
    report = load_report(experiment.report, experiment.argument)
    items = load_items(report, experiment.items, experiment.argument)
    found = certificate.compare_folders(
        made, folder, experiment.name, measured_files(items), draw.was_made(folder, items)
    )
    assert found is not None  # there is a manifest
    if found.is_identical:
        print(found)
    else:
        yield str(found)
