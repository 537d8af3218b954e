"""Checks stored and published results: verifies checksums, repeats some runs, draws results again."""

import argparse
import secrets
import sys
import tempfile
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path

import numpy as np

from benchmark.commands import parse_jobs
from benchmark.execution import driver
from benchmark.execution.store import MOVE, DamagedError, Record, Store
from benchmark.experiments import PUBLISHED, Experiment, RunSpecification, experiment_names, load_experiment
from benchmark.experiments.search import chosen_file, read_chosen
from benchmark.folder import README, SPEED, Folder, digests
from benchmark.publish import document, draw, files, front, sameness
from benchmark.publish.page import build as page
from benchmark.studies import Report, Study, report_of, runs_of
from envs import InputError


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if everything is as it should be, else 1."""
    options.jobs = parse_jobs(options.jobs)
    for option in ("runs", "seed"):
        if (getattr(options, option) or 0) < 0:
            raise InputError(f"--{option} {getattr(options, option)}: accepted: at least 0.")
    names = experiment_names() if options.experiment is None else [options.experiment]
    experiments = [load_experiment(name, smoke=options.smoke) for name in names]
    problems = list[str]()
    with tempfile.TemporaryDirectory() as scratch:  # elsewhere, as the folder may be read-only
        try:
            path = options.results / "runs.db"
            with _opened(path, Path(scratch)) as store, files.alone(options.results):
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
    """Yields a sentence for each problem; prints what is correct."""
    path = options.results / "runs.db"
    if structure := store.problem():
        yield f"{path} is damaged: {structure}; {MOVE}."
    stages = {each.name: report_of(each).stages(store) for each in experiments}
    known = {name: runs_of(chain.from_iterable(groups)) for name, groups in stages.items()}
    declared = {run.digest: run for runs in known.values() for run in runs}
    ended = store.ended()
    checked = [*store.statuses()] if options.experiment is None else sorted(declared.keys() & ended)
    if damaged := store.damaged(checked):
        which = f"{len(damaged)} of {len(checked)} records are damaged (the first: {damaged[0][:12]})"
        yield f"checksums: {which}; run their experiments again, which repeats them."
    else:
        print(f"checksums: correct in all {len(checked)} records.")
    ended -= {*damaged}
    stored = [run for digest, run in declared.items() if digest in ended]
    yield from _differences(stored, store, scratch / "runs.db", options)
    reports = dict[str, Study]()
    for experiment in experiments:
        folder = options.results / experiment.name
        is_stored = [run.digest in ended for run in known[experiment.name]]
        if experiment.declared.report and Folder(folder).is_there:
            report = report_of(experiment).check(is_drawn=all(is_stored))
            reports[experiment.name] = report.study
            if all(is_stored):
                yield from _redrawn(report, store, folder, scratch)
            else:
                n = len(is_stored) - sum(is_stored)
                print(f"{experiment.name}: not drawn again, as {n:,} of {len(is_stored):,} runs are missing.")
            if experiment.declared.search:
                yield from unfounded(experiment, folder)
        elif any(is_stored):
            print(f"{experiment.name}: not drawn again, since there is no report.")
    if not (reports or checked or structure) and options.experiment is not None:
        raise InputError(f"{path}: no run of {options.experiment} is stored or published; run it first.")
    yield from rewritten(reports, options.results)


def _opened(path: Path, scratch: Path) -> Store:
    """Returns the store, or an empty one if there is none: published files can be verified without it."""
    if path.exists():
        return Store(path, read_only=True)
    print(f"{path}: there are no stored runs, so none is repeated.")
    return Store(scratch / "none.db")


def _differences(
    stored: list[RunSpecification], store: Store, path: Path, options: argparse.Namespace
) -> Iterator[str]:
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    chosen = np.random.default_rng(seed).permutation(len(stored))[: options.runs]
    sample = [stored[i] for i in sorted(chosen)]
    print(f"repeating {len(sample)} runs ...", file=sys.stderr)
    n_different = 0
    with Store(path) as repeated:
        driver.run(sample, repeated, options.jobs)
        for run in sample:
            if found := difference_of(*store.get([run.digest]), *repeated.get([run.digest])):
                yield f"{run.folder} ({run.digest[:12]}): {found}."
                n_different += 1
    drawn = f"drawn from {len(stored)} with --seed {seed}"
    print(f"runs: {len(sample) - n_different} of {len(sample)} repeated runs are identical ({drawn}).")


def difference_of(before: Record, after: Record) -> str:
    """Returns what differs between two records of a run; empty if nothing but times and machines does."""
    if before.status != after.status:
        return f"it was {before.status}, but is {after.status} now{f': {after.error}' * bool(after.error)}"
    old, new = (
        {name: (array.dtype, array.shape, array.tobytes()) for name, array in record.arrays.items()}
        for record in (before, after)
    )
    if not (names := sameness.differing(old, new)):
        return ""
    recorded, now = (
        {**record.provenance["versions"], "machine": record.provenance["machine"]}
        for record in (before, after)
    )
    changed = [f"{key} {recorded.get(key)}, here {now.get(key)}" for key in sameness.differing(recorded, now)]
    return f"differs in {', '.join(names)}" + f" (recorded with {'; '.join(changed)})" * bool(changed)


def _redrawn(report: Report, store: Store, folder: Path, scratch: Path) -> Iterator[str]:
    experiment = report.experiment
    name, made = experiment.name, scratch / experiment.name
    print(f"{name}: drawing tables and figures again ...", file=sys.stderr)
    draw.draw(report, store, made)
    again, listed = digests(made), sameness.listed(folder)
    there = {file: digest for file, digest in digests(folder).items() if file in again or file in listed}
    n = len({*again, *there})
    if other := sameness.differing(again, there):
        yield (
            f"{name}: different from the files in {folder}: {len(other)} of {n} files: {', '.join(other)}.\n"
            f"{name}: 'report {experiment.argument}' makes them from the stored runs."
        )
    else:
        print(f"{name}: identical to the files in {folder} ({n} of {n} files).")


def unfounded(experiment: Experiment, folder: Path) -> Iterator[str]:
    """Yields a problem if a search's chosen settings were not made from its published table of trials."""
    try:
        made = read_chosen(experiment.path, experiment.name)
        if made.trials != Folder(folder).manifest["files"].get("trials.csv", ""):
            file = chosen_file(experiment.path)
            again = f"'run {experiment.argument} --report' makes both anew"
            yield f"{file}: made from other trials than those in {folder / 'trials.csv'}; {again}."
    except InputError as error:
        yield str(error)


