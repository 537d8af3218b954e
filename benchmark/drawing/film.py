"""Paints with Pillow what an agent values, does and where it walks: one image per moment of its training.

The maps resemble matplotlib's, but are drawn fast enough to be played. A cell's four triangles are its moves,
the disc in its middle is PING, and the line is the greedy policy's walk from the start. A hatched cell is one
of which the agent has learned nothing: all its actions are equally good.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from agents.policy import contains
from benchmark.analysis.population import Population
from benchmark.analysis.walk import CIRCLE, HORIZON, Walk, walk
from benchmark.drawing.style import check_file
from envs import Model
from envs.model import PING
from envs.regions import Loop
from envs.scene import (
    ARROWHEADS,
    COLOUR_MAP,
    COLOURS,
    TRIANGLES,
    Colour,
    Scene,
    cell_map,
    colour_limits,
    inset,
    scene_of,
)

ENDINGS: Final = {
    "target_ping": "success",
    "issuer_reached": "ran into the issuer",
    "last_wrong_ping": "too many wrong PINGs",
    CIRCLE: "goes in circles",
    HORIZON: "step limit reached",
}
ANIMATIONS: Final = (".webp", ".gif")  # endings of files
_SCALE: Final = 2  # images are drawn this much larger and then reduced, for smooth edges
_WHITE: Final = (255, 255, 255)
_BLACK: Final = (0, 0, 0)
_MOST_PIXELS: Final = 1_500_000  # of a map: the cells of large rooms are smaller
_LONGEST_SIDE: Final = 8000  # pixels
_MOST_WEBP: Final = 16_383  # pixels of a side
_FRAME_MS, _LAST_MS = 350, 2500  # for which a frame is shown, and the last
# (row, column) from a cell's centre, in cells
_CENTRE: Final = np.zeros((1, 2))
_SQUARE: Final = np.array([(-0.5, -0.5), (0.5, 0.5)])
_STROKES: Final = np.array([[(0, -0.5), (-0.5, 0)], [(0.5, 0), (0, 0.5)]])
_TURNS: Final = np.arange(10) * np.pi / 5
_STAR: Final = np.where(np.arange(10) % 2, 0.16, 0.38)[:, None] * np.stack(
    [-np.cos(_TURNS), np.sin(_TURNS)], 1
)


@dataclass(frozen=True, eq=False)
class Film:
    """One agent over its training: V maps of O cells.

    Where one map does not show all, it holds O observations, and `seen` returns the film of the cells in one
    place of the issuer and phase.
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

    def is_unvisited(self, place: int) -> NDArray[np.bool_]:
        """Returns in which cells, (O,), all actions are equally good: the agent has never been there."""
        values = self.values[place]
        # Values are rounded, greedy actions were chosen before.
        return np.asarray((values == values[:, :1]).all(axis=1) & contains(self.greedy[place]).all(axis=1))

    def seen(self, moment: "Moment") -> "Film":
        """Returns the film of the place and phase in which the agent is."""
        if self.model is None:
            return self
        # The states that differ from the agent's by the cell alone.
        first = moment.state - int(self.model.cell[moment.state])
        observed = self.model.observation[first : first + len(self.model.position)]
        context = int(self.model.context[moment.state])
        values, greedy = self.values[:, observed], self.greedy[:, observed]
        scene = scene_of(self.model, context)
        return replace(self, scene=scene, values=values, greedy=greedy, scale=self.limits, model=None)

    def place_at(self, step: int) -> int:
        """Returns the place of the last map that is not later than a step."""
        return int(np.searchsorted(self.steps, step, side="right")) - 1

    def colours(self, values: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Returns the colours of values, (...), on this film's scale, (..., 3)."""
        low, high = self.limits
        share = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0, 1)
        colours = (mpl.colormaps[COLOUR_MAP](share)[..., :3] * 255).astype(np.uint8)
        colours[np.isnan(values)] = COLOURS["no value"]
        return np.asarray(colours)


