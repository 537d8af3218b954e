"""Draws scenes with matplotlib: maps of values and actions, and galleries of scenarios.

On the axes, x is the column and y the row of a cell's centre; in `envs.scene`, of its upper left corner.
"""

import math
from collections.abc import Sequence
from textwrap import wrap
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch, Polygon
from matplotlib.path import Path
from numpy.typing import ArrayLike, NDArray

from benchmark.drawing.style import WIDTH, colour_map, figure_of
from envs import ACTIONS, Model, compile_scenario, load_scenario, scenario_names
from envs.model import PING
from envs.regions import Loop, outlines
from envs.scene import ARROWHEADS, BORDERS, COLOUR_MAP, COLOURS, DIVERGING, TRIANGLES, Scene, scene_of

RGB: Final = {kind: "#{:02x}{:02x}{:02x}".format(*colour) for kind, colour in COLOURS.items()}
Style = dict[str, Any]  # keyword arguments of an artist

_DASHES: Final = (0, (2, 1.5))
_SOLID: Final = {"dash_offset": 0, "dash_list": None}
_BLACK: Final = patheffects.withStroke(linewidth=3, foreground="black", dashes=_SOLID)
_WHITE: Final = patheffects.withStroke(linewidth=1.6, foreground="white", dashes=_SOLID)
_ON_VALUES: Final[Style] = {"ec": "white", "lw": 1.6, "path_effects": [_BLACK]}
_ON_ZONES: Final[Style] = {"ec": "black", "lw": 0.8}
_GLYPHS: Final[dict[str, Style]] = {
    "issuer": {"ls": "", "marker": "*", "ms": 9, "mfc": "white", "mec": "black", "mew": 0.8},
    "bystander": {"ls": "", "marker": "o", "ms": 7, "mfc": "white", "mec": "black", "mew": 1.2},
    "onlooker": {"ls": "", "marker": "D", "ms": 4, "mfc": "0.8", "mec": "black", "mew": 0.8},
    "start": {"ls": "", "marker": "s", "ms": 5, "mfc": "white", "mec": "black", "mew": 0.8},
}
# Hatched, since the colours of values include greys.
_WALL: Final[Style] = {"fc": RGB["wall"], "ec": RGB["line"], "lw": 0, "hatch": "////"}
_DOTTED: Final = (0, (1, 1.5))
_CIRCLE: Final[Style] = {"fill": False, "ec": "black", "ls": _DOTTED, "lw": 0.8}
_ONE_OF_MANY: Final[Style] = {"ls": "", "marker": ".", "ms": 3, "color": "black"}

_TIE: Final = 1e-9  # moves whose probabilities differ by less are equally likely

# The gallery: maps in a row and of a scenario, characters in a line of names
_COLUMNS, _MAX_MAPS, _CHARACTERS = 5, 4, 17
_ROW, _LEGEND, _POINTS = 1.65, 0.7, 8.5  # inches of a row and of the legend; the size of texts
_NOT_ON_A_MAP: Final[Any] = dict.fromkeys(("name", "description", "observe"), True) | {"issuer": {"feedback"}}


def heat(axis: Axes, scene: Scene, values: NDArray[np.float64], norm: Normalize) -> None:
    """Draws one value per cell, (O,)."""
    x, y = np.arange(scene.columns + 1) - 0.5, np.arange(scene.rows + 1) - 0.5
    axis.set_facecolor(RGB["over"])
    axis.pcolormesh(x, y, values.reshape(scene.rows, scene.columns), **_coloured(norm), linewidth=0.2)
    _dress(axis, scene, _ON_VALUES)


def draw_policy(axis: Axes, model: Model, policy: NDArray[np.float64], norm: Normalize) -> None:
    """Draws action probabilities, (O, A), in the first context: PING as colours, the likeliest as marks."""
    scene, chances = scene_of(model), policy[model.observation[model.states_of(0)]]  # (C, A)
    is_likeliest = chances >= chances.max(axis=1, keepdims=True) - _TIE
    is_likeliest[:, PING] &= chances.argmax(axis=1) == PING  # no move is as likely
    heat(axis, scene, np.where(scene.is_over, np.nan, chances[:, PING]), norm)
    mark(axis, scene, is_likeliest)


def policy_legend(figure: Figure, axes: Sequence[Axes], model: Model, norm: Normalize) -> None:
    """Draws the colour scale and the legend of policies."""
    colour_bar(figure, axes, norm, "probability of PING")
    ping = Line2D([], [], ls="", marker="o", color="black", ms=4, label="PING is the likeliest action")
    move = Line2D([], [], ls="", marker=">", color="black", ms=4, label="likeliest moves")
    region_legend(figure, [scene_of(model)], ping, move, columns=2)


