"""Texts of somebody else's experiment and scenario, in every file that reports write of them."""

import csv
import html
import json
import re
from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from markdown_it.token import Token

from benchmark.__main__ import main
from benchmark.reports.published import Published
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import markdown_parser

# A formula, HTML, an entity, a script's link, ill-formed mathematics, LaTeX, and blocks of Markdown.
TEXT = r"""=cmd|"/C calc"!A0 <script>alert(1)</script> | a & b &lt; ![x](javascript:alert(1))
$\frac$ \input{x} % # ^ ~
# heading

- item
[x]: javascript:alert(1)

| a | b |
|---|---|
| 1 | 2 |
"""
EFFECT = r"@1+1 <img src=x onerror=alert(1)> | $\x_$ [a](javascript:b)"
PHASE = r"<b>|$\frac$ [red]_"
GROUP = r"_=$\x^$ <i>&amp;|"
BASE = f"""
description = {json.dumps(TEXT)}
note = {json.dumps(TEXT)}
horizon = 50
evaluation_every = 100
map_every = 200
settings = {{ budget = 200 }}
"""
SCENARIOS = f"""{BASE}
report = "REPORT"
scenarios = ["S1", "mood-1.toml"]
algorithms.one-1 = {{ algorithm = "q_learning", observations = ["index"], seeds = 2, group = GROUP }}
algorithms.2_two = {{ algorithm = "sarsa", observations = ["index"], seeds = 2, group = GROUP }}
"""
EFFECTS = f"""effects = [{{ name = {json.dumps(EFFECT)}, scenario = "mood-1", against = "S1" }}]"""
READINGS = f"""{BASE}
report = "replication"
scenarios = ["S1", "S2", "S3"]
algorithms.one-1 = {{ algorithm = "q_learning", observations = ["index"], seeds = 3 }}
readings.default = {{ question = {json.dumps(TEXT)}, answer = {json.dumps(TEXT)} }}
readings.other-1 = {{ question = "=1?", answer = "-1", settings = {{ epsilon = 0.1 }} }}
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder of results of each kind of report on these texts."""
    folder = tmp_path_factory.mktemp("texts")
    moody = (SCENARIO_DIRECTORY / "Moody.toml").read_text(encoding="utf-8")
    moody = moody.replace('"calm"', json.dumps(PHASE)).replace("{ calm =", f"{{ {json.dumps(PHASE)} =")
    moody = re.sub("description = .*", lambda _: f"description = {json.dumps(TEXT)}", moody)
    (folder / "mood-1.toml").write_text(moody, encoding="utf-8")
    texts = {
        "scenarios": SCENARIOS.replace("REPORT", "scenarios") + EFFECTS,
        "comparison": SCENARIOS.replace("REPORT", "comparison"),
        "replication": READINGS,
    }
    for report, text in texts.items():
        path = folder / f"{report}-1.toml"
        text = text.replace("mood-1.toml", str(folder / "mood-1.toml")).replace("GROUP", json.dumps(GROUP))
        path.write_text(text, encoding="utf-8")
        assert main(["run", str(path), "--report", "--jobs", "1", "--results", str(folder)]) == 0
    return {report: folder / f"{report}-1" for report in texts}


REPORTS = pytest.mark.parametrize("report", ["scenarios", "comparison", "replication"])


def in_one_line(text: str) -> str:
    return " ".join(text.split())


# CSV


