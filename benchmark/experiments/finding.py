"""What the text on an experiment looks up in published tables, and what it claims of them.

The text on `when.toml` is `when.md.jinja`. Beside it, the function `finding` of `when.py` takes the tables,
checks every claim, and returns what the text names, besides the file's constants, which a text names in lower
case. `benchmark.publish.prose` calls it.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

import pandas as pd

Names = Mapping[str, object]  # what a text can name: texts, and functions that return some


class Tables(Protocol):
    """The published tables of an experiment. A learner is given by its name, as in "ppo, coordinates"."""

    def rows(self, table: str, **where: object) -> pd.DataFrame:
        """Returns the rows of a table with these values; of a list, with any of its values."""

    def row(self, table: str, **where: object) -> "pd.Series":
        """Returns the only row of a table with these values."""

    def values(self, table: str, column: str, **where: object) -> set[object]:
        """Returns the different values of a column."""

    def number(self, table: str, column: str, form: str = ",.0f", **where: object) -> str:
        """Returns a number, or with the form "time" seconds, with a link to its row."""

    def numbers(
        self, table: str, column: str, keys: str, form: str = ",.0f", **where: object
    ) -> Callable[..., str]:
        """Returns a function that takes the values of keys, which spaces separate, and returns a number."""

    def count(self, table: str, of: str = "", **where: object) -> str:
        """Returns how many rows have these values, or how many different values a column has in them."""

    def names(self, table: str, column: str, **where: object) -> str:
        """Returns the different values of a column, as a list in words."""

    def claim(self, is_true: object, sentence: str) -> str:
        """Checks that a sentence is true of the tables."""


def gain_of(tables: Tables) -> Callable[[str], str]:
    """Returns a function that says, in words, what a search gained for a learner."""
    default, chosen = (tables.numbers("chosen", key, "learner", ".2f") for key in ("default", "chosen"))
    return lambda learner: f"from {default(learner)} to {chosen(learner)}"


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
