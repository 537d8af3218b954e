"""Draws scenes with matplotlib: maps of values and actions, and a gallery of scenarios.

On the axes, x is the column and y the row of a cell's centre; in `envs.scene`, of its upper left corner.
"""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path
from numpy.typing import NDArray

from benchmark.drawing.style import figure_of
from envs import ACTIONS, Model
from envs.model import MOVES, PING
from envs.regions import Loop, outlines
from envs.scenario import FEEDBACK
from envs.scene import ARROWHEADS, BORDERS, COLOUR_MAP, COLOURS, DIVERGING, TRIANGLES, Scene, scene_of

RGB: Final = {kind: "#{:02x}{:02x}{:02x}".format(*colour) for kind, colour in COLOURS.items()}
Style = dict[str, Any]  # keyword arguments of an artist

_DASHES: Final = (0, (2, 1.5))
_SOLID: Final = {"dash_offset": 0, "dash_list": None}
_ON_VALUES: Final[Style] = {  # white on black
    "ec": "white",
    "lw": 1.6,
    "path_effects": [patheffects.withStroke(linewidth=3, foreground="black", dashes=_SOLID)],
}
_ON_ZONES: Final[Style] = {"ec": "black", "lw": 0.8}
_GLYPHS: Final[dict[str, Style]] = {
    "issuer": {"ls": "", "marker": "*", "ms": 9, "mfc": "white", "mec": "black", "mew": 0.8},
    "start": {"ls": "", "marker": "s", "ms": 5, "mfc": "white", "mec": "black", "mew": 0.8},
}
# Hatched, since the colours of values include greys.
_WALL: Final[Style] = {"fc": RGB["wall"], "ec": RGB["line"], "lw": 0, "hatch": "////"}
_ONE_OF_MANY: Final[Style] = {"ls": "", "marker": ".", "ms": 3, "color": "black"}
_WAY: Final[Style] = {"color": RGB["person"], "lw": 0.9, "ls": ":"}

# Of the gallery
_COLUMNS: Final = 6
_CHARACTERS: Final = 30  # of a line of text below one map
_MOST_MAPS: Final = 4  # of a scenario; of those with more places or phases, three are shown
_MAP, _GAP, _LINE, _LEGEND = 1.36, 0.07, 0.125, 0.65  # inches: a map, between maps, a line of text, a legend


def heat(axis: Axes, scene: Scene, values: NDArray[np.float64], norm: Normalize) -> None:
    """Draws one value per cell, (O,)."""
    x, y = np.arange(scene.columns + 1) - 0.5, np.arange(scene.rows + 1) - 0.5
    axis.set_facecolor(RGB["over"])
    axis.pcolormesh(x, y, values.reshape(scene.rows, scene.columns), **_coloured(norm), linewidth=0.2)
    _dress(axis, scene, _ON_VALUES)


def triangles(axis: Axes, scene: Scene, frame: pd.DataFrame, norm: Normalize, value: str = "mean") -> None:
    """Draws one value per cell and move as a triangle on the side of the cell to which the move leads.

    The frame has columns row, column, action (moves alone) and the one that is drawn.
    """
    shapes, values = _shapes(frame, TRIANGLES), frame[value].to_numpy()
    axis.add_collection(PolyCollection(shapes, array=values, **_coloured(norm), linewidths=0.2))
    _dress(axis, scene, _ON_VALUES)


def discs(axis: Axes, frame: pd.DataFrame, norm: Normalize, value: str) -> None:
    """Draws one value per cell as a disc in its middle; columns row, column and the one that is drawn."""
    style: Style = _coloured(norm) | {"edgecolors": RGB["line"], "linewidths": 0.4}
    style |= {"offsets": frame[["column", "row"]].to_numpy(), "offset_transform": axis.transData}
    values = frame[value].to_numpy()
    axis.add_collection(EllipseCollection([0.4], [0.4], [0], units="xy", array=values, **style))


