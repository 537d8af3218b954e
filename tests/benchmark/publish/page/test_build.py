"""The page as a file: made of published files alone, with every number in the row that it links to."""

import html
import re
import shutil
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.drawing.tables import plain, show
from benchmark.experiments import PUBLISHED
from benchmark.publish import sameness
from benchmark.publish.document import SPEED, Document
from benchmark.publish.page import build
from envs import InputError
from tests.benchmark.publish.page.conftest import rows_of
from tests.benchmark.publish.page.made import TEXT
from tests.support import ROOT, git, reseal


class Page(HTMLParser):
    """A page's elements, links and texts; its tags must match."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: Counter[str] = Counter()
        self.attributes: list[tuple[str, str]] = []
        self.links: list[tuple[str, str, str]] = []  # class, target, text
        self.words = ""
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements[tag] += 1
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag == "a":
            values = dict(attrs)
            self.links.append((values.get("class") or "", values.get("href") or "", ""))
        if tag not in ("meta", "link", "img", "br", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("script", "style"):
            self.words += data.replace("−", "-")
        if "a" in self.open:
            self.links[-1] = (*self.links[-1][:2], self.links[-1][2] + data)


def test_page_says_all_that_the_document_says_and_the_same_each_time(results: Path) -> None:
    page = Page(results / "index.html")
    assert build.write(results).read_text(encoding="utf-8") == page.source
    starts = ["<nav", 'id="finding"', "<h1>", 'class="contents"', 'id="results"', 'id="report-reproduce"',
              '<p class="lead">', "<img", 'id="report-compare_deep"', 'id="explorer"', 'id="report-speed"',
              "<footer>"]  # fmt: skip
    places = [page.source.index(start) for start in starts]
    assert places == sorted(places)
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    document = Document(results / "reproduce")
    assert document.headline is not None
    for text in document.headline.split("\n\n"):
        assert in_one_line(html.unescape(plain(text)).replace("`", "")) in in_one_line(page.words)
    assert len(re.findall(r"<details[^>]*><summary>Mean score over training \(\d+ rows\)", page.source)) == 2
    assert "score: 0 is the random policy, -1 is worse & 2 < 3." in page.words
    for element in ("<em>learner</em>", "<h4>After training<", "<h5>In detail<", "<h4>Terms<"):
        assert page.source.count(element) == 2


def test_page_of_another_experiment_tells_of_it_alone(made: Path) -> None:
    page = Page(made / "index.html")
    assert "<h1>mine</h1>" in page.source
    said = in_one_line(page.words)
    assert said.count(in_one_line(TEXT)) == 2 + 1 + 1 + 6 + 1
    for other in ("10 × 12", "64 places", "tile coding", "this benchmark counts", "results/"):
        assert other not in said


def in_one_line(text: str) -> str:
    return " ".join(text.split())


def test_page_has_no_elements_but_its_own(results: Path) -> None:
    page = Page(results / "index.html")
    assert page.open == []
    assert page.elements["script"] == 4  # its data, two experiments' agents, and its script
    assert page.elements["img"] == 4  # leads of two, and another figure of each
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    targets = [value for name, value in page.attributes if name in ("href", "src", "data", "action")]
    assert not [target for target in targets if "script:" in target]
    source = re.sub("src='data:[^']*'", "", page.source)
    assert not re.findall(r"@import|url\(|src=[\"']", source)
    assert "heading" not in re.findall(r"<h\d>(.*?)</h\d>", page.source)
    # Of every report: description, there and where it says how it was made, note, finding, and six rows.
    assert in_one_line(page.words).count(in_one_line(TEXT)) == 2 * (2 + 1 + 1 + 6) + 1


def test_every_link_leads_somewhere(results: Path) -> None:
    check_links(results)


def check_links(folder: Path) -> None:
    """Checks that every link of a folder's page leads to a file or a place of the page."""
    page = Page(folder / "index.html")
    assert len(page.links) > 100
    for _, target, _ in page.links:
        file, _, fragment = target.partition("#")
        if not file:
            assert f'id="{fragment}"' in page.source, target
        elif not file.startswith("https://"):
            assert (folder / file).exists(), target


def numbers_in(row: list[str], like: str) -> set[str]:
    """Returns what the numbers of a CSV row look like when they are shown as a number of the page is."""
    cells = [float(cell) for cell in row if re.fullmatch(r"-?[\d.]+(e[+-]\d+)?", cell)]
    decimals = len(like.partition(".")[2])
    shown = {show(cell) for cell in cells} | {f"{cell:.{decimals}f}" for cell in cells}
    return shown | {"1"} | ({"never"} if "inf" in row else set())  # 1: how many rows these are


