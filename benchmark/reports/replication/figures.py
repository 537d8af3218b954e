"""Figures of a replication; nothing is computed or written."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from benchmark.drawing.maps import actions, colour_bar, dots, heat, region_legend, triangles
from benchmark.drawing.style import COLOURS, figure_of, norm_of
from benchmark.reports.replication.claims import VERDICTS
from envs import Model
from envs.scene import scene_of

_DASHES: Final = ("-", "--", ":")


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
    """Draws the greedy policy's exact score, and the share of optimal agents, over training.

    Args:
      frame: `benchmark.reports.replication.tables.learning`.
      models: Scenario to compiled scenario, one line per scenario.
    """
    panels = (
        ("score", "score, mean"),
        ("score_iqm", "score, interquartile mean"),
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


def _limits(frame: pd.DataFrame, low: str, high: str) -> tuple[float, float]:
    """Returns axis limits with a little room."""
    bottom, top = float(frame[low].min()), float(frame[high].max())
    return bottom - 0.04 * (top - bottom), top + 0.04 * (top - bottom)