def actions(axis: Axes, scene: Scene, chosen: pd.DataFrame) -> None:
    """Draws an arrow for every chosen move and a dot for every chosen PING, except where the episode is over.

    The frame has columns row, column and action.
    """
    cell = chosen["row"] * scene.columns + chosen["column"]
    chosen = chosen[~scene.is_over[cell.to_numpy(dtype=int)]]
    dots(axis, chosen[chosen["action"] == "PING"])
    moves = chosen[chosen["action"] != "PING"]
    step = MOVES[moves["action"].map(ACTIONS[:PING].index).to_numpy(dtype=int)]
    axis.quiver(
        moves["column"], moves["row"], step[:, 1], step[:, 0],
        angles="xy", scale_units="xy", scale=2.6, width=0.009, color="white", ec="black", lw=0.4,
    )  # fmt: skip


def arrowheads(axis: Axes, moves: pd.DataFrame) -> None:
    """Draws an arrow head for every move, beside the centre of its cell, so that several fit into one.

    The frame has columns row, column and action.
    """
    shapes = _shapes(moves, ARROWHEADS)
    axis.add_collection(PolyCollection(shapes, facecolors="white", edgecolors="black", linewidths=0.4))


def dots(axis: Axes, cells: pd.DataFrame) -> None:
    """Draws a dot in each of these cells; columns row and column."""
    axis.plot(cells["column"], cells["row"], "o", ms=3, mfc="black", mec="white", mew=0.5)


def colour_map(norm: Normalize) -> str:
    """Returns the name of the colours of a scale; if zero is in its middle, zero is white."""
    return DIVERGING if norm.vmin == -(norm.vmax or 0.0) else COLOUR_MAP


def _coloured(norm: Normalize) -> Style:
    # Edges have the same colour, since the background would shine through between cells.
    return {"cmap": colour_map(norm), "norm": norm, "edgecolors": "face"}


def colour_bar(
    figure: Figure, axes: Sequence[Axes], norm: Normalize, label: str, extend: str = "neither"
) -> None:
    """Draws the colour scale that a row of maps shares, and on it a line at zero."""
    mappable = mpl.cm.ScalarMappable(norm=norm, cmap=colour_map(norm))
    aspect = 18 * max(len(axes) // 3, 1)
    bar = figure.colorbar(mappable, ax=list(axes), label=label, aspect=aspect, pad=0.01, extend=extend)
    if 0 < norm(0.0) < 1:
        bar.ax.axhline(0.0, color="black", lw=1)


def region_legend(figure: Figure, *more: Line2D | Patch, columns: int | None = None) -> None:
    """Draws a legend of borders, glyphs and more marks, in one row or in a number of columns."""
    borders = [
        Line2D([], [], ls=_DASHES if is_dashed else "-", color="black", lw=1.4, label=label)
        for label, is_dashed in BORDERS.values()
    ]
    person, start = (Line2D([], [], label=kind, **style) for kind, style in _GLYPHS.items())
    handles = [person, *borders, start, *more]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns or len(handles), frameon=False)