def triangles(axis: Axes, scene: Scene, frame: pd.DataFrame, norm: Normalize) -> None:
    """Draws means by row, column and move as triangles on the sides to which the moves lead."""
    corners = TRIANGLES[frame["action"].map(ACTIONS.index).to_numpy(dtype=int)]
    shapes = list(frame[["column", "row"]].to_numpy()[:, None, :] + corners[..., ::-1])
    values = frame["mean"].to_numpy()
    axis.add_collection(PolyCollection(shapes, array=values, **_coloured(norm), linewidths=0.2))
    _dress(axis, scene, _ON_VALUES)


def mark(axis: Axes, scene: Scene, is_marked: NDArray[np.bool_]) -> None:
    """Marks actions, (C, A), where the episode goes on: small arrow heads, of which four fit, and dots."""
    cell, action = np.nonzero(is_marked & ~scene.is_over[:, None])
    is_ping = action == PING
    centres = scene.position[cell][:, None]
    shapes = (centres[~is_ping] + ARROWHEADS[action[~is_ping]])[..., ::-1]
    axis.add_collection(PolyCollection(list(shapes), facecolors="white", edgecolors="black", linewidths=0.4))
    dots(axis, *scene.position[cell[is_ping]].T)


def dots(axis: Axes, rows: ArrayLike, columns: ArrayLike) -> None:
    """Draws a dot in every cell."""
    axis.plot(columns, rows, "o", ms=3, mfc="black", mec="white", mew=0.5)


def _coloured(norm: Normalize) -> Style:
    colours = DIVERGING if norm.vmin == -(norm.vmax or 0.0) else COLOUR_MAP  # where zero is white, or not
    # Edges have the same colour, since the background would shine through between cells.
    return {"cmap": colour_map(colours), "norm": norm, "edgecolors": "face"}


def colour_bar(
    figure: Figure, axes: Sequence[Axes], norm: Normalize, label: str, extend: str = "neither"
) -> None:
    """Draws the colour scale that a row of maps shares, with a line at zero."""
    mappable = mpl.cm.ScalarMappable(norm=norm, cmap=_coloured(norm)["cmap"])
    aspect = 18 * max(len(axes) // 3, 1)
    bar = figure.colorbar(mappable, ax=list(axes), label=label, aspect=aspect, pad=0.01, extend=extend)
    if 0 < norm(0.0) < 1:
        bar.ax.axhline(0.0, color="black", lw=1)


def region_legend(figure: Figure, scenes: Sequence[Scene], *more: Line2D | Patch, columns: int) -> None:
    """Draws a legend of borders, of glyphs in scenes and of more marks."""
    borders = [
        Line2D([], [], ls=_DASHES if is_dashed else "-", color="black", lw=1.4, label=label)
        for label, is_dashed in BORDERS.values()
    ]
    marks = {kind: Line2D([], [], label=kind, **style) for kind, style in _GLYPHS.items()}
    marks["issuer"].set_label("person")
    handles = [marks["issuer"], *borders, marks["start"], *more]
    if any(scene.circle for scene in scenes):
        label = "circle on which people talk"
        handles.append(Line2D([], [], ls=_DOTTED, color="black", lw=1, label=label))
    kinds = ("bystander", "onlooker")
    handles += [marks[kind] for kind in kinds if any(scene.cells_of(kind) for scene in scenes)]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)