@dataclass(frozen=True)
class Moment:
    """What an image shows: a map, and how far the agent has walked."""

    place: int  # of the map
    cells: tuple[int, ...]  # visited so far; the agent stands in the last
    ending: str = ""  # how the walk ended, see `Walk`, if it has
    state: int = 0  # the last one, which says where the issuer stands and in which phase


def film_of(title: str, population: Population, agent: int = 0) -> Film:
    """Returns the film of one agent of a population."""
    model, places = population.model, population.map_indices
    arrays = population.agents[agent]
    values, greedy = arrays["values"].astype(np.float64), arrays["greedy"][places]
    walks = [walk(model, masks, population.horizon) for masks in greedy]
    n_starts = len(model.starts)
    _, scene, observed = cell_map(model)
    is_egocentric = scene.origin is not None
    if is_egocentric:
        cell = observed.argsort()[model.observation]  # (S,) on the map
        values, greedy = values[:, observed], greedy[:, observed]
        walks = [replace(each, cells=tuple(cell[[*each.states]].tolist())) for each in walks]
    return Film(
        title=title if n_starts == 1 else f"{title}, first of {n_starts} starts",
        scene=scene,
        steps=np.array(population.evaluation_steps)[places].tolist(),
        values=values,
        greedy=greedy,
        scores=population.unbounded_scores[agent, places],
        walks=walks,
        model=None if model.has_cell_maps or is_egocentric else model,
    )


def end_of(film: Film, place: int) -> Moment:
    """Returns the end of the walk at a map."""
    walked = film.walks[place]
    return Moment(place, walked.cells, walked.ending, walked.states[-1])


