"""Draws scenes with matplotlib: maps of values, policies and scenarios.

On the axes, x is the column and y the row of a cell's centre; in `envs.scene`, of its upper left
corner.
"""

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch, Polygon
from matplotlib.path import Path
from numpy.typing import ArrayLike, NDArray

from benchmark.style import WIDTH, colour_map, figure_of
from envs import ACTIONS, ZONES, Model, compile_scenario, load_scenario, scenario_names
from envs.model import PING
from envs.regions import Loop, outlines
from envs.scene import (
    ARROWHEADS,
    BORDERS,
    COLOUR_MAP,
    COLOURS,
    DIVERGING,
    TRIANGLES,
    Scene,
    scene_of,
)

RGB = {kind: "#{:02x}{:02x}{:02x}".format(*colour) for kind, colour in COLOURS.items()}
Style = dict[str, Any]  # keyword arguments of an artist

_DASHES = (0, (2, 1.5))
_DOTS = (0, (1, 1.5))
_BELOW = patheffects.withStroke(
    linewidth=3, foreground="black", dashes={"dash_offset": 0, "dash_list": None}
)
_ON_ZONES: Style = {"fill": False, "ec": "black", "lw": 0.8}
# Light above dark, which can be seen on any colour
_ON_VALUES: Style = {"fill": False, "ec": "white", "lw": 1.6, "path_effects": [_BELOW]}
_GLYPHS: dict[str, Style] = {
    kind: {"ls": "", "marker": marker, "ms": size, "mfc": colour, "mec": "black", "mew": 0.8}
    for kind, marker, size, colour in (
        ("issuer", "*", 9, "white"),
        ("bystander", "o", 7, "white"),
        ("onlooker", "D", 4, "0.8"),
        ("start", "s", 5, "white"),
    )
}
_SIGN: Style = {"ls": "", "color": "black", "ms": 4}
# Hatched, since the colours of values include greys.
_WALL: Style = {"fc": RGB["wall"], "ec": RGB["line"], "lw": 0, "hatch": "////"}

_TIE = 1e-9  # moves whose probabilities differ by less are equally likely

# The gallery: maps in a row, inches of a row and of the legend
_COLUMNS, _ROW, _LEGEND = 5, 1.65, 0.7


def heat(axis: Axes, scene: Scene, values: NDArray[np.float64], norm: Normalize) -> None:
    """Draws one value per cell, (O,)."""
    axis.set_facecolor(RGB["over"])
    _draw_cells(axis, scene, _ON_VALUES, values, **_coloured(norm), lw=0.2)


def draw_policy(axis: Axes, model: Model, policy: NDArray[np.float64], norm: Normalize) -> None:
    """Draws a policy, (O, A), with people in their first place and phase.

    Colours are the probability of PING, marks the likeliest actions.
    """
    scene, chances = scene_of(model), policy[model.observation[model.states_of(0)]]  # (C, A)
    is_likeliest = chances >= chances.max(axis=1, keepdims=True) - _TIE
    is_likeliest[:, PING] &= chances.argmax(axis=1) == PING  # no move is as likely
    heat(axis, scene, np.where(scene.is_over, np.nan, chances[:, PING]), norm)
    mark(axis, scene, is_likeliest)


def policy_legend(figure: Figure, axes: Sequence[Axes], model: Model, norm: Normalize) -> None:
    """Draws the colour scale and the legend of policies."""
    colour_bar(figure, axes, norm, "probability of PING")
    ping = Line2D([], [], **_SIGN, marker="o", label="PING is the likeliest action")
    move = Line2D([], [], **_SIGN, marker=">", label="likeliest moves")
    region_legend(figure, [scene_of(model)], ping, move, columns=2)


def triangles(axis: Axes, scene: Scene, frame: pd.DataFrame, norm: Normalize) -> None:
    """Draws means by row, column and move as triangles on the sides to which the moves lead."""
    corners = TRIANGLES[frame["action"].map(ACTIONS.index).to_numpy(dtype=int)]
    shapes = list(frame[["column", "row"]].to_numpy()[:, None, :] + corners[..., ::-1])
    values = frame["mean"].to_numpy()
    axis.add_collection(PolyCollection(shapes, array=values, **_coloured(norm), linewidths=0.2))
    _dress(axis, scene)


def mark(axis: Axes, scene: Scene, is_marked: NDArray[np.bool_]) -> None:
    """Marks actions, (C, A), where the episode goes on: arrowheads for moves, a dot for PING."""
    cell, action = np.nonzero(is_marked & ~scene.is_over[:, None])
    is_ping = action == PING
    centres = scene.position[cell][:, None]
    shapes = (centres[~is_ping] + ARROWHEADS[action[~is_ping]])[..., ::-1]
    arrows = PolyCollection(list(shapes), facecolors="white", edgecolors="black", linewidths=0.4)
    axis.add_collection(arrows)
    dots(axis, *scene.position[cell[is_ping]].T)


def dots(axis: Axes, rows: ArrayLike, columns: ArrayLike) -> None:
    """Draws a dot in every cell."""
    axis.plot(columns, rows, "o", ms=3, mfc="black", mec="white", mew=0.5)


def _coloured(norm: Normalize) -> Style:
    # The middle of a diverging map, white, is zero.
    name = DIVERGING if norm.vmin == -(norm.vmax or 0.0) else COLOUR_MAP
    # Edges have the same colour, since the background would shine through between cells.
    return {"cmap": colour_map(name), "norm": norm, "edgecolors": "face"}


