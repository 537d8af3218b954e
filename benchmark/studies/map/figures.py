"""Figures of a map: steps and success along an axis and at one point."""

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import ScaledTranslation

from benchmark.drawing.style import figure_of
from benchmark.experiments import Experiment
from benchmark.studies.data import style_of
from benchmark.studies.item import drawing
from benchmark.studies.map import tables
from benchmark.studies.map.analysis import MapAnalysis
from benchmark.studies.map.declared import Panel, axis_of

_MIN_STEPS: Final = 100  # smaller numbers are drawn as this one
_FONT_SIZE: Final = 8.5
_HEIGHT, _LINE = 160.0, 9.5  # points of an axis and of a line of text
_NAME_WIDTH: Final = 18  # characters of a line of a name at its curve
_NAME_DISTANCE: Final = 13  # points from the end of a curve to its name
_ROOM: Final = 0.6  # for names at the right of curves, as a share of their width
_TICK_DISTANCE: Final = 0.07  # smallest distance of the texts of two ticks, as a share of the axis
_NEVER: Final = "never learns"
_LABELS: Final = {"groups": "places", "room": "cells"}  # of axes
_WHAT: Final = {
    "steps": "steps until it has learned\n(fewer is better)",
    "unseen_budget": "success in unseen places\nafter {:,} steps (more is better)",
}


@drawing(
    "answer",
    "the answer: at one point, the steps that learners need, and their success in unseen places",
    "Median steps until a run has learned, on a logarithmic scale, and mean success after all steps of "
    "training with the person in places that did not occur in it. Bands: 95 % intervals; thin lines: from "
    "the fastest to the slowest pick of settings; hollow, at the budget: at least half of the runs never "
    "learn.",
)
def answer(analysis: MapAnalysis, _: pd.DataFrame) -> Figure | None:
    """Draws the declared point, if there is one, with a row for each learner and for each heading."""
    declared, experiment, cells = analysis.data.declared.answer, analysis.data.experiment, analysis.cells
    if declared is None:
        return None
    cells = cells[(cells["grid"] == declared.grid) & (cells["point"] == declared.point)]
    lines = list[tuple[str, str]]()  # texts, and names of learners, which headings lack
    for group in declared.groups:
        lines += [(group.title, "")] * bool(group.title)
        lines += [(text, name) for name, text in group.learners.items()]
    rows, budget = dict(cells.iterrows()), cells["budget"].max()
    scenes = {each.condition.axes["grid"]: each.scenario for each in experiment.populations}
    who = "people" if scenes[declared.grid].group else "the person"
    with figure_of(1, 2, (7.2, 1.3 + 0.26 * len(lines))) as (figure, axes):
        steps, success = axes[0]
        for y, (text, name) in enumerate(lines):
            if name:
                style = style_of(name, experiment, observation="")
                _draw_row(steps, y, rows[name], "steps", style)
                _draw_row(success, y, rows[name], "unseen_budget", style)
            else:
                place = {"xycoords": ("figure fraction", "data"), "va": "center", "in_layout": False}
                steps.annotate(text, (0.01, y), fontweight="bold", **place)
        for axis in (steps, success):
            axis.set(ylim=(len(lines) - 0.5, -0.6), yticks=[])
            axis.grid(axis="x", lw=0.6, color="0.85")
            axis.spines["left"].set_visible(False)
        steps.set(xscale="log", title="Steps until it\nhas learned", xlabel="← fewer is better")
        steps.set_xlim(right=1.1 * budget)
        steps.xaxis.set_major_locator(LogLocator(numticks=9))
        steps.xaxis.set_major_formatter("{x:,.0f}")
        steps.xaxis.set_minor_formatter(NullFormatter())
        steps.set_yticks(range(len(lines)), [text if name else "" for text, name in lines])
        steps.tick_params(axis="y", left=False)
        success.set(xlim=(0, 1.02), xticks=(0, 0.5, 1), xlabel="more is better →")
        success.set(title=fill(f"Success where {who} never stood, after {budget:,} steps", 21))
        _set_texts(figure, 11.0)  # at a width of 460: large enough on a phone
    return figure


