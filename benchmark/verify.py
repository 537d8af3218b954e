"""The command `verify`: is everything published what its runs make, and do runs repeat?

Published folders are copied, made again from their tables of runs, and compared byte for byte.
Some runs, or all that a study needs, are trained again, and some compared with their rows.
"""

import argparse
import secrets
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from benchmark import front, report
from benchmark.experiment import (
    PUBLISHED,
    Experiment,
    experiment_names,
    interleaved,
    load_experiment,
)
from benchmark.folder import (
    MANIFEST,
    MEANINGS,
    README,
    REPOSITORY,
    Folder,
    alone,
    csv_text,
    digests,
)
from benchmark.page.build import page
from benchmark.run import execute, parse_jobs
from benchmark.store import Store
from benchmark.tables import AGENTS, MEASURED, Group, read, run_id, tables
from benchmark.trials import chosen_file, read_chosen
from envs import InputError
from envs.inputs import whole_number

_MOST = 1_000_000  # of runs to repeat, and of seeds that select them
_STORE = "runs.db"
_PAGE = "index.html"
_TEXTS = (README, _PAGE, "scenes.svg")  # about all published results
Tables = tuple[pd.DataFrame, pd.DataFrame]


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if everything is as it should be, else 1."""
    jobs, n = parse_jobs(options.jobs), whole_number(options.runs, "--runs", 0, _MOST)
    seed = secrets.randbelow(_MOST)
    if options.seed is not None:
        seed = whole_number(options.seed, "--seed", 0, _MOST)
    names = experiment_names() if options.experiment is None else [options.experiment]
    experiments = [load_experiment(name, smoke=options.smoke) for name in names]
    results, n_problems = options.results, 0
    shown = [each for each in experiments if (results / each.name).is_dir()]
    if not shown:
        accepted = "a folder with at least one of " + ", ".join(each.name for each in experiments)
        raise InputError(f"--results {results}: nothing to verify; accepted: {accepted}.")
    with TemporaryDirectory() as name, alone(results):
        made = Path(name) / "results"
        made.mkdir()
        for each in {*PUBLISHED, *(each.name for each in shown)}:
            _copy(results / each, made / each)
        with Store(made / _STORE) as repeated:
            for problem in _problems(shown, results, made, repeated, (n, seed, jobs)):
                print(problem.replace(str(made), str(results)), file=sys.stderr)
                n_problems += 1
    known = {*_TEXTS, *(each.name for each in shown)}
    others = sorted(
        each.name
        for each in results.iterdir()
        if each.name not in known and not each.name.startswith((".", _STORE))
    )
    if options.experiment is None and others:
        print(f"not checked: {', '.join(others)}.")
    if n_problems:
        print(f"problems found: {n_problems}.")
    print("Matching digests do not show who made the files; only training runs again does.")
    return int(n_problems > 0)


def _copy(folder: Path, made: Path) -> None:
    """Copies the files that a folder's manifest lists, as far as they are there, and the texts."""
    with suppress(InputError):  # `_changes` says what is wrong
        names = {MANIFEST, README, MEANINGS, *Folder(folder).files}
        made.mkdir()
        for file in names:
            if (folder / file).is_file():
                shutil.copy(folder / file, made)


def _problems(
    shown: Sequence[Experiment],
    results: Path,
    made: Path,
    repeated: Store,
    sample: tuple[int, int, int],
) -> Iterator[str]:
    """Yields a sentence for each problem; prints what is correct."""
    yield from _unrepeated(shown, results, repeated, sample)
    for each in shown:
        if hasattr(report.study_of(each).module, "READS_STORE"):  # it needs all records
            runs = interleaved(population.runs() for population in each.populations)
            what = f"{len(runs):,} runs, since their results need more than their tables"
            print(f"{each.name}: training all {what} ...", file=sys.stderr)
            execute(runs, repeated, sample[-1])
    checks = [_changes(each, results / each.name, made / each.name) for each in shown]
    if any(each.name in PUBLISHED for each in shown):
        checks.append(_texts(results, made))
    for check in checks:
        try:
            yield from check
        except InputError as error:
            yield from error.args


# Runs


