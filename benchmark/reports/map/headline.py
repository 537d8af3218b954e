"""The answer in three paragraphs: where the net takes over, the control, and the other currencies."""

import math
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from benchmark.drawing.tables import duration, link
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding

_FORMS: Final = {  # of tables
    "index": "a row for each pair of cells of agent and person",
    "offset": "a row for each offset between the two",
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


def _named(folder: Folder, table: str) -> str:
    """Returns a table as it is called in a sentence, with what its rows are."""
    form = _FORMS.get(table.split(", ")[1], "")
    return f"{folder.names.told(table)}{f' ({form})' if form else ''}"


def _took(frame: pd.DataFrame, table: str, column: str, line: _Line, learner: str) -> str:
    """Returns the median that a learner took at the line's last point, with a link; empty if most fail."""
    row = _rows(frame, learner, grid=line.grid, point=line.point).iloc[0]
    if math.isinf(row[column]):
        return ""
    return link(duration(row[column]) if column == "cpu_time_s" else f"{row[column]:,.0f}", table, row)


def _clause(folder: Folder, table: str, line: _Line, currency: str, does: str) -> str:
    """Says from which value of the axis on the net does something, with the interval, or that it does not."""
    found = folder.frame(table)
    is_it = (found["grid"] == line.grid) & (found["currency"] == currency)
    (_, row), *_ = found[is_it & (found["x"] == line.net) & (found["y"] == line.table)].iterrows()
    if math.isinf(row["crossing"]):
        return f"does {link('not', table, row)} {does}, even with {line.where}"
    low, high = (
        "–" if math.isinf(end) else f"{end:,.0f}" for end in (row["crossing_low"], row["crossing_high"])
    )
    ends = f"(95 % interval: {low} to {high})" if currency == "steps" else f"[{low}, {high}]"
    value = f"{link(format(row['crossing'], ',.0f'), table, row)} {ends}"
    does = does.replace(" ", "s ", 1)
    if line.axis == "places":
        return f"{does} if the person may stand in about {value} or more places"
    return f"{does} from about {line.axis} = {value} on"


def _steps(folder: Folder, line: _Line) -> str:
    """Says where the net takes over, who needs least at the end of the axis, and what counts."""
    cells, level = folder.frame("cells"), folder.manifest["facts"]["solved"]["success"]
    row = _rows(cells, line.net, grid=line.grid, point=line.point).iloc[0]
    net, table = (_took(cells, "cells", "steps", line, each) or "more than its budget" for each in line[-2:])
    faster = f"learn in fewer steps than {_named(folder, line.table)}"
    text = (
        f"In a room of {row['rows']} × {row['columns']} cells, a net ({folder.names.of_arm(line.net)}) "
        f"{_clause(folder, 'crossings', line, 'steps', faster)}. "
    )
    is_ours = ~cells["algorithm"].isin(folder.manifest["facts"]["references"])
    here = cells[(cells["grid"] == line.grid) & (cells["point"] == line.point) & is_ours]
    best = here.iloc[int(here["steps"].argmin())]
    name = f"{best['algorithm']}, {best['observation']}"
    if np.isfinite(best["steps"]) and name not in (line.net, line.table):
        least = link(f"{best['steps']:,.0f}", "cells", best)
        text += (
            f"But with {line.where}, the smallest median is that of {_named(folder, name)}: {least} steps, "
            f"compared with {net} for the net and {table} for {folder.names.told(line.table)} (medians, "
            "not tested)."
        )
    else:
        text += (
            f"With {line.where}, the median run needs {net} steps with the net and {table} with "
            f"{folder.names.told(line.table)}."
        )
    return f"{text} A run has *learned* when success stays at or above {level:g}."


def _control(folder: Folder, line: _Line) -> str:
    """Says what permuted coordinates do to both, and what both can do in unseen places."""
    cells, than, parts = folder.frame("cells"), folder.names.told(line.table), list[str]()
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
            f"random; what {than} observes does not change. Then {net[0]} runs of the net learn within "
            f"{budgets[0]} steps (unpermuted: {net[1]}), and {table[0]} runs of the table within "
            f"{budgets[1]} (unpermuted: {table[1]})."
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
            f"With the person in a place that was not among the {both[0]['places'].iloc[0]} of training, "
            f"the net succeeds in {net_text} of episodes, and the table in {table_text}."
        )
    return " ".join(parts)


def _currencies(folder: Folder, line: _Line) -> str:
    """Says where the crossing is in the other currencies."""
    than = folder.names.told(line.table)
    wrong = _clause(folder, "crossings", line, "wrong PINGs", f"need fewer wrong PINGs than {than}")
    time = _clause(folder, "crossings_cpu", line, "CPU seconds", "need less CPU time")
    text = f"By medians (not tested), the net {wrong}. It {time}."
    net, table = (_took(folder.frame("cpu"), "cpu", "cpu_time_s", line, each) for each in line[-2:])
    if net and table:
        text += (
            f" With {line.where}, the median run trains for {net} with the net and {table} with the table."
        )
    return text
