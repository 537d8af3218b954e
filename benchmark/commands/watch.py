"""Shows how an agent learns: in a window, or as a file."""

import argparse
import sys
from contextlib import suppress
from typing import Final

from matplotlib import pyplot as plt
from matplotlib.animation import FuncAnimation

from benchmark.analysis.records import load_records
from benchmark.commands import find_run
from benchmark.drawing.film import ANIMATIONS, FRAME_MS, Film, Screen, film_of, learning, write
from benchmark.drawing.style import check_file, settings
from benchmark.execution.driver import pending, run
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, RunSpecification, load_experiment
from envs import InputError

_WINDOWS: Final = ("macosx", "qtagg", "gtk4agg", "gtk3agg", "tkagg", "wxagg")  # backends of matplotlib


def load_film(watched: RunSpecification, store: Store, learner: str) -> Film:
    """Returns the film of a run of this learner; a missing run is trained and stored."""
    title = f"{watched.scenario.name}: {learner}, seed {watched.seed}"
    store.discard_damaged([watched.digest])
    if pending([watched], store):
        print(f"training {title} ...", file=sys.stderr)
        if errors := run([watched], store, jobs=1):
            raise InputError(f"{title}: training failed: {errors[0]}")
    return film_of(title, load_records([watched], store))


def has_window() -> bool:
    """Returns whether matplotlib can open windows here, and makes it do so."""
    for backend in _WINDOWS:
        with suppress(ImportError):  # no screen, or a package is not installed
            plt.switch_backend(backend)
            return True
    return False


def in_window(film: Film) -> None:
    """Plays the film once in a window, until the reader closes it."""
    screen = Screen(film, plt.figure)
    # The animation is kept, or it would not be played.
    kept = FuncAnimation(screen.figure, screen.show, film.steps, interval=FRAME_MS, repeat=False)
    with settings():  # a window draws its figure again when it changes
        plt.show()
    del kept


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    experiment = load_experiment(options.experiment)
    if options.save is not None:
        check_file(options.save, *ANIMATIONS)
    if DEFAULT_CONDITION not in experiment.conditions or experiment.declared.solved is not None:
        accepted = "an experiment without grids, search or solved"
        raise InputError(f"{experiment.name}: its runs cannot be watched; accepted: {accepted}.")
    learner = ", ".join(filter(None, [options.learner, options.observation]))
    watched = find_run(experiment, learner, options.seed, options.scenario, DEFAULT_CONDITION)
    if options.save is None and not has_window():
        raise InputError("watch: no window can be opened here; accepted: --save FILE.")
    title = experiment.learners[f"{watched.variant}, {watched.observation}"].title
    with Store(options.results / "runs.db") as store:
        film = load_film(watched, store, title)
    if options.save is None:
        in_window(film)
    else:
        write(learning(film), options.save)
        print(f"{film.title}: {options.save}")
    return 0
