"""What the text on an experiment looks up in published tables, and what it claims of them.

The text on `when.toml` is `when.md.jinja`. Beside it, the function `finding` of `when.py` takes the tables,
checks every claim, and returns what the text names, besides the file's constants, which a text names in lower
case. `benchmark.publish.prose` calls it.
"""

from collections.abc import Callable, Mapping
from functools import cache

import pandas as pd

from benchmark.drawing.tables import duration
from benchmark.folder import Folder, with_titles

Names = Mapping[str, object]  # what a text can name: texts, and functions that return some


class Tables:
    """The published tables of an experiment. A learner is given by its name, as in "ppo, coordinates"."""

    def __init__(self, folder: Folder) -> None:
        self._frame = cache(lambda table: with_titles(folder.frame(table), {}))
        self.failed: list[str] = []

    def rows(self, table: str, **where: object) -> pd.DataFrame:
        """Returns the rows of a table with these values; of a list, with any of its values."""
        frame = self._frame(table)
        for key, value in where.items():
            frame = frame[frame[key].isin(value if isinstance(value, list) else [value])]
        return frame

    def row(self, table: str, **where: object) -> pd.Series:
        """Returns the only row of a table with these values."""
        rows = self.rows(table, **where)
        if len(rows) != 1:
            raise ValueError(f"{table}.csv has {len(rows)} rows with {where}, not one")
        return rows.iloc[0]

    def values(self, table: str, column: str, **where: object) -> set[object]:
        """Returns the different values of a column."""
        return {*self.rows(table, **where)[column]}

    def number(self, table: str, column: str, form: str = ",.0f", **where: object) -> str:
        """Returns a number, or with the form "time" seconds."""
        row = self.row(table, **where)
        return duration(row[column]) if form == "time" else format(row[column], form)

    def numbers(
        self, table: str, column: str, keys: str, form: str = ",.0f", **where: object
    ) -> Callable[..., str]:
        """Returns a function that takes the values of keys, which spaces separate, and returns a number."""

        def number(*values: object) -> str:
            return self.number(table, column, form, **where, **dict(zip(keys.split(), values, strict=True)))

        return number

    def count(self, table: str, of: str = "", **where: object) -> str:
        """Returns how many rows have these values, or how many different values a column has in them."""
        rows = self.rows(table, **where)
        return str(rows[of].nunique() if of else len(rows))

    def claim(self, is_true: object, sentence: str) -> str:
        """Notes a sentence in `failed` unless it is true; returns an empty text."""
        self.failed += [] if is_true else [sentence]
        return ""


def steps_of(tables: Tables) -> Callable[..., str]:
    """Returns a function that says in how many steps a learner learns at a point of a grid (median)."""

    def steps(learner: str, grid: str, point: str) -> str:
        where = {"learner": learner, "grid": grid, "point": point}
        row = tables.row("cells", **where)
        if row["steps"] < float("inf"):
            return tables.number("cells", "steps", **where)
        n_learned = tables.number("cells", "n_solved", "", **where)
        return f"more than {row['budget']:,} ({n_learned} of {row['n']} runs learn)"

    return steps
