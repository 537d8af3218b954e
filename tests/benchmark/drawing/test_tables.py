"""Files of tables."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.drawing.tables import LINK, link, plain, with_intervals, write_table


def test_tables_come_in_three_forms(tmp_path: Path) -> None:
    frame = pd.DataFrame({"name": ["a_b", "c"], "value": [1 / 3, -1e-17], "n": [2, 3]})
    write_table(frame, tmp_path / "t")
    assert (tmp_path / "t.csv").read_text() == "name,value,n\na_b,0.333333,2\nc,0,3\n"
    assert (tmp_path / "t.md").read_text().splitlines()[2] == "| a_b    |   0.333 |   2 |"
    tex = (tmp_path / "t.tex").read_text()
    assert r"a\_b" in tex
    assert r"\toprule" in tex


def test_readers_get_less_than_the_csv_file_and_a_note(tmp_path: Path) -> None:
    frame = pd.DataFrame({"name": ["a"], "value": [0.5], "value_low": [0.25], "value_high": [np.nan]})
    shown = with_intervals(frame, ["value"])[["name", "value"]]
    write_table(frame, tmp_path / "t", shown, "100 % of runs.")
    assert (tmp_path / "t.csv").read_text().splitlines()[0] == "name,value,value_low,value_high"
    assert (tmp_path / "t.md").read_text().splitlines() == [
        "100 % of runs.",
        "",
        "| name   | value         |",
        "|--------|---------------|",
        "| a      | 0.5 [0.25, -] |",
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
