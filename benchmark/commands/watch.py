"""Makes a film of how an agent learns."""

import argparse
import sys

from benchmark.analysis.records import load_records
from benchmark.commands import find_run
from benchmark.drawing.film import ANIMATIONS, Film, film_of, write
from benchmark.drawing.style import check_file
from benchmark.execution.driver import pending, run
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, RunSpecification, load_experiment
from envs import InputError


def load_film(watched: RunSpecification, store: Store, learner: str) -> Film:
    """Returns the film of a run of this learner; a missing run is trained and stored."""
    title = f"{watched.scenario.name}: {learner}, seed {watched.seed}"
    store.discard_damaged([watched.digest])
    if pending([watched], store):
        print(f"training {title} ...", file=sys.stderr)
        if errors := run([watched], store, jobs=1):
            raise InputError(f"{title}: training failed: {errors[0]}")
    return film_of(title, load_records([watched], store))


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    experiment = load_experiment(options.experiment)
    check_file(options.save, *ANIMATIONS)
    if DEFAULT_CONDITION not in experiment.declared.conditions or experiment.declared.solved is not None:
        accepted = "an experiment without grids, search or solved"
        raise InputError(f"{experiment.name}: its runs cannot be watched; accepted: {accepted}.")
    learner = ", ".join(filter(None, [options.learner, options.observation]))
    watched = find_run(experiment, learner, options.seed, options.scenario, DEFAULT_CONDITION)
    title = experiment.learners[f"{watched.variant}, {watched.observation}"].title
    with Store(options.results / "runs.db") as store:
        film = load_film(watched, store, title)
    write(film, options.save)
    print(f"{film.title}: {options.save}")
    return 0