def gallery(models: Sequence[Model]) -> Figure:
    """Draws the maps of scenarios, with their names above, and cells, observations and what is hidden below.

    Scenarios that differ only in what is observed share their maps. If the issuer has several positions or
    phases, up to four maps are shown. A group of maps goes to the first row that has room for it.
    """
    groups: dict[object, list[Model]] = {}
    for model in models:
        same = {"name": "", "description": "", "observe": ("agent",)}
        groups.setdefault(model.scenario.model_copy(update=same), []).append(model)
    rows: list[list[tuple[str, str, Model, int]]] = []  # maps: title, text below, scenario and context
    for group in groups.values():
        shown = _shown(group[0])
        row = next((row for row in rows if len(row) + len(shown) <= _COLUMNS), None)
        if row is None:
            rows.append(row := [])
        for i, context in enumerate(shown):
            title = "" if i else ", ".join(model.scenario.name for model in group)
            about = [] if i else _about(group, _CHARACTERS * len(shown))
            text = "\n".join(filter(None, [_label(group[0], context), *about]))
            row.append((title, text, group[0], context))
    n_lines = max(text.count("\n") + 1 for row in rows for _, text, *_ in row)
    below = _LINE * (n_lines + 2)  # text, and the title of the next row
    width, height = _COLUMNS * (_MAP + _GAP) + _GAP, len(rows) * (_MAP + below) + _LEGEND
    with figure_of(len(rows), _COLUMNS, (width, height)) as (figure, axes):
        figure.set_layout_engine(None)
        figure.subplots_adjust(
            left=_GAP / width, right=1 - _GAP / width, wspace=_GAP / _MAP, hspace=below / _MAP,
            top=1 - 2 * _LINE / height, bottom=(_LEGEND + below - 2 * _LINE) / height,
        )  # fmt: skip
        for axis in axes.flat:
            axis.set_axis_off()
        for row, row_axes in zip(rows, axes, strict=True):
            for axis, (title, text, model, context) in zip(row_axes, row, strict=False):
                _draw_zones(axis, model, context)
                axis.set_title(title, loc="left", weight="bold", size=8, pad=3)
                axis.annotate(
                    text, (0, 0), (0, -4), xycoords="axes fraction", textcoords="offset points",
                    va="top", size=6.5, linespacing=1.25,
                )  # fmt: skip
        region_legend(
            figure,
            Line2D([], [], **_ONE_OF_MANY, label="one of many starts"),
            Line2D([], [], **_WAY, label="way of the issuer"),
            Patch(**_WALL, label="wall"),
            Line2D([], [], ls="", marker="^", color="black", ms=4, label="where a person looks"),
            columns=3,
        )
    return figure


