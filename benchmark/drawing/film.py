"""Paints with Pillow what an agent values, does and where it walks: one image per moment of its training.

The maps resemble matplotlib's, but are drawn fast enough to be played. A cell's four triangles are its moves,
the disc in its middle is PING, and the line is the greedy policy's walk from the start. A hatched cell is one
of which the agent has learned nothing: all its actions are equally good.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from agents.policy import contains
from benchmark.analysis.population import Population
from benchmark.analysis.walk import CIRCLE, HORIZON, Walk, walk
from envs import InputError, Model
from envs.model import PING
from envs.regions import Loop
from envs.scene import (
    ARROWHEADS,
    COLOUR_MAP,
    COLOURS,
    TRIANGLES,
    Colour,
    Scene,
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
_SCALE: Final = 2  # images are drawn this much larger and then reduced, for smooth edges
_WHITE: Final = (255, 255, 255)
_BLACK: Final = (0, 0, 0)
_MOST_PIXELS: Final = 1_500_000  # of a map: the cells of large rooms are smaller
_LONGEST_SIDE: Final = 8000  # pixels


@dataclass(frozen=True, eq=False)
class Film:
    """One agent over its training: V maps of O cells.

    Where an observation is more than the agent's cell, it holds O observations, and `seen` returns the film
    of the cells in one place of the issuer and phase.
    """

    title: str
    scene: Scene
    steps: Sequence[int]  # (V,)
    values: NDArray[np.float64]  # (V, O, A) action values, or probabilities; NaN of an agent that diverged
    greedy: NDArray[np.uint8]  # (V, O) masks
    scores: NDArray[np.float64]  # (V,)
    walks: Sequence[Walk]  # (V,) of the greedy policy
    scale: tuple[float, float] | None = None  # the ends of a colour scale that films share
    model: Model | None = None  # unless one map shows it all, see `Model.has_cell_maps`

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
        return replace(
            self,
            scene=scene_of(self.model, context),
            values=self.values[:, observed],
            greedy=self.greedy[:, observed],
            scale=self.limits,
            model=None,
        )

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
    places = population.map_places
    arrays = population.of_agent(agent)
    greedy = arrays["greedy"][places]
    n_starts = len(population.model.starts)
    return Film(
        title=title if n_starts == 1 else f"{title}, first of {n_starts} starts",
        scene=scene_of(population.model),
        steps=np.array(population.evaluation_steps)[places].tolist(),
        values=arrays["values"].astype(np.float64),
        greedy=greedy,
        scores=population.scores[agent, places],
        walks=[walk(population.model, masks, population.horizon) for masks in greedy],
        model=None if population.model.has_cell_maps else population.model,
    )


def end_of(film: Film, place: int) -> Moment:
    """Returns the end of the walk at a map."""
    walked = film.walks[place]
    return Moment(place, walked.cells, walked.ending, walked.states[-1])


def picture(film: Film, moment: Moment, cell_pixels: int = 30, *, has_marks: bool = True) -> Image.Image:
    """Draws a moment.

    Args:
      film: The agent.
      moment: What to show of it.
      cell_pixels: Side of a cell; less in large rooms.
      has_marks: Whether to draw PING's values and all greedy actions. If not, for small cells, there is
        only a dot where PING is the single greedy action.
    """
    film = film.seen(moment)
    scene, place = film.scene, moment.place
    unit = _fitting(cell_pixels, scene.rows, scene.columns) * _SCALE
    line = int(0.7 * cell_pixels * _SCALE)
    top = 2 * line + line // 8
    diverged = "diverged, " if np.isnan(film.values[place]).any() else ""
    score = f"step {film.steps[place]:,}   {diverged}score {film.scores[place]:.2f}"
    lines = (film.title, f"{score}   {ENDINGS.get(moment.ending, '')}")
    font = _font(int(0.75 * line))
    # All images of a film have the same width, as a window cannot change its size.
    longest = f"step {film.steps[-1]:,}   score -0.00   {max(ENDINGS.values(), key=len)}"
    width = max(scene.columns * unit, int(max(map(font.getlength, (film.title, longest)))) + line // 2)
    image = Image.new("RGB", (width, top + scene.rows * unit), COLOURS["outside"])
    draw = ImageDraw.Draw(image)
    for i, text in enumerate(lines):
        draw.text((line // 8, i * line + line // 16), text, COLOURS["ink"], font=font)
    _Painter(draw, scene, unit, top).paint(film, moment, has_marks=has_marks)
    return image.resize((image.width // _SCALE, image.height // _SCALE), Image.Resampling.LANCZOS)


def learning(films: Sequence[Sequence[Film]], cell_pixels: int = 21) -> list[Image.Image]:
    """Draws several agents side by side, at every step at which one of them has a map.

    Args:
      films: Rows of columns; the films of a row share a colour scale, which is drawn below them.
      cell_pixels: Side of a cell; less in large rooms.
    """
    columns = max(sum(film.scene.columns for film in row) for row in films)
    rows = sum(max(film.scene.rows for film in row) for row in films)
    cell_pixels = _fitting(cell_pixels, rows, columns)
    films = [_on_one_scale(row) for row in films]
    shown = [
        [
            [picture(film, end_of(film, film.place_at(step)), cell_pixels, has_marks=False) for film in row]
            for row in films
        ]
        for step in sorted({step for row in films for film in row for step in film.steps})
    ]
    widths = [max(panel.width for panel in column if panel) for column in zip_longest(*shown[0])]
    gap = cell_pixels // 2
    bars = [_colour_bar(row, sum(widths) + gap * (len(widths) - 1), cell_pixels) for row in films]
    return [_beside(panels, bars, widths, gap) for panels in shown]


def write(frames: Sequence[Image.Image], path: Path, frame_ms: int = 350, last_ms: int = 2500) -> None:
    """Writes an animated WebP or GIF that repeats; a WebP is a quarter of the size and has all colours.

    Raises:
      InputError: The file name has another ending.
      OSError: The file cannot be written.
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in ("webp", "gif"):
        raise InputError(f"{path}: accepted: a name that ends in .webp or .gif.")
    durations = [frame_ms] * (len(frames) - 1) + [last_ms]
    frames[0].save(
        path, form, save_all=True, append_images=list(frames[1:]), duration=durations, loop=0, quality=70
    )


