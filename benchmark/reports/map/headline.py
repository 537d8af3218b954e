"""The answer in three paragraphs: where the net takes over, the control, and the other currencies."""

import math
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from benchmark.drawing.tables import duration, link
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding

_FORMS: Final = {  # what a learner is given where it sees the cells of both
    "index": "a row for every pair of cells",
    "offset": "a row for every offset between the two",
    "coordinates": "given the coordinates of both",
    "one_hot": "given both cells as one-hot codes",
}


class _Line(NamedTuple):
    """A grid with one axis, its last point, and the learners of its first contrast there."""

    grid: str
    axis: str
    point: str
    value: str
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
    table = folder.frame("contrasts")
    for grid, axes in folder.manifest["facts"]["axes"].items():
        rows = table[table["grid"] == grid]
        if len(axes) == 1 and len(rows):
            (_, row), *_ = rows[(rows["x"] == rows["x"].iloc[0]) & (rows["y"] == rows["y"].iloc[0])][
                ::-1
            ].iterrows()
            point = str(row["point"])
            return _Line(grid, axes[0], point, point.split()[-1], str(row["x"]), str(row["y"]))
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
    return f"`{learner}`{f', {form}' if form else ''}"


def _took(frame: pd.DataFrame, table: str, column: str, line: _Line, learner: str) -> str:
    """Returns the median that a learner took at the line's last point, as a text with a link."""
    row = _rows(frame, learner, grid=line.grid, point=line.point).iloc[0]
    if math.isinf(row[column]):
        return "more than its budget allows"
    return link(duration(row[column]) if column == "cpu_time_s" else f"{row[column]:,.0f}", table, row)


def _from(folder: Folder, table: str, line: _Line, currency: str) -> str:
    """Says from which value of the axis on the net takes less, with its interval."""
    found = folder.frame(table)
    is_it = (found["grid"] == line.grid) & (found["currency"] == currency)
    rows = found[is_it & (found["x"] == line.net) & (found["y"] == line.table)]
    for _, row in rows.iterrows():
        low, high = (
            "never" if math.isinf(end) else f"{round(float(end)):,}"
            for end in (row["crossing_low"], row["crossing_high"])
        )
        if math.isinf(row["crossing"]):
            bound = "" if low == "never" else f" (its 95 % interval begins at {low})"
            return f"at {link('none', table, row)} of the {line.axis} tried{bound}"
        start = link(f"{round(float(row['crossing'])):,}", table, row)
        return f"from {start} [{low}, {high}] {line.axis} on"
    return ""


def _steps(folder: Folder, line: _Line) -> str:
    start, cells = _from(folder, "crossings", line, "steps"), folder.frame("cells")
    row = _rows(cells, line.net, grid=line.grid, point=line.point).iloc[0]
    net, table = (_took(cells, "cells", "steps", line, learner) for learner in (line.net, line.table))
    level = folder.manifest["facts"]["solved"]["success"]
    return (
        f"In a room of {row['rows']} × {row['columns']} cells, a net ({_named(line.net)}) needs fewer steps "
        f"than a table ({_named(line.table)}) {start}. With {line.value} {line.axis}, the median run needs, "
        f"until success stays at or above {level:g}, {net} steps with the net and {table} with the table."
    )


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
        parts.append(
            f"The control: when the coordinates of the person's {coded['places'].iloc[0]} cells are permuted "
            f"at random, which no table can notice, {net[0]} runs of the net still get there (without: "
            f"{net[1]}), and {table[0]} of the table (without: {table[1]})."
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
            f"episodes in places where the person never stood, the table in {table_text}."
        )
    return " ".join(parts)


def _currencies(folder: Folder, line: _Line) -> str:
    """Says where the crossing is in the other currencies, and who needs the fewest steps of all."""
    starts = {
        words: _from(folder, table, line, words)
        for table, words in (("crossings", "disagreements"), ("crossings_cpu", "CPU seconds"))
    }
    net, table = (_took(folder.frame("cpu"), "cpu", "cpu_time_s", line, each) for each in line[-2:])
    text = (
        f"Counted in disagreements of the person, the net takes less {starts['disagreements']}; counted in "
        f"CPU time, {starts['CPU seconds']}. With {line.value} {line.axis}, the CPU time of the median run "
        f"is {net} with the net and {table} with the table."
    )
    cells = folder.frame("cells")
    here = cells[(cells["grid"] == line.grid) & (cells["point"] == line.point)]
    if np.isfinite(here["steps"]).any():
        best = here.iloc[int(here["steps"].argmin())]
        name = f"{best['algorithm']}, {best['observation']}"
        if name not in (line.net, line.table):
            needs = link(f"{best['steps']:,.0f}", "cells", best)
            text += f" Fewest steps there: {_named(name)}, with {needs}."
    return text
