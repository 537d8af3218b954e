"""Checks of sentences against the tables that they are made from."""

import re
from typing import Final

import pandas as pd

from benchmark.drawing.tables import LINK, plain
from benchmark.reports.document import Document

JUDGED: Final = re.compile(
    r"Success of (.+?)(?: \(\w+ policy\))? compared with (.+?)(?: \(\w+ policy\))?(?:, in [^,]+)?(?:, of .+)?"
    r": (?:within [\d.]+, but measurably )?([a-z ]+), "
)


def rows_of(places: str) -> list[int]:
    """Returns the places in a data frame that a link's rows are at."""
    rows: list[int] = []
    for part in places.split(";"):
        first, _, last = part.partition("-")
        rows += range(int(first) - 2, int(last or first) - 1)
    return rows


def check_links(document: Document, *, fewest: int) -> None:
    """Checks that every number which links to rows is in them: each, their mean, or how many they are."""
    n_checked = 0
    findings = [*document.findings, *([document.headline] if document.headline else [])]
    for text, file, places in (link for each in findings for link in LINK.findall(each.text)):
        rows = pd.read_csv(document.folder.path / file).iloc[rows_of(places)]
        number = re.fullmatch(r"(at least )?([-+]?[\d,.]+|∞)( times| m?s)?", text)
        if number is None:  # a list of names or values
            assert {*re.split(", | and ", text)} <= {
                *" ".join(rows.astype(str).to_numpy().ravel()).split()
            }, text
            n_checked += 1
            continue
        if number[3]:
            continue  # a quotient, which the tests above know, or a duration in another unit
        decimals = len(number[2].partition(".")[2])
        counts = [rows[key].nunique() for key in ("scenario", "claim") if key in rows]
        values = [*rows.mean(numeric_only=True), len(rows), *counts]
        assert any(f"{abs(v):,.{decimals}f}" == number[2].lstrip("+-") for v in values), (text, file, places)
        n_checked += 1
    assert n_checked >= fewest


def check_verdicts(document: Document) -> None:
    """Checks that words that judge are the verdicts of their rows, and stand nowhere else."""
    frame, told = document.folder.frame("contrasts"), 0
    for finding in document.findings:
        if finding.verdict:
            (places,) = {match[2] for match in LINK.findall(finding.text)}
            row = frame.iloc[rows_of(places)[0]]
            assert row["success_verdict"] == finding.verdict
            judged = JUDGED.match(plain(finding.text))
            assert judged is not None
            assert [judged[1], judged[2]] == [document.folder.names.told(row[side]) for side in "xy"]
            if "measurably" in finding.text:
                assert finding.verdict == "equivalent"
                assert judged[3] == ("better" if row["success_difference"] > 0 else "worse")
            else:
                assert judged[3] == finding.verdict
            assert f"In score: {row['score_verdict']}," in finding.text
            told += 1
        else:
            words = re.findall(r"\b(better|worse|equivalent|significant\w*|superior)\b", finding.text)
            assert not words or "Better policies may exist" in finding.text, finding.text
    assert told == (len(frame) if len(frame) <= 6 else 0)  # of more, the table tells
    sentences = " ".join(each.text for each in document.findings)
    assert not re.search(r"\bbecause\b|\bcause|\bexplain|\bdue to\b|\bthanks to\b", sentences)
