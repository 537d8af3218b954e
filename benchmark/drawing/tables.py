"""Writes data frames as CSV and Markdown, and numbers as readers see them."""

import math
from pathlib import Path
from typing import IO, Final

import pandas as pd
from tabulate import tabulate

_DIGITS: Final = 6  # significant digits in CSV files: few enough to hide rounding
_SHOWN_DIGITS: Final = 3


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """Writes a frame so that readers infer the types of its columns from any of its rows.

    Floats have six significant digits, and a point or an exponent even if they are whole numbers. A missing
    value is empty, and a column without any value is left out. A file that ends in `.gz` is compressed.
    """
    texts = frame.infer_objects().map(_csv_text, na_action="ignore")
    is_filled = (texts.notna() & (texts != "")).any() | frame.empty
    how = {"method": "gzip", "mtime": 0} if path.suffix == ".gz" else {"method": None}
    texts.loc[:, is_filled].to_csv(path, index=False, lineterminator="\n", compression=how)


def _csv_text(value: object) -> object:
    """Returns a float as a text that is read as a float.

    >>> [_csv_text(value) for value in (1.0, 1e-7, 2 / 3, 1234567.0, -1e-16, math.inf)]
    ['1.0', '1e-07', '0.666667', '1.23457e+06', '0.0', 'inf']
    """
    if not isinstance(value, float):
        return value
    text = f"{_clean(value):.{_DIGITS}g}"
    return text if not math.isfinite(value) or "." in text or "e" in text else f"{text}.0"


def read_csv(file: Path | IO[str] | IO[bytes]) -> pd.DataFrame:
    """Reads what `write_csv` wrote: only an empty entry is a missing value, not a text such as "NA"."""
    return pd.read_csv(file, keep_default_na=False, na_values=[""])


def to_markdown(frame: pd.DataFrame) -> str:
    """Returns a Markdown table with three digits, in which texts stay in their cells."""

    def in_cell(value: object) -> str:
        return " ".join(show(value).split()).replace("|", "&#124;")

    texts = [[in_cell(value) for value in row] for row in frame.itertuples(index=False)]
    first = frame.iloc[0] if len(frame) else [""] * len(frame.columns)
    aligned = ["left" if isinstance(value, str) else "right" for value in first]
    names = [in_cell(name) for name in frame]
    return tabulate(texts, names, tablefmt="github", disable_numparse=True, colalign=aligned) + "\n"


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
