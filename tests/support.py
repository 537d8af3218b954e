"""What tests of several rooms call: the project's commands, as users run them."""

import csv
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

from markdown_it import MarkdownIt

ROOT: Final = Path(__file__).parents[1]


def command(*arguments: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs `python -m benchmark`."""
    return subprocess.run(
        [sys.executable, "-m", "benchmark", *map(str, arguments)], cwd=cwd, capture_output=True, text=True
    )


def make(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs make with this Python, which has all it needs, instead of one that make installs."""
    settings = [f"PY={sys.executable}", "BASE=", "DEEP=", "DEV="]
    return subprocess.run(
        ["make", "--no-print-directory", *arguments, *settings], cwd=cwd, capture_output=True, text=True
    )


def markdown_parser() -> MarkdownIt:
    """Returns a parser of Markdown with tables; it makes links of all targets, safe or not."""
    parser = MarkdownIt("commonmark").enable("table")
    parser.validateLink = bool  # type: ignore[assignment, method-assign]
    return parser


_KINDS: Final = {
    "integer": r"-?\d+",
    "float": r"-?(\d+\.\d+|\d+(\.\d+)?e[+-]\d+|inf)",
    "boolean": r"True|False",
    "text": r".*",
}
_INFERRED_ROWS: Final = 100  # from which Polars infers the type of a column, by default


def mistyped_columns(path: Path) -> list[str]:
    """Lists the columns of a CSV file whose type a reader cannot infer from its first rows."""
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    mistyped = []
    for name, column in zip(header, zip(*rows, strict=True), strict=bool(rows)):
        kinds = [
            next(kind for kind, form in _KINDS.items() if re.fullmatch(form, text, re.DOTALL))
            for text in column
            if text
        ]
        if len(set(kinds)) != 1 or not any(column[:_INFERRED_ROWS]):
            mistyped.append(name)
    return mistyped
