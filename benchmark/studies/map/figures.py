"""Figures of a map, drawn from its tables."""

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation

from benchmark.analysis.looks import EQUAL, FASTER, NEITHER, NO_VERDICT, SLOWER
from benchmark.drawing.style import INK, colour_map, figure_of
from benchmark.drawing.tables import two_digits
from benchmark.experiments import Experiment
from benchmark.studies.comparison.figures import style_of
from benchmark.studies.item import Frames, drawing
from benchmark.studies.map import results
from benchmark.studies.map.crossings import axis_of, kinds_of, leading, ranked

_COLOUR_MAP: Final = "PuOr_r"  # purple: y, orange: x; numbers for x are bold, to tell them apart in grey
_LOWEST: Final = 100  # steps that are drawn
_DARK: Final = 0.62  # share of the scale from which on ink is white
_MOST: Final = float(np.log(16.0))  # logarithm of the ratio from which on colours do not differ
_SMALL: Final = 8.5  # size of a font
_HEIGHT, _LINE = 160.0, 9.5  # of an axis, and of a line of text, in points
_WIDTH, _LONG = 18, 37  # characters of a line of a name
_BESIDE: Final = 13  # points from a point to a name
_ROOM: Final = 0.6  # for names at the right of lines, as a share of their width
_APART: Final = 0.07  # smallest distance of the texts of two ticks, as a share of a logarithmic axis
_COLUMNS: Final = 15  # points in a line of verdicts
_SIGNS: Final = {  # of a ratio, in the order of their legend
    "+": "orange and bold: the first learner needs fewer steps",
    "-": "purple: the second does",
    ">": "number: how many times as many the other one needs",
    "≥": "≥ at least",
    "=": "= equally fast",
    "!": "! decided, but without a ratio",
    "–": "– most runs of neither learn",
    "?": "? undecided",
    "x": "x no verdict",
    "": "blank: not compared",
}
# Of verdicts without a ratio
_SIGN_OF: Final = {FASTER: "!", SLOWER: "!", EQUAL: "=", NEITHER: "–", NO_VERDICT: "x"}
_NEVER: Final = "never learns"
_LABELS: Final = {"groups": "places", "room": "cells"}  # of axes
_WHAT: Final = {
    "steps": "steps until it has learned\n(fewer is better)",
    "unseen_success": "success in unseen places\n(more is better)",
}
Cell = tuple[str, str]  # a point of a grid; a gap between grids has empty names
Panel = tuple[str, str, list[pd.DataFrame]]  # grid, title, and rows of each learner


