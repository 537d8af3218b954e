"""Figures of a map, drawn from its tables."""

from collections.abc import Collection, Iterable, Sequence
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from numpy.typing import NDArray

from benchmark.analysis.looks import EQUAL, FASTER, NEITHER, SLOWER
from benchmark.drawing.style import INK, figure_of
from benchmark.drawing.tables import two_digits
from benchmark.experiments import Experiment
from benchmark.reports.comparison.figures import curve_panels, labelled, style_of
from benchmark.reports.item import Frames, drawing
from benchmark.reports.map import results
from benchmark.reports.map.crossings import axis_of, kinds_of, leading, ranked

_COLOUR_MAP: Final = "PuOr_r"  # purple: y, orange: x; numbers for x are bold, to tell them apart in grey
_LOWEST: Final = 100  # steps that are drawn
_DARK: Final = 0.62  # share of the scale from which on ink is white
_MOST: Final = float(np.log(16.0))  # logarithm of the ratio from which on colours do not differ
_HEIGHT, _LINE = 265.0, 11.0  # of an axis, and of a line of text, in points
_WIDTH: Final = 18  # characters of a line of a label
_PANELS: Final = 6  # of success over training
_APART: Final = 0.07  # smallest distance of the texts of two ticks, as a share of a logarithmic axis
_COLUMNS: Final = 30  # points in a line of verdicts
_SIGNS: Final = {  # of a ratio, in the order of their legend
    "≥": "≥ at least",
    "=": "= equally fast",
    "!": "! decided, but without a ratio",
    "neither": "neither: most runs of both fail",
    "?": "? undecided",
    "": "blank: not compared",
}
_SIGN_OF: Final = {FASTER: "!", SLOWER: "!", EQUAL: "=", NEITHER: "neither"}  # verdicts without a ratio
_FIXED: Final = "\N{NO-BREAK SPACE}"
_LABELS: Final = {
    "places": "places in which the person may stand",
    "groups": "ways in which people may stand",
    "room": "cells of the room",
    "noise": "noise of feedback",
    "cost": "cost of a wrong PING",
}
Cell = tuple[str, str]  # a point of a grid; a gap between grids has empty names


