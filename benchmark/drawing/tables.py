"""Writes data frames as CSV and Markdown, and links numbers to their rows.

Texts may come from anybody's experiment or scenario, so whatever a format would execute, or read as
structure, is escaped here.
"""

import math
import re
from itertools import chain
from pathlib import Path
from typing import IO, Final

import numpy as np
import pandas as pd
from markupsafe import Markup
from tabulate import tabulate

LINK: Final = re.compile(r"\[([^\[\]]*)\]\((\w+\.csv)#row=([\d;-]+)\)")  # text, file, rows
_DIGITS: Final = 6  # significant digits in CSV files: few enough to hide rounding
_SHOWN_DIGITS: Final = 3
# The start of a cell that a spreadsheet would compute, or that would end the cell. In some countries
# semicolons separate cells. An apostrophe in front makes the cell a text; a cell that already has one gets
# another, so that `read_csv` can tell them apart.
_START: Final = r"(?='*(\s*[=+\-@＝＋－＠]|[\t\r\n]))"
_FORMULA: Final = re.compile(rf"(^|;){_START}")
_TEXT: Final = re.compile(rf"(^|;)'{_START}")
# What Markdown would load or link from elsewhere: HTML, links and images, definitions of links, addresses.
_REMOTE: Final = re.compile(r"<(?=\S)|(?<=\])(?:\((?!(?!//)[\w./#=;-]+\))|:)|:(?=//)|(?<=[wW]{3})\.|@(?=\w)")
_ACTIVE: Final = re.compile(rf"(?<=\])\(|&(?=\S)|[\\$]|{_REMOTE.pattern}")  # all links, entities, formulas
_ENTITIES: Final = {each: f"&#{ord(each)};" for each in "<&\\$(:."} | {"@": "@&#8288;"}  # a joiner of words
# The start of a heading, quotation, list, rule, block of code or definition of a link.
_BLOCK: Final = re.compile(r"^(\d*)([#>+=~-]|[*_](?=\s|[\s*_]*$)|`(?=``)|\[(?=.*\]:)|(?<=\d)[.)](?=\s|$))")


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """Writes a frame so that readers infer the types of its columns from any of its rows.

    Floats have six significant digits, and a point or an exponent even if they are whole numbers. A missing
    value is empty, and a column without any value is left out. A text that a spreadsheet would compute gets
    an apostrophe in front, which `read_csv` removes. A file that ends in `.gz` is compressed.
    """
    texts = frame.infer_objects().map(_csv_text, na_action="ignore").rename(columns=_csv_text)
    is_filled = (texts.notna() & (texts != "")).any() | frame.empty
    how = {"method": "gzip", "mtime": 0} if path.suffix == ".gz" else {"method": None}
    texts.loc[:, is_filled].to_csv(path, index=False, lineterminator="\n", compression=how)


def _csv_text(value: object) -> object:
    """Returns a float as a text that is read as a float, and a text as one that no spreadsheet computes.

    >>> [_csv_text(value) for value in (1.0, 1e-7, 2 / 3, 1234567.0, -1e-16, math.inf)]
    ['1.0', '1e-07', '0.666667', '1.23457e+06', '0.0', 'inf']
    >>> [_csv_text(text) for text in ("=1+1", "-", "'=", "'tis", "a=b", "a;=b", "")]
    ["'=1+1", "'-", "''=", "'tis", 'a=b', "a;'=b", '']
    """
    if isinstance(value, str):
        return _FORMULA.sub(r"\1'", value)
    if not isinstance(value, float):
        return value
    text = f"{_clean(value):.{_DIGITS}g}"
    return text if not math.isfinite(value) or "." in text or "e" in text else f"{text}.0"


def read_csv(file: Path | IO[str] | IO[bytes]) -> pd.DataFrame:
    """Reads what `write_csv` wrote."""

    def as_was(text: object) -> object:
        return _TEXT.sub(r"\1", text) if isinstance(text, str) else text

    # Only an empty entry is a missing value, not a text such as "NA".
    frame = pd.read_csv(file, keep_default_na=False, na_values=[""])
    texts = frame.select_dtypes(exclude=["number", "bool"])
    frame[texts.columns] = texts.map(as_was, na_action="ignore")
    return frame.rename(columns=as_was)


def to_markdown(frame: pd.DataFrame) -> str:
    """Returns a Markdown table with three digits; texts have `code` and *emphasis*, `Markup` also links."""

    def escaped(value: object) -> str:
        return value if isinstance(value, Markup) else inert(show(value)).replace("|", "&#124;")

    texts = [[escaped(value) for value in row] for row in frame.itertuples(index=False)]
    first = frame.iloc[0] if len(frame) else [""] * len(frame.columns)
    aligned = ["left" if isinstance(value, str) else "right" for value in first]
    names = [escaped(str(name)) for name in frame]
    return tabulate(texts, names, tablefmt="github", disable_numparse=True, colalign=aligned) + "\n"