def _unrepeated(
    shown: Sequence[Experiment], results: Path, repeated: Store, sample: tuple[int, int, int]
) -> Iterator[str]:
    """Trains some of the published runs again, and yields those that differ."""
    n, seed, jobs = sample
    groups = dict[str, tuple[Group, Tables]]()
    for experiment in shown:
        with suppress(InputError):  # `_changes` says what is damaged
            published = read(results / experiment.name)
            ids, search = {*published[0]["run"]}, experiment.declared.search
            fresh = search.fresh if search else ()  # seeds of its second stage
            for population in experiment.populations:
                for run in population.runs([*population.seeds, *fresh]):
                    if run_id(run) in ids:
                        groups.setdefault(run.digest, (Group(population, [run]), published))
    drawn = np.random.default_rng(seed).permutation(sorted(groups))[:n].tolist()
    execute([groups[digest][0].runs[0] for digest in drawn], repeated, jobs)
    n_same = len(drawn)
    for digest in drawn:
        if found := _difference(*groups[digest], repeated):
            n_same -= 1
            run = groups[digest][0].runs[0]
            yield f"{run.folder} ({digest[:12]}): the repeated run {found}."
    which = f"{len(drawn)} of {len(groups)} runs were repeated, drawn with --seed {seed}"
    print(f"runs: {which}; {n_same} are identical.")


def _difference(group: Group, published: Tables, repeated: Store) -> str:
    """Returns in what a repeated run differs from its rows in the tables; empty if in nothing."""
    run = group.runs[0]
    (record,) = repeated.get([run.digest])
    if record.error:
        return f"failed: {record.error}"
    keys, different = {**group.population.keys, "seed": run.seed}, list[str]()
    for made, there in zip(tables([group], repeated), published, strict=True):
        own = there[(there[[*keys]] == pd.Series(keys)).all(axis=1)]
        for name in made.columns.difference([*MEASURED], sort=False):
            if csv_text(made[[name]]) != csv_text(own[[name]]):
                different.append(name)
    return f"differs in {', '.join(different)}" if different else ""


# Published files


def _changes(experiment: Experiment, folder: Path, made: Path) -> Iterator[str]:
    """Checks a folder's files, makes them again, and yields what differs."""
    published = Folder(folder)
    others = _others(experiment, published)
    if others:
        what = f"{MANIFEST} does not list {', '.join(others)}"
        yield f"{folder}: {what}; accepted: only what it lists."
    published.check()
    if experiment.declared.search is not None:
        yield from unfounded(experiment, published)
    report.write(experiment, made)
    before, after = digests(folder, but=others), digests(made, but=others)
    names = sorted(before.keys() | after.keys())
    different = [name for name in names if before.get(name) != after.get(name)]
    there = folder / _PAGE
    if there.is_file() and there.read_text(encoding="utf-8") != page(made, [Folder(made)]):
        different.append(_PAGE)
    if different:
        again = f"'report {experiment.argument}' writes them again"
        yield f"{folder}: different from what its runs make: {', '.join(different)}; {again}."
    else:
        but = f" ({AGENTS}: only its manifest)" if AGENTS in published.files else ""
        print(f"{experiment.name}: all {len(names)} files match its manifest and its runs{but}.")


def _others(experiment: Experiment, folder: Folder) -> list[str]:
    """Returns what does not belong to a folder; an experiment of `bench` has its file there."""
    own = experiment.path.name, experiment.path.with_suffix(".py").name
    about = {MANIFEST, README, MEANINGS, _PAGE, *own, *folder.files}
    return sorted(
        each.name for each in folder.path.iterdir() if each.name[0] != "." if each.name not in about
    )


def unfounded(experiment: Experiment, folder: Folder) -> Iterator[str]:
    """Yields a problem if a search's chosen settings are not those of its published trials."""
    if read_chosen(experiment.path).trials != folder.files.get("trials.csv"):
        file, trials = chosen_file(experiment.path), folder.path / "trials.csv"
        again = f"'report {experiment.argument}' writes it again"
        yield f"{file}: made from other trials than those in {trials}; {again}."


def _texts(results: Path, made: Path) -> Iterator[str]:
    """Makes the texts about all published results again, and yields those that differ."""
    report.write_texts(made)
    texts = {results / name: (made / name).read_bytes() for name in _TEXTS}
    if results.resolve() == REPOSITORY / "results":
        texts[REPOSITORY / README] = front.readme(results).encode()
    for path, text in texts.items():
        if path.exists() and path.read_bytes() != text:
            yield f"{path}: different from what the tables make; 'report' writes it again."
