"""Figures of a comparison: data frames become pictures, and nothing is computed.

Colour and marker show the arm, so that figures can be read in grey, too; dashes show the observation. A check
is drawn hollow, in the colour and with the marker of the arm that it checks.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.maps import colour_bar, dots, heat, region_legend, triangles
from benchmark.drawing.style import arm_style, figure_of
from benchmark.reports.comparison.data import Context, Learner
from benchmark.reports.comparison.tables import METRICS
from envs import Model
from envs.scene import colour_limits, scene_of

_DASHES: Final = {"index": "-", "one_hot": "-", "coordinates": (0, (4, 1.5))}
_FLOOR: Final = -4.0  # scores below are not drawn
_LABELS: Final = {
    "score": "score (0 random, 1 optimal)",
    "iqm": "interquartile mean",
    "median": "median",
    "mean": "mean",
    "optimality_gap": "optimality gap",
}

_N_MARKERS: Final = 6  # of a curve
_N_POINTS: Final = 4  # of a check
_CHECK_DISTANCE: Final = 0.4  # of the dots of a learner and its check, in rows


def curves(frame: pd.DataFrame, context: Context, x: str, label: str) -> Figure:
    """Draws the mean score of the greedy policy over training, with its interval.

    The mean shows runs that fail, which the interquartile mean leaves out.

    Args:
      frame: `benchmark.reports.comparison.tables.curves` or `curves_cpu`.
      context: Of the comparison; each of its panels is a row.
      x: The column to draw against; seconds are drawn on a logarithmic axis.
      label: What it is.
    """
    panels = context.panels
    scenarios = list(frame["scenario"].unique())
    if x == "cpu_time_s":
        frame = frame[frame["step"] > 0]  # no time has passed, which has no logarithm
    with figure_of(len(panels), len(scenarios), (11.0, 2.6 * len(panels) + 1.0)) as (figure, axes):
        for row, (title, learners) in enumerate(panels.items()):
            for column, scenario in enumerate(scenarios):
                axis = axes[row, column]
                _curves(axis, frame[frame["scenario"] == scenario], x, "score_mean", learners, context)
                axis.axhline(1.0, color="0.35", lw=0.8, ls=":")
                axis.axhline(0.0, color="0.35", lw=0.8, ls=":")
                lowest = max(float(frame["score_mean"].min()) - 0.15, _FLOOR)
                axis.set(ylim=(lowest, 1.15), title=f"{scenario}, {title}")
                axis.set(xlim=(float(frame[x].min()), float(frame[x].max())))
                if x == "cpu_time_s":
                    axis.set_xscale("log")
                else:
                    axis.xaxis.set_major_locator(MaxNLocator(4))
            axes[row, 0].set(ylabel=_LABELS["score"])
        for axis in axes[-1]:
            axis.set(xlabel=label)
        _legend(figure, context, f"{_signs(context)}; scores below {_FLOOR:g} are not drawn")
    return figure


def disagreements(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws how often the issuer disagreed while agents learned.

    Args:
      frame: `benchmark.reports.comparison.tables.curves`.
      context: Of the comparison; each of its panels is a row.
    """
    panels = context.panels
    frame = frame[frame["step"] > 0]  # nothing is counted before the first step
    scenarios = list(frame["scenario"].unique())
    with figure_of(len(panels), len(scenarios), (11.0, 2.4 * len(panels) + 1.0)) as (figure, axes):
        for row, (title, learners) in enumerate(panels.items()):
            for column, scenario in enumerate(scenarios):
                axis = axes[row, column]
                part = frame[frame["scenario"] == scenario]
                _curves(axis, part, "step", "disagreements", learners, context)
                axis.set(title=f"{scenario}, {title}", xlim=(0, float(frame["step"].max())))
                axis.set(ylim=(0, float(frame["disagreements"].max()) * 1.05))
                axis.xaxis.set_major_locator(MaxNLocator(4))
            axes[row, 0].set(ylabel="wrong PINGs\nper 1,000 steps")
        for axis in axes[-1]:
            axis.set(xlabel="environment step")
        _legend(figure, context, _signs(context))
    return figure


