"""Texts written by hand, whose numbers are looked up in published tables and whose claims are checked.

The finding of a published experiment is a template beside its file: `benchmark/experiments/when.md.jinja`.
In it, every number is a link to its rows, and `claim` refuses tables for which a sentence would not be true.
Then, and for other seeds, results have the sentences that their kind of report makes; the README of this
repository is not made.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.drawing import tables
from benchmark.experiments import EXPERIMENT_DIRECTORY
from benchmark.reports.folder import Folder
from envs import InputError
from envs.words import listed


class ClaimError(InputError):
    """The tables do not show what a text claims."""


def text_of(folder: Folder) -> Path | None:
    """Returns the text written for a folder of results; None if there is none for these runs."""
    manifest = folder.manifest
    path = EXPERIMENT_DIRECTORY / f"{manifest.get('argument')}.md.jinja"
    is_as_declared = not manifest.get("partial") and " --seeds " not in manifest.get("command", "")
    return path if is_as_declared and path.is_file() else None


def lookups(folder: Folder) -> dict[str, Callable[..., Any]]:
    """Returns the functions that a text has. A learner is given as in `cells.csv`: "ppo, coordinates"."""

    def rows(table: str, **where: object) -> pd.DataFrame:
        """Returns the rows of a table with these values; of a list, with any of its values."""
        frame = folder.frame(table)
        if "learner" in where and "learner" not in frame:
            where["algorithm"], where["observation"] = str(where.pop("learner")).split(", ")
        for key, value in where.items():
            frame = frame[frame[key].isin(value if isinstance(value, list) else [value])]
        return frame

    def row(table: str, **where: object) -> pd.Series:
        """Returns the only row of a table with these values."""
        found = rows(table, **where)
        if len(found) != 1:
            raise ValueError(f"{table}.csv has {len(found)} rows with {where}, not one")
        return found.iloc[0]

    def number(table: str, column: str, form: str = ",.0f", **where: object) -> str:
        """Returns a number, with a link to its row."""
        found = row(table, **where)
        return tables.link(format(found[column], form), table, found)

    def interval(table: str, column: str, form: str = ".2f", **where: object) -> str:
        """Returns a number with its interval."""
        found = row(table, **where)
        low, high = (format(found[f"{column}_{end}"], form) for end in ("low", "high"))
        return f"{number(table, column, form, **where)} [{low}, {high}]"

    def duration(table: str, column: str, **where: object) -> str:
        """Returns a time in seconds or milliseconds."""
        found = row(table, **where)
        return tables.link(tables.duration(found[column]), table, found)

    def count(table: str, of: str = "", **where: object) -> str:
        """Returns how many rows have these values, or how many different values a column has in them."""
        found = rows(table, **where)
        return tables.link(str(found[of].nunique() if of else len(found)), table, found)

    def names(table: str, column: str, **where: object) -> str:
        """Returns the values of a column, as a list in words."""
        found = rows(table, **where)
        return tables.link(listed(map(str, found[column])), table, found)

    def claim(is_true: bool, sentence: str) -> str:
        """Refuses tables for which a sentence is not true; returns an empty text."""
        if not is_true:
            raise ClaimError(f"{folder.path}: these tables do not show what the text claims: {sentence}")
        return ""

    return {each.__name__: each for each in (rows, row, number, interval, duration, count, names, claim)}
