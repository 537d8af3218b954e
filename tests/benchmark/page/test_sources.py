"""Folders of results: links to lines of files, and sentences about damaged files."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

from benchmark.drawing.tables import link
from benchmark.page import build
from benchmark.page.sources import Folder
from envs import InputError


def test_links_lead_to_lines_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "numbers.csv").write_text("name,value\na,1\nb,-2\nc,3\n", encoding="utf-8")
    folder = Folder(tmp_path, "somewhere/", {})
    frame = folder.read("numbers.csv")
    assert folder.link("numbers.csv") == "somewhere/numbers.csv"
    assert folder.link("numbers.csv", frame.index[1]) == "somewhere/numbers.csv#row=3"  # line 1 is the header
    sentence = f"In `b` it is {link('-2', 'numbers', frame.iloc[1])} < 0, not {link('1', 'numbers', frame)}."
    assert folder.as_html(sentence) == (
        'In <code>b</code> it is <a class="n" href="somewhere/numbers.csv#row=3">−2</a> &lt; 0, '
        'not <a class="n" href="somewhere/numbers.csv#row=2-4">1</a>.'
    )


def test_only_files_that_are_asked_for_are_embedded(tmp_path: Path) -> None:
    for name in ("held.csv", "large.csv"):
        (tmp_path / name).write_text("a,b\n1.50,2.50\n", encoding="utf-8")
    folder = Folder(tmp_path, "", {})
    assert "held.csv" in folder
    assert "other.csv" not in folder
    assert folder.read("held.csv", as_text="a").equals(pd.DataFrame({"a": ["1.50"], "b": [2.5]}))
    folder.read("large.csv", embed=False)
    assert folder.embedded == {"held.csv": "a,b\n1.50,2.50\n"}


@pytest.mark.parametrize(
    ("file", "content", "expected"),
    [
        ("manifest.json", "{}", r"manifest\.json: damaged, or made by another version of this project; make"),
        (
            "claims.csv",
            "claim,value\nx,1\n",
            "reproduce: damaged, or made by another version of this project",
        ),
        ("agent_S2.csv", None, r"another version of this project \(agent_S2\.csv is missing\); make these"),
    ],
)
def test_damaged_results_get_a_sentence(
    results: Path, tmp_path: Path, file: str, content: str | None, expected: str
) -> None:
    shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    if content is None:
        (tmp_path / "reproduce" / file).unlink()
    else:
        (tmp_path / "reproduce" / file).write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=expected):
        build.write(tmp_path)
    assert not (tmp_path / "index.html").exists()