def paragraph(text: str) -> str:
    r"""Returns a text as a paragraph of Markdown, with `code` and *emphasis*.

    All else appears as it is written and is no structure, link or image; within `code`, entities are visible.

    >>> print(paragraph("1. See [a](b.csv),\n# ![c](https://d.org) & <img> in `S1`"))
    1&#46; See [a]&#40;b.csv), # ![c]&#40;https&#58;//d.org) & &#60;img> in `S1`
    """
    return _BLOCK.sub(lambda match: f"{match[1]}&#{ord(match[2])};", inert(text))


def inert(text: str) -> str:
    """Returns a text in one line of Markdown, which becomes structure only at the start of a paragraph."""
    return _ACTIVE.sub(lambda match: _ENTITIES[match[0]], " ".join(text.split()))


def local_only(markdown: str) -> str:
    """Returns Markdown in which nothing but files of the repository is shown or linked."""
    return _REMOTE.sub(lambda match: _ENTITIES[match[0]], markdown)


def show(value: object, decimals: int | None = None) -> str:
    """Returns a value as text, with three significant digits or, if it is below 1,000, with these decimals.

    >>> [show(value) for value in (0.12345, 999.6, 52612345.0, math.inf, math.nan, 7, "S1")]
    ['0.123', '1,000', '52,600,000', 'inf', '-', '7', 'S1']
    >>> [show(value, 2) for value in (0.12345, 1.0, -0.001, 2345.6)]
    ['0.12', '1.00', '0.00', '2,350']
    """
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return "-"
    if decimals is not None and abs(value) < 1000:
        return f"{round(value, decimals) + 0.0:.{decimals}f}"
    shown = f"{_clean(value):.{_SHOWN_DIGITS}g}"
    return f"{float(shown):,.0f}" if 1000 <= abs(float(shown)) < math.inf else shown


def decimals_of(frame: pd.DataFrame, name: str) -> int | None:
    """Returns how many decimals a column needs to show three significant digits of its largest number.

    Returns None if there is no such number, or if a smaller one would be shown as 0, except for shares with
    intervals, which say how uncertain they are.

    >>> frame = pd.DataFrame({"a": [1.0, math.inf], "b": [12.5, 1.0], "c": [1.0, 1e-5], "c_low": [0.0, 0.0]})
    >>> [decimals_of(frame, name) for name in "abc"], decimals_of(frame[["c"]], "c")
    ([2, 1, 2], None)
    """
    is_float = pd.api.types.is_float_dtype(frame[name])
    sizes = [abs(value) for value in frame[name] if is_float and 1e-12 < abs(value) < math.inf]
    if not sizes:
        return None
    decimals = max(0, _SHOWN_DIGITS - 1 - math.floor(math.log10(max(sizes))))
    is_shown = min(sizes) >= 0.5 * 10**-decimals or (f"{name}_low" in frame and max(sizes) <= 1)
    return decimals if is_shown else None


def duration(seconds: float) -> str:
    """Returns a time with two significant digits.

    >>> duration(0.000319), duration(0.0345), duration(0.0999), duration(175)
    ('0.32 ms', '34 ms', '100 ms', '180 s')
    """
    return f"{two_digits(seconds * 1000)} ms" if seconds < 0.1 else f"{two_digits(seconds)} s"


def two_digits(value: float) -> str:
    """Returns a number rounded to two significant digits."""
    return f"{value:.2g}" if value < 10 else f"{round(value, 2 - len(str(int(value)))):,.0f}"


def _clean(value: float) -> float:
    """Replaces a number that is zero except for rounding, such as -1e-16, by zero."""
    return 0.0 if abs(value) < 1e-12 else value


def link(text: str, table: str, *rows: pd.Series | pd.DataFrame) -> str:
    """Returns a Markdown link from a text to rows of a table, numbered as in RFC 7111: 1 is the header.

    The rows have the index of the frame from which the CSV file was written; without any there is no link.

    >>> frame = pd.DataFrame({"score": [0.5, 0.6, 0.7, 0.8]})
    >>> link("0.6", "summary", frame.iloc[1]), link("high", "summary", frame.iloc[[0, 2, 3]])
    ('[0.6](summary.csv#row=3)', '[high](summary.csv#row=2;4-5)')
    """
    indices = [row.index if isinstance(row, pd.DataFrame) else [row.name] for row in rows]
    numbers = np.unique([int(str(i)) + 2 for i in chain(*indices)])
    if not numbers.size:
        return text
    ranges = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    ends = (f"{lines[0]}-{lines[-1]}" if len(lines) > 1 else f"{lines[0]}" for lines in ranges)
    return f"[{inert(text)}]({table}.csv#row={';'.join(ends)})"


def plain(text: str) -> str:
    """Returns a text without its links.

    >>> plain("It has [0.63](summary.csv#row=13) [0.5, 0.7] in S2.")
    'It has 0.63 [0.5, 0.7] in S2.'
    """
    return LINK.sub(r"\1", text)
