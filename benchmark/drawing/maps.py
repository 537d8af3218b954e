"""Maps of a scene, drawn by matplotlib: one value a cell, or one a cell and move."""

from collections.abc import Sequence
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from envs import ACTIONS, Model
from envs.model import MOVES, PING

_MAP: Final = "cividis"
_OUTLINE: Final = [patheffects.Stroke(linewidth=3.2, foreground="black"), patheffects.Normal()]
# Corners of a cell's triangles, (action, corner, (x, y)) from its centre, y downwards: one a move.
_TRIANGLES: Final = np.array(
    [
        [(-0.5, -0.5), (0.5, -0.5), (0, 0)],
        [(-0.5, 0.5), (0.5, 0.5), (0, 0)],
        [(-0.5, -0.5), (-0.5, 0.5), (0, 0)],
        [(0.5, -0.5), (0.5, 0.5), (0, 0)],
    ]
)


def heat(axis: Axes, model: Model, values: NDArray[np.float64], norm: Normalize) -> None:
    """Draws one value a cell, (O,)."""
    grid = model.scenario.grid
    edges = np.arange(grid.columns + 1) - 0.5, np.arange(grid.rows + 1) - 0.5
    axis.pcolormesh(*edges, values.reshape(grid.rows, grid.columns), cmap=_MAP, norm=norm)
    _dress(axis, model)


def triangles(axis: Axes, model: Model, frame: pd.DataFrame, norm: Normalize, value: str = "mean") -> None:
    """Draws one value a cell and move, each as the triangle that points its way."""
    centre = frame[["column", "row"]].to_numpy()[:, None, :]
    action = frame["action"].map(ACTIONS.index).to_numpy()
    polygons = PolyCollection(
        list(centre + _TRIANGLES[action]),
        array=frame[value].to_numpy(),
        cmap=_MAP,
        norm=norm,
        edgecolors="face",
    )
    polygons.set_linewidth(0.2)
    axis.add_collection(polygons)
    _dress(axis, model)


def actions(axis: Axes, model: Model, chosen: pd.DataFrame) -> None:
    """Draws an arrow for every chosen move and a dot for every chosen PING, outside the issuer's cell."""
    issuer = model.scenario.issuer.position
    chosen = chosen[(chosen["row"] != issuer[0]) | (chosen["column"] != issuer[1])]
    pings = chosen[chosen["action"] == "PING"]
    axis.plot(pings["column"], pings["row"], "o", ms=3, mfc="black", mec="white", mew=0.5)
    moves = chosen[chosen["action"] != "PING"]
    step = MOVES[moves["action"].map(ACTIONS[:PING].index).to_numpy(dtype=int)]
    axis.quiver(
        moves["column"], moves["row"], step[:, 1], step[:, 0],
        angles="xy", scale_units="xy", scale=2.6, width=0.009, color="white", ec="black", lw=0.4,
    )  # fmt: skip


def _dress(axis: Axes, model: Model) -> None:
    """Draws regions, issuer and start on a map, and labels it."""
    grid, regions = model.scenario.grid, model.scenario.regions
    row, column = model.scenario.issuer.position
    for radius, dash in ((regions.target_radius, "-"), (regions.uncomfortable_radius, (0, (2, 1.5)))):
        top, bottom = max(row - radius, 0) - 0.5, min(row + radius, grid.rows - 1) + 0.5
        left, right = max(column - radius, 0) - 0.5, min(column + radius, grid.columns - 1) + 0.5
        box = Rectangle((left, top), right - left, bottom - top, fill=False, ec="white", lw=1.6, ls=dash)
        box.set_path_effects(
            _OUTLINE if dash == "-" else [patheffects.withStroke(linewidth=2.8, foreground="black")]
        )
        axis.add_patch(box)
    axis.plot(column, row, "*", ms=9, mfc="white", mec="black", mew=0.8)
    axis.plot(grid.start[1], grid.start[0], "s", ms=5, mfc="none", mec="white", mew=1.2)
    axis.set(xlim=(-0.5, grid.columns - 0.5), ylim=(grid.rows - 0.5, -0.5), aspect="equal")
    axis.set(xlabel="column", ylabel="row")
    axis.spines[:].set_visible(True)
    axis.set_xticks(range(0, grid.columns, 2))
    axis.set_yticks(range(0, grid.rows, 2))


def colour_bar(
    figure: Figure, axes: Sequence[Axes], norm: Normalize, label: str, extend: str = "neither"
) -> None:
    """Draws the one colour scale of a row of maps."""
    mappable = mpl.cm.ScalarMappable(norm=norm, cmap=_MAP)
    aspect = 18 * max(len(axes) // 3, 1)
    bar = figure.colorbar(mappable, ax=list(axes), label=label, aspect=aspect, pad=0.01, extend=extend)
    if norm(0.0) > 0 and norm(0.0) < 1:
        bar.ax.axhline(0.0, color="white", lw=1.5)  # signs are what the claims are about


def region_legend(figure: Figure, *more: Line2D) -> None:
    """Says what the marks on the maps are."""
    handles = [
        Line2D([], [], ls="", marker="*", mfc="white", mec="black", ms=9, label="issuer"),
        Line2D([], [], color="black", lw=1.4, label="target region's outer edge"),
        Line2D([], [], ls=(0, (2, 1.5)), color="black", lw=1.4, label="uncomfortable region's edge"),
        Line2D([], [], ls="", marker="s", mfc="none", mec="black", ms=5, label="start"),
        *more,
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
