"""Data frames become figures, one function a published figure; nothing is computed or written.

Here are the figures of a replication and what all figures share; `benchmark.figures_comparison` has those
of a comparison. Colour maps rise in lightness, so that they read the same to colour-blind eyes and in grey;
lines differ by dash as well as by colour.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib import patheffects
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from benchmark.claims import VERDICTS
from envs import ACTIONS, Model
from envs.model import MOVES, PING

COLOURS: Final = sns.color_palette("colorblind")
_DASHES: Final = ("-", "--", ":")
_MAP: Final = "cividis"
_RC: Final = {
    **sns.axes_style("ticks"),
    **sns.plotting_context("paper", font_scale=1.1),
    "svg.hashsalt": "proxemic",  # else every drawing gets identifiers of its own
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "font.sans-serif": ["DejaVu Sans"],
}
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


def write_figure(figure: Figure, stem: Path) -> None:
    """Writes a figure as `stem.png` and `stem.svg`, the same bytes for the same figure."""
    with plt.rc_context(_RC):
        figure.savefig(stem.with_suffix(".png"), dpi=160, metadata={"Software": None})
        figure.set_layout_engine("none")  # the layout stands; computing it again takes seconds
        figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None, "Creator": None})
    plt.close(figure)


def replication(curves: pd.DataFrame, values: pd.DataFrame, models: Mapping[str, Model]) -> Figure:
    """Draws the paper's figure: max Q per step, final Q of the moves, final Q of PING; S1 to S3.

    Args:
      curves: `benchmark.aggregate.max_q`.
      values: `benchmark.aggregate.q_values`.
      models: Scenario to compiled scenario, the columns of the figure.
    """
    letters = "abcdefghijklmnopqrstuvwxyz"  # as the paper's panels
    with figure_of(3, len(models), (11.0, 9.6)) as (figure, axes):
        moves = values[values["action"] != "PING"]
        pings = values[values["action"] == "PING"]
        for column, (name, model) in enumerate(models.items()):
            curve = curves[curves["scenario"] == name]
            axis = axes[0, column]
            axis.fill_between(curve["step"], curve["min"], curve["max"], color=COLOURS[9], alpha=0.55, lw=0)
            axis.plot(curve["step"], curve["mean"], color=COLOURS[0], lw=0.9)
            axis.axhline(1.0, color="0.35", lw=0.8, ls=":")
            axis.set(title=f"({letters[column]}) max Q, {name}: {model.scenario.issuer.feedback.label}")
            axis.set(
                xlabel="environment step",
                xlim=(0, max(curve["step"].max(), 1)),
                ylim=_limits(curves, "min", "max"),
            )
            triangles(axes[1, column], model, moves[moves["scenario"] == name], norm_of(moves["mean"]))
            axes[1, column].set(title=f"({letters[len(models) + column]}) moves, {name}")
            ping = pings.loc[pings["scenario"] == name, "mean"].to_numpy()
            heat(axes[2, column], model, ping, norm_of(pings["mean"]))
            axes[2, column].set(title=f"({letters[2 * len(models) + column]}) PING, {name}")
            positive = np.flatnonzero(ping > 0)
            row, cell_column = np.divmod(positive, model.scenario.grid.columns)
            axes[2, column].plot(cell_column, row, "o", ms=3, mfc="black", mec="white", mew=0.5)
        axes[0, 0].set(ylabel="max Q of the visited cell")
        axes[0, 0].legend(
            [
                Line2D([], [], color=COLOURS[0]),
                Patch(color=COLOURS[9], alpha=0.55, lw=0),
                Line2D([], [], color="0.35", lw=0.8, ls=":"),
            ],
            ["mean of the agents", "least to largest agent", "what a right PING pays in S1"],
            loc="upper left",
            frameon=False,
        )
        colour_bar(figure, axes[1], norm_of(moves["mean"]), "mean final Q of the moves")
        colour_bar(figure, axes[2], norm_of(pings["mean"]), "mean final Q of PING")
        region_legend(
            figure,
            Line2D([], [], ls="", marker=">", mfc="0.7", mec="none", ms=7, label="the move that way"),
            Line2D([], [], ls="", marker="o", color="black", ms=3, label="mean Q of PING > 0"),
        )
    return figure


def learning(frame: pd.DataFrame, models: Mapping[str, Model]) -> Figure:
    """Draws the greedy policy's exact score, and the share of optimal agents, over training.

    Args:
      frame: `benchmark.aggregate.learning`.
      models: Scenario to compiled scenario, one line each.
    """
    panels = (
        ("score", "score, mean"),
        ("score_iqm", "score, interquartile mean"),
        ("optimal_share", "share of agents that are optimal"),
    )
    with figure_of(1, len(panels), (11.0, 3.6)) as (figure, axes):
        for axis, (key, label) in zip(axes[0], panels, strict=True):
            for i, name in enumerate(models):
                one = frame[frame["scenario"] == name]
                style = {"color": COLOURS[i], "ls": _DASHES[i % len(_DASHES)]}
                axis.plot(one["step"], one[key], label=name, **style)
                axis.fill_between(
                    one["step"], one[f"{key}_low"], one[f"{key}_high"], color=COLOURS[i], alpha=0.25, lw=0
                )
            axis.set(xlabel="environment step", title=label, xlim=(0, max(frame["step"].max(), 1)))
            axis.xaxis.set_major_locator(MaxNLocator(4))
            if key != "optimal_share":
                axis.axhline(1.0, color="0.35", lw=0.8, ls=":")
                axis.axhline(0.0, color="0.35", lw=0.8, ls=":")
                axis.set(ylabel="0 random policy, 1 optimal policy")
        axes[0, 2].set(ylim=(-0.03, 1.03))
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=len(models), frameon=False,
            title="line: over agents, as the panel says; shade: 95 % interval",
        )  # fmt: skip
    return figure


def optimal(cells: pd.DataFrame, models: Mapping[str, Model]) -> Figure:
    """Draws the exact optimum, what learning made of it, and where greedy actions are not optimal.

    Args:
      cells: `benchmark.aggregate.optimal_cells`.
      models: Scenario to compiled scenario, the columns of the figure.
    """
    by_cell = cells.groupby(["scenario", "row", "column"], sort=False)
    best = by_cell[["q_optimal", "largest_learned", "differs"]].max()
    best["difference"] = best["largest_learned"] - best["q_optimal"]
    best["agrees"] = 1 - best["differs"]
    rows = (
        ("q_optimal", "optimal value of the cell"),
        ("difference", "learned minus optimal value"),
        ("agrees", "share of agents acting optimally"),
    )
    with figure_of(3, len(models), (11.0, 9.6)) as (figure, axes):
        for column, (name, model) in enumerate(models.items()):
            over = model.terminated[: model.n_observations].all(axis=1)  # the issuer's cell: no actions
            for row, (key, _) in enumerate(rows):
                shown = np.where(over, np.nan, best.loc[name][key].to_numpy())
                heat(axes[row, column], model, shown, norm_of(best[key]))
                axes[row, column].set(title=name)
            chosen = cells[(cells["scenario"] == name) & cells["is_optimal"]]
            _actions(axes[0, column], model, chosen)
        for row, (key, label) in enumerate(rows):
            colour_bar(figure, axes[row], norm_of(best[key]), label)
        region_legend(
            figure,
            Line2D([], [], ls="", marker=">", mfc="white", mec="black", ms=6, label="optimal move"),
            Line2D([], [], ls="", marker="o", color="black", ms=3, label="optimal PING"),
        )
    return figure


def sensitivity(frame: pd.DataFrame) -> Figure:
    """Draws the verdict on every claim under every reading.

    Args:
      frame: Columns claim, reading, value, threshold, verdict; in the order to be drawn.
    """
    claims, readings = frame["claim"].unique(), frame["reading"].unique()
    colours = dict(zip(VERDICTS, (COLOURS[9], "#f0e0a0", COLOURS[3]), strict=True))
    signs = dict(zip(VERDICTS, ("✓", "(✓)", "✗"), strict=True))
    with figure_of(1, 1, (11.0, 4.4)) as (figure, axes):
        axis = axes[0, 0]
        for claim, reading, value, verdict in frame[["claim", "reading", "value", "verdict"]].to_numpy():
            x, y = list(readings).index(reading), list(claims).index(claim)
            axis.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colours[verdict], ec="white", lw=2))
            axis.text(
                x,
                y,
                f"{signs[verdict]}  {value:.{3 if abs(value) >= 0.01 else 1}g}",
                ha="center",
                va="center",
            )
        axis.set(xlim=(-0.5, len(readings) - 0.5), ylim=(len(claims) - 0.5, -0.5))
        axis.set_xticks(range(len(readings)), readings)
        thresholds = frame.drop_duplicates("claim")["threshold"]
        axis.set_yticks(range(len(claims)), [f"{c}  ({t})" for c, t in zip(claims, thresholds, strict=True)])
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        figure.legend(
            handles=[Patch(color=colours[v], label=f"{signs[v]}  {v}") for v in VERDICTS],
            loc="outside lower center",
            ncols=3,
            frameon=False,
            title="number: the value of the claim's weakest part; in brackets: where all parts must lie",
        )
    return figure


@contextmanager
def figure_of(rows: int, columns: int, size: tuple[float, float]) -> Iterator[tuple[Figure, NDArray[Any]]]:
    """Makes a figure in the project's style; axes are (rows, columns)."""
    with plt.rc_context(_RC):
        figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
        yield figure, axes
        for axis in axes.flat:
            if axis.get_aspect() != "auto":
                axis.label_outer()  # maps of a figure share their rows and columns


def norm_of(values: pd.Series) -> Normalize:
    """Returns one colour scale for all these values."""
    return Normalize(float(values.min()), float(values.max()))


def _limits(frame: pd.DataFrame, low: str, high: str) -> tuple[float, float]:
    """Returns axis limits with a little room."""
    bottom, top = float(frame[low].min()), float(frame[high].max())
    return bottom - 0.04 * (top - bottom), top + 0.04 * (top - bottom)


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


def _actions(axis: Axes, model: Model, chosen: pd.DataFrame) -> None:
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
