"""Draws what an agent values, does and where it walks as images, one a moment of its training.

Fast enough to be shown as it goes, unlike matplotlib's maps, whose look it has: a cell's four triangles
are its moves, the disc in its middle is PING; the line is the greedy policy's way from the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from agents.policy import contains
from benchmark.analysis.population import Population
from benchmark.analysis.snapshots import AGENT
from envs import EVENTS, InputError, Model, ProxemicEnv
from envs.model import MOVES, PING
from envs.scene import COLOURS

_SCALE: Final = 2  # drawn so many times too large, and made smaller: smooth edges
SAID: Final = {
    "target_ping": "success",
    "issuer_reached": "ran into the issuer",
    "last_wrong_ping": "too many wrong PINGs",
}  # of the events that end an episode
_INK: Final = (30, 30, 30)
_WAY: Final = (213, 94, 0)
_LARGEST: Final = 1_500_000  # pixels of an image's cells: large scenes have smaller ones
_WIDEST: Final = 8000  # pixels of its side


@dataclass(frozen=True, eq=False)
class Film:
    """One agent over training: V maps."""

    title: str
    model: Model
    steps: Sequence[int]  # (V,)
    values: NDArray[np.float64]  # (V, O, A) Q, or probabilities
    greedy: NDArray[np.uint8]  # (V, O) masks
    scores: NDArray[np.float64]  # (V,)

    @property
    def limits(self) -> tuple[float, float]:
        """The ends of the colour scale: all values but the lowest and highest hundredth."""
        if not np.isfinite(self.values).any():
            return 0.0, 1.0
        low, high = np.nanpercentile(self.values, [1, 99])
        return float(low), float(max(high, low + 1e-9))

    def place_at(self, step: int) -> int:
        """Returns which map the agent has at a step: the last one not later."""
        return int(np.searchsorted(self.steps, step, side="right")) - 1


def film_of(title: str, population: Population, agent: int = AGENT) -> Film:
    """Returns an agent's film from the records of its population."""
    places = population.map_places
    return Film(
        title=title,
        model=population.model,
        steps=np.array(population.evaluation_steps)[places].tolist(),
        values=population.arrays["values"][agent].astype(np.float64),
        greedy=population.arrays["greedy"][agent, places],
        scores=population.scores[agent, places],
    )


def walk(model: Model, greedy: NDArray[np.uint8], seed: int = 0) -> tuple[list[int], str]:
    """Lets the greedy policy walk in the env, for a while.

    Args:
      model: Of the scene.
      greedy: Masks, (O,); among several greedy actions one is drawn.
      seed: Of these draws.

    Returns:
      The cells it comes through, the start first, and the last event.
    """
    env = ProxemicEnv(model.scenario)
    cell, info = env.reset(seed=seed)
    grid = model.scenario.grid
    longest = max(40, 2 * (grid.rows + grid.columns))  # a walk that bumps a wall goes on for ever
    members = contains(greedy)
    rng = np.random.default_rng(seed)
    way = [int(cell)]
    while len(way) <= longest:
        action = int(rng.choice(np.flatnonzero(members[way[-1]])))
        cell, _, terminated, _, info = env.step(action)
        way.append(int(cell))
        if terminated:
            break
    return way, EVENTS[info["event"]]