def test_every_number_is_in_the_row_that_it_links_to(results: Path) -> None:
    check_numbers(results)


def check_numbers(folder: Path) -> None:
    """Checks that every number of a folder's page is in the rows of the file that it links to."""
    checked = 0
    for kind, target, shown in Page(folder / "index.html").links:
        file, _, place = target.partition("#row=")
        if kind != "n" or not place.isdecimal() or not re.fullmatch(r"[−\d.,]+|never", shown):
            continue  # of several rows, or in other units
        number = shown.replace("−", "-").replace(",", "")
        known = numbers_in(rows_of(folder / file)[int(place) - 1], number)
        known |= {text[1:] for text in known if text.startswith("-") and not text.strip("-0.")}
        assert {number, shown} & known or f"{float(number):,.0f}" in known, (shown, target)
        checked += 1
    assert checked > 100


@pytest.mark.parametrize(
    "change",
    ["manifest.json", "summary.csv", "curves.svg", "agents.json.gz"]  # files
    + [
        {key: None}
        for key in ("command", "commits", "description", "last_started_at", "machines", "versions")
    ]
    + [{"scenarios": []}, {"scenarios": {"S1": 5}}, {"processors": 5}, {"versions": [5]}, {"commits": 5}]
    + [{"algorithms": 5}, {"last_started_at": 5}, {"report": {"kind": 5}}],
    ids=str,
)
def test_damaged_results_are_refused(results: Path, tmp_path: Path, change: str | dict[str, object]) -> None:
    folder = shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    if isinstance(change, str):
        (folder / change).write_bytes(b"{}")
    else:
        reseal(folder, **change)
    with pytest.raises(InputError, match="reproduce"):
        build.write(tmp_path)
    assert not (tmp_path / "index.html").exists()


def test_git_has_the_published_results_and_ignores_those_of_users(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert {path.name for path in (ROOT / "results").glob("[!.]*/")} >= {*PUBLISHED, SPEED}
    results = tmp_path / "results"
    shutil.copytree(ROOT / "results" / "equivalence", results / "equivalence")
    shutil.copy(ROOT / ".gitignore", tmp_path)
    git(tmp_path, "init", "--quiet")
    monkeypatch.setattr(sameness, "REPOSITORY", tmp_path)
    build.write(results, "equivalence")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "--message", "Published")
    listed = git(tmp_path, "ls-files").split()
    assert {"results/README.md", "results/equivalence/manifest.json"} <= {*listed}
    shutil.copytree(made, results / "mine")
    (results / "equivalence" / ".gitignore").write_text("*\n")  # of a run before it was published
    build.write(results, "mine")
    (results / "runs.db").touch()
    assert git(tmp_path, "status", "--porcelain") == ""
    assert "mine" not in (results / "README.md").read_text(encoding="utf-8")
    (results / "equivalence" / "new.csv").touch()
    assert git(tmp_path, "status", "--porcelain") == "?? results/equivalence/new.csv\n"


def test_list_of_results_has_their_findings_by_importance(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results, tmp_path / "results")
    shutil.copytree(results / "reproduce", tmp_path / "results" / "mine")
    build.write(tmp_path / "results")
    listed = re.findall(
        r"^- \[(\w+)\]\((\w+)/README.md\): (.*?)$", (tmp_path / "results" / "README.md").read_text(), re.M
    )
    assert [name for name, _, _ in listed] == ["reproduce", "compare_deep", "speed"]
    assert all(name == folder for name, folder, _ in listed)
    assert [finding.partition(" is ")[0] for *_, finding in listed] == ["The worst score"] * 2 + [
        "Tabular Q-learning"
    ]


def test_texts_of_all_folders_and_the_page_are_written_again(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(results, tmp_path / "results", ignore=shutil.ignore_patterns("README.md", "index.html"))
    shutil.copytree(tmp_path / "results" / "reproduce", tmp_path / "results" / "mine")
    shutil.copytree(tmp_path / "results" / "reproduce", tmp_path / "results" / "other")
    reseal(tmp_path / "results" / "other", report={"kind": "of_another:REPORT", "items": [], "question": ""})
    assert main(["report", "--results", str(tmp_path / "results")]) == 0
    said = r".*other: its texts stay as they are: .* of_another:REPORT: code of users"
    assert re.match(said, capsys.readouterr().err)
    for file in ("index.html", "compare_deep/README.md", "reproduce/README.md"):
        made, there = ((path / file).read_text(encoding="utf-8") for path in (tmp_path / "results", results))
        assert made == there, file
    assert (tmp_path / "results" / "mine" / "README.md").exists()