def _shown(model: Model) -> list[int]:
    """Returns which positions and phases of a scenario the gallery shows, see `Model.context`."""
    n_contexts = model.n_places * len(model.scenario.stages)
    n_shown = n_contexts if n_contexts <= _MOST_MAPS else 3
    return [i * n_contexts // n_shown for i in range(n_shown)]


def _label(model: Model, context: int) -> str:
    """Returns which position and phase a map shows; empty if there is only one."""
    position, phase = divmod(context, len(model.scenario.stages))
    parts = [f"place {position + 1} of {model.n_places}"] if model.n_places > 1 else []
    if (n_phases := len(model.scenario.stages)) > 1:
        name = model.scenario.stages[phase].name
        parts.append(f"phase {name} of {n_phases}" if name.isdecimal() else name)
    return ", ".join(parts)


def _about(group: Sequence[Model], width: int) -> list[str]:
    """Returns the lines of text below the maps of scenarios; the width is in characters."""
    first = group[0].scenario
    kinds = {first.issuer.feedback.kind, *(person.feedback.kind for person in first.others)}
    feedback = sorted(FEEDBACK[kind] for kind in kinds)
    about = [f"{first.grid.rows * first.grid.columns} cells, {' and '.join(feedback)}"]
    for model in group:
        hidden = in_words(model.scenario.hidden) or "nothing"
        seen = f"{model.n_observations:,} observations"
        if len(group) > 1:
            about.append(f"{model.scenario.name}: {seen}; hidden: {hidden}")
        else:
            about += [seen, f"hidden: {hidden}"]
    return [line for sentence in about for line in wrap(sentence, width)]


def in_words(parts: Sequence[str]) -> str:
    """Returns parts of the state as readers see them."""
    return ", ".join(parts).replace("wrong_pings", "wrong PINGs")


def _draw_zones(axis: Axes, model: Model, context: int) -> None:
    """Draws a map of the regions, with all starts of the agent and the way of an issuer who moves."""
    scene, n_phases = scene_of(model, context), len(model.scenario.stages)
    zones = np.array(scene.zone).reshape(scene.rows, scene.columns)
    axis.set_facecolor(RGB["outside"])
    for zone in dict.fromkeys(scene.zone):
        if zone != "outside":
            add_area(axis, outlines(zones == zone), {"fc": RGB[zone], "lw": 0})
    lines: Style = {"colors": [RGB["line"]], "lw": 0.25, "zorder": 1.1}
    axis.vlines(np.arange(1, scene.columns) - 0.5, -0.5, scene.rows - 0.5, **lines)
    axis.hlines(np.arange(1, scene.rows) - 0.5, -0.5, scene.columns - 0.5, **lines)
    if model.scenario.moves:
        way = np.array([people[0].position for people in model.scenario.people[context // n_phases]])
        axis.plot(*np.vstack([way, way[:1]])[:, ::-1].T, **_WAY)
    if not scene.cells_of("start"):
        is_here = model.context[model.starts] // n_phases == context // n_phases
        axis.plot(*scene.position[model.cell[model.starts[is_here]]].T[::-1], **_ONE_OF_MANY)
    _dress(axis, scene, _ON_ZONES, scale=0.7)
    axis.set_axis_on()
    axis.set(xticks=[], yticks=[], xlabel="", ylabel="", anchor="NW")


def _dress(axis: Axes, scene: Scene, border: Style, scale: float = 1.0) -> None:
    """Draws walls, borders of the regions and glyphs on a map, and labels its axes."""
    add_area(axis, outlines(scene.is_wall.reshape(scene.rows, scene.columns)), _WALL)
    for outline in scene.outlines:
        dashes = _DASHES if outline.is_dashed else "-"
        add_area(axis, outline.loops, {"fill": False, "ls": dashes} | border)
    for glyph in scene.glyphs:
        row, column = scene.position[glyph.cell]
        if glyph.heading is not None:
            nose = scene.position[glyph.cell] + 2 * glyph.nose
            axis.add_patch(Polygon(nose[:, ::-1].tolist(), closed=True, fc="black", ec="white", lw=0.6))
        axis.plot(column, row, **_GLYPHS[glyph.kind] | {"ms": scale * _GLYPHS[glyph.kind]["ms"]})
    axis.set(xlim=(-0.5, scene.columns - 0.5), ylim=(scene.rows - 0.5, -0.5), aspect="equal")
    axis.set(xlabel="column", ylabel="row")
    axis.spines[:].set_visible(True)
    row, column = scene.origin or (0, 0)
    n_columns, n_rows = max(scene.columns // 6, 1), max(scene.rows // 5, 1)  # between ticks
    axis.set_xticks(range(column % n_columns, scene.columns, n_columns))
    axis.set_yticks(range(row % n_rows, scene.rows, n_rows))
    if scene.origin:
        axis.set(xlabel="columns from the issuer", ylabel="rows from the issuer")
        axis.xaxis.set_major_formatter(lambda x, _: f"{x - column:g}".replace("-", "−"))
        axis.yaxis.set_major_formatter(lambda y, _: f"{y - row:g}".replace("-", "−"))


def add_area(axis: Axes, loops: Sequence[Loop], style: Style) -> None:
    """Draws the cells that loops enclose, except those in holes."""
    paths = [Path(np.array([*loop, loop[0]])[:, ::-1] - 0.5, closed=True) for loop in loops]
    if paths:
        axis.add_patch(PathPatch(Path.make_compound_path(*paths), **style))


def _shapes(frame: pd.DataFrame, of_move: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Returns the corners, (x, y), of a shape in each row's cell, given those of moves, (4, n, 2)."""
    action = frame["action"].map(ACTIONS.index).to_numpy(dtype=int)
    return list(frame[["column", "row"]].to_numpy()[:, None, :] + of_move[action][..., ::-1])
