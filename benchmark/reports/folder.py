"""A folder of published results, as its files have it: the source of all sentences, README and page."""

import json
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import jinja2
import pandas as pd

from benchmark.drawing.tables import read_csv
from benchmark.reports.learners import Names
from envs import InputError

MANIFEST: Final = "manifest.json"
SCORES: Final = "scores.csv.gz"  # every run of a comparison
_UNREADABLE: Final = (
    OSError, ValueError, LookupError, TypeError, AttributeError, EOFError, zlib.error,
    jinja2.UndefinedError,  # a template asks for what a table does not have
)  # fmt: skip


class Folder:
    """A folder of results: its manifest, and its tables as read back from the CSV files."""

    def __init__(self, path: Path) -> None:
        """Looks at a folder; files are read when they are asked for."""
        self.path = path
        self._frames: dict[str, pd.DataFrame] = {}

    @cached_property
    def manifest(self) -> Mapping[str, Any]:
        """What made the results.

        Raises:
          InputError: It is missing or damaged.
        """
        try:
            found = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
            found["report"]["kind"], found["scenarios"].items()
        except _UNREADABLE as error:
            raise InputError(
                f"{self.path / MANIFEST}: damaged, or made by another version of this project; make these "
                f"results again: python -m benchmark run {self.path.name} --report"
            ) from error
        return dict(found)

    @cached_property
    def names(self) -> Names:
        """What readers call the learners."""
        return Names.from_manifest(self.manifest)

    def __contains__(self, file: str) -> bool:
        """Returns whether there is a file of this name, or one that matches this pattern."""
        return any(self.path.glob(file))

    def frame(self, name: str) -> pd.DataFrame:
        """Returns a table, from its CSV file, which is named without its ending.

        Raises:
          OSError: There is no such file.
        """
        if name not in self._frames:
            self._frames[name] = read_csv(self.path / f"{name}.csv")
        return self._frames[name]

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Turns what goes wrong while files of this folder are read into an `InputError`.

        Raises:
          InputError: A file is missing, damaged, or was made by another version of this project.
        """
        try:
            yield
        except InputError:
            raise
        except _UNREADABLE as error:
            if isinstance(error, FileNotFoundError):
                fault = f"{Path(error.filename).name} is missing"
            else:
                fault = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            again = self.manifest.get("command", f"python -m benchmark run {self.path.name} --report")
            raise InputError(
                f"{self.path}: damaged, or made by another version of this project ({fault}); make these "
                f"results again: {again}"
            ) from error