def shipped() -> Figure:
    """Draws maps of the shipped scenarios, each with people in one of their places, and its names above.

    Scenarios that differ only in what is observed or in feedback share their maps. If people have several
    phases, which are then named below, up to four maps are shown.
    """
    groups: dict[str, list[Model]] = {}
    for scenario in map(load_scenario, scenario_names()):
        place = scenario.layout.places[len(scenario.layout.places) // 2]
        # One place alone is compiled in no time.
        changes: dict[str, Any] = {"issuer.position": place if len(place) > 1 else place[0]}
        changes |= {"onlookers.ways": 1} if scenario.onlookers else {}
        model = compile_scenario(load_scenario(scenario, changes))
        groups.setdefault(model.scenario.model_dump_json(exclude=_NOT_ON_A_MAP), []).append(model)
    maps = []
    for group in groups.values():
        n_phases = len(group[0].scenario.layout.stages)
        maps += [(group, phase) for phase in range(0, n_phases, math.ceil(n_phases / _MAX_MAPS))]
    n_rows = math.ceil(len(maps) / _COLUMNS)
    with figure_of(n_rows, _COLUMNS, (WIDTH, n_rows * _ROW + _LEGEND)) as (figure, axes):
        figure.set_layout_engine("constrained", h_pad=0.1)
        for axis, (group, phase) in zip(axes.flat, maps, strict=False):
            _draw_zones(axis, group[0], phase)
            names = [] if phase else wrap(", ".join(model.scenario.name for model in group), _CHARACTERS)
            axis.set_title("\n".join(names), loc="left", weight="bold", size=_POINTS, pad=3)
            axis.annotate(
                _phase(group[0], phase), (0, 0), (0, -3), xycoords="axes fraction",
                textcoords="offset points", va="top", size=_POINTS,
            )  # fmt: skip
        scenes, wall = [scene_of(group[0], phase) for group, phase in maps], Patch(**_WALL, label="wall")
        start = Line2D([], [], **_ONE_OF_MANY, label="one of many starts")
        nose = Line2D([], [], ls="", marker="^", color="black", ms=4, label="where a person looks")
        region_legend(figure, scenes, start, wall, nose, columns=3)
    return figure


def _phase(model: Model, phase: int) -> str:
    name = scene_of(model, phase).phase
    # People who walk have numbered phases.
    return f"phase {name} of {len(model.scenario.layout.stages)}" if name.isdecimal() else name


def _draw_zones(axis: Axes, model: Model, phase: int) -> None:
    scene = scene_of(model, phase)
    zones = np.array(scene.zone).reshape(scene.rows, scene.columns)
    axis.set_facecolor(RGB["outside"])
    for zone in dict.fromkeys(scene.zone):
        add_area(axis, outlines((zones == zone) & (zones != "outside")), {"fc": RGB[zone], "lw": 0})
    lines: Style = {"colors": [RGB["line"]], "lw": 0.25, "zorder": 1.1}
    axis.vlines(np.arange(1, scene.columns) - 0.5, -0.5, scene.rows - 0.5, **lines)
    axis.hlines(np.arange(1, scene.rows) - 0.5, -0.5, scene.columns - 0.5, **lines)
    if not scene.cells_of("start"):
        axis.plot(*scene.position[model.cell[model.starts]].T[::-1], **_ONE_OF_MANY)
    _dress(axis, scene, _ON_ZONES, scale=0.7)
    axis.set(xticks=[], yticks=[], xlabel="", ylabel="", anchor="NW")


def _dress(axis: Axes, scene: Scene, border: Style, scale: float = 1.0) -> None:
    add_area(axis, outlines(scene.is_wall.reshape(scene.rows, scene.columns)), _WALL)
    for region, (_, is_dashed) in BORDERS.items():
        add_area(axis, scene.outlines[region], {"fill": False, "ls": _DASHES if is_dashed else "-"} | border)
    if scene.circle is not None:
        row, column, radius = scene.circle
        style = _CIRCLE | ({"path_effects": [_WHITE]} if border is _ON_VALUES else {})
        axis.add_patch(Circle((column - 0.5, row - 0.5), radius, **style))
    for glyph in scene.glyphs:
        row, column = scene.position[glyph.cell]
        if glyph.heading is not None:
            nose = scene.position[glyph.cell] + 2 * glyph.nose
            axis.add_patch(Polygon(nose[:, ::-1].tolist(), closed=True, fc="black", ec="white", lw=0.6))
        axis.plot(column, row, **_GLYPHS[glyph.kind] | {"ms": scale * _GLYPHS[glyph.kind]["ms"]})
    axis.set(xlim=(-0.5, scene.columns - 0.5), ylim=(scene.rows - 0.5, -0.5), aspect="equal")
    axis.spines[:].set_visible(True)
    axis.set_xticks(range(0, scene.columns, max(scene.columns // 6, 1)))
    axis.set_yticks(range(0, scene.rows, max(scene.rows // 5, 1)))
    axis.set(xlabel="column", ylabel="row")


def add_area(axis: Axes, loops: Sequence[Loop], style: Style) -> None:
    """Draws the cells that loops enclose, except those in holes."""
    paths = [Path(np.array([*loop, loop[0]])[:, ::-1] - 0.5, closed=True) for loop in loops]
    if paths:
        axis.add_patch(PathPatch(Path.make_compound_path(*paths), **style))
