"""Figures of a replication; nothing is computed or written."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from benchmark.drawing.maps import actions, colour_bar, dots, heat, region_legend, triangles
from benchmark.drawing.style import COLOURS, figure_of, norm_of
from benchmark.reports.replication.claims import VERDICTS, weakest
from envs import Model
from envs.scene import scene_of

_DASHES: Final = ("-", "--", ":")
# Of verdicts: colours that differ in brightness, too.
_COLOURS: Final = dict(zip(VERDICTS, (COLOURS[9], "#f7ecc3", COLOURS[3]), strict=True))
_SIGNS: Final = dict(zip(VERDICTS, ("✓", "?", "✗"), strict=True))


def replication(curves: pd.DataFrame, values: pd.DataFrame, models: Mapping[str, Model]) -> Figure:
    """Draws the paper's figure: max Q per step, final Q of the moves, final Q of PING; S1 to S3.

    Args:
      curves: `benchmark.reports.replication.tables.max_q`.
      values: `benchmark.reports.replication.tables.q_values`.
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
            scene = scene_of(model)
            triangles(axes[1, column], scene, moves[moves["scenario"] == name], norm_of(moves["mean"]))
            axes[1, column].set(title=f"({letters[len(models) + column]}) moves, {name}")
            ping = pings[pings["scenario"] == name]
            heat(axes[2, column], scene, ping["mean"].to_numpy(), norm_of(pings["mean"]))
            axes[2, column].set(title=f"({letters[2 * len(models) + column]}) PING, {name}")
            dots(axes[2, column], ping[ping["mean"] > 0])
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
    """Draws success and score of the greedy policy, and the share of optimal agents, over training.

    Args:
      frame: `benchmark.reports.replication.tables.learning`.
      models: Scenario to compiled scenario, one line per scenario.
    """
    panels = (
        ("success", "success probability"),
        ("score", "mean score, clipped to [0, 1]"),
        ("optimal_share", "share of agents that are optimal"),
    )
    with figure_of(1, len(panels), (11.0, 3.6)) as (figure, axes):
        for axis, (key, label) in zip(axes[0], panels, strict=True):
            for i, name in enumerate(models):
                rows = frame[frame["scenario"] == name]
                style = {"color": COLOURS[i], "ls": _DASHES[i % len(_DASHES)]}
                axis.plot(rows["step"], rows[key], label=name, **style)
                axis.fill_between(
                    rows["step"], rows[f"{key}_low"], rows[f"{key}_high"], color=COLOURS[i], alpha=0.25, lw=0
                )
            axis.set(xlabel="environment step", title=label, xlim=(0, max(frame["step"].max(), 1)))
            axis.set(ylim=(-0.03, 1.03))
            axis.xaxis.set_major_locator(MaxNLocator(4))
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=len(models), frameon=False,
            title="line: mean over agents; shade: 95 % interval",
        )  # fmt: skip
    return figure


