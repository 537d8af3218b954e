"""Figures of the report on scenarios: data frames become pictures, and nothing is computed."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, WORSE
from benchmark.drawing.style import figure_of
from benchmark.reports.comparison.data import Context
from benchmark.reports.comparison.figures import is_of, legend, lines, signs, style_of
from benchmark.reports.comparison.protocol import Learner
from benchmark.reports.scenarios.tables import ENOUGH
from envs.scene import COLOUR_MAP

_COLUMNS: Final = 4  # of panels
_SIGNS: Final = {BETTER: "▲", WORSE: "▼", EQUIVALENT: "="}  # of verdicts
_DARK: Final = 0.55  # values below are written in white


def summary(frame: pd.DataFrame, contrasts: pd.DataFrame | None, context: Context) -> Figure:
    """Draws how often every learner succeeds in every scenario, with the verdicts.

    Args:
      frame: `benchmark.reports.scenarios.tables.summary`.
      contrasts: `benchmark.reports.scenarios.tables.contrasts`, if there is a protocol.
      context: Of the comparison.
    """
    scenarios, learners = list(frame["scenario"].unique()), _learners(frame)
    reference = None if context.protocol is None else context.protocol.reference
    verdicts: dict[tuple[str, str], str] = {}
    if contrasts is not None:
        rows = contrasts[contrasts["y"] == str(reference)]
        keys = zip(rows["scenario"], rows["x"], strict=True)
        verdicts = dict(zip(keys, rows["success_verdict"], strict=True))
    values = frame.set_index(["scenario", "algorithm", "observation"])["success"]
    size = (0.95 * len(learners) + 2.2, 0.32 * len(scenarios) + 2.4)
    with figure_of(1, 1, size) as (figure, axes):
        axis = axes[0, 0]
        table = np.array([[values[scenario, *learner] for learner in learners] for scenario in scenarios])
        axis.imshow(table, cmap=COLOUR_MAP, vmin=0, vmax=1, aspect="auto")
        for row, scenario in enumerate(scenarios):
            for column, learner in enumerate(learners):
                value = table[row, column]
                sign = _SIGNS.get(verdicts.get((scenario, str(learner)), ""), "")
                ink = "white" if value < _DARK else "black"
                axis.text(column, row, f"{value:.2f} {sign}".strip(), ha="center", va="center", color=ink)
        budgets = frame.groupby(["algorithm", "observation"], sort=False)["budget"].first()
        names = [f"{learner.algorithm}\n{learner.observation}\n{budgets[learner]:,}" for learner in learners]
        axis.set_xticks(range(len(learners)), names, rotation=30, ha="left", rotation_mode="anchor")
        axis.set_yticks(range(len(scenarios)), scenarios)
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        text = "success probability after training, mean over runs; below each name, steps of training"
        if verdicts:
            text += (
                f"\nagainst {reference}: ▲ better, ▼ worse, = equivalent; no sign: undecided, no "
                "verdict "
                "or not compared"
            )
        figure.supxlabel(text, fontsize="small")
    return figure


def curves(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws how often learners succeed over training, a panel per scenario, on a logarithmic axis.

    Args:
      frame: `benchmark.reports.scenarios.tables.curves`.
      context: Of the comparison; if it has a protocol, the learners that it compares are drawn, and those
        that train longest.
    """
    scenarios, learners = list(frame["scenario"].unique()), _learners(frame)
    longest = _learners(frame[frame["step"] == frame["step"].max()])
    compared = _compared(learners, context)
    learners = [learner for learner in learners if learner in (*compared, *longest)]
    frame = frame[frame["step"] > 0]  # which has no logarithm
    n_rows = math.ceil(len(scenarios) / _COLUMNS)
    shown = replace(context, panels={"": learners}, learners=learners)
    with figure_of(n_rows, _COLUMNS, (11.0, 2.1 * n_rows + 1.0)) as (figure, axes):
        for axis, scenario in zip(axes.flat, scenarios, strict=False):
            lines(axis, frame[frame["scenario"] == scenario], "step", "success", learners, shown)
            axis.axhline(ENOUGH, color="0.35", lw=0.8, ls=":")
            axis.set(ylim=(-0.03, 1.03), title=scenario, xscale="log")
            axis.set(xlim=(float(frame["step"].min()), float(frame["step"].max())))
            axis.xaxis.set_minor_formatter(NullFormatter())
        for axis in axes.flat[len(scenarios) :]:
            axis.set_axis_off()
        for axis in axes[:, 0]:
            axis.set(ylabel="success")
        for axis in axes.flat[max(len(scenarios) - _COLUMNS, 0) : len(scenarios)]:
            axis.set(xlabel="environment step")
        legend(figure, shown, f"{signs(shown)}; dotted: {ENOUGH:g}")
    return figure


def effects(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws what each difference between two scenarios does to the learners that the protocol compares.

    Args:
      frame: `benchmark.reports.scenarios.tables.effects`.
      context: Of the comparison.
    """
    learners = _compared(_learners(frame), context)
    frame = pd.concat([frame[is_of(frame, learner)] for learner in learners])
    names = list(frame["effect"].unique())
    labels = {"success": "success", "disagreements": "disagreements per 1,000 steps"}
    size = (11.0, (0.2 * len(learners) + 0.5) * len(names) + 0.8)
    with figure_of(len(names), len(labels), size) as (figure, axes):
        for row, name in enumerate(names):
            part = frame[frame["effect"] == name]
            for column, (key, label) in enumerate(labels.items()):
                axis = axes[row, column]
                _differences(axis, part, key, learners, context)
                axis.set_yticks(range(len(learners)), map(str, learners) if column == 0 else [])
                axis.tick_params(axis="y", length=0, labelsize="small")
                axis.grid(axis="y", lw=0.4, color="0.85")
                if column == 0:
                    pair = f"{part['scenario'].iloc[0]} − {part['against'].iloc[0]}"
                    axis.set_title(f"{name}: {pair}", loc="left", fontweight="bold")
                if row == len(names) - 1:
                    axis.set(xlabel=f"difference in {label}")
        for column, key in enumerate(labels):
            reach = 1.05 * float(frame[[f"{key}_low", f"{key}_high"]].abs().to_numpy().max())
            for axis in axes[:, column]:
                axis.set(xlim=(-reach, reach), ylim=(len(learners) - 0.5, -0.5))
        text = "difference between two scenarios; bar: 95 % interval, not adjusted; exploratory"
        figure.supxlabel(text, fontsize="small")
    return figure


def _differences(
    axis: Axes, frame: pd.DataFrame, key: str, learners: Sequence[Learner], context: Context
) -> None:
    """Draws a dot with its interval for every learner, from top to bottom."""
    axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
    for place, learner in enumerate(learners):
        style = style_of(learner, context)
        for _, row in frame[is_of(frame, learner)].iterrows():
            ends = [row[f"{key}_low"], row[f"{key}_high"]]
            axis.plot(ends, [place, place], color=style["color"], lw=2.2, alpha=0.6)
            axis.plot(row[key], place, color=style["color"], marker=style["marker"], ms=5)


def _compared(learners: Sequence[Learner], context: Context) -> list[Learner]:
    """Returns the learners that the protocol compares; all, if there is no protocol."""
    if context.protocol is None:
        return list(learners)
    return [learner for learner in learners if learner in context.protocol.compared]


def _learners(frame: pd.DataFrame) -> list[Learner]:
    """Lists the learners in a frame, in its order."""
    pairs = dict.fromkeys(zip(frame["algorithm"], frame["observation"], strict=True))
    return [Learner(*pair) for pair in pairs]
