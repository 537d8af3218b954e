"""Figures of a map, drawn from its tables."""

import math
from collections.abc import Callable, Iterable, Mapping
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from benchmark.analysis.looks import EQUAL, FASTER, NEITHER, SLOWER, TOO_SHORT
from benchmark.drawing.style import INK, figure_of
from benchmark.drawing.tables import two_digits
from benchmark.experiments import Experiment
from benchmark.reports.comparison.figures import style_of
from benchmark.reports.item import Frames, drawing

_COLOUR_MAP: Final = "PuOr_r"  # purple: y, orange: x; signs tell them apart in grey
_LOWEST: Final = 100  # steps that are drawn
_DARK: Final = 0.62  # share of the scale from which on ink is white
_MOST: Final = float(np.log(16.0))  # logarithm of the ratio from which on colours do not differ
_POINTS, _LINE = 62.0, 11.0  # points of a power of ten on the axis, and of a line of text
_SIGNS: Final = {  # of a ratio, in the order of their legend
    "≥": "≥ at least",
    "=": "= equally fast",
    "!": "! decided, but without a ratio",
    "neither": "neither: most runs of both fail",
    "short": "short: the smaller budget is too short",
    "?": "? undecided",
    "": "blank: not trained",
}
# Of verdicts without a ratio
_SIGN_OF: Final = {FASTER: "!", SLOWER: "!", EQUAL: "=", NEITHER: "neither", TOO_SHORT: "short"}
_FIXED: Final = "\N{NO-BREAK SPACE}"
_LABELS: Final = {
    "places": "places in which the person may stand",
    "room": "cells of the room",
    "noise": "noise of feedback",
}


