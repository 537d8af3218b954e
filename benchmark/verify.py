"""The command `verify`: is everything published what its runs make, and do runs repeat?

Published folders are copied, made again from their tables of runs, and compared byte for byte.
Some runs are trained again, and compared with what is stored or published of them.
"""

import argparse
import secrets
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import pandas as pd

from benchmark import front, report
from benchmark.experiment import PUBLISHED, Experiment, experiment_names, load_experiment
from benchmark.export import difference_of
from benchmark.folder import MANIFEST, README, REPOSITORY, Folder, alone, csv_text, digests
from benchmark.run import execute, parse_jobs
from benchmark.store import DamagedError, Record, Store
from benchmark.tables import MEASURED, Group, read, run_id, tables
from benchmark.trials import chosen_file, read_chosen
from envs import InputError
from envs.inputs import whole_number

_MOST: Final = 1_000_000  # of runs to repeat, and of seeds that select them
_STORE: Final = "runs.db"
_TEXTS: Final = (README, "index.html", "scenes.svg")  # about all published results
Tables = tuple[pd.DataFrame, pd.DataFrame]


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if everything is as it should be, else 1."""
    jobs, n = parse_jobs(options.jobs), whole_number(options.runs, "--runs", 0, _MOST)
    seed = secrets.randbelow(_MOST) if options.seed is None else options.seed
    seed = whole_number(str(seed), "--seed", 0, _MOST)
    names = experiment_names() if options.experiment is None else [options.experiment]
    experiments = [load_experiment(name, smoke=options.smoke) for name in names]
    results, n_problems = options.results, 0
    with TemporaryDirectory() as name, alone(results):
        made = Path(name) / "results"
        with suppress(shutil.Error):  # of what is no file
            shutil.copytree(results, made, ignore=shutil.ignore_patterns(f"{_STORE}*", ".*"))
        for problem in _problems(experiments, results, made, (n, seed, jobs)):
            print(problem, file=sys.stderr)
            n_problems += 1
    if n_problems:
        print(f"problems found: {n_problems}.")
    return int(n_problems > 0)


def _problems(
    experiments: Sequence[Experiment], results: Path, made: Path, sample: tuple[int, int, int]
) -> Iterator[str]:
    """Yields a sentence for each problem; prints what is correct."""
    path = results / _STORE
    shown = [each for each in experiments if _is_there(results / each.name)]
    if path.exists():
        (made / _STORE).symlink_to(path.resolve())
    elif not shown:
        raise InputError(f"{results}: no run of these experiments is stored or published.")
    try:
        yield from _stored(experiments, results, made, sample)
    except DamagedError as error:
        yield str(error)
    for experiment in shown:
        yield from _changes(experiment, results / experiment.name, made / experiment.name)
    if any(each.name in PUBLISHED for each in shown):
        yield from _texts(results, made)


def _is_there(folder: Path) -> bool:
    return any((folder / file).exists() for file in (MANIFEST, README))


# Runs


def _stored(
    experiments: Sequence[Experiment], results: Path, made: Path, sample: tuple[int, int, int]
) -> Iterator[str]:
    """Checks the store, and repeats some of the declared runs that are stored or published."""
    path, (n, seed, jobs) = results / _STORE, sample
    with Store(path if path.exists() else made / "none.db", read_only=path.exists()) as store:
        damaged = store.damaged([*store.statuses()])
        ended = store.ended().difference(damaged)
        if structure := store.problem():
            yield f"{path} is damaged: {structure}."
        if damaged:
            which = f"{len(damaged)} records are damaged (the first: {damaged[0][:12]})"
            yield f"{path}: {which}; run their experiments again, which repeats them."
        else:
            print(f"{path}: the checksums of all {len(ended)} stored records are correct.")
        groups = dict[str, tuple[Group, Tables | None]]()
        for experiment in experiments:
            published = _published(results / experiment.name)
            ids = {*published[0]["run"]} if published else set[str]()
            search = experiment.declared.search
            fresh = search.fresh if search else ()  # seeds of its second stage
            for population in experiment.populations:
                for run in population.runs([*population.seeds, *fresh]):
                    if run.digest in ended or run_id(run) in ids:
                        groups.setdefault(run.digest, (Group(population, [run]), published))
        drawn = np.random.default_rng(seed).permutation(sorted(groups))[:n].tolist()
        n_same = len(drawn)
        with Store(made / "repeated.db") as repeated:
            execute([groups[digest][0].runs[0] for digest in drawn], repeated, jobs)
            for digest in drawn:
                before = store.get([digest]) if digest in ended else []
                if found := _difference(*groups[digest], before, repeated):
                    n_same -= 1
                    run = groups[digest][0].runs[0]
                    yield f"{run.folder} ({digest[:12]}): the repeated run {found}."
        which = f"{len(drawn)} of {len(groups)} runs were repeated, drawn with --seed {seed}"
        print(f"runs: {which}; {n_same} are identical.")


def _published(folder: Path) -> Tables | None:
    """Returns the tables of a folder; None if there are none, or damaged ones."""
    with suppress(InputError):
        return read(folder)
    return None


def _difference(
    group: Group, published: Tables | None, stored: Sequence[Record], repeated: Store
) -> str:
    """Returns in what a repeated run differs from its record and from its rows in the tables."""
    run, names = group.runs[0], group.population.keys
    (record,) = repeated.get([run.digest])
    if record.error:
        return f"failed: {record.error}"
    for before in stored:
        if found := difference_of(before, record):
            return found
    different = list[str]()
    for made, there in zip(tables([group], repeated), published or (), strict=False):
        is_own = there[[*names, "seed"]] == pd.Series({**names, "seed": run.seed})
        for name in made.columns.difference([*MEASURED], sort=False):
            if csv_text(made[[name]]) != csv_text(there.loc[is_own.all(axis=1), [name]]):
                different.append(name)
    return f"differs in {', '.join(different)}" if different else ""


# Published files


def _changes(experiment: Experiment, folder: Path, made: Path) -> Iterator[str]:
    """Checks a folder's files, makes them again, and yields what differs."""
    try:
        published = Folder(folder)
        published.check()
        if experiment.declared.search is not None:
            yield from unfounded(experiment, published)
        report.write(experiment, made)
    except InputError as error:
        yield from str(error).split("\n")
        return
    before, after = digests(folder), digests(made)
    names = sorted(before.keys() | after.keys())
    different = [name for name in names if before.get(name) != after.get(name)]
    if different:
        again = f"'report {experiment.argument}' writes them again"
        yield f"{folder}: different from what its runs make: {', '.join(different)}; {again}."
    else:
        print(f"{experiment.name}: all {len(names)} files match its manifest and its runs.")


def unfounded(experiment: Experiment, folder: Folder) -> Iterator[str]:
    """Yields a problem if a search's chosen settings are not those of its published trials."""
    made = read_chosen(experiment.path, experiment.name)
    if made.trials != folder.files.get("trials.csv", ""):
        file, trials = chosen_file(experiment.path), folder.path / "trials.csv"
        again = f"'run {experiment.argument} --report' makes both anew"
        yield f"{file}: made from other trials than those in {trials}; {again}."


def _texts(results: Path, made: Path) -> Iterator[str]:
    """Makes the texts about all published results again, and yields those that differ."""
    try:
        report.write_texts(made)
        texts = {results / name: (made / name).read_bytes() for name in _TEXTS}
        if results.resolve() == REPOSITORY / "results":
            texts[REPOSITORY / README] = front.readme(results).encode()
    except InputError as error:
        yield from str(error).split("\n")
        return
    for path, text in texts.items():
        if path.exists() and path.read_bytes() != text:
            yield f"{path}: different from what the tables make; 'report' writes it again."