def aggregate(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws rliable's aggregates over all scenarios with their intervals.

    Args:
      frame: `benchmark.reports.comparison.tables.aggregate`.
      context: Of the comparison.
    """
    shown = frame[(frame["policy"] == "greedy") & (frame["evaluated_from"] == "start")]
    learners = _learners(shown, context)
    row_height = 0.44 if context.checks else 0.36
    with figure_of(1, len(METRICS), (11.0, row_height * len(learners) + 1.5)) as (figure, axes):
        for column, metric in enumerate(METRICS):
            axis = axes[0, column]
            _dots(axis, shown[shown["metric"] == metric], ("value", "low", "high"), learners, context)
            _rows(axis, learners, first=column == 0)
            axis.set(title=_LABELS[metric], xlabel="score missed" if metric == "optimality_gap" else "score")
            axis.xaxis.set_major_locator(MaxNLocator(4))
            best = 0.0 if metric == "optimality_gap" else 1.0
            axis.axvline(best, color="0.35", lw=0.8, ls=":", zorder=0)
        text = _with_checks("greedy policies after training, all scenarios; bar: 95 % interval", context)
        figure.supxlabel(text, fontsize="small")
    return figure


def profile(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws performance profiles: the share of runs whose score is above a number.

    Args:
      frame: `benchmark.reports.comparison.tables.profile`.
      context: Of the comparison, without checks; each of its panels is a column.
    """
    panels = context.panels
    with figure_of(1, len(panels), (11.0, 4.2)) as (figure, axes):
        for column, (title, learners) in enumerate(panels.items()):
            axis = axes[0, column]
            _curves(axis, frame, "score", "share", learners, context)
            axis.set(title=title, xlabel="score (0 random, 1 optimal)", xlim=(0, 1), ylim=(-0.03, 1.03))
        axes[0, 0].set(ylabel="share of runs above that score")
        _legend(
            figure, context, "line: all scenarios alike; shade: 95 % interval; scores below 0 are not drawn"
        )
    return figure


def improvement(frame: pd.DataFrame) -> Figure:
    """Draws the probability that a run of one learner outscores one of another.

    Args:
      frame: `benchmark.reports.comparison.tables.improvement`.
    """
    names = list(dict.fromkeys(frame["x"]))
    names += [name for name in dict.fromkeys(frame["y"]) if name not in names]
    wide = frame.pivot(index="x", columns="y", values="probability").loc[names, names]
    with figure_of(1, 1, (9.0, 6.0)) as (figure, axes):
        axis = axes[0, 0]
        image = axis.imshow(wide.to_numpy(), cmap="cividis", norm=Normalize(0, 1), aspect="auto")
        for x, y, p, low, high in frame[["x", "y", "probability", "low", "high"]].to_numpy():
            sure = low > 0.5 or high < 0.5
            axis.text(
                names.index(y), names.index(x), f"{p:.2f}{'*' if sure else ''}",
                ha="center", va="center", fontsize="small", color="black" if p > 0.55 else "white",
            )  # fmt: skip
        axis.set_xticks(range(len(names)), [name.replace(", ", ",\n") for name in names], rotation=90)
        axis.set_yticks(range(len(names)), names)
        axis.set(ylabel="how probably a run of this learner", xlabel="outscores a run of this one")
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        figure.colorbar(image, ax=axis, label="probability; * its 95 % interval excludes 0.5")
    return figure


def threshold(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws the share of runs that reach a good score, and the share that stays there.

    Args:
      frame: `benchmark.reports.comparison.tables.threshold`.
      context: Of the comparison.
    """
    labels = {
        "reached_share": f"share of runs that ever score {GOOD_SCORE:g}",
        "stays_share": "share that stays there to the end",
    }
    return _by_scenario(frame, labels, context)


def region(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws how well the cells where agents value PING match the target region.

    Args:
      frame: `benchmark.reports.comparison.tables.region`.
      context: Of the comparison.
    """
    labels = {"precision": "precision", "recall": "recall", "overlap": "intersection over union"}
    return _by_scenario(frame, labels, context)


def maps(
    frame: pd.DataFrame,
    models: Mapping[str, Model],
    learners: Sequence[Learner],
    action: str,
    label: str,
    limits: tuple[float, float] | None = None,
) -> Figure:
    """Draws the same map of every learner and scenario, on one colour scale.

    Args:
      frame: `benchmark.reports.comparison.tables.maps`.
      models: Scenario to compiled scenario, the columns.
      learners: The rows.
      action: `"PING"`, or `"moves"` for all others at once.
      label: What the colours are.
      limits: The ends of the colour scale; by default those of the middle 98 % of the values.
    """
    is_ping = frame["action"] == "PING"
    is_shown = np.logical_or.reduce([_is(frame, learner) for learner in learners])
    shown = frame[is_shown & (is_ping if action == "PING" else ~is_ping)]
    norm = Normalize(*(limits or colour_limits(shown["value"].to_numpy())))
    with figure_of(len(learners), len(models), (11.0, 2.75 * len(learners) + 0.9)) as (figure, axes):
        for row, learner in enumerate(learners):
            for column, (scenario, model) in enumerate(models.items()):
                values, axis, scene = _of(shown, learner, scenario), axes[row, column], scene_of(model)
                if action == "PING":
                    heat(axis, scene, values["value"].to_numpy(), norm)
                    dots(axis, values[values["marked"] > 0.5])
                else:
                    triangles(axis, scene, values, norm, "value")
                axis.set(title=f"{scenario}: {', '.join(learner)}")
        colour_bar(figure, list(axes.flat), norm, label, extend="neither" if limits else "both")
        marks = {
            "PING": Line2D(
                [], [], ls="", marker="o", color="black", ms=3, label="where most runs value PING"
            ),
            "moves": Line2D(
                [], [], ls="", marker=">", mfc="0.7", mec="none", ms=7, label="the move that way"
            ),
        }
        region_legend(figure, marks[action])
    return figure


def _by_scenario(frame: pd.DataFrame, labels: Mapping[str, str], context: Context) -> Figure:
    """Draws columns that lie in [0, 1] as dots with intervals: a row a scenario, a panel a column."""
    scenarios, learners = list(frame["scenario"].unique()), _learners(frame, context)
    row_height = 0.36 if context.checks else 0.27
    size = (11.0, (row_height * len(learners) + 0.75) * len(scenarios) + 0.4)
    with figure_of(len(scenarios), len(labels), size) as (figure, axes):
        for row, scenario in enumerate(scenarios):
            for column, (name, label) in enumerate(labels.items()):
                axis = axes[row, column]
                part, names = frame[frame["scenario"] == scenario], (name, f"{name}_low", f"{name}_high")
                _dots(axis, part, names, learners, context)
                _rows(axis, learners, first=column == 0)
                axis.set(title=f"{scenario}: {label}", xlim=(-0.03, 1.03))
        figure.supxlabel(_with_checks("bar: 95 % interval over runs", context), fontsize="small")
    return figure


def _learners(frame: pd.DataFrame, context: Context) -> list[Learner]:
    """Lists the learners in a frame that are no checks, in its order."""
    pairs = dict.fromkeys(zip(frame["algorithm"], frame["observation"], strict=True))
    return [learner for pair in pairs if (learner := Learner(*pair)) not in context.checks]


def _checks_of(learner: Learner, context: Context) -> list[Learner]:
    """Lists the checks of a learner."""
    return [check for check, checked in context.checks.items() if checked == learner]


def _is(frame: pd.DataFrame, learner: Learner) -> NDArray[np.bool_]:
    """Returns which rows are a learner's."""
    rows = (frame["algorithm"] == learner.algorithm) & (frame["observation"] == learner.observation)
    return np.asarray(rows.to_numpy())


def _of(frame: pd.DataFrame, learner: Learner, scenario: str) -> pd.DataFrame:
    """Returns the rows of a learner in a scenario."""
    return frame[_is(frame, learner) & (frame["scenario"] == scenario).to_numpy()]


def _style(learner: Learner, context: Context) -> dict[str, Any]:
    """Returns a learner's colour, marker and dash, the same in every figure of a comparison."""
    place = context.arms.index(learner.algorithm)
    return {**arm_style(place), "ls": _DASHES.get(learner.observation, "-")}


def _curves(
    axis: Axes, frame: pd.DataFrame, x: str, y: str, learners: Sequence[Learner], context: Context
) -> None:
    """Draws lines with their intervals and some markers, and above them some points of their checks."""
    low, high = ("low", "high") if y == "share" else (f"{y}_low", f"{y}_high")
    for learner in learners:
        rows, style = frame[_is(frame, learner)], _style(learner, context)
        axis.plot(rows[x], rows[y], lw=1.3, ms=4, markevery=max(len(rows) // _N_MARKERS, 1), **style)
        axis.fill_between(rows[x], rows[low], rows[high], color=style["color"], alpha=0.12, lw=0)
    checks = [(check, learner) for learner in learners for check in _checks_of(learner, context)]
    for place, (check, learner) in enumerate(checks, start=1):
        rows, style = frame[_is(frame, check)], _style(learner, context)
        every = math.ceil(len(rows) / _N_POINTS)
        rows = rows.iloc[every * place // (len(checks) + 1) :: every]  # not where those of others are
        axis.vlines(rows[x], rows[low], rows[high], color=style["color"], ls=style["ls"], lw=0.8, zorder=3)
        axis.plot(rows[x], rows[y], **{**style, "ls": ""}, ms=5, mfc="white", zorder=3)


def _dots(
    axis: Axes,
    frame: pd.DataFrame,
    columns: tuple[str, str, str],
    learners: Sequence[Learner],
    context: Context,
) -> None:
    """Draws dots with intervals, each learner's with those of its checks below; nothing for a missing number.

    Args:
      axis: Where.
      frame: A row per learner.
      columns: The number, and the ends of its interval.
      learners: From top to bottom.
      context: Of the comparison.
    """
    for row, learner in enumerate(learners):
        style, together = _style(learner, context), [learner, *_checks_of(learner, context)]
        for place, each in enumerate(together):
            value, low, high = frame[_is(frame, each)].iloc[0][list(columns)]
            y, is_check = row + _CHECK_DISTANCE * (place - (len(together) - 1) / 2), place > 0
            width = 1.2 if is_check else 2.2
            axis.plot([low, high], [y, y], color=style["color"], ls=style["ls"], lw=width, alpha=0.6)
            fill: dict[str, Any] = (
                {"mfc": "white", "ms": 5} if is_check else {"mec": "white", "mew": 0.6, "ms": 6}
            )
            axis.plot(value, y, color=style["color"], marker=style["marker"], **fill)


def _rows(axis: Axes, learners: Sequence[Learner], *, first: bool) -> None:
    """Names the rows of dots, from top to bottom."""
    axis.set_yticks(range(len(learners)), [str(learner) for learner in learners] if first else [])
    axis.set(ylim=(len(learners) - 0.5, -0.5))
    axis.grid(axis="y", lw=0.4, color="0.85")
    axis.tick_params(axis="y", length=0)


def _signs(context: Context) -> str:
    """Returns what the signs of learning curves mean."""
    return f"line: mean over runs; shade{' or bar' if context.checks else ''}: 95 % interval"


def _with_checks(text: str, context: Context) -> str:
    """Returns what a figure says of its signs, and what it says of checks."""
    return "; ".join(filter(None, [text, context.check_note]))


def _legend(figure: Figure, context: Context, title: str) -> None:
    """Draws the legend that names each learner's line."""
    learners = dict.fromkeys(learner for panel in context.panels.values() for learner in panel)
    handles = [
        Line2D([], [], label=str(learner), lw=1.3, ms=5, **_style(learner, context)) for learner in learners
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=4,
        frameon=False,
        handlelength=3,
        title=_with_checks(title, context),
    )