@drawing(
    "map",
    "the map: steps against places, who needs fewer in rooms and places, and the control",
    "Steps until a run has learned. Left: median steps of each learner, with 95 % intervals; hollow, drawn "
    "at the budget: most runs do not learn. Middle: which of two learners needs fewer, where that is "
    "decided, and how many times as many the other one needs. Right: a control, in which the coordinates of "
    "more and more places are permuted.",
)
def picture(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws the first grid with one axis, the first with two, and the control, as far as there are any."""
    return _draw(tables, experiment, _leading(_kinds(tables, experiment)))


@drawing(
    "grids",
    "the same of all other grids",
    "The other grids. For unseen places, the figure shows success in them, with 95 % intervals.",
)
def others(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws what the map does not show, but for references."""
    kinds = _kinds(tables, experiment)
    return _draw(tables, experiment, {grid: kinds[grid] for grid in kinds if grid not in _leading(kinds)})


def _kinds(tables: Frames, experiment: Experiment) -> dict[str, str]:
    kinds = {}
    for name, grid in experiment.declared.grids.items():
        lines = _lines(tables, experiment, name) if len(grid.axes) == 1 else {}
        if lines:
            has_unseen = any(rows["unseen"].any() for rows in lines.values())
            kinds[name] = "control" if "permuted" in grid.axes else "unseen" if has_unseen else "lines"
        elif len(grid.axes) == 2 and (tables["contrasts"]["grid"] == name).any():
            kinds[name] = "square"
    return kinds


def _leading(kinds: Mapping[str, str]) -> dict[str, str]:
    """Returns the grids that the map shows: the first of each kind, with their kinds."""
    first = {kind: grid for grid, kind in reversed([*kinds.items()])}
    return {first[kind]: kind for kind in ("lines", "square", "control") if kind in first}


def _draw(tables: Frames, experiment: Experiment, kinds: Mapping[str, str]) -> Figure | None:
    if not kinds:
        return None
    widths = [_DRAWN[kind][1] for kind in kinds.values()]
    with figure_of(1, 1, (sum(widths), 4.9)) as (figure, axes):
        axes[0, 0].remove()
        parts = figure.subfigures(1, len(kinds), width_ratios=widths, squeeze=False)[0]
        for part, (grid, kind) in zip(parts, kinds.items(), strict=True):
            axis, (draw, width) = part.subplots(), _DRAWN[kind]
            draw(axis, tables, experiment, grid)
            question = fill(experiment.declared.grids[grid].question, round(9.5 * width))
            axis.set_title(question, loc="left", fontweight="bold")
    return figure


def _axis_of(experiment: Experiment, grid: str) -> tuple[str, dict[str, float], list[str]]:
    """Returns the only axis of a grid, its values as numbers, by name (5x6 is 30), and as written, 5×6."""
    ((axis, names),) = experiment.declared.grids[grid].axes.items()
    values = {name: math.prod(float(part) for part in name.split("x")) for name in names}
    return axis, values, [name.replace("x", "×") for name in names]


def _lines(tables: Frames, experiment: Experiment, grid: str) -> dict[str, pd.DataFrame]:
    """Returns the rows of each learner but references in a grid with one axis, whose numbers are in `at`."""
    cells, (axis, values, _) = tables["cells"], _axis_of(experiment, grid)
    at = {f"{axis} {name}": value for name, value in values.items()}
    rows = cells[cells["grid"] == grid]
    rows = rows.assign(learner=rows["algorithm"] + ", " + rows["observation"], at=rows["point"].map(at))
    return {
        str(name): of_learner.sort_values("at")
        for name, of_learner in rows.groupby("learner", sort=False)
        if not experiment.learners[str(name)].reference_for
    }


def _draw_lines(axis: Axes, tables: Frames, experiment: Experiment, grid: str) -> None:
    report, solved = experiment.report, experiment.declared.solved
    assert report is not None
    assert solved is not None
    name, numbers, texts = _axis_of(experiment, grid)
    values, lines = [*numbers.values()], _lines(tables, experiment, grid)
    is_positive = min(values) > 0
    axis.set_yscale("log")
    compared = {*tables["contrasts"]["x"], *tables["contrasts"]["y"]}
    _apart(
        [
            _curve(axis, rows, experiment, alpha=0.2 if learner in compared else 0.08)
            for learner, rows in lines.items()
        ]
    )
    if is_positive:
        axis.set_xscale("log")
    axis.set_xticks(values, texts)
    axis.minorticks_off()
    axis.set_xlabel(_LABELS.get(name, name))
    axis.set_xlim(values[0] / 1.15 if is_positive else 0, values[-1] * (9 if is_positive else 2))
    axis.set_ylabel(f"steps until success stays at or above {solved.success:g}")
    of_y = lines.get(report.contrasts[0][1], pd.DataFrame({"at": [], "steps": []}))
    last = of_y.loc[of_y["at"] == values[-1], "steps"]
    if np.isfinite(last).any():
        proportional = last.iloc[0] * np.array(values) / values[-1]
        axis.plot(values, proportional, color="0.4", lw=1, ls=":")
        start = values[0], proportional[0]
        label = axis.annotate("proportional", start, (4, -9), textcoords="offset points")
        label.set_fontsize("x-small")


def _curve(axis: Axes, rows: pd.DataFrame, experiment: Experiment, alpha: float) -> Annotation:
    """Draws a learner's median steps, hollow at the budget where most runs never solve; returns its label."""
    learner = experiment.learners[rows["learner"].iloc[0]]
    style, values = style_of(learner.name, experiment), rows["at"].to_numpy()
    shown, low, high = (
        rows[column].where(np.isfinite(rows[column]), rows["budget"]).clip(lower=_LOWEST)
        for column in ("steps", "steps_low", "steps_high")
    )
    axis.plot(values, shown, color=style["color"], ls=style["ls"], lw=1.6)
    axis.fill_between(values, low, high, color=style["color"], alpha=alpha, lw=0)
    is_known = np.isfinite(rows["steps"].to_numpy())
    for chosen, filling in ((is_known, style["color"]), (~is_known, "white")):
        mark = {"marker": style["marker"], "mec": style["color"], "mfc": filling, "ls": ""}
        axis.plot(values[chosen], shown[chosen], ms=6, **mark)
    end = values[-1], shown.iloc[-1]
    label = axis.annotate(learner.title, end, (8, 0), textcoords="offset points")
    # The colour of a name does not become lighter with what the learner observes.
    ink = style_of(learner.name, experiment, observation="")["color"]
    label.set(va="center", fontsize="small", color=ink)
    return label


def _apart(labels: Iterable[Annotation]) -> None:
    lowest = -np.inf
    for label in sorted(labels, key=lambda label: label.xy[1]):
        height = max(np.log10(label.xy[1]), lowest)
        label.set_position((8, (height - np.log10(label.xy[1])) * _POINTS))
        lowest = height + _LINE / _POINTS


def _draw_square(axis: Axes, tables: Frames, experiment: Experiment, grid: str) -> None:
    declared, used = experiment.declared.grids[grid], set[str]()
    first, second = declared.axes
    rows, columns = [*declared.axes[first]], [*declared.axes[second]]
    colours = np.full((len(rows), len(columns)), np.nan)
    contrasts = tables["contrasts"]
    # The first contrast at every point
    compared = contrasts[contrasts["grid"] == grid].drop_duplicates("point").set_index("point")
    for values in declared.points.values():
        point = ", ".join(f"{name} {value}" for name, value in values.items())
        if point in compared.index:
            index = rows.index(values[first]), columns.index(values[second])
            text, colours[index] = _sign(compared.loc[[point]].iloc[0], point, tables["pairs"])
            used.update([text, text[:1]])
            is_dark = abs(np.nan_to_num(colours[index])) > _DARK * _MOST
            ink = "black" if np.isnan(colours[index]) else INK[int(is_dark)]
            axis.text(index[1], index[0], text, ha="center", va="center", color=ink, fontsize="small")
    if len(compared) < colours.size:
        used.add("")
    edges = np.arange(len(columns) + 1) - 0.5, np.arange(len(rows) + 1) - 0.5
    norm = Normalize(-_MOST, _MOST)
    image = axis.pcolormesh(*edges, colours, cmap=_COLOUR_MAP, norm=norm, edgecolors="white", linewidth=0.8)
    axis.set_xticks(range(len(columns)), columns)
    axis.set_yticks(range(len(rows)), [row.replace("x", "×") for row in rows])
    axis.set(xlabel=_LABELS.get(second, second), ylabel=_LABELS.get(first, first))
    axis.spines[:].set_visible(False)
    axis.tick_params(length=0)
    _draw_legend(axis, image, experiment, used)


def _sign(row: pd.Series, point: str, pairs: pd.DataFrame) -> tuple[str, float]:
    """Returns the text and the colour of a contrast: the logarithm of its ratio of steps, or NaN for none."""
    if row["verdict"] not in (FASTER, SLOWER) or np.isnan(row["ratio"]):
        return _SIGN_OF.get(row["verdict"], "?"), np.nan
    logarithm = np.log(row["ratio"])
    own = pairs[(pairs["grid"] == row["grid"]) & (pairs["point"] == point)]
    own = own[(own["x"] == row["x"]) & (own["y"] == row["y"])]
    # Where most runs of a side never learn, the ratio is a bound.
    is_bound = any(np.isinf(own[side].fillna(np.inf).median()) for side in ("steps_x", "steps_y"))
    return "≥" * is_bound + two_digits(np.exp(abs(logarithm))), float(np.clip(logarithm, -_MOST, _MOST))


def _draw_legend(axis: Axes, image: QuadMesh, experiment: Experiment, used: set[str]) -> None:
    assert experiment.report is not None
    bar = axis.figure.colorbar(image, ax=axis, location="bottom", aspect=30, pad=0.02)
    net, table = (experiment.learners[side].title for side in experiment.report.contrasts[0])
    labels = [f"{name}\nneeds fewer steps" if name else "" for name in (table, "", net)]
    bar.set_ticks([-_MOST, 0, _MOST], labels=labels)
    bar.ax.tick_params(length=0)
    left, _, right = bar.ax.get_xticklabels()
    left.set_horizontalalignment("left")
    right.set_horizontalalignment("right")
    bar.outline.set_visible(False)
    signs = ["number: how many times as many the other one needs"]
    signs += dict.fromkeys(text.replace(" ", _FIXED) for sign, text in _SIGNS.items() if sign in used)
    bar.ax.set_xlabel(fill("; ".join(signs), 58), fontsize="small")


def _draw_success(axis: Axes, tables: Frames, experiment: Experiment, grid: str) -> None:
    name, _, texts = _axis_of(experiment, grid)
    column = "success" if name == "permuted" else "unseen_success"
    for learner, rows in _lines(tables, experiment, grid).items():
        success, low, high = (rows[f"{column}{end}"].to_numpy() for end in ("", "_low", "_high"))
        style = {"lw": 1.6, "elinewidth": 0.8, "ms": 6, **style_of(learner, experiment)}
        ends, title = [success - low, high - success], experiment.learners[learner].title
        axis.errorbar(range(len(rows)), success, ends, label=title, **style)
    axis.set_xticks(range(len(texts)), texts)
    axis.set_ylim(-0.04, 1.04)
    axis.figure.legend(loc="outside lower center", frameon=False, fontsize="small")
    if name == "permuted":
        label, what = "% of the places whose\ncoordinates are permuted", "at the end of training"
    else:
        label, what = fill(_LABELS.get(name, name), 24), "in unseen places"
    axis.set(xlabel=label, ylabel=f"success {what}")


# What draws a grid of each kind, and the width of the figure in inches
_DRAWN: Final[dict[str, tuple[Callable[[Axes, Frames, Experiment, str], None], float]]] = {
    "lines": (_draw_lines, 6.0),
    "square": (_draw_square, 4.2),
    "control": (_draw_success, 3.0),
    "unseen": (_draw_success, 3.0),
}