def _fitting(cell_pixels: int, rows: int, columns: int) -> int:
    """Returns the side of a cell, in pixels: the given one, unless the image would be too large."""
    largest = int((_MOST_PIXELS / (rows * columns)) ** 0.5)
    return max(min(cell_pixels, _LONGEST_SIDE // max(rows, columns), largest), 1)


def _on_one_scale(films: Sequence[Film]) -> list[Film]:
    """Returns films with one colour scale."""
    scale = colour_limits(np.concatenate([film.values.ravel() for film in films]))
    return [replace(film, scale=scale) for film in films]


def _beside(
    panels: Sequence[Sequence[Image.Image]], bars: Sequence[Image.Image], widths: Sequence[int], gap: int
) -> Image.Image:
    """Joins rows of images, with a bar below each row.

    Args:
      panels: Rows of columns.
      bars: One per row; as wide as all columns together.
      widths: Of the columns.
      gap: Between the columns.
    """
    heights = [max(panel.height for panel in row) for row in panels]
    size = bars[0].width, sum(heights) + sum(bar.height for bar in bars)
    joined = Image.new("RGB", size, COLOURS["outside"])
    top = 0
    for row, height, bar in zip(panels, heights, bars, strict=True):
        for j, panel in enumerate(row):
            joined.paste(panel, (sum(widths[:j]) + j * gap, top))
        joined.paste(bar, (0, top + height))
        top += height + bar.height
    return joined


def _colour_bar(films: Sequence[Film], width: int, cell_pixels: int) -> Image.Image:
    """Draws the colour scale of a row of films, with its ends and zero below it.

    An end has the sign of an inequality if there are values beyond it.
    """
    low, high = films[0].limits
    values = np.concatenate([film.values.ravel() for film in films])
    line = int(0.7 * cell_pixels * _SCALE)
    font, gap = _font(int(0.75 * line)), line // 3
    image = Image.new("RGB", (width * _SCALE, 3 * line), COLOURS["outside"])
    draw = ImageDraw.Draw(image)
    long = image.width // 2
    left, upper, lower = (image.width - long) // 2, gap, gap + 2 * line // 3
    colours = films[0].colours(np.linspace(low, high, long))
    image.paste(Image.fromarray(np.repeat(colours[None], lower - upper, axis=0)), (left, upper))
    draw.text((left - gap, (upper + lower) // 2), "value", COLOURS["ink"], font=font, anchor="rm")
    ends = {
        low: ("≤ " if np.nanmin(values, initial=low) < low else "") + _number(low),
        high: ("≥ " if np.nanmax(values, initial=high) > high else "") + _number(high),
    }
    margin = (font.getlength(max(ends.values(), key=len)) / 2 + line) / long
    zero = -low / (high - low)
    marks = ends | ({0.0: "0"} if margin < zero < 1 - margin else {})
    for value, text in marks.items():
        x = left + int((value - low) / (high - low) * (long - 1))
        draw.line((x, lower, x, lower + gap), COLOURS["ink"], width=_SCALE)
        draw.text((x, lower + gap), text, COLOURS["ink"], font=font, anchor="ma")
    if 0.0 in marks:
        x = left + int(zero * (long - 1))
        draw.line((x, upper, x, lower), _WHITE, width=_SCALE)
    return image.resize((width, image.height // _SCALE), Image.Resampling.LANCZOS)


def _number(value: float) -> str:
    """Returns a number with two digits and a proper minus sign."""
    return f"{value:.2g}".replace("-", "−")


@dataclass(frozen=True)
class _Painter:
    """Paints one map on an image."""

    draw: ImageDraw.ImageDraw
    scene: Scene
    unit: int  # pixels of a cell's side
    top: int  # pixels above the map

    def paint(self, film: Film, moment: Moment, *, has_marks: bool) -> None:
        """Paints a moment of a film."""
        colours = [[tuple(c) for c in row] for row in film.colours(film.values[moment.place]).tolist()]
        greedy = contains(film.greedy[moment.place])
        unvisited = film.is_unvisited(moment.place)
        for cell in range(self.scene.n_cells):
            if self.scene.is_wall[cell]:
                self._wall(cell)
                continue
            if unvisited[cell] and not self.scene.is_over[cell]:
                self._hatching(cell)
                continue
            self._values(cell, colours[cell], has_marks=has_marks)
            # All actions are greedy mostly where the agent has never been; marks would say nothing.
            if not (self.scene.is_over[cell] or greedy[cell].all()):
                self._marks(cell, np.flatnonzero(greedy[cell]).tolist(), has_marks=has_marks)
        for outline in self.scene.outlines:
            for loop in outline.loops:
                self._border(loop, is_dashed=outline.is_dashed)
        for person in self.scene.glyphs_of("issuer"):
            if person.heading is not None:
                self.draw.polygon(self._shape(person.cell, 1.5 * person.nose), _WHITE, _BLACK)
            self._star(person.cell)
        for cell in self.scene.cells_of("start"):
            self._square(cell)
        self._path(moment.cells)

    def _at(self, cell: int) -> tuple[float, float]:
        """Returns the centre of a cell, (x, y)."""
        row, column = self.scene.centre(cell)
        return column * self.unit, row * self.unit + self.top

    def _shape(self, cell: int, corners: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Returns the corners, (row, column) in cells from a cell's centre, as points, (x, y)."""
        x, y = self._at(cell)
        return [(x + column * self.unit, y + row * self.unit) for row, column in corners.tolist()]

    def _values(self, cell: int, colours: Sequence[Colour], *, has_marks: bool) -> None:
        """Paints the values of a cell's actions, PING's only with marks."""
        (x, y), half = self._at(cell), self.unit / 2
        if self.scene.is_over[cell]:
            self.draw.rectangle((x - half, y - half, x + half, y + half), COLOURS["over"])
            return
        for move, triangle in enumerate(TRIANGLES):
            self.draw.polygon(self._shape(cell, triangle), colours[move])
        if has_marks:
            width = max(self.unit // 30, 1)
            self.draw.circle((x, y), 0.2 * self.unit, colours[PING], COLOURS["line"], width=width)

    def _hatching(self, cell: int) -> None:
        """Paints a cell of which the agent has learned nothing."""
        self._strokes(cell, COLOURS["no value"], COLOURS["line"])

    def _wall(self, cell: int) -> None:
        """Paints a wall, hatched, since the colours of values include greys."""
        self._strokes(cell, COLOURS["wall"], COLOURS["line"])

    def _strokes(self, cell: int, colour: Colour, stroke: Colour) -> None:
        """Paints a cell with two strokes, from the lower left to the upper right."""
        (x, y), half = self._at(cell), self.unit / 2
        self.draw.rectangle((x - half, y - half, x + half, y + half), colour)
        for along in (-half / 2, half / 2):
            ends = (x + along - half / 2, y + along + half / 2, x + along + half / 2, y + along - half / 2)
            self.draw.line(ends, stroke, width=max(self.unit // 20, 1))

    def _marks(self, cell: int, actions: Sequence[int], *, has_marks: bool) -> None:
        """Marks the greedy actions of a cell."""
        for action in actions:
            if action == PING and (has_marks or len(actions) == 1):
                width = max(self.unit // 30, 1)
                self.draw.circle(self._at(cell), 0.1 * self.unit, _WHITE, _BLACK, width=width)
            elif action != PING and has_marks:
                self.draw.polygon(self._shape(cell, ARROWHEADS[action]), _WHITE, _BLACK)

    def _border(self, loop: Loop, *, is_dashed: bool) -> None:
        """Paints a region's border, on the cells inside: white on black."""
        unit = self.unit
        self._edges(loop, 0, unit // 6, _BLACK)
        if is_dashed:
            self._edges(loop, unit // 24, unit // 12 + 1, _WHITE, unit // 6 + 1, unit // 3)
        else:
            self._edges(loop, unit // 24, unit // 12, _WHITE)

    def _edges(
        self, loop: Loop, depth: int, width: int, colour: Colour, dash: int | None = None, period: int = 1
    ) -> None:
        """Paints a band along the edges of a loop.

        Args:
          loop: The border.
          depth: Pixels between the border and the band.
          width: Of the band, in pixels.
          colour: Of the band.
          dash: Pixels of a dash; without dashes by default.
          period: Pixels from one dash to the next.
        """
        outer, inner = (self._corners(loop, pixels) for pixels in (depth, depth + width))
        for i in range(len(loop)):
            points = outer[i - 1], outer[i], inner[i - 1], inner[i]
            (left, right), (top, bottom) = ((min(along), max(along)) for along in zip(*points, strict=True))
            if dash is None:
                self.draw.rectangle((left, top, right - 1, bottom - 1), colour)
            elif right - left > bottom - top:
                for x in range(left, right - 1, period):
                    self.draw.rectangle((x, top, min(x + dash, right) - 1, bottom - 1), colour)
            else:
                for y in range(top, bottom - 1, period):
                    self.draw.rectangle((left, y, right - 1, min(y + dash, bottom) - 1), colour)

    def _corners(self, loop: Loop, depth: int) -> list[tuple[int, int]]:
        """Returns a loop's corners, (x, y), some pixels inside the border."""
        corners = inset(loop, depth / self.unit)
        return [(round(column * self.unit), round(row * self.unit) + self.top) for row, column in corners]

    def _star(self, cell: int) -> None:
        """Paints the issuer."""
        x, y = self._at(cell)
        radii = np.where(np.arange(10) % 2, 0.16, 0.38) * self.unit
        angles = np.arange(10) * np.pi / 5
        points = np.column_stack([x + radii * np.sin(angles), y - radii * np.cos(angles)])
        self.draw.polygon([(x, y) for x, y in points.tolist()], _WHITE, _BLACK)

    def _square(self, cell: int) -> None:
        """Paints the start."""
        (x, y), side, width = self._at(cell), 0.34 * self.unit, self.unit // 14
        for edge, colour in ((width // 2, _BLACK), (0, _WHITE)):
            half = side + edge
            corners = (x - half, y - half, x + half, y + half)
            self.draw.rectangle(corners, outline=colour, width=width + 2 * edge)

    def _path(self, cells: Sequence[int]) -> None:
        """Paints the walk and the agent at its end."""
        unit, centres = self.unit, [self._at(cell) for cell in cells]
        if len(centres) > 1:
            self.draw.line(centres, _WHITE, width=unit // 7, joint="curve")
            self.draw.line(centres, COLOURS["path"], width=unit // 12, joint="curve")
        self.draw.circle(centres[-1], 0.28 * unit, COLOURS["path"], _WHITE, width=unit // 14)


@cache
def _font(size: int) -> Any:
    """Returns the font that comes with matplotlib, which is present wherever figures can be drawn."""
    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)
