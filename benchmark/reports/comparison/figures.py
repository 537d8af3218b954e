"""Figures of a comparison: data frames become pictures, and nothing is computed.

A learner has one colour, marker and dash in every figure. Colour and marker show its arm, and tint and dash
its observation, so that figures can be read in grey, too. A check is drawn hollow, in the colour of the
learner that it checks.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.differences import differences
from benchmark.drawing.maps import colour_bar, dots, heat, region_legend
from benchmark.drawing.style import arm_style, figure_of
from benchmark.reports.comparison.data import Context
from benchmark.reports.comparison.protocol import Learner, answer
from envs import Model
from envs.scene import colour_limits, scene_of

_DASHES: Final[dict[str, Any]] = {"index": "-", "one_hot": "-", "coordinates": (0, (4, 1.5))}
_TINTED: Final = "coordinates"  # the observation of the learners that are drawn lighter
_ENDPOINTS: Final = {"success": "success probability", "score": "score, clipped to [0, 1]"}

_N_MARKERS: Final = 6  # of a curve
_N_POINTS: Final = 4  # of a check
_CHECK_DISTANCE: Final = 0.4  # of the dots of a learner and its check, in rows
_NEARLY_GOOD: Final = 0.9  # a score by which the best learners are found for the enlarged profiles
_N_BEST: Final = 4  # learners that are drawn enlarged


def summary(
    frame: pd.DataFrame, contrasts: pd.DataFrame | None, overall: pd.DataFrame, context: Context
) -> Figure:
    """Draws how often each learner succeeds, by scenario and over all, with the answer as the title.

    Args:
      frame: `benchmark.reports.comparison.tables.summary`.
      contrasts: `benchmark.reports.comparison.tables.contrasts`, if there is a protocol.
      overall: `benchmark.reports.comparison.tables.aggregate`.
      context: Of the comparison.
    """
    scenarios, learners = list(frame["scenario"].unique()), _learners(frame, context)
    parts = {scenario: frame[frame["scenario"] == scenario] for scenario in scenarios}
    reference = None if context.protocol is None else context.protocol.reference
    is_decided = contrasts is not None and bool((contrasts["y"] == str(reference)).any())
    if len(scenarios) > 1 and not is_decided:
        parts["mean over scenarios"] = overall
    without_checks = dataclasses.replace(context, checks={})
    size = (11.0, 0.3 * len(learners) + 1.5)
    with figure_of(1, len(parts) + is_decided, size) as (figure, axes):
        for axis, (title, part) in zip(axes[0], parts.items(), strict=False):
            _dots(axis, part, ("success", "success_low", "success_high"), learners, without_checks)
            _rows(axis, learners, first=axis is axes[0, 0], tuning=context.tuning)
            axis.set(title=title, xlim=(-0.03, 1.03), xticks=(0, 0.5, 1))
        if reference in learners:
            place = learners.index(reference)
            for axis in axes[0]:
                axis.axhspan(place - 0.5, place + 0.5, color="0.93", lw=0, zorder=0)
        if is_decided and contrasts is not None:
            _differences(axes[0, -1], contrasts, learners, context)
        if context.protocol is not None and contrasts is not None:
            figure.suptitle(answer(context.protocol, contrasts), fontweight="bold")
        text = "success probability after training; bar: 95 % interval over runs"
        if is_decided:
            text += f"; last panel: difference from {reference}, margin and verdict"
        figure.supxlabel(text, fontsize="small")
    return figure


def _differences(axis: Axes, frame: pd.DataFrame, learners: Sequence[Learner], context: Context) -> None:
    """Draws how far learners are from the reference over all scenarios, with the margin and the verdicts."""
    assert context.protocol is not None
    margin = context.protocol.success_margin
    axis.axvspan(-margin, margin, color="0.85", lw=0, zorder=0)
    axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
    for place, learner in enumerate(learners):
        rows = frame[(frame["x"] == str(learner)) & (frame["y"] == str(context.protocol.reference))]
        for _, row in rows.iterrows():
            style = style_of(learner, context)
            ends = [row["success_difference_low"], row["success_difference_high"]]
            axis.plot(ends, [place, place], color=style["color"], lw=2.2, alpha=0.6)
            axis.plot(row["success_difference"], place, color=style["color"], marker=style["marker"], ms=5)
            axis.text(1.04, place, row["success_verdict"], va="center", transform=axis.get_yaxis_transform())
    _rows(axis, learners, {}, first=False)
    shown = frame[frame["y"] == str(context.protocol.reference)]
    farthest = max(float(shown[f"success_difference_{end}"].abs().max()) for end in ("low", "high"))
    reach = max(1.5 * margin, 1.1 * farthest)
    axis.set(title="mean difference", xlim=(-reach, reach), xticks=(-margin, 0, margin))


def contrasts(frame: pd.DataFrame) -> Figure:
    """Draws the protocol's contrasts.

    Args:
      frame: `benchmark.reports.comparison.tables.contrasts`.
    """
    names = [f"{row.x}\nagainst {row.y}" for row in frame.itertuples()]
    return differences(frame, names, _ENDPOINTS)


def curves(frame: pd.DataFrame, context: Context, x: str, label: str) -> Figure:
    """Draws how often learners succeed over training, with intervals.

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
    with figure_of(len(panels), len(scenarios), (11.0, 2.4 * len(panels) + 1.0)) as (figure, axes):
        for row, (title, learners) in enumerate(panels.items()):
            for column, scenario in enumerate(scenarios):
                axis = axes[row, column]
                lines(axis, frame[frame["scenario"] == scenario], x, "success", learners, context)
                axis.set(ylim=(-0.03, 1.03), title=f"{scenario}, {title}")
                axis.set(xlim=(float(frame[x].min()), float(frame[x].max())))
                if x == "cpu_time_s":
                    axis.set_xscale("log")
                else:
                    axis.xaxis.set_major_locator(MaxNLocator(4))
            axes[row, 0].set(ylabel="success probability")
        for axis in axes[-1]:
            axis.set(xlabel=label)
        legend(figure, context, signs(context))
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
                lines(axis, part, "step", "disagreements", learners, context)
                axis.set(title=f"{scenario}, {title}", xlim=(0, float(frame["step"].max())))
                axis.set(ylim=(0, float(frame["disagreements"].max()) * 1.05))
                axis.xaxis.set_major_locator(MaxNLocator(4))
            axes[row, 0].set(ylabel="wrong PINGs\nper 1,000 steps")
        for axis in axes[-1]:
            axis.set(xlabel="environment step")
        legend(figure, context, signs(context))
    return figure