@drawing(
    "map",
    "the map: steps that learners need",
    "Median steps of each learner until a run has learned, with 95 % intervals; hollow, drawn at the budget: "
    "most runs do not learn.",
)
def picture(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws grids about steps, by default the first one, in the declared panels or in one."""
    panels = [panel for panel in _panels(experiment) if _lines(tables, experiment, panel[0])]
    if not panels:
        return None
    steps = _shown(
        pd.concat(rows for grid, *_ in panels for rows in _lines(tables, experiment, grid).values())
    )
    with figure_of(1, len(panels), (max(4.4 * len(panels), 7.0), 4.9)) as (figure, axes):
        for axis, (grid, title, learners) in zip(axes[0], panels, strict=True):
            _draw_lines(axis, tables, experiment, grid, learners, steps)
            axis.set_title(fill(title, 42), loc="left", fontweight="bold")
            axis.label_outer()
    return figure


def _panels(experiment: Experiment) -> list[tuple[str, str, tuple[str, ...]]]:
    """Returns grid, title and learners of each panel of the map, all learners if there are none."""
    report, first = experiment.report, leading(experiment)
    assert report is not None
    declared = [(panel.grid or first, panel.title, panel.learners) for panel in report.panels]
    return declared or [(first, experiment.declared.grids[first].question, ())] * bool(first)


@drawing(
    "grids",
    "the other grids with one axis",
    "The other grids. For unseen places: success in them; for permuted coordinates: success at the end of "
    "training. Bars: 95 % intervals.",
)
def others(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws what the map does not show of grids with one axis."""
    kinds, drawn = kinds_of(experiment), {grid for grid, *_ in _panels(experiment)}
    grids = [grid for grid in kinds if grid not in drawn and _lines(tables, experiment, grid)]
    widths = [6.0 if kinds[grid] == "steps" else 3.0 for grid in grids]
    if not grids:
        return None
    n_named = max(len(_lines(tables, experiment, grid)) for grid in grids)  # below panels of success
    with figure_of(1, 1, (sum(widths), 4.3 + 0.2 * n_named)) as (figure, axes):
        axes[0, 0].remove()
        parts = figure.subfigures(1, len(grids), width_ratios=widths, squeeze=False)[0]
        for part, grid, width in zip(parts, grids, widths, strict=True):
            axis, draw = part.subplots(), _draw_lines if kinds[grid] == "steps" else _draw_success
            draw(axis, tables, experiment, grid)
            question = fill(experiment.declared.grids[grid].question, round(9 * width))
            axis.set_title(question, loc="left", fontweight="bold")
    return figure


@results.success.figure(
    "Success over training at some points of the map, mean over runs, with 95 % intervals. A run that "
    "has learned may end; from then on, it is counted with its last evaluation."
)
def training(table: pd.DataFrame, experiment: Experiment) -> Figure:
    """Draws at most six points of the map's grids, as many of each, or of the first grid."""
    grids = [*dict.fromkeys(grid for grid, *_ in _panels(experiment))] or [table["grid"].iloc[0]]
    parts = []
    for grid in grids:
        rows = table[table["grid"] == grid]
        points = rows["point"].unique()
        spread = np.linspace(len(points) - 1, 0, max(_PANELS // len(grids), 1))
        rows = rows[rows["point"].isin(points[np.unique(spread.round().astype(int))])]
        parts.append(rows.assign(scenario=rows["point"] if len(grids) == 1 else f"{grid}: " + rows["point"]))
    rows = labelled(pd.concat(parts))
    names = (
        ranked(experiment) if len(grids) == 1 else [name for *_, own in _panels(experiment) for name in own]
    )
    with curve_panels(rows, names, experiment, "success", "success") as (figure, axes):
        for axis in axes:
            axis.set_xscale("log")
    return figure


@results.verdicts.figure(
    "Which of two learners needs fewer steps, where that is decided, and how many times as many the other "
    "one needs: a row for each contrast, a column for each point of the grids."
)
def who(tables: Frames, experiment: Experiment) -> Figure:
    """Draws all contrasts; grids share a line while there is room."""
    contrasts, used = tables["contrasts"], {""}
    rows = [*dict.fromkeys(zip(contrasts["x"], contrasts["y"], strict=True))]
    names = [" against\n".join(experiment.learners[side].title for side in sides) for sides in rows]
    lines = _packed(contrasts)
    n_columns, height = max(map(len, lines)), 0.36 * len(rows) + 1.1
    with figure_of(len(lines), 1, (0.4 * n_columns + 2.6, height * len(lines) + 1.1)) as (figure, axes):
        for axis, columns in zip(axes.flat, lines, strict=True):
            image = _draw_cells(axis, tables, rows, columns, used)
            axis.set_xlim(-0.5, n_columns - 0.5)
            axis.set_yticks(range(len(rows)), names, fontsize="small")
        _draw_legend(figure, axes, image, used)
    return figure


def _packed(contrasts: pd.DataFrame) -> list[list[Cell]]:
    """Returns the columns of each line: the points of as many grids as have room."""
    lines: list[list[Cell]] = []
    for grid, own in contrasts.groupby("grid", sort=False):
        points = [(str(grid), str(point)) for point in own["point"].unique()]
        for line in lines:
            if len(line) + len(points) < _COLUMNS:
                line += [("", ""), *points]
                break
        else:
            lines.append(points)
    return lines


def _draw_cells(
    axis: Axes, tables: Frames, rows: Sequence[Cell], columns: Sequence[Cell], used: set[str]
) -> QuadMesh:
    colours, contrasts = np.full((len(rows), len(columns)), np.nan), tables["contrasts"]
    own = contrasts[contrasts["grid"].isin({grid for grid, _ in columns})]
    for _, row in own.iterrows():
        index = rows.index((row["x"], row["y"])), columns.index((row["grid"], row["point"]))
        text, colours[index] = _sign(row, tables["pairs"])
        used.update([text, text[:1]])
        is_dark = abs(np.nan_to_num(colours[index])) > _DARK * _MOST
        ink = "black" if np.isnan(colours[index]) else INK[int(is_dark)]
        label = axis.text(index[1], index[0], text, ha="center", va="center", color=ink)
        weight = "bold" if colours[index] > 0 else "normal"
        label.set(fontsize="x-small" if text in _SIGNS else "small", fontweight=weight)
    edges = np.arange(len(columns) + 1) - 0.5, np.arange(len(rows) + 1) - 0.5
    norm = Normalize(-_MOST, _MOST)
    image = axis.pcolormesh(*edges, colours, cmap=_COLOUR_MAP, norm=norm, edgecolors="white", linewidth=0.8)
    for grid in dict.fromkeys(grid for grid, _ in columns if grid):
        points = [point for name, point in columns if name == grid]
        axes = ", ".join(part.split()[0] for part in points[0].split(", "))
        title = fill(grid if grid == axes else f"{grid}: {axes}".replace("_", " "), max(4 * len(points), 10))
        axis.text(columns.index((grid, points[0])) - 0.5, -0.6, title, va="bottom", fontweight="bold")
    at = [i for i, (grid, _) in enumerate(columns) if grid]
    labels = [", ".join(part.split()[1] for part in columns[i][1].split(", ")) for i in at]
    axis.set_xticks(at, [label.replace("x", "×") for label in labels])
    axis.tick_params(length=0)
    axis.tick_params(axis="x", rotation=90 if max(map(len, labels)) > 4 else 0)
    axis.spines[:].set_visible(False)
    axis.invert_yaxis()
    return image


def _lines(tables: Frames, experiment: Experiment, grid: str) -> dict[str, pd.DataFrame]:
    """Returns the rows of each learner but references in a grid with one axis, whose numbers are in `at`."""
    cells, (axis, values, _) = tables["cells"], axis_of(experiment, grid)
    at = {f"{axis} {name}": value for name, value in values.items()}
    rows = cells[cells["grid"] == grid]
    rows = rows.assign(learner=rows["algorithm"] + ", " + rows["observation"], at=rows["point"].map(at))
    return {
        str(name): of_learner.sort_values("at")
        for name, of_learner in rows.groupby("learner", sort=False)
        if not experiment.learners[str(name)].reference_for
    }


def _draw_lines(
    axis: Axes,
    tables: Frames,
    experiment: Experiment,
    grid: str,
    learners: Collection[str] = (),
    steps: pd.DataFrame | None = None,
) -> None:
    """Draws learners, by default all, with what they need with the second and third best settings.

    Heights are those of `steps`, by default of all learners of the grid.
    """
    ranks, (name, numbers, texts) = ranked(experiment), axis_of(experiment, grid)
    values, every = [*numbers.values()], _lines(tables, experiment, grid)
    lines = {learner: every[learner] for learner in learners or ranks if learner in every}
    is_positive = min(values) > 0
    axis.set_yscale("log")
    drawn = _shown(pd.concat(every.values())) if steps is None else steps
    axis.set_ylim(drawn["steps"].min() / 1.6, drawn["steps_high"].max() * 1.3)
    labels = []
    for learner, rows in lines.items():
        labels.append(_curve(axis, rows, experiment))
        colour = style_of(learner, experiment)["color"]
        for other in (every[other] for other in ranks[learner] if other in every):
            axis.plot(other["at"], _shown(other)["steps"], color=colour, lw=0.8, ls=(0, (5, 3)))
    _apart(axis, labels)
    if is_positive:
        axis.set_xscale("log")
    axis.set_xlim(values[0] / 1.15 if is_positive else 0, values[-1] * (9 if is_positive else 2))
    shown, apart = [0], (np.divide(*axis.get_xlim()[::-1])) ** _APART if is_positive else 0.0
    for i in range(1, len(values)):  # only texts that do not cover each other
        if not is_positive or values[i] / values[shown[-1]] > apart:
            shown.append(i)
    axis.set_xticks(values, [text if i in shown else "" for i, text in enumerate(texts)])
    axis.minorticks_off()
    axis.set_xlabel(_LABELS.get(name, name))
    axis.set_ylabel("steps until a run has learned")


def _curve(axis: Axes, rows: pd.DataFrame, experiment: Experiment) -> Annotation:
    """Draws a learner's median steps, hollow at the budget where most runs never solve; returns its label."""
    learner = experiment.learners[rows["learner"].iloc[0]]
    style, values = style_of(learner.name, experiment), rows["at"].to_numpy()
    shown, low, high = _shown(rows).to_numpy().T
    axis.plot(values, shown, color=style["color"], ls=style["ls"], lw=1.6)
    axis.fill_between(values, low, high, color=style["color"], alpha=0.15, lw=0)
    is_known = np.isfinite(rows["steps"].to_numpy())
    for chosen, filling in ((is_known, style["color"]), (~is_known, "white")):
        mark = {"marker": style["marker"], "mec": style["color"], "mfc": filling, "ls": ""}
        axis.plot(values[chosen], shown[chosen], ms=6, **mark)
    end = values[-1], shown[-1]
    label = axis.annotate(fill(learner.title, _WIDTH), end, (8, 0), textcoords="offset points")
    # The colour of a name does not become lighter with what the learner observes.
    ink = style_of(learner.name, experiment, observation="")["color"]
    label.set(va="center", fontsize="small", color=ink)
    return label


def _shown(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns median steps and their intervals as they are drawn: at the budget where they are infinite."""
    columns = rows[["steps", "steps_low", "steps_high"]]
    return columns.clip(lower=_LOWEST, upper=rows["budget"], axis=0)


def _apart(axis: Axes, labels: Iterable[Annotation]) -> None:
    """Moves the names at the ends of lines down, so that none covers another one or the title above."""
    low, high = np.log10(axis.get_ylim())
    scale = _HEIGHT / (high - low)  # points of a power of ten
    end = high * scale
    for label in sorted(labels, key=lambda label: label.xy[1], reverse=True):
        at, half = np.log10(label.xy[1]) * scale, _LINE * (1 + label.get_text().count("\n")) / 2
        height = min(at, end - half)
        label.set_position((8, height - at))
        end = height - half


def _sign(row: pd.Series, pairs: pd.DataFrame) -> tuple[str, float]:
    """Returns the text and the colour of a contrast: the logarithm of its ratio of steps, or NaN for none."""
    if row["verdict"] not in (FASTER, SLOWER) or np.isnan(row["ratio"]):
        return _SIGN_OF.get(row["verdict"], "?"), np.nan
    logarithm = np.log(row["ratio"])
    own = pairs[(pairs["grid"] == row["grid"]) & (pairs["point"] == row["point"])]
    own = own[(own["x"] == row["x"]) & (own["y"] == row["y"])]
    # Where most runs of a side never learn, the ratio is a bound.
    is_bound = any(np.isinf(own[side].fillna(np.inf).median()) for side in ("steps_x", "steps_y"))
    return "≥" * is_bound + two_digits(np.exp(abs(logarithm))), float(np.clip(logarithm, -_MOST, _MOST))


def _draw_legend(figure: Figure, axes: NDArray[Any], image: QuadMesh, used: set[str]) -> None:
    bar = figure.colorbar(image, ax=axes, location="bottom", aspect=40, pad=0.02, shrink=0.6)
    labels = [f"the {name} learner\nneeds fewer steps" if name else "" for name in ("second", "", "first")]
    bar.set_ticks([-_MOST, 0, _MOST], labels=labels)
    bar.ax.tick_params(length=0)
    left, _, right = bar.ax.get_xticklabels()
    left.set_horizontalalignment("left")
    right.set_horizontalalignment("right")
    bar.outline.set_visible(False)
    signs = ["number: how many times as many the other one needs, bold where the first needs fewer"]
    signs += dict.fromkeys(text.replace(" ", _FIXED) for sign, text in _SIGNS.items() if sign in used)
    bar.ax.set_xlabel(fill("; ".join(signs), 100), fontsize="small")


def _draw_success(axis: Axes, tables: Frames, experiment: Experiment, grid: str) -> None:
    name, numbers, texts = axis_of(experiment, grid)
    column = "success" if name == "permuted" else "unseen_success"
    every = _lines(tables, experiment, grid)
    shown = [learner for learner in ranked(experiment) if learner in every]
    for i, learner in enumerate(shown):
        rows, beside = every[learner], (i - (len(shown) - 1) / 2) * 0.06
        success, low, high = (rows[f"{column}{end}"].to_numpy() for end in ("", "_low", "_high"))
        style = {"lw": 1.6, "elinewidth": 0.8, "ms": 6, **style_of(learner, experiment)}
        ends, title = [success - low, high - success], experiment.learners[learner].title
        at = np.searchsorted([*numbers.values()], rows["at"]) + beside
        axis.errorbar(at, success, ends, label=title, **style)
    axis.set_xticks(range(len(texts)), texts)
    axis.set_ylim(-0.04, 1.04)
    axis.figure.legend(loc="outside lower center", frameon=False, fontsize="small")
    if name == "permuted":
        label, what = "% of the places whose\ncoordinates are permuted", "at the end of training"
    else:
        label, what = fill(_LABELS.get(name, name), 24), "in unseen places"
    axis.set(xlabel=label, ylabel=f"success {what}")