@REPORTS
def test_no_spreadsheet_computes_a_text(folders: dict[str, Path], report: str) -> None:
    for path in folders[report].glob("*.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
        assert {len(row) for row in rows} == {len(rows[0])}, path.name
        for cell in (cell for row in rows for cell in row if cell.startswith(tuple("=+-@\t\r"))):
            float(cell)  # raises ValueError unless it is a number


def test_texts_are_read_as_they_were_written(folders: dict[str, Path]) -> None:
    published = Published(folders["scenarios"])
    assert set(published.frame("effects")["effect"]) == {EFFECT}
    assert published.frame("scenarios")["description"].tolist()[1] == TEXT
    assert published.frame("scenarios")["scenario"].tolist() == ["S1", "mood-1"]


# Markdown


def walk(tokens: list[Token] | None) -> Iterator[Token]:
    for token in tokens or ():
        yield token
        yield from walk(token.children)


def rendered(path: Path) -> tuple[list[Token], str]:
    """Returns a file of Markdown as tokens, and the text that readers see."""
    parser = markdown_parser()
    text = path.read_text(encoding="utf-8")
    words = html.unescape(re.sub("<[^>]+>", " ", parser.render(text)))
    return list(walk(parser.parse(text))), in_one_line(words)


@REPORTS
def test_markdown_has_no_structure_but_that_of_the_report(folders: dict[str, Path], report: str) -> None:
    for path in folders[report].glob("*.md"):
        tokens, _ = rendered(path)
        kinds = Counter(token.type for token in tokens)
        assert not kinds["html_block"] + kinds["html_inline"], path.name
        targets = [str(token.attrGet("src") or token.attrGet("href") or "") for token in tokens]
        assert not [target for target in targets if ":" in target]
        headings = [tokens[i + 1].content for i, token in enumerate(tokens) if token.type == "heading_open"]
        assert "heading" not in headings
        if path.name == "README.md":
            assert (headings[0], headings[-1]) == (f"{report}-1", "Terms")
        else:
            assert kinds["table_open"] == 1
            rows = kinds["tr_open"]
            assert kinds["th_open"] + kinds["td_open"] == kinds["th_open"] * rows


def test_markdown_shows_texts_as_they_are(folders: dict[str, Path]) -> None:
    for report, folder in folders.items():
        _, words = rendered(folder / "README.md")
        # description and note; that of the scenario, or question and answer, whose first letter is a capital
        expected = {"scenarios": 3, "comparison": 2, "replication": 4}[report]
        assert words.count(in_one_line(TEXT)) == expected
    _, words = rendered(folders["scenarios"] / "README.md")
    assert f"{EFFECT}: mood-1 minus S1, in success" in words
    _, words = rendered(folders["scenarios"] / "effects.md")
    assert words.count(EFFECT) == 2  # learners


# HTML


class Page(HTMLParser):
    """A page's elements and texts; its tags must match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: Counter[str] = Counter()
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements[tag] += 1
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in ("meta", "link", "img", "br", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@REPORTS
def test_page_has_no_elements_but_its_own(folders: dict[str, Path], report: str) -> None:
    folder = folders[report]
    page = Page((folder / "index.html").read_text(encoding="utf-8"))
    assert page.open == []
    assert page.elements["script"] == 2  # its data and its script
    assert page.elements["img"] <= len(list(folder.glob("*.png")))
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert not [value for name, value in page.attributes if name in ("href", "src") and "script:" in value]
    words = in_one_line(page.text)
    assert words.count(in_one_line(TEXT)) >= 3  # two of the description, one of the note
    if report == "scenarios":
        assert f"{EFFECT}: mood-1 minus S1, in success" in words


# Figures, and LaTeX


@REPORTS
def test_figures_have_the_texts_as_characters(folders: dict[str, Path], report: str) -> None:
    pictures = {path.stem: path.read_text(encoding="utf-8") for path in folders[report].glob("*.svg")}
    assert pictures
    for text in pictures.values():
        ElementTree.fromstring(text)  # raises ParseError unless it is XML
    # Ill-formed mathematics could not have been drawn. Matplotlib repeats a text beside its outlines.
    comments = {name: html.unescape("".join(re.findall("<!--(.*?)-->", text, re.DOTALL)))
                for name, text in pictures.items()}  # fmt: skip
    if report == "scenarios":
        assert f"{EFFECT}: mood-1 − S1" in comments["effects"]
        assert PHASE in comments["scenarios"]
    if report == "comparison":
        assert f"S1, {GROUP}" in comments["curves"]


@REPORTS
def test_latex_has_no_commands_but_its_own(folders: dict[str, Path], report: str) -> None:
    own = {
        "adjustbox", "begin", "bottomrule", "end", "ensuremath", "midrule", "noindent", "par",
        "textasciitilde", "textbackslash", "textbar", "textbf", "textheight", "textwidth", "toprule",
        "usepackage",
    }  # fmt: skip
    for path in folders[report].glob("*.tex"):
        text = path.read_text(encoding="utf-8")
        assert set(re.findall(r"\\([A-Za-z]+)", text)) <= own, path.name
        rows = [line for line in text.splitlines() if line.endswith(r"\\")]
        assert len({len(re.findall(r"(?<!\\)&", row)) for row in rows}) == 1
        assert not re.findall(r"(?<!\\)[$#]|\|", text)