def _draw_row(axis: Axes, y: int, row: pd.Series, column: str, style: Mapping[str, Any]) -> None:
    """Draws a value with its interval, hollow if half of the runs never learn, and writes it on the right."""
    ends, colour, number = row.filter(like=column), style["color"], row[column]
    text = f"{number:.2f}"
    if column == "steps":
        ends = ends.clip(_MIN_STEPS, row["budget"])
        text = f"{number:,.0f}" if np.isfinite(number) else _NEVER
    axis.axhline(y, color="0.92", lw=0.6, zorder=0)
    axis.hlines(y, ends.min(), ends.max(), color=colour, lw=1)
    axis.hlines(y, ends[f"{column}_low"], ends[f"{column}_high"], color=colour, lw=6, alpha=0.4)
    mark = {"marker": style["marker"], "mec": colour, "mfc": "white" if text == _NEVER else colour, "ls": ""}
    axis.plot(ends[column], y, ms=6.5, mew=1.5, clip_on=False, **mark)
    axis.text(1.06, y, text, va="center", transform=axis.get_yaxis_transform())


def _set_texts(figure: Figure, size: float) -> None:
    """Gives all texts the same size, in points, and puts titles at the left."""
    for axis in figure.axes:
        axis.set_title(axis.get_title(), loc="left", fontweight="bold")
        axis.set_title("")
    for text in figure.findobj(Text):
        text.set(fontsize=size)


@drawing(
    "map",
    "the map: steps that learners need",
    "Median steps of each learner until a run has learned, with 95 % intervals; hollow: at least half of the "
    "runs never learn.",
)
def picture(analysis: MapAnalysis, _: pd.DataFrame) -> Figure:
    """Draws the panels."""
    return _draw_panels(analysis, analysis.data.declared.panels, "steps")


@tables.unseen.figure(
    "Mean success of each learner, after all steps of training, with the person in places that did not occur "
    "in it, by the number of places in training, with 95 % intervals."
)
def unseen(analysis: MapAnalysis, _: pd.DataFrame) -> Figure | None:
    """Draws the grid that the answer names, with those of its learners that run there."""
    answer, panels = analysis.data.declared.answer, list[Panel]()
    if answer is None or not answer.unseen:
        return None
    question = analysis.data.experiment.declared.grids[answer.unseen].question
    for group in answer.groups:
        title = f"{group.title}: {question}" if group.title else question
        panels.append(Panel(grid=answer.unseen, title=title, learners=tuple(group.learners)))
    return _draw_panels(analysis, panels, "unseen_budget")


def _curves(analysis: MapAnalysis, panel: Panel) -> dict[str, pd.DataFrame]:
    """Returns the rows of each learner of a panel, in the order of values of the grid's axis, `at`."""
    axis, values = axis_of(analysis.data.experiment, panel.grid)
    rows = analysis.cells[analysis.cells["grid"] == panel.grid]
    rows = rows.assign(at=rows["point"].map({f"{axis} {name}": value for name, value in values.items()}))
    return {name: rows.loc[[name]].sort_values("at") for name in panel.learners if name in rows.index}


