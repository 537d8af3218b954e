"""A folder of published results, as its files have it: the source of all sentences, README and page."""

import json
import re
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import jinja2
import pandas as pd

from benchmark.drawing.tables import read_csv
from benchmark.experiments import title_of
from envs import InputError

MANIFEST: Final = "manifest.json"
SCORES: Final = "scores.csv.gz"  # every run of a comparison
_UNREADABLE: Final = (
    OSError, ValueError, LookupError, TypeError, AttributeError, EOFError, zlib.error,
    jinja2.UndefinedError,  # a template asks for what a table does not have
)  # fmt: skip


@dataclass(eq=False)
class Folder:
    """A folder of results: its manifest, and its tables as read back from the CSV files."""

    path: Path

    @cached_property
    def manifest(self) -> Mapping[str, Any]:
        """What made the results; raises an InputError if it is missing or damaged."""
        if not (self.path / MANIFEST).is_file():
            raise InputError(f"{self.path}: there are no results; run the experiment with --report first.")
        with self.reading():
            manifest = dict(json.loads((self.path / MANIFEST).read_text(encoding="utf-8")))
            manifest["report"]["kind"], manifest["scenarios"].items()
        return manifest

    @cached_property
    def titles(self) -> dict[str, str]:
        """What readers call the learners, by their names in files."""
        return {
            f"{name}, {form}": title_of(variant.get("title") or name, form, variant.get("family", ""))
            for name, variant in self.manifest.get("algorithms", {}).items()
            for form in variant["settings"]
        }

    def title(self, side: str) -> str:
        """Returns what readers call a learner, or a side of a contrast, see `titled`."""
        return titled(side, self.titles)

    def phrase(self, side: str) -> str:
        """Returns the same for a sentence, in which a table has an article."""
        title = self.title(side)
        return f"the {title}" if re.search(r"\btable\b", title) else title

    def __contains__(self, file: str) -> bool:
        """Returns whether there is a file of this name, or one that matches this pattern."""
        return any(self.path.glob(file))

    def figure(self, name: str) -> str:
        """Returns the name of the file with an item's figure; empty if there is none."""
        return file if (file := f"{name}.svg") in self else ""

    def frame(self, name: str) -> pd.DataFrame:
        """Returns a table, from its CSV file, which is named without its ending; raises an OSError."""
        return read_csv(self.path / f"{name}.csv")

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Turns what goes wrong while files of this folder are read into an `InputError`."""
        try:
            yield
        except InputError:
            raise
        except _UNREADABLE as error:
            fault = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            if isinstance(error, FileNotFoundError):
                fault = f"{Path(error.filename).name} is missing"
            raise InputError(
                f"{self.path}: damaged, or made by another version of this project ({fault}); make these "
                "results again."
            ) from error


def titled(side: str, titles: Mapping[str, str]) -> str:
    """Returns a side of a contrast with the titles of learners.

    >>> titled("q, offset @ S1", {"q, offset": "table of offsets"})
    'table of offsets @ S1'
    """
    return " @ ".join(titles.get(part, part) for part in side.split(" @ "))


def with_titles(frame: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Returns a table with a column of learners, if it can have one, and with their titles."""
    frame = frame.copy()
    if {"variant", "observation"} <= {*frame} and "learner" not in frame:
        learners = frame["variant"] + ", " + frame["observation"]
        frame.insert([*frame].index("variant"), "learner", learners)
    for column in {"learner", "reference", "x", "y"} & {*frame}:
        frame[column] = frame[column].map(lambda side: titled(side, titles), na_action="ignore")
    return frame
