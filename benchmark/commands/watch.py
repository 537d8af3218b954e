"""Shows an agent learn: in a window, in the terminal, or as a file."""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from agents.policy import contains
from benchmark.analysis.population import load_population
from benchmark.commands import MOST_SEEDS
from benchmark.drawing import film as animation
from benchmark.drawing.film import Film
from benchmark.execution import driver as runner
from benchmark.execution.store import Store
from benchmark.experiments import (
    DEFAULT_CONDITION,
    Experiment,
    RunSpecification,
    load_experiment,
    specifications,
)
from envs import ZONES, InputError
from envs.inputs import unknown_name
from envs.model import PING
from envs.render import Window

FRAMES_PER_SECOND: Final = 12
_REST: Final = 6  # frames that the last moment of a walk is shown
_ARROWS: Final = "↑↓←→"
_BRACKETS: Final = {"outside": "  ", "target": "[]", "uncomfortable": "{}", "issuer": "  "}
_SIGNS: Final = """\
↑↓←→ greedy move   P greedy PING   + several   . all alike
[ ] target region   { } uncomfortable region
* issuer            @ agent"""


@dataclass(frozen=True)
class Moment:
    """What is shown at a time: a map of the agent, and how far it has walked."""

    place: int  # of the map
    way: list[int]  # cells, the agent in the last
    event: str


def specification(
    experiment: Experiment, scenario: str, arm: str, observation: str | None, seed: int
) -> RunSpecification:
    """Returns the run that is to be watched.

    Args:
      experiment: Of the run.
      scenario: One of its scenarios, by name.
      arm: One of its algorithms.
      observation: One of the arm's; its first by default.
      seed: Any, also one that the experiment does not declare.

    Raises:
      InputError: The experiment has no such run.
    """
    if arm not in experiment.algorithms:
        unknown_name(experiment.name, "algorithm", arm, experiment.algorithms)
    observations = experiment.algorithms[arm].observations
    if observation is None:
        observation = observations[0]
    if observation not in observations:
        unknown_name(f"{experiment.name}: {arm}", "observation", observation, observations)
    names = {Path(one).stem: one for one in experiment.scenarios}
    if scenario not in names:
        unknown_name(experiment.name, "scenario", scenario, names)
    return specifications(experiment, DEFAULT_CONDITION, names[scenario], arm, observation, [seed])[0]


def load_film(run: RunSpecification, store: Store) -> Film:
    """Returns a run's film, from its record, or trains it first and keeps it.

    Raises:
      InputError: Training failed.
    """
    title = f"{run.scenario.name}: {run.arm}, {run.observation}, seed {run.seed}"
    if runner.pending([run], store):
        print(f"training {title} ...", file=sys.stderr)
        errors = runner.run([run], store, jobs=1)
        if errors:
            raise InputError(f"{title}: training failed: {errors[0]}")
    return animation.film_of(title, load_population([run], store, fewest=1))


def moments(film: Film) -> Iterator[Moment]:
    """Yields what is to be shown: at every map the greedy policy's walk, cell by cell."""
    for place in range(len(film.steps)):
        way, event = animation.walk(film.model, film.greedy[place])
        for n in range(1, len(way)):
            yield Moment(place, way[:n], "")
        for _ in range(_REST):
            yield Moment(place, way, event)


def has_window() -> bool:
    """Returns whether a window can be shown: pygame-ce is there, and a screen."""
    has_screen = sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
    )
    return has_screen and find_spec("pygame") is not None


def in_window(film: Film) -> None:
    """Shows the film in a window until it is closed: space pauses, left and right change the map."""
    shown = list(moments(film))
    first = animation.picture(film, 0, shown[0].way, cell=40)
    window = Window(np.asarray(first), f"{film.title}   (space: pause, left and right: training, q: quit)")
    at, paused = 0, False
    try:
        if not window.has_screen:
            raise InputError("no window can be opened: there is no screen.")
        while True:
            for key in window.pressed():
                if key == "q":
                    return
                if key == "space":
                    paused = not paused
                elif key in ("left", "right"):
                    place = shown[at].place + (1 if key == "right" else -1)
                    at = next((i for i, one in enumerate(shown) if one.place == place), at)
            moment = shown[at]
            image = animation.picture(film, moment.place, moment.way, moment.event, cell=40)
            window.show(np.asarray(image), FRAMES_PER_SECOND)
            if not paused:
                at = min(at + 1, len(shown) - 1)  # the end stays until somebody goes
    finally:
        window.close()