def _draw_panels(analysis: MapAnalysis, panels: Sequence[Panel], column: str) -> Figure:
    """Draws steps or success against the axis of each panel's grid, in rows of two panels."""
    experiment, all_curves = analysis.data.experiment, [_curves(analysis, panel) for panel in panels]
    cells = pd.concat(rows for curves in all_curves for rows in curves.values())
    lowest, budget = _shown(cells, "steps").min().min(), cells["budget"].max()
    n_rows, n_columns = -(-len(panels) // 2), min(len(panels), 2)
    with figure_of(n_rows, n_columns, (3.95 * n_columns, 3.0 * n_rows)) as (figure, axes):
        for axis in axes.flat[len(panels) :]:
            axis.remove()
        for axis, panel, curves in zip(axes.flat, panels, all_curves, strict=False):
            if column == "steps":
                first, last = next(iter(curves.values()))["at"].iloc[[0, -1]]
                axis.set(yscale="log", ylim=(lowest / 1.3, 2.2 * budget))
                axis.hlines(budget, first, last, color="0.6", lw=0.8, zorder=0)
                if first < last:  # else the names of curves are there
                    axis.annotate(_NEVER, (first, budget), (0, 5), textcoords="offset points")
                axis.yaxis.set_major_formatter("{x:,.0f}")
            else:
                axis.set(ylim=(0, 1.04))
            _set_horizontal(axis, *axis_of(experiment, panel.grid))
            shifts = range(1 - len(curves), len(curves), 2)  # points
            labels = [
                _draw_curve(axis, column, name, rows, shift, experiment)
                for (name, rows), shift in zip(curves.items(), shifts, strict=True)
            ]
            _separate(axis, labels)
            is_labelled = axis in axes[:, 0]
            what = _WHAT[column].format(budget) if is_labelled else ""
            axis.set(title=fill(panel.title, 44), ylabel=what)
            axis.tick_params(labelleft=is_labelled)
        _set_texts(figure, _FONT_SIZE)
    return figure


def _set_horizontal(axis: Axes, name: str, values: Mapping[str, float]) -> None:
    """Sets the horizontal axis, with room for names at the right, and texts that do not overlap."""
    numbers = [*values.values()]
    if numbers[0] > 0:
        span = max(numbers[-1] / numbers[0], 4.0)
        axis.set(xscale="log", xlim=(numbers[0] / span**0.06, numbers[-1] * span**_ROOM))
    else:
        unit = next(filter(None, numbers), 1.0)
        axis.set_xscale("symlog", linthresh=unit, linscale=0.3)
        axis.set_xlim(-0.2 * unit, unit * max(numbers[-1] / unit, 4.0) ** (1 + _ROOM))
    shares = (axis.transScale + axis.transLimits).transform([(number, 1) for number in numbers])[:, 0]
    labels, last = list[str](), -1.0
    for share, text in zip(shares, values, strict=True):
        labels.append(text.replace("x", "×") if share - last > _TICK_DISTANCE else "")
        last = share if labels[-1] else last
    axis.set_xticks(numbers, labels)
    axis.minorticks_off()
    axis.set_xlabel(f"number of {_LABELS.get(name, name)}")


def _draw_curve(
    axis: Axes, column: str, name: str, rows: pd.DataFrame, shift: float, experiment: Experiment
) -> Annotation:
    """Draws a learner's curve; returns its name.

    Markers are hollow where at least half of the runs never learn. It is shifted by some points, so that
    intervals do not cover each other.
    """
    style, at = style_of(name, experiment), rows["at"].to_numpy()
    title = experiment.learners[name].title
    shown, low, high = _shown(rows, column).to_numpy().T
    moved = axis.transData + ScaledTranslation(shift / 72, 0, axis.figure.dpi_scale_trans)
    axis.plot(at, shown, color=style["color"], ls=style["ls"], lw=1.6, transform=moved)
    axis.vlines(at, low, high, color=style["color"], lw=2.5, alpha=0.35, transform=moved)
    is_known = np.isfinite(rows[column].to_numpy())
    for chosen, filling in ((is_known, style["color"]), (~is_known, "white")):
        mark = {"marker": style["marker"], "mec": style["color"], "mfc": filling, "ls": ""}
        axis.plot(at[chosen], shown[chosen], ms=6, transform=moved, **mark)
    label = axis.annotate(fill(title, _NAME_WIDTH), (at[-1], shown[-1]), (0, 0), textcoords="offset points")
    # The colour of a name does not become lighter with what the learner observes.
    label.set(va="center", color=style_of(name, experiment, observation="")["color"], linespacing=1.0)
    return label


def _shown(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Returns values and their intervals as they are drawn: steps at the budget where they are infinite."""
    columns = rows[[column, f"{column}_low", f"{column}_high"]]
    return columns.clip(_MIN_STEPS, rows["budget"], axis=0) if column == "steps" else columns


def _separate(axis: Axes, labels: Sequence[Annotation]) -> None:
    """Moves the names at the ends of curves, so that none covers another one, the title above or the axis."""
    to_share, heights = axis.transScale + axis.transLimits, list[float]()
    names = sorted(labels, key=lambda label: label.xy[1], reverse=True)
    ends = [to_share.transform(label.xy)[1] * _HEIGHT for label in names]
    halves = [_LINE * (1 + label.get_text().count("\n")) / 2 for label in names]
    top, bottom = _HEIGHT, 0.0
    for end, half in zip(ends, halves, strict=True):  # down from the title
        heights.append(min(end, top - half))
        top = heights[-1] - half
    for i in reversed(range(len(names))):  # up from the axis
        heights[i] = max(heights[i], bottom + halves[i])
        bottom = heights[i] + halves[i]
        names[i].set_position((_NAME_DISTANCE, heights[i] - ends[i]))
