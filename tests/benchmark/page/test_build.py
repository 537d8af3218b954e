"""The page as a file: made of published files alone, with every number in the row that it links to."""

import json
import re
import shutil
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image

from benchmark.__main__ import main
from benchmark.drawing.tables import plain, show
from benchmark.experiments import experiment_names
from benchmark.page import build
from benchmark.reports import sameness
from benchmark.reports.document import Document
from envs import InputError, load_scenario
from tests.benchmark.page.conftest import rows_of
from tests.benchmark.page.made import TEXT
from tests.support import ROOT, git


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


@pytest.fixture(params=["results", "published"])
def folder(request: pytest.FixtureRequest) -> Path:
    """A folder of results with a page."""
    found: Path = request.getfixturevalue(request.param)
    return found


def test_published_list_is_what_the_code_makes(published: Path) -> None:
    made, there = ((path / "README.md").read_text(encoding="utf-8") for path in (published, ROOT / "results"))
    assert made == there, "README.md is out of date: run make report"
    assert (published / "index.html").stat().st_size <= 4_000_000


def test_page_says_all_that_the_document_says_and_the_same_each_time(results: Path) -> None:
    page = Page(results / "index.html")
    assert build.write(results).read_text(encoding="utf-8") == page.source
    starts = ["<nav", 'id="finding"', "<h1>", 'class="moving"', '<p class="lead">', "<img",
              'id="episode"', 'id="explorer"', 'id="results"', 'id="compare_deep"', 'id="reproduce"',
              'id="speed"', 'id="made"', "<footer>"]  # fmt: skip
    places = [page.source.index(start) for start in starts]
    assert places == sorted(places)
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    document = Document(results / "reproduce")
    assert document.headline is not None
    for text in (*document.headline.text.split("\n\n"), *(each.text for each in document.findings)):
        assert as_shown(plain(text).replace("`", "")) in in_one_line(page.words)
    assert len(re.findall(r"<details[^>]*><summary>Mean score over training \(\d+ rows\)", page.source)) == 2
    assert "score: 0 is the random policy, -1 is worse & 2 < 3." in page.words
    for element in ("<em>learner</em>", "<h4>After training</h4>", "<h5>In detail</h5>", "<summary>Terms<"):
        assert page.source.count(element) == 3


