"""Writes data frames as CSV, Markdown and LaTeX files, and links numbers to their rows."""

import math
import re
from pathlib import Path
from typing import Final

import pandas as pd
from tabulate import tabulate

LINK: Final = re.compile(r"\[([^\[\]]*)\]\((\w+\.csv)#row=([\d;-]+)\)")  # text, file, rows
_DIGITS: Final = 6  # significant digits in CSV files: few enough to hide rounding
_SHOWN_DIGITS: Final = 3
_ROWS_PER_PAGE: Final = 70  # of a LaTeX table that is scaled to a page
# A longer one breaks across pages and cannot be scaled. If it is too wide, it reaches into both margins.
_LONG: Final = r"""\footnotesize
\setlength{\tabcolsep}{3pt}
\setlength{\LTleft}{0pt plus 1fill minus 1fill}
\setlength{\LTright}{\LTleft}
"""
_ESCAPED: Final = str.maketrans(
    {character: f"\\{character}" for character in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
)


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """Writes a frame so that readers infer the types of its columns from any of its rows.

    Floats have six significant digits, and a point or an exponent even if they are whole numbers. A missing
    value is empty, and a column that has no value in any row is left out.
    """
    texts = {name: _column_texts(frame[name]) for name in frame}
    filled = {name: column for name, column in texts.items() if any(column) or not len(frame)}
    pd.DataFrame(filled).to_csv(path, index=False, lineterminator="\n")


def write_table(frame: pd.DataFrame, stem: Path, shown: pd.DataFrame | None = None, note: str = "") -> None:
    """Writes a frame as `stem.csv`, `stem.md` and `stem.tex`.

    Args:
      frame: What the CSV file holds.
      stem: Path without suffix.
      shown: What the other two files hold, if that differs.
      note: A sentence above their tables.
    """
    write_csv(frame, stem.with_suffix(".csv"))
    shown = frame if shown is None else shown
    markdown = f"{note}\n\n{to_markdown(shown)}" if note else to_markdown(shown)
    stem.with_suffix(".md").write_text(markdown, encoding="utf-8")
    stem.with_suffix(".tex").write_text(_to_latex(shown, note), encoding="utf-8")


def with_intervals(frame: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Returns the frame with these columns as text, `value [low, high]`.

    Args:
      frame: Also has the columns `NAME_low` and `NAME_high` for each name.
      names: The columns.
    """
    columns = {
        name: [
            f"{show(value)} [{show(low)}, {show(high)}]" if value == value else "-"
            for value, low, high in frame[[name, f"{name}_low", f"{name}_high"]].to_numpy()
        ]
        for name in names
    }
    return frame.assign(**columns)


def to_markdown(frame: pd.DataFrame) -> str:
    """Returns a Markdown table with three significant digits."""
    return _format(frame, "github")


def _format(frame: pd.DataFrame, form: str) -> str:
    """Returns a table in one of tabulate's formats."""
    texts = [[show(value) for value in row] for row in frame.itertuples(index=False)]
    first = frame.iloc[0] if len(frame) else [""] * len(frame.columns)
    aligned = ["left" if isinstance(value, str) else "right" for value in first]
    return tabulate(texts, list(frame.columns), tablefmt=form, disable_numparse=True, colalign=aligned) + "\n"


def _to_latex(frame: pd.DataFrame, note: str) -> str:
    """Returns a LaTeX table that fits the page, with a note above it."""
    above = f"\\textbf{{{note.translate(_ESCAPED)}}}\\par\n" if note else ""
    if len(frame) > _ROWS_PER_PAGE:
        table = _format(frame, "latex_longtable")
        return f"% Needs \\usepackage{{longtable}}\n{above}{{{_LONG}{table}}}\n"
    limits = r"max width=\textwidth, max totalheight=\textheight"
    table = f"\\begin{{adjustbox}}{{{limits}}}\n{_format(frame, 'latex_booktabs')}\\end{{adjustbox}}%\n"
    return f"% Needs \\usepackage{{booktabs,adjustbox}}\n{above}\\noindent\n{table}"


def show(value: object) -> str:
    """Returns a value as text, with three significant digits.

    >>> [show(value) for value in (0.12345, 999.6, 52612345.0, math.inf, math.nan, 7, "S1")]
    ['0.123', '1,000', '52,600,000', 'inf', '-', '7', 'S1']
    """
    value = _clean(value)
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return "-"
    shown = f"{value:.{_SHOWN_DIGITS}g}"
    return f"{float(shown):,.0f}" if 1000 <= abs(float(shown)) < math.inf else shown


def _column_texts(column: pd.Series) -> list[str]:
    """Returns the values of a column as a CSV file has them; integers beside floats are floats, too."""
    values = column.tolist()
    is_missing = column.isna().tolist()
    has_floats = any(isinstance(value, float) for value in values)
    texts = []
    for value, missing in zip(values, is_missing, strict=True):
        if missing:
            texts.append("")
        elif has_floats and isinstance(value, int | float) and not isinstance(value, bool):
            texts.append(_float_text(float(value)))
        else:
            texts.append(str(value))
    return texts


def _float_text(value: float) -> str:
    """Returns a float that is read back as a float.

    >>> [_float_text(value) for value in (1.0, 0.5, 1e-7, 2 / 3, 1234567.0, -1e-16, math.inf)]
    ['1.0', '0.5', '1e-07', '0.666667', '1.23457e+06', '0.0', 'inf']
    """
    text = f"{_clean(value):.{_DIGITS}g}"
    return text if not math.isfinite(value) or "." in text or "e" in text else f"{text}.0"


def _clean(value: object) -> object:
    """Replaces a number that is zero but for rounding, such as -1e-16, by zero."""
    return 0.0 if isinstance(value, float) and abs(value) < 1e-12 else value


def link(text: str, table: str, *rows: pd.Series | pd.DataFrame) -> str:
    """Returns a Markdown link from a text to rows of a table.

    Rows are numbered as in RFC 7111: from 1, which is the header.

    Args:
      text: What the link says, usually a number.
      table: The CSV file's name without suffix.
      rows: Rows of the frame that the file was written from, with its index.

    >>> frame = pd.DataFrame({"score": [0.5, 0.6, 0.7, 0.8]})
    >>> link("0.6", "summary", frame.iloc[1]), link("high", "summary", frame.iloc[[0, 2, 3]])
    ('[0.6](summary.csv#row=3)', '[high](summary.csv#row=2;4-5)')
    """
    numbers: set[int] = set()
    for row in rows:
        index = row.index if isinstance(row, pd.DataFrame) else [row.name]
        numbers |= {int(str(i)) + 2 for i in index}
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and ranges[-1][-1] == number - 1:
            ranges[-1][1:] = [number]
        else:
            ranges.append([number])
    return f"[{text}]({table}.csv#row={';'.join('-'.join(map(str, ends)) for ends in ranges)})"


def plain(text: str) -> str:
    """Returns a text with the links removed.

    >>> plain("It has [0.63](summary.csv#row=13) [0.5, 0.7] in S2.")
    'It has 0.63 [0.5, 0.7] in S2.'
    """
    return LINK.sub(r"\1", text)
