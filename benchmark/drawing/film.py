"""Paints how agents learn: what they value and do, and where they walk, one frame per moment of training.

A cell's four triangles are the values of its moves, the disc in its middle is that of PING, and the line is
the greedy policy's walk from the start. Cells are hatched where the agent has learned nothing: all actions
are equally good.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from textwrap import wrap
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib import pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Colormap, Normalize
from numpy.typing import NDArray
from PIL import Image

from agents.policy import contains
from benchmark.analysis.population import Population
from benchmark.analysis.walk import CIRCLE, HORIZON, Walk, walk
from benchmark.drawing.maps import (
    RGB,
    Style,
    add_area,
    arrowheads,
    colour_bar,
    colour_map,
    dots,
    triangles,
)
from benchmark.drawing.style import check_file, figure_of
from envs import ACTIONS, Model
from envs.model import PING
from envs.regions import outlines
from envs.scene import Scene, cell_map, colour_limits, scene_of

ENDINGS: Final = {
    "target_ping": "success",
    "issuer_reached": "ran into the issuer",
    "last_wrong_ping": "too many wrong PINGs",
    CIRCLE: "goes in circles",
    HORIZON: "step limit reached",
}
ANIMATIONS: Final = (".webp", ".gif")  # endings of files
_DPI: Final = 100
_CELL, _LARGE_CELL = 0.21, 0.34  # inches, of the cells of several films, and of one
_LARGEST_MAP: Final = 150  # square inches: cells of larger rooms are smaller
_LONGEST_SIDE: Final = 80  # inches, of a map
_NARROWEST: Final = 2.6  # inches, of the texts above a map
_TITLE, _LINE, _CHARACTERS = 8, 0.14, 15  # size in points, inches of a line, characters in an inch
_MOST_WEBP: Final = 16_383  # pixels of a side
_FRAME_MS, _LAST_MS = 350, 2500  # for which a frame is shown, and the last
_UNVISITED: Final[Style] = {"fc": RGB["no value"], "ec": RGB["line"], "lw": 0, "hatch": "//", "zorder": 0.8}
_OUTLINED: Final = [patheffects.withStroke(linewidth=2.8, foreground="white")]
_PATH: Final[Style] = {"color": RGB["path"], "lw": 1.5, "path_effects": _OUTLINED, "zorder": 1.6}
_AGENT: Final[Style] = {"color": RGB["path"], "marker": "o", "ms": 8, "mec": "white", "mew": 1, "zorder": 1.7}


@dataclass(frozen=True, eq=False)
class Film:
    """One agent over its training: V maps of O cells.

    Where one map does not show all, it holds O observations, and `seen` returns the film of the cells with
    the issuer in one position and phase.
    """

    title: str
    scene: Scene
    steps: Sequence[int]  # (V,)
    values: NDArray[np.float64]  # (V, O, A) action values, or probabilities; NaN of an agent that diverged
    greedy: NDArray[np.uint8]  # (V, O) masks
    scores: NDArray[np.float64]  # (V,)
    walks: Sequence[Walk]  # (V,) of the greedy policy
    scale: tuple[float, float] | None = None  # the ends of a colour scale that films share
    model: Model | None = None  # unless one map shows it all, see `Model.has_cell_maps` and `cell_map`

    @cached_property
    def limits(self) -> tuple[float, float]:
        """The ends of the colour scale, the same for all maps."""
        return self.scale or colour_limits(self.values)

    @property
    def norm(self) -> Normalize:
        """The colour scale."""
        return Normalize(*self.limits)

    @property
    def colours(self) -> Colormap:
        """The colours of the values; NaN has one, too."""
        return mpl.colormaps[colour_map(self.norm)].with_extremes(bad=RGB["no value"])

    def is_unvisited(self, index: int) -> NDArray[np.bool_]:
        """Returns in which cells of a map, (O,), all actions are equally good: the agent was never there."""
        values = self.values[index]
        # Values are rounded, greedy actions were chosen before.
        return np.asarray((values == values[:, :1]).all(axis=1) & contains(self.greedy[index]).all(axis=1))

    def seen(self, moment: "Moment") -> "Film":
        """Returns the film with the issuer where it is at a moment, in the same phase."""
        if self.model is None:
            return self
        # The states that differ from the agent's by the cell alone.
        first = moment.state - int(self.model.cell[moment.state])
        observed = self.model.observation[first : first + len(self.model.position)]
        context = int(self.model.context[moment.state])
        return replace(
            self,
            scene=scene_of(self.model, context),
            values=self.values[:, observed],
            greedy=self.greedy[:, observed],
            scale=self.limits,
            model=None,
        )

    def end_at(self, step: int) -> "Moment":
        """Returns the end of the walk at the last map that is not later than a step."""
        return end_of(self, int(np.searchsorted(self.steps, step, side="right")) - 1)


@dataclass(frozen=True)
class Moment:
    """What a frame shows: a map, and how far the agent has walked."""

    index: int  # of the map
    cells: tuple[int, ...]  # visited so far; the agent stands in the last
    ending: str = ""  # how the walk ended, see `Walk`, if it has
    state: int = 0  # the last one, which says where the issuer stands and in which phase


def film_of(title: str, population: Population, agent: int = 0) -> Film:
    """Returns the film of one agent of a population."""
    model, indices = population.model, population.map_indices
    arrays = population.agents[agent]
    values, greedy = arrays["values"].astype(np.float64), arrays["greedy"][indices]
    walks = [walk(model, masks, population.horizon) for masks in greedy]
    n_starts = len(model.starts)
    _, scene, observed = cell_map(model)
    is_egocentric = scene.origin is not None
    if is_egocentric:
        cell = observed.argsort()[model.observation]  # (S,) on the map
        values, greedy = values[:, observed], greedy[:, observed]
        walks = [replace(walked, cells=tuple(cell[[*walked.states]].tolist())) for walked in walks]
    return Film(
        title=title if n_starts == 1 else f"{title}, first of {n_starts} starts",
        scene=scene,
        steps=np.array(population.evaluation_steps)[indices].tolist(),
        values=values,
        greedy=greedy,
        scores=population.unbounded_scores[agent, indices],
        walks=walks,
        model=None if model.has_cell_maps or is_egocentric else model,
    )


def end_of(film: Film, index: int) -> Moment:
    """Returns the end of the walk at a map."""
    walked = film.walks[index]
    return Moment(index, walked.cells, walked.ending, walked.states[-1])


class Screen:
    """A figure on which films are shown side by side; those of a row share a colour scale.

    The cells of a single film are larger, and have an arrow head for every greedy move.
    """

    def __init__(self, films: Sequence[Sequence[Film]]) -> None:
        """Makes the figure, without any moment. If a WebP cannot be so wide, the last films are left out."""
        has_arrows = sum(map(len, films)) == 1
        rows, columns = np.max([(film.scene.rows, film.scene.columns) for row in films for film in row], 0)
        cell = min(
            _LARGE_CELL if has_arrows else _CELL,
            (_LARGEST_MAP / (rows * columns)) ** 0.5,
            _LONGEST_SIDE / max(rows, columns),
        )
        panel = max(cell * columns, _NARROWEST)
        films = [row[: max(int(_MOST_WEBP / _DPI / (panel + 0.1)) - 1, 1)] for row in films]
        n_characters = int(panel * _CHARACTERS)
        n_lines = max(len(wrap(film.title, n_characters)) for row in films for film in row) + 2
        n_columns = max(map(len, films))
        size = (panel + 0.1) * n_columns + 0.7, (cell * rows + _LINE * n_lines + 0.2) * len(films)
        self.panels: list[_Panel] = []
        with figure_of(len(films), n_columns, size) as (self.figure, axes):
            self.figure.set_dpi(_DPI)
            for row, row_axes in zip(films, axes, strict=True):
                scale = colour_limits(np.concatenate([film.values.ravel() for film in row]))
                row = [replace(film, scale=scale) for film in row]
                colour_bar(self.figure, row_axes, row[0].norm, "value", extend="both")
                for axis in row_axes[len(row) :]:
                    axis.set_axis_off()
                for axis, film in zip(row_axes, row, strict=False):
                    title = "\n".join(wrap(film.title, n_characters))
                    self.panels.append(_Panel(axis, replace(film, title=title), has_arrows=has_arrows))
            self.show([end_of(panel.film, 0) for panel in self.panels])
            self.figure.draw_without_rendering()
            self.figure.set_layout_engine("none")  # a layout takes longer than a frame

    def show(self, moments: Sequence[Moment]) -> None:
        """Shows a moment of every film."""
        for panel, moment in zip(self.panels, moments, strict=True):
            panel.show(moment)

    def image(self) -> Image.Image:
        """Returns the figure as an image."""
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="rgba", dpi=_DPI)
        size = round(self.figure.bbox.width), round(self.figure.bbox.height)
        return Image.frombytes("RGBA", size, buffer.getvalue()).convert("RGB")


def learning(films: Sequence[Sequence[Film]]) -> list[Image.Image]:
    """Draws agents side by side, at every step at which one of them has a map."""
    screen = Screen(films)
    frames = []
    for step in sorted({step for row in films for film in row for step in film.steps}):
        screen.show([panel.film.end_at(step) for panel in screen.panels])
        frames.append(screen.image())
    plt.close(screen.figure)
    return frames


def write(frames: Sequence[Image.Image], path: Path) -> None:
    """Writes an animated WebP or GIF that repeats; a WebP is a quarter of the size and has all colours.

    Raises:
      InputError: The file name has another ending, or there is no such folder.
      OSError: The file cannot be written.
    """
    check_file(path, *ANIMATIONS)
    frames[0].save(
        path,
        path.suffix.lower().removeprefix("."),
        save_all=True,
        append_images=frames[1:],
        loop=0,
        quality=70,
        duration=[_FRAME_MS] * (len(frames) - 1) + [_LAST_MS],
    )


class _Panel:
    """The map of one film."""

    def __init__(self, axis: Axes, film: Film, *, has_arrows: bool) -> None:
        self.film = film
        self._axis, self._has_arrows = axis, has_arrows
        self._scene: Scene | None = None
        self._marks: list[Artist] = []  # of the moment that is shown

    def show(self, moment: Moment) -> None:
        film, index = self.film.seen(moment), moment.index
        if film.scene is not self._scene:
            self._draw(film.scene)
        values, greedy = film.values[index], contains(film.greedy[index])
        self._moves.set_array(values[self._cells, :PING].ravel())
        self._pings.set_array(values[self._cells, PING])
        is_unvisited = film.is_unvisited(index) & ~film.scene.is_over
        # All actions are greedy mostly where the agent has never been; marks would say nothing.
        is_marked = greedy & ~greedy.all(axis=1, keepdims=True) & ~film.scene.is_over[:, None]
        chosen = _cells(film.scene, *np.nonzero(is_marked))
        is_ping = chosen["action"] == "PING"
        pings = dots(self._axis, chosen[is_ping])
        pings.set_zorder(1.5)  # below the path, which is below person and start
        for mark in self._marks:
            mark.remove()
        self._marks = [
            *add_area(self._axis, outlines(is_unvisited.reshape(film.scene.rows, -1)), _UNVISITED),
            *([arrowheads(self._axis, chosen[~is_ping])] if self._has_arrows else []),
            pings,
            *self._axis.plot(*film.scene.position[[*moment.cells]].T[::-1], **_PATH),
            *self._axis.plot(*film.scene.position[moment.cells[-1:]].T[::-1], **_AGENT),
        ]
        diverged = "diverged   " if np.isnan(film.values[index]).any() else ""
        state = f"step {film.steps[index]:,}   {diverged}score {film.scores[index]:.2f}"
        text = f"{film.title}\n{state}\n{ENDINGS.get(moment.ending, '')}"
        self._axis.set_title(text, loc="left", size=_TITLE, parse_math=False)

    def _draw(self, scene: Scene) -> None:
        """Draws what stays the same as long as the scene does."""
        self._axis.clear()
        self._marks, self._scene = [], scene
        self._cells = np.flatnonzero(~scene.is_over)
        moves = _cells(scene, np.repeat(self._cells, PING), np.tile(np.arange(PING), len(self._cells)))
        self._moves = triangles(self._axis, scene, moves.assign(value=0.0), self.film.norm, "value")
        self._moves.set(cmap=self.film.colours, zorder=0.5)
        self._pings = EllipseCollection(
            [0.4],
            [0.4],
            [0.0],
            units="xy",
            offsets=scene.position[self._cells][:, ::-1],
            offset_transform=self._axis.transData,
            norm=self.film.norm,
            cmap=self.film.colours,
            edgecolors=[RGB["line"]],
            linewidths=0.4,
            zorder=0.6,
        )
        self._axis.add_collection(self._pings)
        self._axis.set(facecolor=RGB["over"], xticks=[], yticks=[], xlabel="", ylabel="")


def _cells(scene: Scene, cell: NDArray[np.intp], action: NDArray[np.intp]) -> pd.DataFrame:
    """Returns cells and actions as `maps` draws them."""
    row, column = np.divmod(cell, scene.columns)
    return pd.DataFrame({"row": row, "column": column, "action": np.array(ACTIONS)[action]})
