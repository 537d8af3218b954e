"""The command `watch`: a film of how an agent learns, one frame per moment of training.

A cell's colour is the value of its best action, which is marked, and the line is the greedy
policy's walk from the start. Where the agent has learned nothing, no action is marked.
"""

import argparse
import sys
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib import patheffects
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from agents.policy import contains
from benchmark.experiment import load_experiment
from benchmark.export import find_run
from benchmark.folder import damaged
from benchmark.records import Records, load_records
from benchmark.run import execute, pending
from benchmark.scenes import RGB, Style, colour_bar, heat, mark
from benchmark.store import Store
from benchmark.style import check_file, figure_of, settings
from envs import EVENTS, InputError, Model
from envs.scene import colour_limits, scene_of

CIRCLE = "goes in circles"
HORIZON = "step limit reached"
ENDINGS = {
    "target_ping": "success",
    "issuer_reached": "ran into the person",
    "last_wrong_ping": "too many wrong PINGs",
}
ANIMATIONS = (".webp", ".gif")  # endings of files
_DPI = 100
_CELL = 0.34  # inches
_MAX_SIDE = 20  # inches, of a map
_FPS = 3
_OUTLINED = [patheffects.withStroke(linewidth=2.8, foreground="white")]
_PATH: Style = {"color": RGB["path"], "lw": 1.5, "path_effects": _OUTLINED, "zorder": 1.6}
_AGENT: Style = {"color": RGB["path"], "ms": 8, "mec": "white", "mew": 1, "zorder": 1.7}


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    experiment = load_experiment(options.experiment)
    check_file(options.save, *ANIMATIONS)
    if experiment.declared.solved is not None:
        accepted = "an experiment without grids, search or solved"
        raise InputError(f"{experiment.name}: its runs cannot be watched; accepted: {accepted}.")
    learner = ", ".join(filter(None, [options.learner, options.observation]))
    watched, title = find_run(experiment, learner, options.seed, options.scenario)
    with Store(options.results / "runs.db") as store:
        store.discard_damaged([watched.digest])
        if pending([watched], store):
            print(f"training {title} ...", file=sys.stderr)
            if errors := execute([watched], store, jobs=1):
                raise InputError(f"{title}: training failed: {errors[0]}")
        with damaged(options.results / "runs.db"):
            write(title, load_records([watched], store), options.save)
    print(f"{title}: {options.save}")
    return 0


def walk(model: Model, greedy: NDArray[np.uint8], horizon: int) -> tuple[list[int], str]:
    """Walks from the first start by a greedy policy, (O,) masks; returns its states and its end.

    Of several greedy actions the agent takes the first, of several outcomes the likeliest happens.
    So a walk that returns to a state would go in circles; it ends there.
    """
    actions, states = contains(greedy).argmax(axis=1), [model.start]
    while True:
        state = states[-1]
        action = actions[model.observation[state]]
        outcome = model.probability[state, action].argmax()
        states.append(int(model.next_state[state, action, outcome]))
        if model.terminated[state, action]:
            return states, ENDINGS[EVENTS[model.event[state, action]]]
        if states[-1] in states[:-1]:
            return states, CIRCLE
        if len(states) > horizon:
            return states, HORIZON


def write(title: str, records: Records, path: Path) -> None:
    """Writes the film of the first agent, an animated WebP or GIF that repeats.

    A WebP is smaller and has all colours.
    """
    grid, n_maps = records.model.scenario.grid, len(records.map_indices)
    cell = min(_CELL, _MAX_SIDE / max(grid.rows, grid.columns))
    size = max(cell * grid.columns, 3) + 1, cell * grid.rows + 1
    norm = Normalize(*colour_limits(records.agents[0]["values"].astype(float).ravel()))
    with figure_of(1, 1, size) as (figure, axes):
        frame = partial(draw, axes[0, 0], title, records, norm)
        is_value = not len(records.agents[0]["stochastic"])
        label = "value of the best action" if is_value else "probability of the likeliest action"
        colour_bar(figure, [axes[0, 0]], norm, label, extend="both")
        frame(0)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # a layout takes longer than a frame
    with settings():
        order = [*range(n_maps), *[n_maps - 1] * _FPS]  # the last one is shown longer
        FuncAnimation(figure, frame, order).save(path, PillowWriter(_FPS), dpi=_DPI)


def draw(axis: Axes, title: str, records: Records, norm: Normalize, index: int) -> None:
    """Draws one map of the first agent, and its walk."""
    model, point = records.model, records.map_indices[index]
    masks = records.agents[0]["greedy"][point]
    states, ending = walk(model, masks, records.run.horizon)
    path = model.cell[states]
    # The map shows the states that differ from the walk's last one by the agent's cell alone.
    first = states[-1] - path[-1]
    observed = model.observation[first : first + len(model.position)]
    scene = scene_of(model, int(model.context[states[-1]]))
    values = records.agents[0]["values"][index, observed].max(axis=1).astype(float)
    greedy = contains(masks[observed])
    # All actions are greedy mostly where the agent has never been.
    is_marked = greedy & ~greedy.all(axis=1, keepdims=True)
    is_marked[path[-1]] = False
    axis.clear()
    heat(axis, scene, np.where(scene.is_over, np.nan, values), norm)
    mark(axis, scene, is_marked)
    rows, columns = scene.position[path].T
    axis.plot(columns, rows, **_PATH)
    axis.plot(columns[-1:], rows[-1:], "o", **_AGENT)
    score = records.unbounded_scores()[0, point]
    text = f"step {records.evaluation_steps[point]:,}, score {score:.2f}: {ending}"
    axis.set_title(f"{title}\n{text}", loc="left", size="small", wrap=True, parse_math=False)
    axis.set(xticks=[], yticks=[], xlabel="", ylabel="")