def picture(film: Film, moment: Moment, cell_pixels: int = 30, *, has_marks: bool = True) -> Image.Image:
    """Draws a moment; the side of a cell is shorter in large rooms.

    Marks are PING's values and all greedy actions. Without them, for small cells, there is only a dot where
    PING is the single greedy action.
    """
    film = film.seen(moment)
    scene, place = film.scene, moment.place
    unit = _fitting(cell_pixels, scene.rows, scene.columns) * _SCALE
    line = int(0.7 * cell_pixels * _SCALE)
    top = 2 * line + line // 8
    diverged = "diverged, " if np.isnan(film.values[place]).any() else ""
    score = f"step {film.steps[place]:,}   {diverged}score {film.scores[place]:.2f}"
    font = _font(int(0.75 * line))
    # All images of a film have the same width, as a window cannot change its size.
    longest = f"step {film.steps[-1]:,}   score -0.00   {max(ENDINGS.values(), key=len)}"
    width = max(scene.columns * unit, int(max(map(font.getlength, (film.title, longest)))) + line // 2)
    image = Image.new("RGB", (width, top + scene.rows * unit), COLOURS["outside"])
    draw = ImageDraw.Draw(image)
    for i, text in enumerate((film.title, f"{score}   {ENDINGS.get(moment.ending, '')}")):
        draw.text((line // 8, i * line + line // 16), text, COLOURS["ink"], font=font)
    _Painter(draw, scene, unit, top).paint(film, moment, has_marks=has_marks)
    return image.resize((image.width // _SCALE, image.height // _SCALE), Image.Resampling.LANCZOS)


def learning(films: Sequence[Sequence[Film]], cell_pixels: int = 21) -> list[Image.Image]:
    """Draws several agents side by side, at every step at which one of them has a map.

    The films of a row share a colour scale, which is drawn below them. As many of the first ones are drawn as
    fit into a WebP image.
    """
    width = max(picture(each, end_of(each, 0), cell_pixels).width for row in films for each in row)
    films = [row[: max(_MOST_WEBP // (width + cell_pixels), 1)] for row in films]
    columns = max(sum(film.scene.columns for film in row) for row in films)
    cell_pixels = _fitting(cell_pixels, sum(max(film.scene.rows for film in row) for row in films), columns)
    scales = [colour_limits(np.concatenate([film.values.ravel() for film in row])) for row in films]
    films = [[replace(film, scale=scale) for film in row] for row, scale in zip(films, scales, strict=True)]
    frames, gap = [], cell_pixels // 2
    for step in sorted({step for row in films for film in row for step in film.steps}):
        panels = [
            [picture(film, end_of(film, film.place_at(step)), cell_pixels, has_marks=False) for film in row]
            for row in films
        ]
        width = max(panel.width for row in panels for panel in row) + gap
        bar = max(map(len, panels)) * width - gap, 3 * int(0.7 * cell_pixels)
        heights = [max(panel.height for panel in row) for row in panels]
        frame = Image.new("RGB", (bar[0], sum(heights) + len(panels) * bar[1]), COLOURS["outside"])
        top = 0
        for row, shown, height in zip(panels, films, heights, strict=True):
            for j, panel in enumerate(row):
                frame.paste(panel, (j * width, top))
            frame.paste(_colour_bar(shown[0], bar), (0, top + height))
            top += height + bar[1]
        frames.append(frame)
    return frames


def write(frames: Sequence[Image.Image], path: Path) -> None:
    """Writes an animated WebP or GIF that repeats; a WebP is a quarter of the size and has all colours.

    Raises:
      InputError: The file name has another ending, or there is no such folder.
      OSError: The file cannot be written.
    """
    check_file(path, *ANIMATIONS)
    options: dict[str, Any] = {"save_all": True, "append_images": list(frames[1:]), "loop": 0, "quality": 70}
    durations = [_FRAME_MS] * (len(frames) - 1) + [_LAST_MS]
    frames[0].save(path, path.suffix.lower().removeprefix("."), duration=durations, **options)


def _fitting(cell_pixels: int, rows: int, columns: int) -> int:
    """Returns the side of a cell, in pixels: the given one, unless the image would be too large."""
    largest = int((_MOST_PIXELS / (rows * columns)) ** 0.5)
    return max(min(cell_pixels, _LONGEST_SIDE // max(rows, columns), largest), 1)


def _colour_bar(film: Film, size: tuple[int, int]) -> Image.Image:
    """Draws the colour scale of a film, half as long as the image is wide, with its ends and zero."""
    low, high = film.limits
    image = Image.new("RGB", (size[0] * _SCALE, size[1] * _SCALE), COLOURS["outside"])
    line = image.height // 3
    draw, font, gap = ImageDraw.Draw(image), _font(int(0.75 * line)), line // 3
    left, long, lower = image.width // 4, image.width // 2, line
    colours = film.colours(np.linspace(low, high, long))
    image.paste(Image.fromarray(np.repeat(colours[None], lower - gap, axis=0)), (left, gap))
    draw.text((left - gap, (gap + lower) // 2), "value", COLOURS["ink"], font=font, anchor="rm")
    zero = -low / (high - low)
    shares = {f"≤ {low:.2g}": 0.0, f"≥ {high:.2g}": 1.0} | ({"0": zero} if 0.2 < zero < 0.8 else {})
    for text, share in shares.items():
        x = left + int(share * (long - 1))
        draw.line((x, lower, x, lower + gap), COLOURS["ink"], width=_SCALE)
        draw.text((x, lower + gap), text.replace("-", "−"), COLOURS["ink"], font=font, anchor="ma")
        if text == "0":
            draw.line((x, gap, x, lower), _WHITE, width=_SCALE)
    return image.resize(size, Image.Resampling.LANCZOS)


@dataclass(frozen=True)
class _Painter:
    """Paints one map on an image."""

    draw: ImageDraw.ImageDraw
    scene: Scene
    unit: int  # pixels of a cell's side
    top: int  # pixels above the map

    def paint(self, film: Film, moment: Moment, *, has_marks: bool) -> None:
        """Paints a moment of a film."""
        scene, place = self.scene, moment.place
        colours = [[tuple(c) for c in row] for row in film.colours(film.values[place]).tolist()]
        greedy, unvisited = contains(film.greedy[place]), film.is_unvisited(place)
        for cell in range(scene.n_cells):
            if scene.is_wall[cell]:
                self._hatching(cell, COLOURS["wall"])  # since the colours of values include greys
            elif scene.is_over[cell]:
                self.draw.rectangle(self._points(cell, _SQUARE), COLOURS["over"])
            elif unvisited[cell]:
                self._hatching(cell, COLOURS["no value"])
            else:
                # All actions are greedy mostly where the agent has never been; marks would say nothing.
                marked = [] if greedy[cell].all() else np.flatnonzero(greedy[cell]).tolist()
                self._actions(cell, colours[cell], marked, has_marks=has_marks)
        for outline in scene.outlines:
            for loop in outline.loops:
                self._border(loop, is_dashed=outline.is_dashed)
        for glyph in scene.glyphs:
            if glyph.kind == "issuer":
                self.draw.polygon(self._points(glyph.cell, _STAR), _WHITE, _BLACK)
                if glyph.heading is not None:
                    self.draw.polygon(self._points(glyph.cell, 1.5 * glyph.nose), _WHITE, _BLACK)
            else:
                for side, width, colour in ((0.74, self.unit // 9, _BLACK), (0.68, self.unit // 14, _WHITE)):
                    self.draw.rectangle(self._points(glyph.cell, side * _SQUARE), outline=colour, width=width)
        path = [self._points(cell, _CENTRE)[0] for cell in moment.cells]
        if len(path) > 1:
            self.draw.line(path, _WHITE, width=self.unit // 7, joint="curve")
            self.draw.line(path, COLOURS["path"], width=self.unit // 12, joint="curve")
        self.draw.circle(path[-1], 0.28 * self.unit, COLOURS["path"], _WHITE, width=self.unit // 14)

    def _points(self, cell: int, offsets: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Returns points, (x, y) in pixels, given (row, column) in cells from a cell's centre."""
        return self._pixels(offsets + self.scene.centre(cell))

    def _pixels(self, corners: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Returns points, (x, y) in pixels, given (row, column) in cells."""
        return [(x, y + self.top) for y, x in (corners * self.unit).tolist()]

    def _actions(
        self, cell: int, colours: Sequence[Colour], greedy: Sequence[int], *, has_marks: bool
    ) -> None:
        """Paints the values of a cell's actions, and marks the greedy ones."""
        thin, (centre,) = max(self.unit // 30, 1), self._points(cell, _CENTRE)
        for move, triangle in enumerate(TRIANGLES):
            self.draw.polygon(self._points(cell, triangle), colours[move])
        if has_marks:
            self.draw.circle(centre, 0.2 * self.unit, colours[PING], COLOURS["line"], width=thin)
        for action in greedy:
            if action == PING and (has_marks or len(greedy) == 1):
                self.draw.circle(centre, 0.1 * self.unit, _WHITE, _BLACK, width=thin)
            elif action != PING and has_marks:
                self.draw.polygon(self._points(cell, ARROWHEADS[action]), _WHITE, _BLACK)

    def _hatching(self, cell: int, colour: Colour) -> None:
        """Paints a cell with two strokes, from the lower left to the upper right."""
        self.draw.rectangle(self._points(cell, _SQUARE), colour)
        for stroke in _STROKES:
            self.draw.line(self._points(cell, stroke), COLOURS["line"], width=max(self.unit // 20, 1))

    def _border(self, loop: Loop, *, is_dashed: bool) -> None:
        """Paints a region's border, on the cells inside: white on black."""
        corners = np.array(inset(loop, 1 / 12))
        closed = self._pixels(np.concatenate([corners, corners[:2]]))
        self.draw.line(closed, _BLACK, width=self.unit // 6, joint="curve")
        if not is_dashed:
            self.draw.line(closed, _WHITE, width=self.unit // 12, joint="curve")
            return
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            n_dashes = int(3 * abs(end - start).max())
            for k in range(n_dashes):
                ends = np.array([[k + 0.25], [k + 0.75]]) / n_dashes
                self.draw.line(self._pixels(start + ends * (end - start)), _WHITE, width=self.unit // 12)


@cache
def _font(size: int) -> Any:
    """Returns the font that comes with matplotlib, which is present wherever figures can be drawn."""
    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)