def optimal(cells: pd.DataFrame, models: Mapping[str, Model]) -> Figure:
    """Draws the exact optimum, what learning made of it, and where greedy actions are not optimal.

    Args:
      cells: `benchmark.reports.replication.tables.optimal_cells`.
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
            scene = scene_of(model)
            for row, (key, _) in enumerate(rows):
                shown = np.where(scene.is_over, np.nan, best.loc[name][key].to_numpy())
                heat(axes[row, column], scene, shown, norm_of(best[key]))
                axes[row, column].set(title=name)
            chosen = cells[(cells["scenario"] == name) & cells["is_optimal"]]
            actions(axes[0, column], scene, chosen)
        for row, (key, label) in enumerate(rows):
            colour_bar(figure, axes[row], norm_of(best[key]), label)
        region_legend(
            figure,
            Line2D([], [], ls="", marker=">", mfc="white", mec="black", ms=6, label="optimal move"),
            Line2D([], [], ls="", marker="o", color="black", ms=3, label="optimal PING"),
        )
    return figure


def claims(frame: pd.DataFrame) -> Figure:
    """Draws every part of every claim with its interval and its threshold, one panel per claim.

    Args:
      frame: Columns claim, part, agents, value, low, high, right_side, threshold, verdict; in the order to be
        drawn.
    """
    names = frame["claim"].unique()
    sizes = sorted(frame["agents"].unique())
    styles = [{"color": "0.45", "marker": "s", "mfc": "white"}, {"color": COLOURS[0], "marker": "o"}]
    styles = styles[-len(sizes) :]
    columns = 3
    n_rows = -(-len(names) // columns)
    with figure_of(n_rows, columns, (11.0, 2.5 * n_rows)) as (figure, axes):
        for axis in axes.flat[len(names) :]:
            axis.set_visible(False)
        for axis, name in zip(axes.flat, names, strict=False):
            rows = frame[frame["claim"] == name]
            parts = list(rows["part"].unique())
            side, threshold = rows[["right_side", "threshold"]].iloc[0]
            for i, size in enumerate(sizes):
                shown = rows[(rows["agents"] == size) & rows["value"].map(np.isfinite)]
                places = shown["part"].map(parts.index) + 0.3 * (i - (len(sizes) - 1) / 2)
                ends = (shown["value"] - shown["low"], shown["high"] - shown["value"])
                axis.errorbar(
                    shown["value"], places, xerr=np.maximum(ends, 0), ls="", ms=4.5, capsize=2.5, **styles[i]
                )
            axis.margins(x=0.1)
            axis.axvline(threshold, color="black", lw=0.9, ls="--")
            low, high = axis.get_xlim()
            ends = (threshold, high) if side == ">" else (low, threshold)
            axis.axvspan(*ends, color=COLOURS[9], alpha=0.3, lw=0, zorder=0)
            axis.set(xlim=(low, high), ylim=(len(parts) - 0.4, -0.6))
            axis.set_yticks(range(len(parts)), parts)
            axis.xaxis.set_major_locator(MaxNLocator(4))
            verdicts = [rows.loc[rows["agents"] == size, "verdict"].iloc[0] for size in sizes]
            axis.set_title(f"{name}  {' '.join(_SIGNS[verdict] for verdict in verdicts)}")
        handles: list[Artist] = [
            Line2D([], [], ls="", ms=4.5, label=f"{size:,} agents", **style)
            for size, style in zip(sizes, styles, strict=True)
        ]
        handles.append(Line2D([], [], color="black", lw=0.9, ls="--", label="threshold"))
        handles.append(Patch(color=COLOURS[9], alpha=0.3, lw=0, label="right side"))
        order = f", with {' and '.join(f'{size:,}' for size in sizes)} agents" if len(sizes) > 1 else ""
        meaning = ", ".join(f"{sign} {verdict}" for verdict, sign in _SIGNS.items())
        figure.legend(
            handles=handles,
            loc="outside lower center",
            ncols=len(handles),
            frameon=False,
            title=f"bars: 95 % intervals; verdict on the claim{order}: {meaning}",
        )
    return figure


def sensitivity(frame: pd.DataFrame) -> Figure:
    """Draws the verdict on every claim under every reading.

    Args:
      frame: Columns claim, reading, value, right_side, threshold, state, verdict; in the order to be drawn.
    """
    names, readings = frame["claim"].unique(), frame["reading"].unique()
    with figure_of(1, 1, (11.0, 4.4)) as (figure, axes):
        axis = axes[0, 0]
        for _, row in weakest(frame, "reading").iterrows():
            x, y = list(readings).index(row["reading"]), list(names).index(row["claim"])
            colour, value = _COLOURS[row["verdict"]], row["value"]
            axis.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="white", lw=2))
            shown = f"{value:.{3 if abs(value) >= 0.01 else 1}g}" if np.isfinite(value) else "-"
            axis.text(x, y, f"{_SIGNS[row['verdict']]}  {shown}", ha="center", va="center")
        axis.set(xlim=(-0.5, len(readings) - 0.5), ylim=(len(names) - 0.5, -0.5))
        axis.set_xticks(range(len(readings)), readings)
        claims = frame.drop_duplicates("claim")
        axis.set_yticks(
            range(len(names)),
            [f"{row['claim']}  ({row['right_side']} {row['threshold']:g})" for _, row in claims.iterrows()],
        )
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        figure.legend(
            handles=[Patch(color=_COLOURS[v], label=f"{_SIGNS[v]}  {v}") for v in VERDICTS],
            loc="outside lower center",
            ncols=3,
            frameon=False,
            title="number: the value of the claim's weakest part; in brackets: where all parts must lie",
        )
    return figure


def _limits(frame: pd.DataFrame, low: str, high: str) -> tuple[float, float]:
    """Returns axis limits with a little room."""
    bottom, top = float(frame[low].min()), float(frame[high].max())
    return bottom - 0.04 * (top - bottom), top + 0.04 * (top - bottom)