def rewritten(reports: Mapping[str, Study], results: Path) -> Iterator[str]:
    """Yields files that differ from their manifests, and texts that differ from what the tables make.

    `reports` are those of the published experiments that are verified, by name.
    """
    texts, problems = dict[Path, str](), list[str]()
    for name in [*reports, *[SPEED] * Folder(results / SPEED).is_there]:
        try:
            folder = Folder(results / name)
            if name == SPEED:
                folder.check()
            else:
                texts[results / name / README] = document.Document(results / name, reports[name]).readme()
            print(f"{name}: all files in its manifest are unchanged ({len(folder.manifest['files'])}).")
        except InputError as error:
            problems += error.args
    pages = {None if name in PUBLISHED else name: report for name, report in reports.items()}
    try:
        texts |= {path: text for name in pages for path, text in page.texts(results, name, pages[name])}
        if None in pages and results.resolve() == sameness.REPOSITORY / "results":
            texts[sameness.REPOSITORY / README] = front.front(results)
    except InputError as error:
        problems += error.args
    yield from dict.fromkeys(problems)
    again = {str(path): text.encode() for path, text in texts.items()}
    there = {str(path): path.read_bytes() if path.is_file() else b"" for path in texts if path.exists()}
    for path in map(Path, sameness.differing(again, there)):
        if path.exists() or (path.name == README and Folder(path.parent).is_there):
            yield f"{path}: different from what the tables make; 'report' writes it again."
