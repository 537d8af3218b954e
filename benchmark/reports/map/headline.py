"""The answer in three paragraphs: where the net takes over, the control, and the other currencies."""

import math
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from benchmark.drawing.tables import duration, link
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding

_FORMS: Final = {  # what a learner is given where it sees the cells of both
    "index": "one row for every pair of their cells",
    "offset": "one row for every offset between agent and person",
    "coordinates": "it observes the coordinates of agent and person",
    "one_hot": "it observes both cells as one-hot codes",
}


class _Line(NamedTuple):
    """A grid with one axis, its last point, and the learners of its first contrast there."""

    grid: str
    axis: str
    point: str
    where: str  # the same in words
    net: str
    table: str


def headline(folder: Folder) -> Finding | None:
    """Says where the net takes over, what the control shows, and what else counts."""
    line = _first_line(folder)
    if line is None:
        return None
    parts = [_steps(folder, line), _control(folder, line), _currencies(folder, line)]
    return Finding("\n\n".join(part for part in parts if part), "several")


def _first_line(folder: Folder) -> _Line | None:
    """Returns the first crossing of a net and a table that are compared; None if there is none."""
    if "contrasts.csv" not in folder or "crossings.csv" not in folder:
        return None
    facts, table, found = folder.manifest["facts"], folder.frame("contrasts"), folder.frame("crossings")
    for grid in found["grid"].unique():
        for _, row in table[table["grid"] == grid][::-1].iterrows():
            x, y = str(row["x"]), str(row["y"])
            is_it = (found["grid"] == grid) & (found["x"] == x) & (found["y"] == y)
            if is_it.any() and [x, y] == facts["contrast"]:
                value = str(row["point"]).split()[-1]
                axis = facts["axes"][grid][0]
                where = f"{value} {axis}" if axis == "places" else f"{axis} = {value}"
                return _Line(str(grid), axis, str(row["point"]), where, x, y)
    return None


def _rows(frame: pd.DataFrame, learner: str, **where: object) -> pd.DataFrame:
    """Returns a learner's rows with these values."""
    algorithm, observation = learner.split(", ")
    rows = frame[(frame["algorithm"] == algorithm) & (frame["observation"] == observation)]
    for key, value in where.items():
        rows = rows[rows[key] == value]
    return rows


def _named(learner: str) -> str:
    form = _FORMS.get(learner.split(", ")[1], "")
    return f"`{learner}`{f'; {form}' if form else ''}"


def _took(frame: pd.DataFrame, table: str, column: str, line: _Line, learner: str) -> str:
    """Returns the median that a learner took at the line's last point, with a link; empty if most fail."""
    row = _rows(frame, learner, grid=line.grid, point=line.point).iloc[0]
    if math.isinf(row[column]):
        return ""
    return link(duration(row[column]) if column == "cpu_time_s" else f"{row[column]:,.0f}", table, row)


def _clause(folder: Folder, table: str, line: _Line, currency: str, things: str) -> str:
    """Says from which value of the axis on the net needs less, with the interval, or that it does not."""
    found = folder.frame(table)
    is_it = (found["grid"] == line.grid) & (found["currency"] == currency)
    (_, row), *_ = found[is_it & (found["x"] == line.net) & (found["y"] == line.table)].iterrows()
    if math.isinf(row["crossing"]):
        return f"does {link('not', table, row)} need {things}, even with {line.where}"
    low, high = (
        "–" if math.isinf(end) else f"{end:,.0f}" for end in (row["crossing_low"], row["crossing_high"])
    )
    value = f"{link(format(row['crossing'], ',.0f'), table, row)} [{low}, {high}]"
    if line.axis == "places":
        return f"needs {things} if the person may stand in about {value} or more places"
    return f"needs {things} from about {line.axis} = {value} on"


def _steps(folder: Folder, line: _Line) -> str:
    """Says where the net takes over, what both need at the end of the axis, and who needs least there."""
    cells, level = folder.frame("cells"), folder.manifest["facts"]["solved"]["success"]
    row = _rows(cells, line.net, grid=line.grid, point=line.point).iloc[0]
    net, table = (_took(cells, "cells", "steps", line, each) or "more than its budget" for each in line[-2:])
    things = f"fewer steps than a table ({_named(line.table)})"
    text = (
        f"In a room of {row['rows']} × {row['columns']} cells, a net ({_named(line.net)}) "
        f"{_clause(folder, 'crossings', line, 'steps', things)}. "
        f"Counted are the steps until success stays at or above {level:g}. With {line.where}, the median run "
        f"needs {net} with the net and {table} with this table."
    )
    is_ours = ~cells["algorithm"].isin(folder.manifest["facts"]["references"])
    here = cells[(cells["grid"] == line.grid) & (cells["point"] == line.point) & is_ours]
    best = here.iloc[int(here["steps"].argmin())]
    name = f"{best['algorithm']}, {best['observation']}"
    if np.isfinite(best["steps"]) and name not in (line.net, line.table):
        low, high = (f"{best[f'steps_{end}']:,.0f}" for end in ("low", "high"))
        needs = link(f"{best['steps']:,.0f}", "cells", best)
        text += f" The smallest median there is {needs} [{low}, {high}], that of {_named(name)}."
    return text


def _control(folder: Folder, line: _Line) -> str:
    """Says what permuted coordinates do to both, and what both can do in unseen places."""
    cells, parts = folder.frame("cells"), []
    coded = cells[cells["grid"].isin(cells.loc[cells["permuted"] == 1, "grid"])]
    both = [pd.concat([_rows(coded, each, permuted=share) for share in (1.0, 0.0)]) for each in line[-2:]]
    if all(len(rows) == 2 for rows in both):
        net, table = (
            [f"{link(str(row['n_solved']), 'cells', row)} of {row['n']}" for _, row in rows.iterrows()]
            for rows in both
        )
        budgets = [f"{rows['budget'].iloc[0]:,}" for rows in both]
        parts.append(
            f"As a control, the coordinates of the person's {coded['places'].iloc[0]} places are permuted at "
            f"random. What the table observes does not change. With the permutation, {net[0]} runs of the "
            f"net reach this level within {budgets[0]} steps (without it: {net[1]}), and {table[0]} runs of "
            f"the table within {budgets[1]} (without it: {table[1]})."
        )
    unseen = cells[cells["unseen_success"].notna()] if "unseen_success" in cells else cells[:0]
    both = [_rows(unseen, each, places=unseen["places"].max()) for each in line[-2:]]
    if all(len(rows) for rows in both):
        net_text, table_text = (
            f"{link(f'{row.unseen_success:.2f}', 'cells', row)} [{row.unseen_success_low:.2f}, "
            f"{row.unseen_success_high:.2f}]"
            for row in (rows.iloc[0] for rows in both)
        )
        parts.append(
            f"After training with {both[0]['places'].iloc[0]} places, the net succeeds in {net_text} of "
            f"episodes with the person in a place that did not occur in training, and this table in "
            f"{table_text}."
        )
    return " ".join(parts)


def _currencies(folder: Folder, line: _Line) -> str:
    """Says where the crossing is in the other currencies."""
    wrong = _clause(folder, "crossings", line, "wrong PINGs", "fewer wrong PINGs")
    time = _clause(folder, "crossings_cpu", line, "CPU seconds", "less CPU time")
    text = f"The net {wrong}. It {time}."
    net, table = (_took(folder.frame("cpu"), "cpu", "cpu_time_s", line, each) for each in line[-2:])
    if net and table:
        text += f" At {line.where}, the median run trains for {net} with the net and {table} with the table."
    return text
