"""Writes data frames as CSV, Markdown and LaTeX; computes nothing."""

import math
import re
from pathlib import Path
from typing import Final

import pandas as pd
from tabulate import tabulate

LINK: Final = re.compile(r"\[([^\[\]]*)\]\((\w+\.csv)#row=([\d;-]+)\)")  # text, file, rows
_DIGITS = 6  # significant ones in CSV, fewer than any machine's rounding shows
_SHOWN_DIGITS = 3
_ROWS_OF_A_PAGE = 40


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """Writes a frame with six significant digits."""
    frame = frame.map(_clean)
    frame.to_csv(path, index=False, float_format=f"%.{_DIGITS}g", lineterminator="\n")


def write_table(frame: pd.DataFrame, stem: Path, shown: pd.DataFrame | None = None, note: str = "") -> None:
    """Writes a frame as `stem.csv`, and for readers as `stem.md` and `stem.tex`.

    Args:
      frame: All of it, for the CSV.
      stem: Path without suffix.
      shown: What readers see, where that is less or otherwise arranged.
      note: A sentence to stand above what readers see.
    """
    write_csv(frame, stem.with_suffix(".csv"))
    shown = frame if shown is None else shown
    markdown = f"{note}\n\n{to_markdown(shown)}" if note else to_markdown(shown)
    stem.with_suffix(".md").write_text(markdown, encoding="utf-8")
    form = "latex_booktabs" if len(shown) <= _ROWS_OF_A_PAGE else "latex_longtable"
    latex = f"\\textbf{{{_escape(note)}}}\\par\n{_format(shown, form)}" if note else _format(shown, form)
    stem.with_suffix(".tex").write_text(latex, encoding="utf-8")


def with_intervals(frame: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Returns the frame with these columns as text, `value [low, high]`, from `name_low` and `name_high`."""
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


def _format(frame: pd.DataFrame, kind: str) -> str:
    cells = [[show(value) for value in row] for row in frame.itertuples(index=False)]
    aligned = ["left" if isinstance(value, str) else "right" for value in frame.iloc[0]]
    return tabulate(cells, list(frame.columns), tablefmt=kind, disable_numparse=True, colalign=aligned) + "\n"


def _escape(text: str) -> str:
    """Returns text as LaTeX wants it."""
    return text.replace("_", r"\_").replace("%", r"\%")


def show(value: object) -> str:
    """Returns a cell's text.

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


def _clean(value: object) -> object:
    """Takes rounding's dust, such as -1e-16 for an exact 0, off a number."""
    return 0.0 if isinstance(value, float) and abs(value) < 1e-12 else value


def link(text: str, table: str, *rows: pd.Series | pd.DataFrame) -> str:
    """Makes a text a Markdown link to rows of a table, counted as by RFC 7111: the header is the first."""
    places: set[int] = set()
    for row in rows:
        index = row.index if isinstance(row, pd.DataFrame) else [row.name]
        places |= {int(str(i)) + 2 for i in index}  # from 1, the header being the first
    ranges: list[list[int]] = []
    for place in sorted(places):
        if ranges and ranges[-1][-1] == place - 1:
            ranges[-1][1:] = [place]
        else:
            ranges.append([place])
    return f"[{text}]({table}.csv#row={';'.join('-'.join(map(str, one)) for one in ranges)})"


def plain(text: str) -> str:
    """Returns a text without its links.

    >>> plain("It has [0.63](summary.csv#row=13) [0.5, 0.7] in S2.")
    'It has 0.63 [0.5, 0.7] in S2.'
    """
    return LINK.sub(r"\1", text)
