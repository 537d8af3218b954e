"""Draws an experiment's tables and figures from its stored runs, and builds the page."""

import argparse
import sys
from pathlib import Path

from benchmark.commands import parse_seeds
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, experiment_names, load_experiment
from benchmark.experiments.choices import digest_of_search
from benchmark.experiments.search import Choices, chosen_file
from benchmark.folder import MANIFEST, SPEED, Folder
from benchmark.publish import document, draw, files, front, prose, sameness
from benchmark.publish.page import build as page
from benchmark.sealed import sealed
from benchmark.studies import report_of
from benchmark.studies.search.analysis import SearchAnalysis
from envs import InputError
from envs.inputs import check_all


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    if options.experiment is None:
        return _rewrite(options)
    experiment = load_experiment(options.experiment, smoke=options.smoke)
    report = report_of(experiment).check()
    seeds = other_seeds(experiment, parse_seeds(options.seeds))
    directory = options.results / folder_name(experiment, seeds)
    with Store(options.results / "runs.db", read_only=True) as store:
        made = draw.draw(report, store, directory, seeds)
        if experiment.declared.search is not None:
            _write_chosen(made.analysis, Folder(directory))
    print(f"{experiment.name}: tables and figures are in {directory}.")
    print(f"{experiment.name}: the page is {page.write(options.results, directory.name, report.study)}.")
    if made.certificate is not None:
        print(made.certificate.text)
    try:
        finding = report.study.finding
        if prose.written(Folder(directory), finding) is None and finding is not None and finding.is_file():
            print(f"{experiment.name}: {finding} is not used, since it is about all declared runs.")
    except prose.ClaimError as error:  # Stable-Baselines3's results depend on the type of processor
        print(f"{error}\n{experiment.name}: so its text is not used.")
    return 0


def _rewrite(options: argparse.Namespace) -> int:
    if options.seeds is not None:
        raise InputError("--seeds: accepted only together with an experiment.")
    folders = sorted(path.parent for path in options.results.glob(f"[!.]*/{MANIFEST}"))
    if folders := [folder for folder in folders if not folder.name.startswith(SPEED)]:
        with files.alone(options.results):
            check_all(*(Folder(folder).check for folder in folders if folder.name in experiment_names()))
            for folder in folders:
                _write_texts(folder)
            if options.results.resolve() == sameness.REPOSITORY / "results":
                files.write_text(sameness.REPOSITORY / "README.md", front.front(options.results))
    print(f"the page is {page.write(options.results)}.")
    return 0


def _write_texts(folder: Path) -> None:
    """Writes the texts of a folder of results; if a user's code for them is missing, they stay."""
    try:
        document.write(folder)
    except InputError as error:
        if folder.name in experiment_names():
            raise
        print(f"{folder}: its texts stay as they are: {error}", file=sys.stderr)


def _write_chosen(analysis: SearchAnalysis, folder: Folder) -> None:
    """Writes the settings that a search has chosen beside its file, for experiments that name it."""
    experiment, trials = analysis.data.experiment, folder.manifest["files"].get("trials.csv", "")
    file, search = chosen_file(experiment.path), digest_of_search(experiment.declared)
    now = Choices(search=search, trials=trials, learners=dict(analysis.chosen))
    files.write_text(file, sealed(now.model_dump(mode="json"), indent=1))
    print(f"{experiment.name}: the chosen settings are in {file}.")


def other_seeds(experiment: Experiment, seeds: range | None) -> range | None:
    """Returns the given seeds, or None if they select exactly the declared runs."""
    return None if all(each.taken(seeds) == each.seeds for each in experiment.populations) else seeds


def folder_name(experiment: Experiment, seeds: range | None) -> str:
    """Returns the name of a report's folder; other seeds have one of their own."""
    if seeds is None:
        return experiment.name
    return f"{experiment.name}_seeds_{'-'.join(str(seed) for seed in dict.fromkeys((seeds[0], seeds[-1])))}"