def test_page_of_another_experiment_tells_of_s1_only_if_it_has_it(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made, tmp_path / "mine")
    manifest = json.loads((made / "manifest.json").read_text(encoding="utf-8"))
    for scenario in ("S2", "S1"):
        manifest["scenarios"][scenario] = load_scenario(scenario).model_dump(mode="json")
        (tmp_path / "mine" / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
        text = Page(build.write(tmp_path, "mine")).words
        for said in ("In a ring of 16 cells", "One episode, step by step", "The room has 10 × 12 cells"):
            assert (said in in_one_line(text)) == (scenario == "S1")
        assert "The map above" not in text


def in_one_line(text: str) -> str:
    return " ".join(text.split())


def as_shown(text: str) -> str:
    """Returns a text as the page shows it: pictures of others are links."""
    return re.sub(r"!\[(\w+)\]\(https:[^)]*\)", r"!\1", in_one_line(text))


def test_page_has_no_elements_but_its_own(results: Path) -> None:
    page = Page(results / "index.html")
    assert page.open == []
    assert page.elements["script"] == 4  # its data, two experiments' agents, and its script
    assert page.elements["img"] == 5  # leads of two, and another figure of each
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    targets = [value for name, value in page.attributes if name in ("href", "src", "data", "action")]
    assert not [target for target in targets if "script:" in target]
    assert not re.findall(r"@import|url\(|src=\"(?!data:)", page.source)
    assert "heading" not in re.findall(r"<h\d>(.*?)</h\d>", page.source)
    # Of every report: description, there and where it says how it was made, note, finding, and six rows.
    assert in_one_line(page.words).count(as_shown(TEXT)) == 3 * (2 + 1 + 1 + 6) + 1


def test_every_link_leads_somewhere(folder: Path) -> None:
    page = Page(folder / "index.html")
    assert len(page.links) > 100
    for _, target, _ in page.links:
        file, _, fragment = target.partition("#")
        if not file:
            assert f'id="{fragment}"' in page.source, target
        elif not file.startswith("https://"):
            assert (folder / file).exists(), target


def test_links_to_files_that_the_page_lacks_lead_to_the_repository_if_it_has_an_address(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(results, tmp_path / "results")

    def others() -> set[str]:
        page = Page(build.write(tmp_path / "results"))
        return {target for _, target, _ in page.links if not target.startswith("#") and ".csv" not in target}

    assert others() == {"https://arxiv.org/abs/2108.03730"} | {each for each in others() if "://" in each}
    about = {"version": "9", "repository": "https://example.org/a/b"}
    monkeypatch.setattr(build, "about", lambda: about)
    found = others()
    assert "https://example.org/a/b/blob/main/results/compare_deep/manifest.json" in found
    assert all(target.startswith("https://") for target in found)


def numbers_in(row: list[str], like: str) -> set[str]:
    """Returns what the numbers of a CSV row look like when they are shown as a number of the page is."""
    cells = [float(cell) for cell in row if re.fullmatch(r"-?[\d.]+(e[+-]\d+)?", cell)]
    decimals = len(like.partition(".")[2])
    shown = {show(cell) for cell in cells} | {f"{cell:.{decimals}f}" for cell in cells}
    return shown | {"1"} | ({"never"} if "inf" in row else set())  # 1: how many rows these are


def test_every_number_is_in_the_row_that_it_links_to(folder: Path) -> None:
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
    ("file", "content"),
    [("manifest.json", None), ("summary.csv", None)]
    + [(name, b"{}") for name in ("manifest.json", "summary.csv", "curves.svg", "agents.json.gz")]
    + [("manifest.json", b"{")],
)
def test_damaged_results_are_refused(results: Path, tmp_path: Path, file: str, content: bytes | None) -> None:
    shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    (tmp_path / "reproduce" / file).unlink()
    if content is not None:
        (tmp_path / "reproduce" / file).write_bytes(content)
    with pytest.raises(InputError, match="reproduce"):
        build.write(tmp_path, "reproduce" if file == "manifest.json" else None)
    assert not (tmp_path / "index.html").exists()


@pytest.mark.parametrize(
    "changes",
    [{key: None} for key in ("command", "commits", "description", "last_started_at", "machines", "versions")]
    + [{"scenarios": []}, {"scenarios": {"S1": 5}}, {"processors": 5}, {"versions": [5]}, {"commits": 5}]
    + [{"algorithms": 5}, {"last_started_at": 5}, {"report": {"kind": 5}}],
    ids=str,
)
def test_damaged_manifests_are_refused(results: Path, tmp_path: Path, changes: dict[str, object]) -> None:
    for name in ("compare_deep", "reproduce"):
        shutil.copytree(results / name, tmp_path / name)
    path = tmp_path / "reproduce" / "manifest.json"
    found = json.loads(path.read_text(encoding="utf-8")) | changes
    path.write_text(json.dumps({key: value for key, value in found.items() if value is not None}))
    with pytest.raises(InputError, match="reproduce"):
        build.write(tmp_path)
    assert not (tmp_path / "index.html").exists()


def test_figure_that_is_too_high_for_the_page_is_smaller_there(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    (tmp_path / "reproduce" / "curves.svg").unlink(missing_ok=True)
    Image.new("RGB", (800, 40_000)).save(tmp_path / "reproduce" / "curves.png")
    assert re.search(r'width="32[78]" height="16383"', build.write(tmp_path).read_text(encoding="utf-8"))


def test_page_is_written_when_a_file_has_changed(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made, tmp_path / "mine")
    page = tmp_path / "mine" / "index.html"
    assert build.update(tmp_path, "mine") == str(page)
    assert build.update(tmp_path, "mine") == f"{page}, up to date"
    manifest = json.loads((tmp_path / "mine" / "manifest.json").read_text(encoding="utf-8"))
    (tmp_path / "mine" / "manifest.json").write_text(json.dumps(manifest | {"partial": "Said again."}))
    assert build.update(tmp_path, "mine") == str(page)
    assert '<p class="partial">Said again.</p>' in page.read_text(encoding="utf-8")
    assert "[mine](mine/README.md)" in (tmp_path / "README.md").read_text(encoding="utf-8")


def test_results_of_users_experiments_leave_git_status_clean(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ignoring = (ROOT / ".gitignore").read_text(encoding="utf-8")
    kept = {*re.findall(r"^!results/(\w+)/$", ignoring, flags=re.MULTILINE)}
    shipped = {name for name in experiment_names() if not name.endswith("_smoke")}
    assert kept == shipped - {"compare_deep_long"} | {build.SPEED}
    results = tmp_path / "results"
    shutil.copytree(ROOT / "results" / "equivalence", results / "equivalence")
    (tmp_path / ".gitignore").write_text(ignoring, encoding="utf-8")
    git(tmp_path, "init", "--quiet")
    monkeypatch.setattr(sameness, "REPOSITORY", tmp_path)
    build.update(results, "equivalence")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "--message", "Published")
    shutil.copytree(made, results / "mine")
    build.update(results, "mine")
    for path in ("results/runs.db", "map.png", "film.webp"):
        (tmp_path / path).touch()
    assert git(tmp_path, "status", "--porcelain") == ""
    (results / "equivalence" / "README.md").write_text("changed", encoding="utf-8")
    assert git(tmp_path, "status", "--porcelain") == " M results/equivalence/README.md\n"


def test_texts_of_all_folders_and_the_page_are_written_again(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(results, tmp_path / "results", ignore=shutil.ignore_patterns("README.md", "index.html"))
    shutil.copytree(tmp_path / "results" / "speed", tmp_path / "results" / "mine")
    shutil.copytree(tmp_path / "results" / "speed", tmp_path / "results" / "other")
    manifest = tmp_path / "results" / "other" / "manifest.json"
    text = manifest.read_text(encoding="utf-8")
    manifest.write_text(text.replace("tests.benchmark.page.made:", "of_another_machine:"), encoding="utf-8")
    assert main(["report", "--results", str(tmp_path / "results")]) == 0
    assert re.match(r".*other: its texts stay as they are: .*'of_another_machine'", capsys.readouterr().err)
    for file in ("index.html", "compare_deep/README.md", "reproduce/README.md"):
        made, there = ((path / file).read_text(encoding="utf-8") for path in (tmp_path / "results", results))
        assert made == there, file
    assert (tmp_path / "results" / "mine" / "README.md").exists()


@pytest.mark.parametrize(
    ("form", "files"),
    [("svg", ["curves.svg", "highest.svg"]), ("tex", ["curves.tex", "summary.tex"])],
)
def test_other_forms_have_a_folder_of_their_own(made: Path, form: str, files: list[str]) -> None:
    arguments = ["report", str(made.parent / "mine.toml"), "--results", str(made.parent), "--format", form]
    assert main(arguments) == 0
    assert sorted(path.name for path in made.with_name(f"mine_{form}").iterdir()) == files
    assert main([*arguments, "--partial"]) == 2
