"""Checks of sentences against the tables that they are made from."""

import re

import pandas as pd

from benchmark.drawing.tables import LINK
from benchmark.reports.document import Document


def rows_of(places: str) -> list[int]:
    """Returns the indices in a data frame of the rows that a link names."""
    rows: list[int] = []
    for part in places.split(";"):
        first, _, last = part.partition("-")
        rows += range(int(first) - 2, int(last or first) - 1)
    return rows


def check_links(document: Document, *, fewest: int) -> None:
    """Checks that every number which links to rows is in them: each, their mean, or how many they are."""
    n_checked = 0
    for text, file, places in LINK.findall(document.headline or ""):
        rows = pd.read_csv(document.folder.path / file).iloc[rows_of(places)]
        number = re.fullmatch(r"(at least )?([-+]?[\d,.]+|∞)( times| m?s)?", text)
        if number is None:  # a list of names or values
            assert {*re.split(", | and | to ", text)} <= {
                *" ".join(rows.astype(str).to_numpy().ravel()).split()
            }, text
            n_checked += 1
            continue
        if number[3]:
            continue  # a quotient, or a duration in another unit
        decimals = len(number[2].partition(".")[2])
        counts = [rows[key].nunique() for key in ("scenario", "claim") if key in rows]
        values = [*rows.mean(numeric_only=True), len(rows), *counts]
        assert any(f"{abs(v):,.{decimals}f}" == number[2].lstrip("+-") for v in values), (text, file, places)
        n_checked += 1
    assert n_checked >= fewest
