"""Paints scenes with matplotlib, with one value per cell, or one per cell and move.

On the axes, x is the column and y the row of a cell's centre, so that the corners of `envs.scene` lie half
a cell off.
"""

from collections.abc import Sequence
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
from matplotlib.patches import Polygon, Rectangle
from matplotlib.patheffects import AbstractPathEffect
from numpy.typing import NDArray

from envs import ACTIONS
from envs.model import MOVES, PING
from envs.scene import ARROWHEADS, BORDERS, COLOUR_MAP, COLOURS, TRIANGLES, Scene

_DASHES: Final = (0, (2, 1.5))
_AROUND_SOLID: Final[list[AbstractPathEffect]] = [
    patheffects.Stroke(linewidth=3.2, foreground="black"),
    patheffects.Normal(),
]
_AROUND_DASHED: Final[list[AbstractPathEffect]] = [patheffects.withStroke(linewidth=2.8, foreground="black")]
_GLYPHS: Final[dict[str, dict[str, Any]]] = {
    "issuer": {"marker": "*", "ms": 9, "mfc": "white", "mec": "black", "mew": 0.8},
    "start": {"marker": "s", "ms": 5, "mfc": "none", "mec": "white", "mew": 1.2},
}
# Hatched, since the colours of values include greys.
_WALL: Final[dict[str, Any]] = {
    "fc": np.array(COLOURS["wall"]) / 255,
    "ec": np.array(COLOURS["line"]) / 255,
    "lw": 0,
    "hatch": "////",
}


def heat(axis: Axes, scene: Scene, values: NDArray[np.float64], norm: Normalize) -> None:
    """Draws one value per cell, (O,)."""
    edges = np.arange(scene.columns + 1) - 0.5, np.arange(scene.rows + 1) - 0.5
    axis.pcolormesh(*edges, values.reshape(scene.rows, scene.columns), cmap=COLOUR_MAP, norm=norm)
    _dress(axis, scene)


def triangles(axis: Axes, scene: Scene, frame: pd.DataFrame, norm: Normalize, value: str = "mean") -> None:
    """Draws one value per cell and move as a triangle on the side of the cell to which the move leads.

    Args:
      axis: Where to draw.
      scene: The map.
      frame: Columns row, column, action (moves alone) and `value`.
      norm: The colour scale.
      value: The column to draw.
    """
    centre = frame[["column", "row"]].to_numpy()[:, None, :]
    action = frame["action"].map(ACTIONS.index).to_numpy()
    polygons = PolyCollection(
        list(centre + TRIANGLES[action][..., ::-1]),
        array=frame[value].to_numpy(),
        cmap=COLOUR_MAP,
        norm=norm,
        edgecolors="face",
    )
    polygons.set_linewidth(0.2)
    axis.add_collection(polygons)
    _dress(axis, scene)


def actions(axis: Axes, scene: Scene, chosen: pd.DataFrame) -> None:
    """Draws an arrow for every chosen move and a dot for every chosen PING, except where the episode is over.

    Args:
      axis: Where to draw.
      scene: The map.
      chosen: Columns row, column, action.
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

    Args:
      axis: Where to draw.
      moves: Columns row, column, action.
    """
    centre = moves[["column", "row"]].to_numpy()[:, None, :]
    action = moves["action"].map(ACTIONS.index).to_numpy(dtype=int)
    heads = list(centre + ARROWHEADS[action][..., ::-1])
    axis.add_collection(PolyCollection(heads, facecolors="white", edgecolors="black", linewidths=0.4))


def dots(axis: Axes, cells: pd.DataFrame) -> None:
    """Draws a dot in each of these cells; columns row and column."""
    axis.plot(cells["column"], cells["row"], "o", ms=3, mfc="black", mec="white", mew=0.5)


def _dress(axis: Axes, scene: Scene) -> None:
    """Draws walls, the regions' borders and the glyphs on a map, and labels it."""
    for row, column in scene.position[scene.is_wall]:
        axis.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, **_WALL))
    for outline in scene.outlines:
        for loop in outline.loops:
            corners = np.array(loop)[:, ::-1] - 0.5
            dashes = _DASHES if outline.is_dashed else "-"
            border = Polygon(corners.tolist(), closed=True, fill=False, ec="white", lw=1.6, ls=dashes)
            border.set_path_effects(_AROUND_DASHED if outline.is_dashed else _AROUND_SOLID)
            axis.add_patch(border)
    for glyph in scene.glyphs:
        row, column = scene.position[glyph.cell]
        if glyph.heading is not None:
            nose = scene.position[glyph.cell] + 1.5 * glyph.nose
            axis.add_patch(Polygon(nose[:, ::-1].tolist(), closed=True, fc="white", ec="black", lw=0.8))
        axis.plot(column, row, ls="", **_GLYPHS[glyph.kind])
    axis.set(xlim=(-0.5, scene.columns - 0.5), ylim=(scene.rows - 0.5, -0.5), aspect="equal")
    axis.set(xlabel="column", ylabel="row")
    axis.spines[:].set_visible(True)
    axis.set_xticks(range(0, scene.columns, max(scene.columns // 6, 1)))
    axis.set_yticks(range(0, scene.rows, max(scene.rows // 5, 1)))


def colour_bar(
    figure: Figure, axes: Sequence[Axes], norm: Normalize, label: str, extend: str = "neither"
) -> None:
    """Draws the colour scale that a row of maps shares."""
    mappable = mpl.cm.ScalarMappable(norm=norm, cmap=COLOUR_MAP)
    aspect = 18 * max(len(axes) // 3, 1)
    bar = figure.colorbar(mappable, ax=list(axes), label=label, aspect=aspect, pad=0.01, extend=extend)
    if norm(0.0) > 0 and norm(0.0) < 1:
        bar.ax.axhline(0.0, color="white", lw=1.5)  # marks where the sign changes


def region_legend(figure: Figure, *more: Line2D, columns: int | None = None) -> None:
    """Draws a legend of borders, glyphs and more marks on the maps.

    Args:
      figure: Where to draw.
      *more: Further entries.
      columns: Entries in a row; by default all.
    """
    borders = [
        Line2D([], [], ls=_DASHES if is_dashed else "-", color="black", lw=1.4, label=label)
        for label, is_dashed in BORDERS.values()
    ]
    handles = [
        Line2D([], [], ls="", marker="*", mfc="white", mec="black", ms=9, label="issuer"),
        *borders,
        Line2D([], [], ls="", marker="s", mfc="none", mec="black", ms=5, label="start"),
        *more,
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns or len(handles), frameon=False)
