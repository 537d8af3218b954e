"""Figures of a map."""

from collections.abc import Callable, Sequence
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, WORSE
from benchmark.analysis.looks import NEITHER, TOO_SHORT, Cell, Decision
from benchmark.drawing.style import INK, figure_of, learner_style
from benchmark.drawing.tables import two_digits
from benchmark.reports.item import Frames, drawing
from benchmark.reports.learners import Names
from benchmark.reports.map.data import Maps, number

_COLOUR_MAP: Final = "PuOr_r"  # purple: y, orange: x; to be told apart in grey by the signs
_LOWEST: Final = 100  # steps that are drawn
_DARK: Final = 0.62  # share of the scale from which on ink is white
_FARTHEST: Final = 16.0  # ratio from which on colours do not differ
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
_FIXED: Final = "\N{NO-BREAK SPACE}"
_LABELS: Final = {
    "places": "places in which the person may stand",
    "room": "cells of the room",
    "noise": "noise of feedback",
}


def styles(data: Maps) -> dict[str, dict[str, Any]]:
    """Returns colour, marker and dash of every learner but references."""
    names = [name for name, each in data.experiment.algorithms.items() if not each.reference_for]
    cells = [cell for cell in data.ends if not data.is_reference(cell)]
    return {cell.learner: learner_style(cell.variant, cell.observation, names) for cell in cells}


def _ink(data: Maps, learner: str) -> Any:
    """Returns the colour of a learner's name: not lighter, whatever it observes."""
    return learner_style(learner.partition(", ")[0], "", [*data.experiment.algorithms])["color"]


def _curves(axis: Axes, data: Maps, rows: pd.DataFrame, grid: str) -> None:
    """Draws the median steps of every learner, hollow and at the budget where most runs never solve."""
    style, texts, names = styles(data), list[Any](), Names.of(data.experiment)
    compared = {cell.learner for pair in data.decided for cell in pair}
    for name, line in data.lines[grid].items():
        if name not in style:
            continue
        look, table = style[name], pd.DataFrame([_row_of(rows, data, cell) for _, cell in sorted(line)])
        values = np.array([value for value, _ in sorted(line)])
        shown, low, high = (
            table[column].where(np.isfinite(table[column]), table["budget"]).clip(lower=_LOWEST)
            for column in ("steps", "steps_low", "steps_high")
        )
        axis.plot(values, shown, color=look["color"], ls=look["ls"], lw=1.6)
        alpha = 0.2 if name in compared else 0.08
        axis.fill_between(values, low, high, color=look["color"], alpha=alpha, lw=0)
        is_known = np.isfinite(table["steps"].to_numpy())
        for chosen, filling in ((is_known, look["color"]), (~is_known, "white")):
            mark = {"marker": look["marker"], "mec": look["color"], "mfc": filling, "ls": ""}
            axis.plot(values[chosen], shown[chosen], ms=6, **mark)
        text = axis.annotate(
            names.of_side(name), (values[-1], shown.iloc[-1]), (8, 0), textcoords="offset points"
        )
        text.set(va="center", fontsize="small", color=_ink(data, name))
        texts.append(text)
    _apart(texts)


def _apart(texts: list[Any]) -> None:
    """Moves labels up so that none is over another, given that their axis is logarithmic."""
    lowest = -np.inf
    for text in sorted(texts, key=lambda each: each.xy[1]):
        place = max(np.log10(text.xy[1]), lowest)
        text.set_position((8, (place - np.log10(text.xy[1])) * _POINTS))
        lowest = place + _LINE / _POINTS


def _row_of(rows: pd.DataFrame, data: Maps, cell: Cell) -> pd.Series:
    key = data.key(cell)
    is_here = (rows["grid"] == key["grid"]) & (rows["point"] == key["point"])
    is_ours = (rows["algorithm"] == cell.variant) & (rows["observation"] == cell.observation)
    return next(row for _, row in rows[is_here & is_ours].iterrows())


def _set_axis(axis: Axes, values: list[float], texts: list[str], label: str) -> None:
    if min(values) > 0:
        axis.set_xscale("log")
    axis.set_xticks(values, texts)
    axis.minorticks_off()
    axis.set_xlabel(label)


def _values(data: Maps, grid: str) -> tuple[list[float], list[str]]:
    (axis,) = data.experiment.grids[grid].axes
    names = [*data.experiment.grids[grid].axes[axis]]
    return [number(name) for name in names], [name.replace("x", "×") for name in names]


def _label(data: Maps, grid: str) -> str:
    (axis,) = data.experiment.grids[grid].axes
    return _LABELS.get(axis, axis)


