"""Files of tables."""

import csv
import html
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from markupsafe import Markup

from benchmark.drawing.tables import (
    LINK,
    link,
    local_only,
    paragraph,
    plain,
    read_csv,
    to_markdown,
    write_csv,
)
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


@pytest.mark.parametrize(
    ("indices", "rows"), [([0], "2"), ([2, 0], "2;4"), ([0, 1, 2], "2-4"), ([3, 1, 0], "2-3;5")]
)
def test_links_name_the_lines_of_the_csv_file(tmp_path: Path, indices: list[int], rows: str) -> None:
    frame = pd.DataFrame({"value": [0.125, 2.0, 30.0, 4.5]})
    write_csv(frame, tmp_path / "t.csv")
    lines = (tmp_path / "t.csv").read_text().splitlines()
    for i in indices:
        match = LINK.fullmatch(link("x", "t", frame.iloc[i]))
        assert match is not None
        assert float(lines[int(match[3]) - 1]) == frame["value"][i]
    linked = link("0.5 [0, 1]", "t", frame.loc[indices])
    assert linked == f"[0.5 [0, 1]](t.csv#row={rows})"
    assert plain(f"It is {link('0.5', 't', *(frame.loc[i] for i in indices))}.") == "It is 0.5."


# Texts of somebody else


@given(st.lists(st.text(alphabet="'=+-@＝\t\n ,;\"a1|", max_size=5), min_size=1))
def test_no_text_in_a_csv_file_is_a_formula_and_all_are_read_back(
    tmp_path_factory: pytest.TempPathFactory, texts: list[str]
) -> None:
    texts = [*texts, "NA", "x"]
    path = tmp_path_factory.getbasetemp() / "texts.csv"
    frame = pd.DataFrame({"=name": texts, "n": range(len(texts)), "x": -1.5})
    write_csv(frame, path)
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["'=name", "n", "x"]
    cells = [cell for row in rows for cell in row[0].split(";")]  # which separates cells in some countries
    assert not [cell for cell in cells if cell.startswith(("\t", "\n")) or cell.strip()[:1] in set("=+-@＝")]
    assert {row[2] for row in rows} == {"-1.5"}  # numbers stay numbers
    assert read_csv(path).fillna("").equals(frame)


@pytest.mark.parametrize(
    "text",
    [
        "# a", "> a", "- a", "+ a", "* a", "1. a", "12) a", "* * *", "---", "___", "***", "===", "```",
        "~~~ a", "```a\nb\n```", "    a", "\ta", "[a]: javascript:b", r"[a\]b]: c", "[^1]: a", "a\n===",
        "a\n# b", "a\n\n- b", "|a|b|\n|-|-|\n|c|d|", "<b>a</b>", "<!-- a", "<?a?>", "<a@b.c>", "&lt;",
        "&#60;b>", r"\<b>", r"\&lt;",
        "[a](javascript:b)", "[a](JavaScript:b)", r"[a](java\script:b)", "[a](&#106;avascript:b)",
        "[a](<data:b>)",
        "![a](data:b)", "[a]( vbscript:b)", "[a](\njavascript:b)", r"[a\]](javascript:b)", "[a](b:c)",
        "![a](https://b.org/c.png)", "![a](b.svg)", "[a](b.csv)", "[a](//b.org)", "[![a](https://b.org)](c.csv)",
        "<https://b.org>", "https://b.org", "HTTP://b.org", "www.b.org", "a@b.org", "mailto:a@b.org", "@a",
        "$x$", r"$$\frac$$", r"a \ b", r"\`<b>`", "`` ` `` <b> ` x", "*** a",
    ],
)  # fmt: skip
def test_markdown_of_a_text_is_the_text_in_a_paragraph(text: str) -> None:
    rendered = markdown_parser().render(f"before\n\n{paragraph(text)}\n\n[a] [^1]")
    match = re.fullmatch(r"<p>before</p>\n<p>(.*)</p>\n<p>\[a\] \[\^1\]</p>\n", rendered)
    assert match is not None
    shown = re.sub("</?(em|strong|code)>", "", match[1])
    assert "<" not in shown
    assert "$" not in paragraph(text)  # sites draw formulas
    if "`" not in text and "*" not in text:
        assert html.unescape(shown).replace("\u2060", "") == " ".join(text.split())
    for active in ("](", "://", "www.", "@b", "@a"):  # also where addresses become links by themselves
        assert active not in paragraph(text)


def test_markdown_keeps_code_and_emphasis() -> None:
    text = "`code` and *emphasis* < 1; 0.5 [0, 1]"
    assert paragraph(text) == text
    frame = pd.DataFrame({"text": [text], "link": [Markup("[a](b.csv)")]})
    rendered = markdown_parser().render(to_markdown(frame))
    assert "<td><code>code</code> and <em>emphasis</em> &lt; 1; 0.5 [0, 1]</td>" in rendered
    assert rendered.count("<a href=") == 1


def test_markdown_shows_and_links_files_of_the_repository_alone() -> None:
    local = "![a](b.svg) [c](../d/README.md#e) [0.5](f.csv#row=2;4-5) < 1, [0, 1] @ S1"
    assert local_only(local) == local
    texts = ["![a](https://b.org)", "[a](//b.org)", r"[a](/\b.org)", "[a](javascript:b)", "[a](b 'c')", "<b>"]
    for text in [*texts, "https://b.org", "www.b.org", "a@b.org", "x\n\n[a]: https://b.org\n\n![a]"]:
        rendered = markdown_parser().render(local_only(text))
        assert not re.search("<(?!/?p>)", rendered), text
        assert local_only(local_only(text)) == local_only(text)
    assert (
        link("[a](https://b.org)", "t", pd.DataFrame(index=[0]))
        == "[[a]&#40;https&#58;//b.org)](t.csv#row=2)"
    )


def test_entries_of_a_markdown_table_stay_in_their_columns() -> None:
    texts = ["a|b", r"a\|b", r"a\\|b", "a\nb", "<b>", "|", "`a|b", "[a](javascript:b)"]
    rendered = markdown_parser().render(to_markdown(pd.DataFrame({"x|y": texts, "z": range(len(texts))})))
    assert re.findall("<th.*?>(.*)</th>", rendered) == ["x|y", "z"]
    cells = [html.unescape(cell) for cell in re.findall("<td.*?>(.*)</td>", rendered)]
    assert cells[::2] == [" ".join(text.split()) for text in texts]
    assert cells[1::2] == [str(i) for i in range(len(texts))]
