"""Draws how an agent learns: what it values and does, and where it walks, one frame per moment of training.

A cell's four triangles are the values of its moves, the disc in its middle is that of PING, and the line is
the greedy policy's walk from the start. Cells are hatched where the agent has learned nothing, so that all
actions are equally good, or where it has diverged.
"""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from agents.policy import contains
from benchmark.analysis.records import Records
from benchmark.analysis.walk import CIRCLE, HORIZON, Walk, walk
from benchmark.drawing.maps import RGB, Style, add_area, arrowheads, colour_bar, discs, dots, triangles
from benchmark.drawing.style import figure_of, settings
from envs import ACTIONS, Model
from envs.regions import outlines
from envs.scene import colour_limits, scene_of

ENDINGS: Final = {
    "target_ping": "success",
    "issuer_reached": "ran into the person",
    "last_wrong_ping": "too many wrong PINGs",
    CIRCLE: "goes in circles",
    HORIZON: "step limit reached",
}
ANIMATIONS: Final = (".webp", ".gif")  # endings of files
_DPI: Final = 100
_CELL: Final = 0.34  # inches
_LONGEST_SIDE: Final = 20  # inches, of a map
_NARROWEST, _LOWEST, _GAP, _BAR = 2.6, 0.5, 0.1, 0.7  # inches: sizes of a map, gap, width of a colour bar
_TITLE, _LINE, _CHARACTERS = 8, 0.14, 15  # size in points, inches of a line, characters in an inch
FRAME_MS, _LAST_MS = 350, 2500  # for which a frame is shown, and the last
_UNKNOWN: Final[Style] = {"fc": RGB["no value"], "ec": RGB["line"], "lw": 0, "hatch": "//"}
_OUTLINED: Final = [patheffects.withStroke(linewidth=2.8, foreground="white")]
_PATH: Final[Style] = {"color": RGB["path"], "lw": 1.5, "path_effects": _OUTLINED, "zorder": 1.6}
_AGENT: Final[Style] = {"color": RGB["path"], "marker": "o", "ms": 8, "mec": "white", "mew": 1, "zorder": 1.7}


@dataclass(frozen=True, eq=False)
class Film:
    """One agent over its training: V maps of O observations."""

    title: str
    model: Model
    steps: Sequence[int]  # (V,)
    values: NDArray[np.float64]  # (V, O, A) action values, or probabilities; NaN of an agent that diverged
    greedy: NDArray[np.uint8]  # (V, O) masks
    scores: NDArray[np.float64]  # (V,)
    walks: Sequence[Walk]  # (V,) of the greedy policy


def film_of(title: str, records: Records) -> Film:
    """Returns the film of the first of these agents."""
    model, indices, arrays = records.model, records.map_indices, records.agents[0]
    n_starts = len(model.starts)
    return Film(
        title=title if n_starts == 1 else f"{title}, first of {n_starts} starts",
        model=model,
        steps=np.array(records.evaluation_steps)[indices].tolist(),
        values=arrays["values"].astype(np.float64),
        greedy=arrays["greedy"][indices],
        scores=records.unbounded_scores()[0, indices],
        walks=[walk(model, masks, records.run.horizon) for masks in arrays["greedy"][indices]],
    )


class Screen:
    """A figure on which a film is shown."""

    def __init__(self, film: Film, new: Callable[..., Figure] = Figure) -> None:
        self.film, grid = film, film.model.scenario.grid
        cell = min(_CELL, _LONGEST_SIDE / max(grid.rows, grid.columns))
        width, height = max(cell * grid.columns, _NARROWEST) + _GAP, max(cell * grid.rows, _LOWEST) + _GAP
        self._title = fill(film.title, int(width * _CHARACTERS))
        height += (self._title.count("\n") + 3) * _LINE
        with figure_of(1, 1, (width + _BAR, height), new) as (self.figure, axes):
            self.figure.set_dpi(_DPI)
            self._axis, self._norm = axes[0, 0], Normalize(*colour_limits(film.values.ravel()))
            colour_bar(self.figure, [self._axis], self._norm, "value", extend="both")
            self.show(0)
            self.figure.draw_without_rendering()
            self.figure.set_layout_engine("none")  # a layout takes longer than a frame

    def show(self, step: int) -> None:
        """Shows the last map that is not later than a step."""
        index = int(np.searchsorted(self.film.steps, step, side="right")) - 1
        with settings():
            _draw(self._axis, self.film, index, self._norm, self._title)

    def image(self, step: int) -> Image.Image:
        """Shows a step, and returns the figure as an image."""
        self.show(step)
        buffer = io.BytesIO()
        with settings():
            self.figure.savefig(buffer, format="rgba", dpi="figure")
        size = self.figure.canvas.get_width_height()
        return Image.frombytes("RGBA", size, buffer.getvalue()).convert("RGB")


def _draw(axis: Axes, film: Film, index: int, norm: Normalize, title: str) -> None:
    model, walked = film.model, film.walks[index]
    agent, state = walked.cells[-1], walked.states[-1]
    # The map shows the states that differ from the walk's last one by the agent's cell alone.
    first = state - int(model.cell[state])
    observed = model.observation[first : first + len(model.position)]
    scene = scene_of(model, int(model.context[state]))
    values, greedy = film.values[index, observed], contains(film.greedy[index, observed])
    # Values alone do not tell, since they are rounded.
    is_unvisited = (values == values[:, :1]).all(axis=1) & greedy.all(axis=1)
    is_unknown = is_unvisited | np.isnan(values).any(axis=1)
    # All actions are greedy mostly where the agent has never been.
    is_marked = greedy & ~greedy.all(axis=1, keepdims=True) & (np.arange(scene.n_cells) != agent)[:, None]
    cell = np.flatnonzero(~is_unknown & ~scene.is_over)
    frame = pd.DataFrame(scene.position[cell.repeat(len(ACTIONS))], columns=["row", "column"])
    frame["action"] = np.tile(ACTIONS, len(cell))
    frame["value"], frame["is_marked"] = values[cell].ravel(), is_marked[cell].ravel()
    is_ping = frame["action"] == "PING"
    axis.clear()
    axis.set_facecolor(RGB["over"])
    add_area(axis, outlines((is_unknown & ~scene.is_over).reshape(scene.rows, -1)), _UNKNOWN)
    triangles(axis, scene, frame[~is_ping], norm, "value")
    discs(axis, frame[is_ping], norm, "value")
    arrowheads(axis, frame[~is_ping & frame["is_marked"]])
    dots(axis, frame[is_ping & frame["is_marked"]])
    axis.plot(*scene.position[[*walked.cells]].T[::-1], **_PATH)
    axis.plot(*scene.position[[agent]].T[::-1], **_AGENT)
    diverged = "diverged   " if np.isnan(values).any() else ""
    numbers = f"step {film.steps[index]:,}   {diverged}score {film.scores[index]:.2f}"
    text = f"{title}\n{numbers}\n{ENDINGS[walked.ending]}"
    axis.set_title(text, loc="left", size=_TITLE, parse_math=False)
    axis.set(xticks=[], yticks=[], xlabel="", ylabel="")


def learning(film: Film) -> list[Image.Image]:
    """Draws an agent at every step at which it has a map."""
    screen = Screen(film)
    return [screen.image(step) for step in film.steps]


def write(frames: Sequence[Image.Image], path: Path) -> None:
    """Writes an animated WebP or GIF that repeats; a WebP is a quarter of the size and has all colours."""
    duration = [FRAME_MS] * (len(frames) - 1) + [_LAST_MS]
    frames[0].save(path, save_all=True, append_images=frames[1:], loop=0, quality=70, duration=duration)