def aggregate(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws success and score over all scenarios, and the best learners once more, enlarged.

    Args:
      frame: `benchmark.reports.comparison.tables.aggregate`.
      context: Of the comparison.
    """
    learners = _learners(frame, context)
    row_height = 0.44 if context.checks else 0.36
    with figure_of(1, 2 * len(_ENDPOINTS), (11.0, row_height * len(learners) + 1.5)) as (figure, axes):
        for place, (name, label) in enumerate(_ENDPOINTS.items()):
            whole, enlarged = axes[0, 2 * place], axes[0, 2 * place + 1]
            for axis in (whole, enlarged):
                _dots(axis, frame, (name, f"{name}_low", f"{name}_high"), learners, context)
                _rows(axis, learners, first=axis is axes[0, 0], tuning=context.tuning)
            enlarged.xaxis.set_major_locator(MaxNLocator(4))
            ranked = frame[~frame["algorithm"].isin({check.algorithm for check in context.checks})]
            best = ranked.nlargest(_N_BEST, name)
            lowest = float(best[f"{name}_low"].min())
            whole.set(title=label, xlim=(-0.03, 1.03), xticks=(0, 0.5, 1))
            enlarged.set(title="enlarged", xlim=(lowest - 0.1 * (1 - lowest), 1 + 0.1 * (1 - lowest)))
        text = _with_checks("mean over scenarios after training; bar: 95 % interval", context)
        figure.supxlabel(text, fontsize="small")
    return figure


def profile(frame: pd.DataFrame, context: Context) -> Figure:
    """Draws performance profiles: the share of runs that score at least a number; below, the top enlarged.

    Args:
      frame: `benchmark.reports.comparison.tables.profile`.
      context: Of the comparison, without checks; each of its panels is a column.
    """
    panels = context.panels
    shares = frame[frame["score"] == _NEARLY_GOOD].nlargest(_N_BEST, "share")["low"]
    lowest = max(min(float(shares.min()), 0.9), 0.0)
    with figure_of(2, len(panels), (11.0, 6.4)) as (figure, axes):
        for column, (title, learners) in enumerate(panels.items()):
            for axis, ends in zip(axes[:, column], ((-0.03, 1.03), (lowest, 1.004)), strict=True):
                lines(axis, frame, "score", "share", learners, context)
                axis.set(xlim=(0, 1), ylim=ends)
            axes[0, column].set(title=title)
            axes[1, column].set(title=f"{title}, enlarged", xlabel="score, at least (0 random, 1 optimal)")
        for axis in axes[:, 0]:
            axis.set(ylabel="share of runs")
        text = "line: mean over scenarios; shade: 95 % interval; scores below 0 are not drawn"
        legend(figure, context, text)
    return figure


def improvement(frame: pd.DataFrame, context: Context) -> Figure | None:
    """Draws the probability that a run of one learner scores higher than one of another, with its interval.

    Args:
      frame: `benchmark.reports.comparison.tables.improvement`.
      context: Of the comparison; the pairs are its contrasts, and every other learner with the reference.
    """
    protocol = context.protocol
    if protocol is None:
        return None
    pairs = [(str(x), str(y)) for x, y in protocol.contrasts]
    if protocol.reference is not None:
        learners = [learner for learner in context.learners if learner != protocol.reference]
        others = [(str(learner), str(protocol.reference)) for learner in learners]
        pairs += [pair for pair in others if pair not in pairs and pair[::-1] not in pairs]
    rows: Any = frame.set_index(["x", "y"])
    pairs = [pair for pair in pairs if pair in rows.index]
    if not pairs:
        return None
    with figure_of(1, 1, (8.5, 0.32 * len(pairs) + 1.3)) as (figure, axes):
        axis = axes[0, 0]
        right = axis.twinx()
        for y, pair in enumerate(pairs):
            value, low, high = (float(rows[key][pair]) for key in ("probability", "low", "high"))
            style = style_of(Learner.of(pair[0]), context)
            axis.barh(y, high - low, left=low, height=0.7, color=style["color"], alpha=0.55)
            axis.vlines(value, y - 0.35, y + 0.35, color="black", lw=1.6)
        axis.axvline(0.5, color="0.35", lw=0.8, ls=":")
        axis.set(xlim=(0, 1), xlabel="probability of improvement: left over right, ties count half")
        for each, names in zip((axis, right), zip(*pairs, strict=True), strict=True):
            each.set_yticks(range(len(pairs)), names)
            each.set(ylim=(len(pairs) - 0.5, -0.5))
            each.tick_params(axis="y", length=0)
        figure.supxlabel("line: estimate; bar: 95 % interval; exploratory, not tested", fontsize="small")
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
    label: str,
    limits: tuple[float, float] | None = None,
) -> Figure:
    """Draws the map of PING's values of every learner and scenario, on one colour scale.

    Args:
      frame: `benchmark.reports.comparison.tables.maps`.
      models: Scenario to compiled scenario, the columns; those without maps are left out.
      learners: The rows.
      label: What the colours are.
      limits: The ends of the colour scale; by default those of the middle 98 % of the values.
    """
    is_shown = np.logical_or.reduce([is_of(frame, learner) for learner in learners])
    shown = frame[is_shown & (frame["action"] == "PING")]
    models = {scenario: model for scenario, model in models.items() if model.has_cell_maps}
    norm = Normalize(*(limits or colour_limits(shown["value"].to_numpy())))
    with figure_of(len(learners), len(models), (11.0, 2.75 * len(learners) + 0.9)) as (figure, axes):
        for row, learner in enumerate(learners):
            for column, (scenario, model) in enumerate(models.items()):
                values, axis = _of(shown, learner, scenario), axes[row, column]
                heat(axis, scene_of(model), values["value"].to_numpy(), norm)
                dots(axis, values[values["marked"] > 0.5])
                axis.set(title=f"{scenario}: {', '.join(learner)}")
        colour_bar(figure, list(axes.flat), norm, label, extend="neither" if limits else "both")
        mark = "where most runs value PING"
        region_legend(figure, Line2D([], [], ls="", marker="o", color="black", ms=3, label=mark))
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
                _rows(axis, learners, {}, first=column == 0)
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


def is_of(frame: pd.DataFrame, learner: Learner) -> NDArray[np.bool_]:
    """Returns which rows are a learner's."""
    rows = (frame["algorithm"] == learner.algorithm) & (frame["observation"] == learner.observation)
    return np.asarray(rows.to_numpy())


def _of(frame: pd.DataFrame, learner: Learner, scenario: str) -> pd.DataFrame:
    """Returns the rows of a learner in a scenario."""
    return frame[is_of(frame, learner) & (frame["scenario"] == scenario).to_numpy()]


def style_of(learner: Learner, context: Context) -> dict[str, Any]:
    """Returns a learner's colour, marker and dash, the same in every figure of a comparison."""
    place = context.arms.index(learner.algorithm)
    style = arm_style(place)
    if learner.observation == _TINTED:
        style["color"] = tuple(0.5 + 0.5 * part for part in to_rgb(style["color"]))
    return {**style, "ls": _DASHES.get(learner.observation, "-")}


def lines(
    axis: Axes, frame: pd.DataFrame, x: str, y: str, learners: Sequence[Learner], context: Context
) -> None:
    """Draws lines with their intervals and some markers, and above them some points of their checks."""
    low, high = ("low", "high") if y == "share" else (f"{y}_low", f"{y}_high")
    for learner in learners:
        rows, style = frame[is_of(frame, learner)], style_of(learner, context)
        axis.plot(rows[x], rows[y], lw=1.3, ms=4, markevery=max(len(rows) // _N_MARKERS, 1), **style)
        axis.fill_between(rows[x], rows[low], rows[high], color=style["color"], alpha=0.12, lw=0)
    checks = [(check, learner) for learner in learners for check in _checks_of(learner, context)]
    for place, (check, learner) in enumerate(checks, start=1):
        rows, style = frame[is_of(frame, check)], style_of(learner, context)
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
        style, together = style_of(learner, context), [learner, *_checks_of(learner, context)]
        for place, each in enumerate(together):
            value, low, high = frame[is_of(frame, each)].iloc[0][list(columns)]
            y, is_check = row + _CHECK_DISTANCE * (place - (len(together) - 1) / 2), place > 0
            width = 1.2 if is_check else 2.2
            axis.plot([low, high], [y, y], color=style["color"], lw=width, alpha=0.6)
            fill: dict[str, Any] = (
                {"mfc": "white", "ms": 5} if is_check else {"mec": "white", "mew": 0.6, "ms": 5}
            )
            axis.plot(value, y, color=style["color"], marker=style["marker"], **fill)


def _rows(axis: Axes, learners: Sequence[Learner], tuning: Mapping[str, int], *, first: bool) -> None:
    """Names the rows of dots, from top to bottom, with how many settings were tried."""

    def name(learner: Learner) -> str:
        n_tried = tuning.get(learner.algorithm, 0)
        return f"{learner} ({n_tried} tried)" if n_tried else str(learner)

    axis.set_yticks(range(len(learners)), [name(learner) for learner in learners] if first else [])
    axis.set(ylim=(len(learners) - 0.5, -0.5))
    axis.grid(axis="y", lw=0.4, color="0.85")
    axis.tick_params(axis="y", length=0)


def signs(context: Context) -> str:
    """Returns what the signs of learning curves mean."""
    return f"line: mean over runs; shade{' or bar' if context.checks else ''}: 95 % interval"


def _with_checks(text: str, context: Context) -> str:
    """Returns what a figure says of its signs, and what it says of checks."""
    return "; ".join(filter(None, [text, context.check_note]))


def legend(figure: Figure, context: Context, title: str) -> None:
    """Draws the legend that names each learner's line."""
    learners = dict.fromkeys(learner for panel in context.panels.values() for learner in panel)
    handles = [
        Line2D([], [], label=str(learner), lw=1.3, ms=5, **style_of(learner, context)) for learner in learners
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=4,
        frameon=False,
        handlelength=3,
        title=_with_checks(title, context),
    )
