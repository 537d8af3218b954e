"""A folder of published results, as its files have it: the source of all sentences."""

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import pandas as pd

from benchmark.drawing.tables import read_csv

MANIFEST: Final = "manifest.json"


class Published:
    """A folder of results: its manifest, and its tables as read back from the CSV files."""

    def __init__(self, path: Path) -> None:
        """Looks at a folder; files are read when they are asked for."""
        self.path = path
        self._frames: dict[str, pd.DataFrame] = {}

    @cached_property
    def manifest(self) -> Mapping[str, Any]:
        """What made the results."""
        return dict(json.loads((self.path / MANIFEST).read_text(encoding="utf-8")))

    def __contains__(self, file: str) -> bool:
        return (self.path / file).exists()

    def matches(self, pattern: str) -> bool:
        """Returns whether a file's name matches a pattern."""
        return any(self.path.glob(pattern))

    def frame(self, name: str) -> pd.DataFrame:
        """Returns a table, from its CSV file.

        Raises:
          OSError: There is no such file.
        """
        if name not in self._frames:
            self._frames[name] = read_csv(self.path / f"{name}.csv")
        return self._frames[name]
