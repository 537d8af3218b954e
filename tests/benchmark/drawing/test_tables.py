"""Files of tables."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmark.drawing.tables import read_csv, to_markdown, write_csv
from tests.support import markdown_parser, mistyped_columns


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


def test_columns_without_any_value_are_left_out(tmp_path: Path) -> None:
    frame = pd.DataFrame({"a": [1, 2], "none": [np.nan, np.nan], "empty": ["", ""], "b": [np.nan, 0.5]})
    for rows, expected in ((frame, "a,b\n1,\n2,0.5\n"), (frame.head(0), "a,none,empty,b\n")):
        write_csv(rows, tmp_path / "t.csv")
        assert (tmp_path / "t.csv").read_text() == expected


@given(st.lists(st.text(alphabet="'=\n ,;\"a1|", max_size=5), min_size=1))
def test_texts_are_read_back(tmp_path_factory: pytest.TempPathFactory, texts: list[str]) -> None:
    path = tmp_path_factory.getbasetemp() / "texts.csv"
    frame = pd.DataFrame({"name": [*texts, "NA", "x"], "x": -1.5})
    write_csv(frame, path)
    assert read_csv(path).fillna("").equals(frame)


def test_entries_of_a_markdown_table_stay_in_their_columns() -> None:
    texts = ["a|b", r"a\|b", r"a\\|b", "a\nb", "<b>", "|"]
    rendered = markdown_parser().render(to_markdown(pd.DataFrame({"x|y": texts, "z": range(len(texts))})))
    assert re.findall("<th.*?>(.*)</th>", rendered) == ["x|y", "z"]
    assert re.findall("<td.*?>(.*)</td>", rendered)[1::2] == [str(i) for i in range(len(texts))]