@drawing(
    "map",
    "the map: steps against places, who needs fewer in rooms and places, and the control",
    "Steps until a run has learned. Left: median steps of each learner, with 95 % intervals; hollow, drawn "
    "at the budget: most runs do not learn. Middle: which of two learners needs fewer, where that is "
    "decided, and how many times as many the other one needs. Right: a control, in which the coordinates of "
    "more and more places are permuted.",
)
def picture(tables: Frames, data: Maps) -> Figure | None:
    """Draws the first grid with one axis, the first with two, and the control, as far as there are any."""
    return _panels(tables, data, _leading(data))


@drawing(
    "grids",
    "the same of all other grids",
    "The other grids. For unseen places, the figure shows success in them, with 95 % intervals.",
)
def others(tables: Frames, data: Maps) -> Figure | None:
    """Draws what the map does not show, but for references."""
    shown = _leading(data)
    rest = [name for name in data.experiment.grids if name not in shown and (_kind(data, name) is not None)]
    return _panels(tables, data, rest)


def _leading(data: Maps) -> list[str]:
    kinds = {name: _kind(data, name) for name in data.experiment.grids}
    first = (next((name for name in kinds if kinds[name] is draw), None) for draw in _WIDTHS)
    return [name for name in [*first][:3] if name is not None]


def _kind(data: Maps, grid: str) -> "Draw | None":
    """Returns what draws a grid; None if it is not drawn."""
    axes = [*data.experiment.grids[grid].axes]
    cells = [cell for cell in data.ends if cell.condition.split("/")[1] == grid]
    if len(axes) == 1 and any(not data.is_reference(cell) for cell in cells):
        if axes == ["permuted"]:
            return _draw_control
        return _draw_unseen if any(data.scenario(cell).issuer.unseen for cell in cells) else _draw_lines
    return _draw_square if len(axes) == 2 and _compared(data, grid) else None


def _panels(tables: Frames, data: Maps, grids: Sequence[str]) -> Figure | None:
    """Draws grids side by side."""
    panels = [(draw, grid) for grid in grids if (draw := _kind(data, grid)) is not None]
    if not panels:
        return None
    widths = [_WIDTHS[draw] for draw, _ in panels]
    with figure_of(1, 1, (sum(widths), 4.9)) as (figure, axes):
        axes[0, 0].remove()
        parts = figure.subfigures(1, len(panels), width_ratios=widths, squeeze=False)[0]
        for part, (draw, grid) in zip(parts, panels, strict=True):
            axis = part.subplots()
            draw(axis, tables, data, grid)
            question = fill(data.experiment.grids[grid].question, round(9.5 * _WIDTHS[draw]))
            axis.set_title(question, loc="left", fontweight="bold")
    return figure


def _draw_lines(axis: Axes, tables: Frames, data: Maps, grid: str) -> None:
    """Draws steps against the values of an axis."""
    values, texts = _values(data, grid)
    is_positive = min(values) > 0
    axis.set_yscale("log")
    _curves(axis, data, tables["cells"], grid)
    _set_axis(axis, values, texts, _label(data, grid))
    axis.set_xlim(values[0] / 1.15 if is_positive else 0, values[-1] * (9 if is_positive else 2))
    assert data.experiment.solved is not None
    assert data.experiment.report is not None
    axis.set_ylabel(f"steps until success stays at or above {data.experiment.solved.success:g}")
    y = data.experiment.report.contrasts[0][1]
    steps = {value: np.median(data.ends[cell].took()[0]) for value, cell in data.lines[grid].get(y, [])}
    if values[-1] in steps and np.isfinite(last := steps[values[-1]]):
        proportional = last * np.array(values) / values[-1]
        axis.plot(values, proportional, color="0.4", lw=1, ls=":")
        axis.annotate(
            "proportional",
            (values[0], proportional[0]),
            (4, -9),
            textcoords="offset points",
            fontsize="x-small",
        )


def _compared(data: Maps, grid: str) -> dict[tuple[str, ...], tuple[Cell, Cell, Decision]]:
    """Returns the first contrast at every point of a grid, by the values of its axes."""
    found: dict[tuple[str, ...], tuple[Cell, Cell, Decision]] = {}
    for (x, y), decision in data.decided.items():
        _, name, *point = x.condition.split("/")
        if name == grid:
            found.setdefault(tuple(each.split("=")[1] for each in point), (x, y, decision))
    return found


