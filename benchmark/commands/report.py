"""Draws an experiment's tables and figures from its stored runs, and builds the page."""

import argparse

from benchmark.commands import parse_jobs, parse_seeds, seeds_text
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, load_experiment
from benchmark.page import build as page
from benchmark.reports import draw, load_items, load_report
from envs import InputError


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    if options.experiment is None:
        if options.partial or options.seeds is not None:
            raise InputError("--partial, --seeds: accepted only together with an experiment.")
        print(f"the page is {page.write(options.results)}.")
        return 0
    experiment = load_experiment(options.experiment)
    check(experiment, is_required=True)
    seeds = other_seeds(experiment, parse_seeds(options.seeds))
    directory = options.results / folder_name(experiment, seeds, partial=options.partial)
    # With --cluster, --jobs says nothing about this machine.
    jobs = None if getattr(options, "cluster", None) else getattr(options, "jobs", None)
    with Store(options.results / "runs.db", read_only=True) as store:
        made = draw.draw(
            experiment,
            store,
            directory,
            seeds,
            partial=options.partial,
            jobs=parse_jobs(jobs),
        )
    print(f"{experiment.name}: tables and figures are in {directory}{'' if made.is_new else ', up to date'}.")
    is_published = made.certificate is not None and made.certificate.is_identical
    updated = page.update(options.results, directory.name, is_published=is_published)
    print(f"{experiment.name}: the page is {updated}.")
    if made.certificate is not None:
        print(made.certificate)
    return 0


def other_seeds(experiment: Experiment, seeds: range | None) -> range | None:
    """Returns the given seeds; None if every arm declares just these under every condition."""
    declared = {
        experiment.declared_seeds(arm, condition)
        for arm in experiment.algorithms
        for condition in experiment.conditions
    }
    return None if declared == {seeds} else seeds


def folder_name(experiment: Experiment, seeds: range | None, *, partial: bool) -> str:
    """Returns the name of the folder that a report is drawn into.

    Args:
      experiment: As loaded.
      seeds: Other seeds than the declared ones; they have a folder of their own.
      partial: Whether runs may be missing; such a report has a folder of its own, too.
    """
    chosen = f"_seeds_{seeds_text(seeds)}" if seeds is not None else ""
    return f"{experiment.name}{chosen}{'_partial' if partial else ''}"


def check(experiment: Experiment, *, is_required: bool) -> None:
    """Checks that an experiment's report can be drawn of it.

    Args:
      experiment: As loaded.
      is_required: Whether it must have a report.

    Raises:
      InputError: It has none although it must, or its report asks for something else, lacks a package that it
        needs, or has an item that cannot be used.
    """
    if experiment.report:
        report = load_report(experiment.report, experiment.argument)
        report.check(experiment)
        load_items(report, experiment.items, experiment.argument)
        if is_required:
            draw.check_packages(report, experiment.name)
    elif is_required:
        raise InputError(f"{experiment.argument}: there is no key report; accepted: an experiment with one.")
