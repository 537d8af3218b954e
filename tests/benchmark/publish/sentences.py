"""Checks of sentences against the tables that they are made from."""

import re

import pandas as pd

from benchmark.drawing.tables import LINK
from benchmark.publish.document import Document


def rows_of(places: str) -> list[int]:
    """Returns the indices in a data frame of the rows that a link names."""
    rows: list[int] = []
    for part in places.split(";"):
        first, _, last = part.partition("-")
        rows += range(int(first) - 2, int(last or first) - 1)
    return rows


def check_links(document: Document, *, fewest: int) -> None:
    """Checks that what links to rows is in them: names, or numbers, their mean, or how many there are."""
    linked = LINK.findall(document.headline or "")
    assert len(linked) >= fewest
    for text, file, places in linked:
        rows = pd.read_csv(document.folder.path / file).iloc[rows_of(places)]
        counts = [len(rows), *(rows[key].nunique() for key in ("scenario", "claim") if key in rows)]
        numbers = [*rows.select_dtypes("number").to_numpy().ravel(), *rows.mean(numeric_only=True), *counts]
        shown = {f"{abs(value):,.{decimals}f}" for value in numbers for decimals in range(4)}
        known = shown | {*" ".join(rows.astype(str).to_numpy().ravel()).split()}
        assert {*re.split(", | and | to ", text)} <= known, (text, file, places)