def _draw_square(axis: Axes, __: Frames, data: Maps, grid: str) -> None:
    """Colours who needs fewer steps at every point of two axes; white where that is not decided."""
    declared, report = data.experiment.grids[grid], data.experiment.report
    assert report is not None
    first, second = declared.axes
    rows, columns = [*declared.axes[first]], [*declared.axes[second]]
    most, used, compared = np.log(_FARTHEST), set[str](), _compared(data, grid)
    names = Names.of(data.experiment)
    colours = np.full((len(rows), len(columns)), np.nan)
    for (row, column), (x, y, decision) in compared.items():
        at, ratio = (rows.index(row), columns.index(column)), data.ratio(x, y, "steps")
        text = {EQUIVALENT: "=", NEITHER: "neither", TOO_SHORT: "short"}.get(decision.verdict, "?")
        if decision.verdict in (BETTER, WORSE):
            logarithm = np.log(ratio.value) if ratio.value > 0 else -most
            if np.isnan(logarithm):
                colours[at], text = (1 if decision.verdict == BETTER else -1) * most / 4, "!"
            else:
                colours[at] = np.clip(logarithm, -most, most)
                text = "≥" * data.is_bound(x, y) + two_digits(np.exp(abs(logarithm)))
        used.update([text, text[:1]])
        is_dark = abs(np.nan_to_num(colours[at])) > _DARK * most
        ink = "black" if np.isnan(colours[at]) else INK[int(is_dark)]
        axis.text(at[1], at[0], text, ha="center", va="center", color=ink, fontsize="small")
    if len(compared) < colours.size:
        used.add("")
    norm = Normalize(-most, most)
    edges = np.arange(len(columns) + 1) - 0.5, np.arange(len(rows) + 1) - 0.5
    image = axis.pcolormesh(*edges, colours, cmap=_COLOUR_MAP, norm=norm, edgecolors="white", linewidth=0.8)
    axis.set_xticks(range(len(columns)), columns)
    axis.set_yticks(range(len(rows)), [row.replace("x", "×") for row in rows])
    axis.set(xlabel=_LABELS.get(second, second), ylabel=_LABELS.get(first, first))
    axis.spines[:].set_visible(False)
    axis.tick_params(length=0)
    bar = axis.figure.colorbar(image, ax=axis, location="bottom", aspect=30, pad=0.02)
    net, table = (names.of_side(side) for side in report.contrasts[0])
    labels = [f"{name}\nneeds fewer steps" if name else "" for name in (table, "", net)]
    bar.set_ticks([-most, 0, most], labels=labels)
    bar.ax.tick_params(length=0)
    left, _, right = bar.ax.get_xticklabels()
    left.set_horizontalalignment("left")
    right.set_horizontalalignment("right")
    bar.outline.set_visible(False)
    signs = ["number: how many times as many the other one needs"]
    signs += dict.fromkeys(text.replace(" ", _FIXED) for sign, text in _SIGNS.items() if sign in used)
    bar.ax.set_xlabel(fill("; ".join(signs), 58), fontsize="small")


def _draw_control(axis: Axes, tables: Frames, data: Maps, grid: str) -> None:
    """Draws the success at the end of training against the share of codes that are permuted."""
    _draw_success(axis, tables, data, grid, "success")
    axis.set(xlabel="% of the places whose\ncoordinates are permuted")
    axis.set(ylabel="success at the end of training")


def _draw_unseen(axis: Axes, tables: Frames, data: Maps, grid: str) -> None:
    """Draws the success in unseen places."""
    _draw_success(axis, tables, data, grid, "unseen_success")
    axis.set(xlabel=fill(_label(data, grid), 24), ylabel="success in unseen places")


def _draw_success(axis: Axes, tables: Frames, data: Maps, grid: str, column: str) -> None:
    style, names = styles(data), Names.of(data.experiment)
    _, texts = _values(data, grid)
    for name, line in data.lines[grid].items():
        if name in style:
            points = pd.DataFrame([_row_of(tables["cells"], data, cell) for _, cell in sorted(line)])
            success, low, high = (points[f"{column}{end}"].to_numpy() for end in ("", "_low", "_high"))
            ends = [success - low, high - success]
            axis.errorbar(
                range(len(points)),
                success,
                ends,
                lw=1.6,
                elinewidth=0.8,
                ms=6,
                label=names.of_side(name),
                **style[name],
            )
    axis.set_xticks(range(len(texts)), texts)
    axis.set_ylim(-0.04, 1.04)
    axis.figure.legend(loc="outside lower center", frameon=False, fontsize="small")


Draw = Callable[[Axes, Frames, Maps, str], None]
_WIDTHS: Final[dict[Draw, float]] = {
    _draw_lines: 6.0,
    _draw_square: 4.2,
    _draw_control: 3.0,
    _draw_unseen: 3.0,
}