def picture(
    film: Film, place: int, way: Sequence[int], event: str = "", cell: int = 30, *, marks: bool = True
) -> Image.Image:
    """Draws one moment of training.

    Args:
      film: The agent.
      place: Which of its maps.
      way: Cells it has come through; the agent stands in the last.
      event: What happened last.
      cell: Pixels of a cell's side.
      marks: Whether to draw PING's values and all greedy actions; else, where cells are small, a dot where
        PING is the only one.
    """
    grid = film.model.scenario.grid
    unit = _fitting(cell, grid.rows, grid.columns) * _SCALE
    line = int(0.7 * cell * _SCALE)
    top = 2 * line + line // 8
    diverged = "diverged, " if np.isnan(film.values[place]).any() else ""
    score = f"step {film.steps[place]:,}   {diverged}score {film.scores[place]:.2f}"
    lines = (film.title, f"{score}   {SAID.get(event, '')}")
    font = _font(int(0.75 * line))
    # The same for all moments, or a window would change its size.
    longest = f"step {film.steps[-1]:,}   score -0.00   {max(SAID.values(), key=len)}"
    width = max(grid.columns * unit, int(max(map(font.getlength, (film.title, longest)))) + line // 2)
    image = Image.new("RGB", (width, top + grid.rows * unit), COLOURS["outside"])
    draw = ImageDraw.Draw(image)
    for i, one in enumerate(lines):
        draw.text((line // 8, i * line + line // 16), one, _INK, font=font)
    _draw_map(draw, film, place, unit, top, marks=marks)
    _draw_scene(draw, film.model, unit, top)
    centres = [_centre(one, grid.columns, unit, top) for one in way]
    if len(centres) > 1:
        draw.line(centres, (255, 255, 255), width=unit // 7, joint="curve")
        draw.line(centres, _WAY, width=unit // 12, joint="curve")
    x, y = centres[-1]
    draw.circle((x, y), 0.28 * unit, _WAY, (255, 255, 255), width=unit // 14)
    return image.resize((image.width // _SCALE, image.height // _SCALE), Image.Resampling.LANCZOS)


def learning(films: Sequence[Sequence[Film]], cell: int = 21) -> list[Image.Image]:
    """Draws several agents side by side at every step at which one of them has a map.

    Args:
      films: Rows of columns.
      cell: Pixels of a cell's side.
    """
    columns = max(sum(one.model.scenario.grid.columns for one in row) for row in films)
    rows = sum(max(one.model.scenario.grid.rows for one in row) for row in films)
    cell = _fitting(cell, rows, columns)
    frames = []
    for step in sorted({step for row in films for one in row for step in one.steps}):
        panels = []
        for row in films:
            places = [one.place_at(step) for one in row]
            ways = [walk(one.model, one.greedy[place]) for one, place in zip(row, places, strict=True)]
            panels.append(
                [
                    picture(one, place, *way, cell, marks=False)
                    for one, place, way in zip(row, places, ways, strict=True)
                ]
            )
        frames.append(_beside(panels, cell // 2))
    return frames


def _fitting(cell: int, rows: int, columns: int) -> int:
    """Returns how many pixels a cell's side can have, at most those wished for."""
    return max(min(cell, _WIDEST // max(rows, columns), int((_LARGEST / (rows * columns)) ** 0.5)), 1)


def write(frames: Sequence[Image.Image], path: Path, frame_ms: int = 350, last_ms: int = 2500) -> None:
    """Writes an animated WebP or GIF that repeats; a WebP is a quarter of the size, and has all colours.

    Raises:
      InputError: The name ends otherwise.
      OSError: The file cannot be written.
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in ("webp", "gif"):
        raise InputError(f"{path}: accepted: a name that ends in .webp or .gif.")
    durations = [frame_ms] * (len(frames) - 1) + [last_ms]
    frames[0].save(
        path, form, save_all=True, append_images=list(frames[1:]), duration=durations, loop=0, quality=70
    )


def _beside(panels: Sequence[Sequence[Image.Image]], gap: int) -> Image.Image:
    """Puts rows of images one below the other, in columns as wide as the widest of their images."""
    widths = [max(row[j].width for row in panels if j < len(row)) for j in range(max(map(len, panels)))]
    heights = [max(panel.height for panel in row) for row in panels]
    size = sum(widths) + gap * (len(widths) - 1), sum(heights) + gap * (len(heights) - 1)
    whole = Image.new("RGB", size, COLOURS["outside"])
    for i, row in enumerate(panels):
        for j, panel in enumerate(row):
            whole.paste(panel, (sum(widths[:j]) + j * gap, sum(heights[:i]) + i * gap))
    return whole


def _draw_map(draw: ImageDraw.ImageDraw, film: Film, place: int, unit: int, top: int, *, marks: bool) -> None:
    """Draws a value a cell and action, and the greedy actions."""
    low, high = film.limits
    values = film.values[place]
    share = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0, 1)
    colours = (mpl.colormaps["cividis"](share)[..., :3] * 255).astype(int)
    colours[np.isnan(values)] = COLOURS["outside"]  # the net has diverged
    over = np.all(film.model.terminated[: len(values)], axis=1)
    greedy = contains(film.greedy[place])
    half = unit / 2
    for o in range(len(values)):
        x, y = _centre(o, film.model.scenario.grid.columns, unit, top)
        if over[o]:
            draw.rectangle((x - half, y - half, x + half, y + half), (138, 138, 138))
            continue
        for a in range(PING):
            dy, dx = MOVES[a].tolist()  # a move's triangle stands on the side that it leads to
            corners = [
                (x + half * (dx + dy), y + half * (dy + dx)),
                (x + half * (dx - dy), y + half * (dy - dx)),
            ]
            draw.polygon([*corners, (x, y)], tuple(colours[o, a].tolist()))
        disc = tuple(colours[o, PING].tolist())
        if marks:
            draw.circle((x, y), 0.2 * unit, disc, (200, 200, 200), width=max(unit // 30, 1))
        if greedy[o].all():  # where it never was, mostly: marks would say nothing
            continue
        for a in np.flatnonzero(greedy[o]).tolist():
            if a == PING and (marks or greedy[o].sum() == 1):
                draw.circle((x, y), 0.1 * unit, (255, 255, 255), (0, 0, 0), width=max(unit // 30, 1))
            elif a != PING and marks:
                dy, dx = (MOVES[a] * unit).tolist()
                tip, base = (x + 0.46 * dx, y + 0.46 * dy), (x + 0.27 * dx, y + 0.27 * dy)
                side = 0.13 * dy, 0.13 * dx
                head = [tip, (base[0] + side[0], base[1] + side[1]), (base[0] - side[0], base[1] - side[1])]
                draw.polygon(head, (255, 255, 255), (0, 0, 0))


def _draw_scene(draw: ImageDraw.ImageDraw, model: Model, unit: int, top: int) -> None:
    """Draws the regions' edges, the issuer and the start."""
    grid, regions = model.scenario.grid, model.scenario.regions
    row, column = model.scenario.issuer.position
    for radius, dashed in ((regions.target_radius, False), (regions.uncomfortable_radius, True)):
        box = (
            max(column - radius, 0) * unit,
            max(row - radius, 0) * unit + top,
            (min(column + radius, grid.columns - 1) + 1) * unit - 1,
            (min(row + radius, grid.rows - 1) + 1) * unit - 1 + top,
        )
        draw.rectangle(box, outline=(0, 0, 0), width=unit // 6)
        inner = (box[0] + unit // 24, box[1] + unit // 24, box[2] - unit // 24, box[3] - unit // 24)
        if dashed:
            _dashes(draw, inner, unit)
        else:
            draw.rectangle(inner, outline=(255, 255, 255), width=unit // 12)
    x, y = _centre(row * grid.columns + column, grid.columns, unit, top)
    radii = np.where(np.arange(10) % 2, 0.16, 0.38) * unit
    angles = np.arange(10) * np.pi / 5
    points = np.column_stack([x + radii * np.sin(angles), y - radii * np.cos(angles)])
    draw.polygon([tuple(point) for point in points.tolist()], (255, 255, 255), (0, 0, 0))
    x, y = _centre(model.start, grid.columns, unit, top)
    side = 0.34 * unit
    draw.rectangle((x - side, y - side, x + side, y + side), outline=(255, 255, 255), width=unit // 14)


def _dashes(draw: ImageDraw.ImageDraw, box: tuple[int, int, int, int], unit: int) -> None:
    """Draws a dashed rectangle."""
    left, top, right, bottom = box
    width = unit // 12
    for x in range(left, right, unit // 3):
        for y in (top, bottom - width):
            draw.rectangle((x, y, min(x + unit // 6, right), y + width), (255, 255, 255))
    for y in range(top, bottom, unit // 3):
        for x in (left, right - width):
            draw.rectangle((x, y, x + width, min(y + unit // 6, bottom)), (255, 255, 255))


def _centre(cell: int, columns: int, unit: int, top: int) -> tuple[float, float]:
    """Returns where a cell's centre is drawn."""
    row, column = divmod(cell, columns)
    return (column + 0.5) * unit, (row + 0.5) * unit + top


@cache
def _font(size: int) -> Any:
    """Returns matplotlib's own font, which is there wherever figures can be drawn."""
    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)
