"""Files of tables."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.drawing.tables import LINK, link, plain, with_intervals, write_csv, write_table
from tests.support import mistyped_columns


def test_tables_come_in_three_forms(tmp_path: Path) -> None:
    frame = pd.DataFrame({"name": ["a_b", "c"], "value": [1 / 3, -1e-17], "n": [2, 3]})
    write_table(frame, tmp_path / "t")
    assert (tmp_path / "t.csv").read_text() == "name,value,n\na_b,0.333333,2\nc,0.0,3\n"
    assert (tmp_path / "t.md").read_text().splitlines()[2] == "| a_b    |   0.333 |   2 |"
    tex = (tmp_path / "t.tex").read_text()
    assert r"a\_b" in tex
    assert r"\toprule" in tex


def test_floats_stay_floats_in_csv_files(tmp_path: Path) -> None:
    frame = pd.DataFrame(
        {
            "whole": [1.0, -2.0, 0.0],
            "all": [0.5, 1e-7, 1234567.0],
            "endless": [np.inf, -np.inf, 3.0],
            "some": [np.nan, 2.0, np.nan],
            "integer": [1, 10, -3],
            "large": [1e15, 1e5, 999_999.6],
            "is": [True, False, True],
            "mixed": pd.Series([1, 2.5, None], dtype=object),
            "text": ["a,b", "", 'c"d'],
        }
    )
    write_csv(frame, tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_bytes().decode().split("\n") == [
        "whole,all,endless,some,integer,large,is,mixed,text",
        '1.0,0.5,inf,,1,1e+15,True,1.0,"a,b"',
        "-2.0,1e-07,-inf,2.0,10,100000.0,False,2.5,",
        '0.0,1.23457e+06,3.0,,-3,1e+06,True,,"c""d"',
        "",
    ]
    assert mistyped_columns(tmp_path / "t.csv") == []
    read = pd.read_csv(tmp_path / "t.csv")
    assert "".join(read[name].dtype.kind for name in read) == "ffffifbfO"


def test_columns_without_any_value_are_left_out(tmp_path: Path) -> None:
    frame = pd.DataFrame({"a": [1, 2], "none": [np.nan, np.nan], "empty": ["", ""], "b": [np.nan, 0.5]})
    write_csv(frame, tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == "a,b\n1,\n2,0.5\n"
    write_csv(frame.head(0), tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == "a,none,empty,b\n"


@pytest.mark.parametrize(
    ("column", "is_mistyped"),
    [
        (["1"] * 100 + ["0.5"], True),
        ([""] * 100 + ["0.5"], True),
        (["", ""], True),
        (["x", "1"], True),
        ([""] * 99 + ["0.5"], False),
        (["1e-07", "inf", "-0.5"], False),
    ],
)
def test_mistyped_columns_are_found(tmp_path: Path, column: list[str], is_mistyped: bool) -> None:
    rows = "".join(f"a,{text}\n" for text in column)
    (tmp_path / "t.csv").write_text(f"name,value\n{rows}", encoding="utf-8")
    assert mistyped_columns(tmp_path / "t.csv") == (["value"] if is_mistyped else [])


@pytest.mark.parametrize(
    ("n", "package", "other"), [(70, "adjustbox", "longtable"), (71, "longtable", "adjustbox")]
)
def test_latex_tables_name_their_packages_and_fit_the_page(
    tmp_path: Path, n: int, package: str, other: str
) -> None:
    write_table(pd.DataFrame({"value": [0.5] * n}), tmp_path / "t", note="50 % of a_b & c #1.")
    first, *rest = (tmp_path / "t.tex").read_text().splitlines()
    assert first.startswith(r"% Needs \usepackage{")
    assert package in first
    text = "\n".join(rest)
    assert rf"\begin{{{package}}}" in text
    assert other not in text
    assert (r"max width=\textwidth, max totalheight=\textheight" in text) == (package == "adjustbox")
    assert r"\textbf{50 \% of a\_b \& c \#1.}" in text
    assert len(re.findall(r"^ +0\.5 ", text, re.MULTILINE)) == n


def test_readers_get_less_than_the_csv_file_and_a_note(tmp_path: Path) -> None:
    frame = pd.DataFrame({"name": ["a"], "value": [0.5], "value_low": [0.25], "value_high": [0.75]})
    shown = with_intervals(frame, ["value"])[["name", "value"]]
    write_table(frame, tmp_path / "t", shown, "100 % of runs.")
    assert (tmp_path / "t.csv").read_text().splitlines()[0] == "name,value,value_low,value_high"
    assert (tmp_path / "t.md").read_text().splitlines() == [
        "100 % of runs.",
        "",
        "| name   | value            |",
        "|--------|------------------|",
        "| a      | 0.5 [0.25, 0.75] |",
    ]
    assert r"\textbf{100 \% of runs.}" in (tmp_path / "t.tex").read_text()


def test_links_name_the_lines_of_the_csv_file(tmp_path: Path) -> None:
    frame = pd.DataFrame({"value": [0.125, 2.0, 30.0, 4.5]})
    write_table(frame, tmp_path / "t")
    lines = (tmp_path / "t.csv").read_text().splitlines()
    for i, value in enumerate(frame["value"]):
        match = LINK.fullmatch(link("x", "t", frame.iloc[i]))
        assert match is not None
        text, file, number = match.groups()
        assert (text, file) == ("x", "t.csv")
        assert float(lines[int(number) - 1]) == value


@pytest.mark.parametrize(
    ("places", "rows"), [([0], "2"), ([2, 0], "2;4"), ([0, 1, 2], "2-4"), ([3, 1, 0], "2-3;5")]
)
def test_links_to_several_rows_are_short(places: list[int], rows: str) -> None:
    frame = pd.DataFrame({"value": [1, 2, 3, 4]})
    linked = link("0.5 [0, 1]", "t", frame.loc[places])
    assert linked == f"[0.5 [0, 1]](t.csv#row={rows})"
    assert link("x", "t", *(frame.loc[i] for i in places)) == f"[x](t.csv#row={rows})"
    assert plain(f"It is {link('0.5', 't', frame.loc[places])}.") == "It is 0.5."
