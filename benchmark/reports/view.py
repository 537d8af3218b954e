"""Tables as README and page show them: columns of a CSV file, each number with a link to its row.

Rows are counted as by RFC 7111; the header is the first.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import pandas as pd

from benchmark.drawing.tables import plain, show, to_markdown
from benchmark.reports.published import Published

_NO_NUMBER: Final = "-"


@dataclass(frozen=True)
class Entry:
    """An entry of a table; its texts may hold `code` and links, see `benchmark.drawing.tables.link`."""

    text: str
    order: str = ""  # what it is sorted by; its text if empty
    row: str = ""  # the row that it comes from, as `file.csv#row=3`
    kind: str = ""  # a CSS class
    note: str = ""  # a second line
    details: str = ""  # shown on demand
    details_title: str = ""


@dataclass(frozen=True)
class Table:
    """A table as readers see it."""

    caption: str
    file: str  # the CSV file
    columns: Sequence[tuple[str, bool]]  # label, and whether it holds numbers
    rows: Sequence[Sequence[Entry]]

    def markdown(self) -> str:
        """Returns it as a Markdown table, without links."""
        labels = [label for label, _ in self.columns]
        rows = [[plain(entry.text) for entry in row] for row in self.rows]
        return to_markdown(pd.DataFrame(rows, columns=labels)) if rows else ""


def number_text(value: float, low: float | None = None, high: float | None = None) -> str:
    """Returns a number as readers see it, with its interval if it has one.

    >>> number_text(0.7, 0.123, 1.0), number_text(math.nan), number_text(math.inf)
    ('0.7 [0.123, 1]', '-', 'never')
    """
    if math.isnan(value):
        return _NO_NUMBER
    if math.isinf(value):
        return "never"  # of steps until something happens
    return show(value) + ("" if low is None or high is None else f" [{show(low)}, {show(high)}]")


def number_cell(file: str, row: pd.Series, key: str, ends: tuple[str, str] | None = None) -> Entry:
    """Returns a number of a row, with its interval if the row has one.

    Args:
      file: The CSV file.
      row: Of its data frame, whose index counts the rows of the file.
      key: The column.
      ends: The columns of the interval; by default the column's name with `_low` and `_high`.
    """
    value = float(row.get(key, math.nan))  # a column without values is not in the file
    low, high = (row.get(end) for end in ends or (f"{key}_low", f"{key}_high"))
    text = number_text(value, low, high)
    source = "" if text == _NO_NUMBER else f"{file}#row={int(str(row.name)) + 2}"
    return Entry(text, str(value).replace("inf", "Infinity"), source, "number")


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """Shows some columns of a CSV file: one row per row of the file, or per group of rows."""

    file: str
    caption: str
    keys: tuple[str, ...]  # columns that say what a row is about
    numbers: Mapping[str, str]  # columns of numbers with their labels; those that the file lacks are left out
    where: Callable[[pd.DataFrame], pd.DataFrame] | None = None  # the rows that are shown; by default all
    ends: tuple[str, str] | None = None  # of the intervals, see `number_cell`
    labels: Mapping[str, str] = field(default_factory=dict)  # of keys, where their names do not do

    def __call__(self, published: Published) -> Table:
        """Makes the table of a published folder."""
        frame = published.frame(self.file.removesuffix(".csv"))
        if self.where is not None:
            frame = self.where(frame)
        shown = {key: label for key, label in self.numbers.items() if key in frame}
        rows = [
            [
                *(Entry(str(row[key])) for key in self.keys),
                *(number_cell(self.file, row, key, self.ends) for key in shown),
            ]
            for _, row in frame.iterrows()
        ]
        columns = [(self.labels.get(key, key.replace("_", " ")), False) for key in self.keys]
        return Table(self.caption, self.file, [*columns, *((label, True) for label in shown.values())], rows)
