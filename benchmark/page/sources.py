"""Published files that the page is made of: folders of results, links to rows, and damaged files."""

import html
import io
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

import pandas as pd
from markupsafe import Markup

from benchmark.drawing.tables import LINK, read_csv
from envs import InputError

_UNREADABLE: Final = (OSError, ValueError, LookupError, TypeError, AttributeError)

Content = TypeVar("Content")


@dataclass
class Folder:
    """A folder of results: its CSV files as read, and how the page links to them."""

    path: Path
    prefix: str  # of links from the page to the folder's files
    manifest: dict[str, Any]
    embedded: dict[str, str] = field(default_factory=dict)  # link to text of the files that the page holds

    def __contains__(self, name: str) -> bool:
        """Returns whether the folder has a file."""
        return (self.path / name).exists()

    def read(self, name: str, *, embed: bool = True, as_text: str = "") -> pd.DataFrame:
        """Reads a CSV file.

        Args:
          name: Of the file.
          embed: Whether the page holds the file, so that it can show the row behind a number.
          as_text: A column that is read as it is written, or nothing.
        """
        text = (self.path / name).read_text(encoding="utf-8")
        if embed:
            self.embedded[self.link(name)] = text
        return read_csv(io.StringIO(text), as_text)

    def link(self, name: str, row: object = None) -> str:
        """Returns the link to a file, or to the line of a data frame's row, given by its index label."""
        return f"{self.prefix}{name}" + ("" if row is None else f"#row={line_of(row)}")

    def target(self, markdown: str) -> str:
        """Returns where a link made by `benchmark.drawing.tables.link` leads on the page."""
        return LINK.sub(rf"{self.prefix}\2#row=\3", markdown)

    def as_html(self, text: str) -> Markup:
        """Returns a sentence as HTML, with `code` and links from numbers to their rows."""
        escaped = re.sub(r"(?<![\w-])-(?=\d)", "−", html.escape(text, quote=False))
        escaped = LINK.sub(
            lambda match: f'<a class="n" href="{self.target(match[0])}">{match[1]}</a>', escaped
        )
        parts = escaped.split("`")
        return Markup("".join(f"<code>{part}</code>" if i % 2 else part for i, part in enumerate(parts)))


def line_of(label: object) -> int:
    """Returns the line of a CSV file that a data frame's row was read from; line 1 is the header."""
    return int(str(label)) + 2


def open_folder(path: Path, prefix: str) -> Folder:
    """Opens a folder of results.

    Raises:
      InputError: Its manifest is missing or damaged.
    """
    try:
        manifest = json.loads((path / "manifest.json").read_text(encoding="utf-8"))
        manifest["report"], manifest["scenarios"]
    except _UNREADABLE as error:
        raise InputError(
            f"{path / 'manifest.json'}: damaged, or made by another version of this project; make these "
            f"results again: python -m benchmark run {path.name} --report"
        ) from error
    return Folder(path, prefix, manifest)


def section(folder: Folder, read: Callable[[Folder], Content]) -> Content:
    """Returns what a function reads from a folder.

    Raises:
      InputError: A file is missing, damaged, or was made by another version of this project.
    """
    try:
        return read(folder)
    except InputError:
        raise
    except _UNREADABLE as error:
        if isinstance(error, FileNotFoundError):
            fault = f"{Path(error.filename).name} is missing"
        else:
            fault = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise InputError(
            f"{folder.path}: damaged, or made by another version of this project ({fault}); make these "
            f"results again: {folder.manifest.get('command')}"
        ) from error