@drawing(
    "answer",
    "the answer: at one point, the steps that learners need, and their success in unseen places",
    "Median steps until a run has learned, and mean success with the person in places that did not occur in "
    "training, with 95 % intervals; hollow, at the budget: most runs never learn.",
)
def answer(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws the declared point, if there is one, so that it can be read on a phone."""
    assert experiment.report is not None
    declared, cells = experiment.report.answer, tables["cells"]
    if declared is None:
        return None
    cells = cells[(cells["grid"] == declared.grid) & (cells["point"] == declared.point)]
    cells = cells.set_index(cells["variant"] + ", " + cells["observation"])
    rows = cells.loc[[name for name in declared.learners if name in cells.index]]
    if rows.empty:
        return None
    unseen = rows[[f"unseen_success{end}" for end in ("", "_low", "_high")]]
    scenes = {x.condition.axes.get("grid"): x.scenario for x in experiment.populations}
    who = "people" if scenes[declared.grid].group else "the person"
    with figure_of(1, 2, (5.8, 1.2 + 0.55 * len(rows))) as (figure, (axes,)):
        texts = [_NEVER if np.isinf(steps) else f"{steps:,.0f}" for steps in rows["steps"]]
        _dots(axes[0], _shown(rows), texts, experiment)
        _dots(axes[1], unseen, [f"{value:.2f}" for value in unseen["unseen_success"]], experiment)
        axes[0].set(title="Steps until it\nhas learned", xlabel="← fewer is better")
        axes[1].set(title=fill(f"Success where {who} never stood in training", 19), xlabel="more is better →")
        axes[0].tick_params(labelleft=True)
        axes[0].set_yticklabels([fill(declared.learners[name], 12) for name in rows.index])
        _sized(figure, 13.0)  # at a width of 420: large enough on a phone
    return figure


def _dots(axis: Axes, rows: pd.DataFrame, texts: Sequence[str], experiment: Experiment) -> None:
    """Draws a row for each learner: a value and its text, with its interval; hollow if it never learns."""
    most = max(1.0, rows.to_numpy().max())
    for y, (name, (value, low, high)) in enumerate(rows.iterrows()):
        colour = style_of(str(name), experiment, observation="")["color"]
        axis.plot([0, value], [y, y], color=colour, lw=1.5)
        axis.plot([low, high], [y, y], color=colour, lw=6, alpha=0.35, solid_capstyle="round")
        axis.plot(value, y, "o", ms=10, mec=colour, mfc="white" if texts[y] == _NEVER else colour, mew=2)
        side = "left" if value < most / 4 else "right" if value > 0.75 * most else "center"
        axis.annotate(texts[y], (value, y), (0, 8), textcoords="offset points", ha=side)
    axis.set(xlim=(0, 1.08 * most), ylim=(len(rows) - 0.5, -0.8), yticks=range(len(rows)))
    axis.xaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
    axis.xaxis.set_major_formatter("{x:,g}")
    axis.tick_params(left=False, labelleft=False)


def _sized(figure: Figure, size: float) -> None:
    """Gives all texts the same size, in points, and puts titles at the left."""
    for axis in figure.axes:
        axis.set_title(axis.get_title(), loc="left", fontweight="bold")
        axis.set_title("")
    for text in figure.findobj(Text):
        text.set(fontsize=size)


@drawing(
    "map",
    "the map: steps that learners need",
    "Median steps of each learner until a run has learned, with 95 % intervals; hollow: most runs never "
    "learn.",
)
def picture(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws grids about steps, by default the first one, in the declared panels or in one."""
    assert experiment.report is not None
    first = leading(experiment)
    panels = [(panel.grid or first, panel.title, panel.learners) for panel in experiment.report.panels]
    panels = panels or [(first, experiment.declared.grids[first].question, ())] * bool(first)
    drawn = [(grid, title, _rows(tables, experiment, grid, own)) for grid, title, own in panels]
    return _lines(experiment, drawn, "steps")


@results.unseen.figure(
    "Mean success of each learner with the person in places that did not occur in training, by the number of "
    "places in training, with 95 % intervals."
)
def unseen(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws the learners of the answer, or all, in the grids about unseen places that have them."""
    assert experiment.report is not None
    answer, grids = experiment.report.answer, experiment.declared.grids
    learners = tuple(answer.learners) if answer else ()
    about = [grid for grid, kind in kinds_of(experiment).items() if kind == "unseen"]
    panels = [(grid, grids[grid].question, _rows(tables, experiment, grid, learners)) for grid in about]
    return _lines(experiment, [panel for panel in panels if len(panel[2]) >= len(learners)], "unseen_success")


@results.verdicts.figure(
    "Contrasts (rows) at each point of the grids (columns): where decided, which learner needs fewer steps, "
    "and how many times as many the other needs. Headings name a grid and its axes, as in `cells: places`."
)
def who(tables: Frames, experiment: Experiment) -> Figure:
    """Draws all contrasts; grids share a line while there is room."""
    contrasts, used = tables["contrasts"], {*"+->", ""}
    lines = _packed(contrasts)
    parts = [contrasts[contrasts["grid"].isin({grid for grid, _ in columns})] for columns in lines]
    sides = [[*dict.fromkeys(zip(own["x"], own["y"], strict=True))] for own in parts]
    height = 0.34 * sum(map(len, sides)) + 0.7 * len(lines) + 1.5
    with figure_of(len(lines), 1, (7.9, height)) as (figure, axes):
        axes[0, 0].get_gridspec().set_height_ratios([*map(len, sides)])
        for axis, own, rows, columns in zip(axes.flat, parts, sides, lines, strict=True):
            _draw_cells(axis, own, tables["pairs"], rows, columns, used)
            axis.set_xlim(-0.5, max(map(len, lines)) - 0.5)
            names = [[fill(experiment.learners[side].title, _LONG) for side in pair] for pair in rows]
            axis.set_yticks(range(len(rows)), [" vs\n".join(pair) for pair in names])
        signs = [text for sign, text in _SIGNS.items() if sign in used]
        figure.supxlabel(fill("; ".join(text.replace(" ", "\N{NO-BREAK SPACE}") for text in signs), 110))
        _sized(figure, _SMALL)
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
    axis: Axes, own: pd.DataFrame, pairs: pd.DataFrame, rows: list[Cell], columns: list[Cell], used: set[str]
) -> None:
    colours = np.full((len(rows), len(columns)), np.nan)
    for _, row in own.iterrows():
        index = rows.index((row["x"], row["y"])), columns.index((row["grid"], row["point"]))
        text, colours[index] = _sign(row, pairs)
        used.update([text, text[:1]])
        is_dark = abs(np.nan_to_num(colours[index])) > _DARK * _MOST
        ink = "black" if np.isnan(colours[index]) else INK[int(is_dark)]
        label = axis.text(index[1], index[0], text, ha="center", va="center", color=ink)
        label.set_fontweight("bold" if colours[index] > 0 else "normal")
    edges = np.arange(len(columns) + 1) - 0.5, np.arange(len(rows) + 1) - 0.5
    scale, norm = colour_map(_COLOUR_MAP), Normalize(-_MOST, _MOST)
    axis.pcolormesh(*edges, colours, cmap=scale, norm=norm, edgecolors="white", linewidth=0.8)
    for grid in dict.fromkeys(grid for grid, _ in columns if grid):
        points = [point for name, point in columns if name == grid]
        axes = ", ".join(_LABELS.get(part.split()[0], part.split()[0]) for part in points[0].split(", "))
        title = axes if axes.startswith(grid) else f"{grid}: {axes}".replace("_", " ")
        title, x = fill(title, max(5 * len(points), 10)), columns.index((grid, points[0])) - 0.5
        axis.text(x, -0.6, title, va="bottom", fontweight="bold")
    at = [i for i, (grid, _) in enumerate(columns) if grid]
    labels = [", ".join(part.split()[1] for part in columns[i][1].split(", ")) for i in at]
    axis.set_xticks(at, [label.replace("x", "×") for label in labels])
    axis.tick_params(length=0)
    axis.tick_params(axis="x", rotation=90 if max(map(len, labels)) > 4 else 0)
    axis.spines[:].set_visible(False)
    axis.invert_yaxis()


def _rows(tables: Frames, experiment: Experiment, grid: str, learners: Sequence[str]) -> list[pd.DataFrame]:
    """Returns rows of learners, by default all but references, whose values of the only axis are in `at`."""
    cells, (axis, values, _) = tables["cells"], axis_of(experiment, grid)
    at = {f"{axis} {name}": value for name, value in values.items()}
    rows = cells[cells["grid"] == grid]
    rows = rows.assign(learner=rows["variant"] + ", " + rows["observation"], at=rows["point"].map(at))
    own = dict([*rows.sort_values("at").groupby("learner")])
    return [own[name] for name in learners or ranked(experiment) if name in own]


def _lines(experiment: Experiment, panels: Sequence[Panel], column: str) -> Figure | None:
    """Draws steps or success against the axis of a grid, in rows of two panels, with the same heights."""
    panels = [panel for panel in panels if panel[2]]
    if not panels:
        return None
    every = pd.concat(rows for *_, lines in panels for rows in lines)
    lowest, budget = _shown(every, column).min().min(), every["budget"].max()
    n_rows, n_columns = -(-len(panels) // 2), min(len(panels), 2)
    with figure_of(n_rows, n_columns, (3.95 * n_columns, 3.0 * n_rows)) as (figure, axes):
        for axis in axes.flat[len(panels) :]:
            axis.remove()
        for axis, (grid, title, lines) in zip(axes.flat, panels, strict=False):
            if column == "steps":
                first, last = lines[0]["at"].iloc[[0, -1]]
                axis.set(yscale="log", ylim=(lowest / 1.3, 2.2 * budget))
                axis.hlines(budget, first, last, color="0.6", lw=0.8, zorder=0)
                axis.annotate(_NEVER, (first, budget), (0, 5), textcoords="offset points")
                axis.yaxis.set_major_formatter("{x:,.0f}")
            else:
                axis.set(ylim=(0, 1.04))
            _set_horizontal(axis, *axis_of(experiment, grid))
            besides = range(1 - len(lines), len(lines), 2)  # points
            placed = zip(lines, besides, strict=True)
            _apart(axis, [_curve(axis, *line, column, experiment) for line in placed])
            axis.set(title=fill(title, 44), ylabel=_WHAT[column] if axis in axes[:, 0] else "")
            axis.tick_params(labelleft=axis in axes[:, 0])
        _sized(figure, _SMALL)
    return figure


def _set_horizontal(axis: Axes, name: str, numbers: Mapping[str, float], texts: Sequence[str]) -> None:
    """Sets the horizontal axis, with as much room for names at the right as lines have."""
    values = [*numbers.values()]
    if values[0] > 0:
        span = max(values[-1] / values[0], 4.0)
        axis.set(xscale="log", xlim=(values[0] / span**0.06, values[-1] * span**_ROOM))
    else:
        axis.set_xlim(0, values[-1] * (1 + _ROOM))
    shares = (axis.transScale + axis.transLimits).transform([(value, 1) for value in values])[:, 0]
    labels, last = list[str](), -1.0
    for share, text in zip(shares, texts, strict=True):  # only texts that do not cover each other
        labels.append(text if share - last > _APART else "")
        last = share if labels[-1] else last
    axis.set_xticks(values, labels)
    axis.minorticks_off()
    axis.set_xlabel(f"number of {_LABELS.get(name, name)}")


def _curve(axis: Axes, rows: pd.DataFrame, beside: float, column: str, experiment: Experiment) -> Annotation:
    """Draws a learner's line, with hollow markers where most runs never learn; returns its name.

    It is some points beside its place, so that intervals do not cover each other.
    """
    learner = experiment.learners[rows["learner"].iloc[0]]
    style, values = style_of(learner.name, experiment), rows["at"].to_numpy()
    shown, low, high = _shown(rows, column).to_numpy().T
    moved = axis.transData + ScaledTranslation(beside / 72, 0, axis.figure.dpi_scale_trans)
    axis.plot(values, shown, color=style["color"], ls=style["ls"], lw=1.6, transform=moved)
    axis.vlines(values, low, high, color=style["color"], lw=2.5, alpha=0.35, transform=moved)
    is_known = np.isfinite(rows[column].to_numpy())
    for chosen, filling in ((is_known, style["color"]), (~is_known, "white")):
        mark = {"marker": style["marker"], "mec": style["color"], "mfc": filling, "ls": ""}
        axis.plot(values[chosen], shown[chosen], ms=6, transform=moved, **mark)
    end = values[-1], shown[-1]
    label = axis.annotate(fill(learner.title, _WIDTH), end, (_BESIDE, 0), textcoords="offset points")
    # The colour of a name does not become lighter with what the learner observes.
    ink = style_of(learner.name, experiment, observation="")["color"]
    label.set(va="center", color=ink, linespacing=1.0)
    return label


def _shown(rows: pd.DataFrame, column: str = "steps") -> pd.DataFrame:
    """Returns values and their intervals as they are drawn: steps at the budget where they are infinite."""
    columns = rows[[column, f"{column}_low", f"{column}_high"]]
    return columns.clip(_LOWEST, rows["budget"], axis=0) if column == "steps" else columns


def _apart(axis: Axes, labels: Iterable[Annotation]) -> None:
    """Moves the names at the ends of lines, so that none covers another one or the title above."""
    end = _HEIGHT
    to_points = axis.transScale + axis.transLimits
    for label in sorted(labels, key=lambda label: label.xy[1], reverse=True):
        at, half = to_points.transform(label.xy)[1] * _HEIGHT, _LINE * (1 + label.get_text().count("\n")) / 2
        height = min(at, end - half)
        label.set_position((_BESIDE, height - at))
        end = height - half


def _sign(row: pd.Series, pairs: pd.DataFrame) -> tuple[str, float]:
    """Returns the text and the colour of a contrast: the logarithm of its ratio of steps, or NaN for none."""
    if row["verdict"] not in (FASTER, SLOWER) or np.isnan(row["ratio"]):
        return _SIGN_OF.get(row["verdict"], "?"), np.nan
    logarithm = np.log(row["ratio"])
    own = pairs[(pairs["grid"] == row["grid"]) & (pairs["point"] == row["point"])]
    own = own[(own["x"] == row["x"]) & (own["y"] == row["y"])][: row["n"]]
    # Where most runs of a side never learn, the ratio is a bound.
    is_bound = any(np.isinf(own[side].fillna(np.inf).median()) for side in ("steps_x", "steps_y"))
    return "≥" * is_bound + two_digits(np.exp(abs(logarithm))), float(np.clip(logarithm, -_MOST, _MOST))
