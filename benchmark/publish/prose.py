"""Texts written by hand, whose numbers are looked up in published tables and whose claims are checked.

The finding of an experiment is a template beside its file: of `when.toml`, it is `when.md.jinja`. If there is
a function `finding` in `when.py`, it checks the claims and returns what the template can name, see
`benchmark.experiments.finding`. Every number is a link to its rows. The first paragraph is the answer. A
paragraph may start with a title in bold, by which the README of this repository includes it, and those
without a title after it. Results of other seeds, or of only some of the runs, have no such text.
"""

import re
import runpy
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Final

import pandas as pd

from benchmark.drawing import tables
from benchmark.experiments import EXPERIMENT_DIRECTORY, experiment_names
from benchmark.experiments.finding import Names, Tables
from benchmark.folder import Folder, with_titles
from benchmark.publish.templates import mistakes_in, rendered
from envs import InputError
from envs.words import listed

_TITLE: Final = re.compile(r"^\*\*(.+?)\.\*\* ", re.MULTILINE)


class ClaimError(InputError):
    """The tables do not show what a text claims."""


def written(folder: Folder, template: Path | None = None) -> str | None:
    """Returns the text written for a folder of results, in Markdown; None if there is none for these runs.

    The template is by default that of a shipped experiment. A mistake in it, or citing what the tables
    lack, raises an InputError; a claim that they do not show, a ClaimError. On another type of
    processor nets learn differently, so there a claim can fail without any error.
    """
    manifest = folder.manifest
    if template is None and manifest.get("argument") in experiment_names():
        template = EXPERIMENT_DIRECTORY / f"{manifest['argument']}.md.jinja"
    is_as_declared = not manifest.get("partial") and " --seeds " not in manifest.get("command", "")
    if template is None or not (is_as_declared and template.is_file()):
        return None
    lookups = Lookups(folder)
    known: dict[str, object] = {name: getattr(lookups, name) for name in vars(Lookups) if name[0] != "_"}
    known |= _named(template.with_name(f"{template.name.partition('.')[0]}.py"), lookups)
    text = rendered(template, known)
    if lookups.failed:
        where = f"{folder.path}: its tables do not show, as {template.name} claims,"
        raise ClaimError(*(f"{where} that {claim}." for claim in lookups.failed))
    paragraphs = [" ".join(paragraph.split()) for paragraph in text.split("\n\n")]
    return "\n\n".join(filter(None, paragraphs))


def _named(path: Path, tables: Tables) -> Names:
    """Returns a Python file's texts, by their names in lower case, and what `finding` returns."""
    if not path.is_file():
        return {}
    with mistakes_in(path):
        module = runpy.run_path(str(path))
        texts = {key.lower(): text for key, text in module.items() if key.isupper() and isinstance(text, str)}
        names = module["finding"](tables) if "finding" in module else {}
    if not isinstance(names, Mapping):
        raise InputError(f"{path}: finding returns {names!r}; accepted: names, each with what it stands for.")
    return {**texts, **names}


def paragraphs(folder: Folder, title: str = "") -> str:
    """Returns a folder's text under a title, by default before the first, as one paragraph without links."""
    first, *others = _TITLE.split(tables.plain(written(folder) or ""))
    titled = {name: f"**{name}.** {text}" for name, text in zip(others[::2], others[1::2], strict=True)}
    return " ".join(({"": first} | titled)[title].split())


class Lookups:
    """The functions that a text has. A learner is given by its name, as in "ppo, coordinates"."""

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
        """Returns a number, or with the form "time" seconds, with a link to its row."""
        row = self.row(table, **where)
        text = tables.duration(row[column]) if form == "time" else format(row[column], form)
        return tables.link(text, table, row)

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
        return tables.link(str(rows[of].nunique() if of else len(rows)), table, rows)

    def names(self, table: str, column: str, **where: object) -> str:
        """Returns the different values of a column, as a list in words."""
        rows = self.rows(table, **where)
        return tables.link(listed(map(str, rows[column].unique())), table, rows)

    def claim(self, is_true: object, sentence: str) -> str:
        """Notes a sentence in `failed` unless it is true; returns an empty text."""
        self.failed += [] if is_true else [sentence]
        return ""