def colour_bar(
    figure: Figure, axes: Sequence[Axes], norm: Normalize, label: str, extend: str = "neither"
) -> None:
    """Draws the colour scale that a row of maps shares, with a line at zero."""
    mappable = mpl.cm.ScalarMappable(norm=norm, cmap=_coloured(norm)["cmap"])
    aspect = 18 * max(len(axes) // 3, 1)
    bar = figure.colorbar(
        mappable, ax=list(axes), label=label, aspect=aspect, pad=0.01, extend=extend
    )
    if 0 < norm(0.0) < 1:
        bar.ax.axhline(0.0, color="black", lw=1)


def region_legend(
    figure: Figure, scenes: Sequence[Scene], *more: Line2D | Patch, columns: int
) -> None:
    """Draws a legend of borders, of glyphs in scenes and of more marks."""
    marks = {
        kind: Line2D([], [], **style, label=kind.replace("issuer", "person"))
        for kind, style in _GLYPHS.items()
        if kind in ("issuer", "start") or any(scene.cells_of(kind) for scene in scenes)
    }
    borders = [
        Line2D([], [], ls=_DASHES if is_dashed else "-", color="black", lw=1.4, label=label)
        for label, is_dashed in BORDERS.values()
    ]
    handles = [marks.pop("issuer"), *borders, *marks.values(), *more]
    if any(scene.circle for scene in scenes):
        label = "circle on which people talk"
        handles.append(Line2D([], [], ls=_DOTS, color="black", lw=1, label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)


def shipped() -> Figure:
    """Draws the shipped scenarios, with people in one of their places and in their first phase."""
    models = []
    for scenario in map(load_scenario, scenario_names()):
        place = scenario.layout.places[len(scenario.layout.places) // 2]
        # One place alone is compiled in no time.
        number = {"issuer.places": 1} if scenario.issuer.places else {}
        changes = {"issuer.position": place if len(place) > 1 else place[0], **number}
        models.append(compile_scenario(load_scenario(scenario, changes)))
    n_rows = math.ceil(len(models) / _COLUMNS)
    with figure_of(n_rows, _COLUMNS, (WIDTH, n_rows * _ROW + _LEGEND)) as (figure, axes):
        for axis, model in zip(axes.flat, models, strict=False):
            _draw_zones(axis, model)
            axis.set_title(model.scenario.name, loc="left", weight="bold", size=8.5, pad=3)
        signs = {".": "one of many starts", "^": "where a person looks"}
        more = [Line2D([], [], **_SIGN, marker=sign, label=text) for sign, text in signs.items()]
        scenes = map(scene_of, models)
        region_legend(figure, [*scenes], Patch(**_WALL, label="wall"), *more, columns=3)
    return figure


def _draw_zones(axis: Axes, model: Model) -> None:
    scene = scene_of(model)
    zones = np.array([ZONES.index(zone) for zone in scene.zone])
    colours = ListedColormap([RGB[zone] for zone in ZONES])
    norm = Normalize(0, len(ZONES) - 1)
    _draw_cells(
        axis, scene, _ON_ZONES, zones, cmap=colours, norm=norm, edgecolors=RGB["line"], lw=0.25
    )
    if not scene.cells_of("start"):
        axis.plot(
            *scene.position[model.cell[model.starts]].T[::-1], **_SIGN | {"ms": 2}, marker="."
        )
    axis.set(xticks=[], yticks=[], xlabel="", ylabel="", anchor="NW")


def _draw_cells(
    axis: Axes, scene: Scene, border: Style, values: NDArray[Any], **style: Any
) -> None:
    """Colours the cells by one value each, (O,), and draws walls, borders and people over them."""
    x, y = np.arange(scene.columns + 1) - 0.5, np.arange(scene.rows + 1) - 0.5
    axis.pcolormesh(x, y, values.reshape(scene.rows, scene.columns), **style)
    _dress(axis, scene, border)


def _dress(axis: Axes, scene: Scene, border: Style = _ON_VALUES) -> None:
    """Draws walls, borders, people and axes."""
    _add_area(axis, outlines(scene.is_wall.reshape(scene.rows, scene.columns)), _WALL)
    for region, (_, is_dashed) in BORDERS.items():
        style = border | {"ls": _DASHES if is_dashed else "-"}
        _add_area(axis, scene.outlines[region], style)
    if scene.circle is not None:
        row, column, radius = scene.circle
        axis.add_patch(Circle((column - 0.5, row - 0.5), radius, **border | {"ls": _DOTS}))
    for glyph in scene.glyphs:
        row, column = centre = scene.position[glyph.cell]
        nose = (centre + 2 * glyph.nose)[:, ::-1]  # without corners if nobody looks anywhere
        axis.add_patch(Polygon(nose, fc="black", ec="white", lw=0.6))
        axis.plot(column, row, **_GLYPHS[glyph.kind])
    axis.set(xlim=(-0.5, scene.columns - 0.5), ylim=(scene.rows - 0.5, -0.5), aspect="equal")
    axis.spines[:].set_visible(True)
    axis.set_xticks(range(0, scene.columns, max(scene.columns // 6, 1)))
    axis.set_yticks(range(0, scene.rows, max(scene.rows // 5, 1)))
    axis.set(xlabel="column", ylabel="row")


def _add_area(axis: Axes, loops: Sequence[Loop], style: Style) -> None:
    """Draws the cells that loops enclose, except those in holes."""
    paths = [Path(np.array([*loop, loop[0]])[:, ::-1] - 0.5, closed=True) for loop in loops]
    if paths:
        axis.add_patch(PathPatch(Path.make_compound_path(*paths), **style))