def in_terminal(film: Film, console: Console) -> None:
    """Shows the film in the terminal; where it is none, the end of every map's walk."""
    if not console.is_terminal:
        last = {moment.place: moment for moment in moments(film)}
        for moment in last.values():
            console.print(to_text(film, moment))
        return
    console.print("Ctrl-C ends it.", style="dim")
    with suppress(KeyboardInterrupt), Live(console=console, auto_refresh=False) as live:
        for moment in moments(film):
            live.update(to_text(film, moment), refresh=True)
            time.sleep(1 / FRAMES_PER_SECOND)


def to_file(film: Film, path: Path) -> None:
    """Writes the film as an animated GIF or WebP, a frame a map.

    Raises:
      InputError: The name ends otherwise, or the file cannot be written.
    """
    frames = [
        animation.picture(film, place, *animation.walk(film.model, greedy), cell=32)
        for place, greedy in enumerate(film.greedy)
    ]
    try:
        animation.write(frames, path)
    except OSError as error:
        raise InputError(f"--save {path}: cannot be written: {error.strerror or error}.") from error


def to_text(film: Film, moment: Moment) -> Text:
    """Returns a moment as text: greedy actions, on the colour of the cell's best value."""
    grid = film.model.scenario.grid
    low, high = film.limits
    values = film.values[moment.place]
    best = np.nan_to_num(values, nan=low).max(axis=1)
    colours = (mpl.colormaps["cividis"](np.clip((best - low) / (high - low), 0, 1))[:, :3] * 255).astype(int)
    colours[np.isnan(values).any(axis=1)] = 255  # the net has diverged
    greedy = contains(film.greedy[moment.place])
    over = np.all(film.model.terminated[: len(values)], axis=1)
    text = Text(f"{film.title}\n")
    text.append(f"step {film.steps[moment.place]:,}, score {film.scores[moment.place]:.2f}  ")
    text.append(f"{animation.SAID.get(moment.event, '')}\n")
    for o in range(len(values)):
        members = np.flatnonzero(greedy[o])
        sign = (
            "."
            if greedy[o].all()
            else "+"
            if len(members) > 1
            else "P"
            if members[0] == PING
            else _ARROWS[members[0]]
        )
        if over[o]:
            sign = "*"
        if o == moment.way[-1]:
            sign = "@"
        brackets = _BRACKETS[ZONES[film.model.zone_of_cell[o]]]
        red, green, blue = colours[o].tolist()
        ink = "rgb(0,0,0)" if red + green + blue > 330 else "rgb(255,255,255)"
        style = f"{'bold ' if o == moment.way[-1] else ''}{ink} on rgb({red},{green},{blue})"
        text.append(f"{brackets[0]}{sign}{brackets[1]}", style=style)
        if (o + 1) % grid.columns == 0:
            text.append("\n")
    text.append(_SIGNS, style="dim")
    return text


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    experiment = load_experiment(options.experiment)
    if not options.seed.isdecimal() or int(options.seed) >= MOST_SEEDS:
        raise InputError(f"--seed {options.seed}: accepted: a whole number from 0 to {MOST_SEEDS - 1:,}.")
    if options.save is not None and options.save.suffix.lower() not in (".webp", ".gif"):
        raise InputError(f"--save {options.save}: accepted: a name that ends in .webp or .gif.")
    if options.save is not None and not options.save.parent.is_dir():
        raise InputError(f"--save {options.save}: there is no folder {options.save.parent}.")
    run = specification(
        experiment, options.scenario, options.algorithm, options.observation, int(options.seed)
    )
    with Store(options.results / "runs.db") as store:
        film = load_film(run, store)
    if options.save is not None:
        to_file(film, options.save)
        print(f"{film.title}: {options.save}")
        return 0
    if has_window() and not options.terminal:
        try:
            in_window(film)
        except InputError as error:
            print(f"{error} The terminal is used instead.", file=sys.stderr)
        else:
            return 0
    in_terminal(film, Console())
    return 0
