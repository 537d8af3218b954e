"""The page as a file: made of published files alone, the same each time, with links that lead somewhere."""

import re
import shutil
import tomllib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.experiments import PUBLISHED
from benchmark.folder import SPEED, Folder
from benchmark.publish.document import Document
from benchmark.publish.page import build
from envs import InputError
from tests.benchmark.publish.page.made import TEXT
from tests.support import ROOT, git, reseal


class Page(HTMLParser):
    """A page's attributes and words; its tags must match."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in ("meta", "link", "img", "br", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data.replace("−", "-") if self.open and self.open[-1] not in ("script", "style") else ""

    @property
    def words(self) -> str:
        return " ".join(self.text.split())

    def values(self, name: str) -> list[str]:
        return [value for key, value in self.attributes if key == name]


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results in the repository, with the page that today's code makes of them."""
    results = tmp_path_factory.mktemp("published") / "results"
    ignored = shutil.ignore_patterns("runs.db*", "*_smoke", ".*", "index.html")
    shutil.copytree(ROOT / "results", results, ignore=ignored)
    build.write(results)
    return results


def test_page_says_all_that_the_document_says_and_the_same_each_time(results: Path) -> None:
    page = Page(results / "index.html")
    assert build.write(results).read_text(encoding="utf-8") == page.source
    starts = ['id="finding"', 'id="report-reproduce"', '<p class="lead">', 'id="report-compare_deep"',
              'id="explorer"', "<footer>"]  # fmt: skip
    places = [page.source.index(start) for start in starts]
    assert places == sorted(places)
    ids = page.values("id")
    assert len(ids) == len({*ids})
    document = Document(results / "reproduce")
    assert (document.headline or "").split(" is ")[0] in page.words
    assert "score: 0 is the random policy, -1 is worse & 2 < 3." in page.words
    for element in ("<em>learner</em>", "<h4>After training<", "<h5>In detail<", "<h4>Terms<"):
        assert page.source.count(element) == 2
    # Of both experiments: description, note, finding, six rows of a table; and the scenario's description.
    assert page.words.count("<script>alert(1)</script> | a & b < ") == 2 * (1 + 1 + 1 + 6) + 1
    assert [name for name, _ in page.attributes if name.startswith("on")] == []


def test_page_of_another_experiment_shows_it_alone(made: Path) -> None:
    page = Page(made / "index.html")
    assert "<h1>mine</h1>" in page.source
    assert "results/" not in page.words


@pytest.mark.parametrize("name", ["results", "published"])
def test_every_link_leads_somewhere(name: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue(name)
    page = Page(folder / "index.html")
    for target in {*page.values("href")} - {"data:,", "https://arxiv.org/abs/2108.03730"}:
        file, _, fragment = target.partition("#")
        assert (folder / file).is_file() if file else fragment in page.values("id"), target


def test_published_list_is_what_the_code_makes(published: Path) -> None:
    made, there = ((path / "README.md").read_text(encoding="utf-8") for path in (published, ROOT / "results"))
    assert made == there, "README.md is out of date: run make report"
    names = [f"report-{name}" for name in PUBLISHED]
    assert [each for each in Page(published / "index.html").values("id") if each in names] == names


def test_every_published_column_is_explained(published: Path) -> None:
    known = tomllib.loads((ROOT / "benchmark/studies/columns.toml").read_text(encoding="utf-8"))
    names = {name for table, named in known.items() if not table.endswith("_labels") for name in named}

    def bases(name: str) -> Iterator[str]:
        for pattern in known["affixes"]:
            if match := re.fullmatch(pattern, name):
                yield next(filter(None, match.groups()))

    def is_explained(name: str) -> bool:
        return name in names or any(is_explained(base) for base in bases(name))

    for path in [path for name in (*PUBLISHED, SPEED) for path in (published / name).glob("*.csv*")]:
        folder = Folder(path.parent)
        of_scenes = {*folder.manifest["scenarios"]} if path.name == "trials.csv" else set()
        columns = {str(name) for name in folder.frame(path.name)} - of_scenes
        assert {name for name in columns if not is_explained(name)} == set(), path


@pytest.mark.parametrize(
    "change",
    ["manifest.json", "summary.csv", "agents.json.gz", {"commits": None}, {"algorithms": 5}],
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


def test_git_has_the_published_results_and_ignores_others(tmp_path: Path) -> None:
    shutil.copy(ROOT / ".gitignore", tmp_path)
    git(tmp_path, "init", "--quiet")
    for name in (*PUBLISHED, SPEED, "mine", "when_smoke", "when_seeds_0-4"):
        (tmp_path / "results" / name).mkdir(parents=True)
        for file in ("a.csv", "index.html"):
            (tmp_path / "results" / name / file).touch()
    for file in ("README.md", "index.html", "runs.db", "runs.db-wal"):
        (tmp_path / "results" / file).touch()
    git(tmp_path, "add", "--all")
    listed = {Path(name) for name in git(tmp_path, "ls-files", "results").split()}
    expected = {Path("results", name, "a.csv") for name in (*PUBLISHED, SPEED)}
    assert listed == {Path("results", "README.md"), *expected}


def test_texts_of_all_folders_and_the_page_are_written_again(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = tmp_path / "results"
    shutil.copytree(results, again, ignore=shutil.ignore_patterns("README.md", "index.html"))
    shutil.copytree(again / "reproduce", again / "other")
    reseal(again / "other", report={"kind": "of_another:REPORT", "items": [], "question": ""})
    assert main(["report", "--results", str(again)]) == 0
    said = r".*other: its texts stay as they are: .* of_another:REPORT: code of users"
    assert re.match(said, capsys.readouterr().err)
    for file in ("index.html", "README.md", "compare_deep/README.md", "reproduce/README.md"):
        made, there = ((path / file).read_text(encoding="utf-8") for path in (again, results))
        assert made == there, file
    listed = re.findall(r"^- \[(\w+)\]\(\1/README.md\): (.*) is ", (again / "README.md").read_text(), re.M)
    assert [name for name, _ in listed] == ["reproduce", "compare_deep"]


def test_rows_of_readme_stay_rows(results: Path) -> None:
    """Texts of users may have bars, line breaks and HTML."""
    readme = (results / "reproduce" / "README.md").read_text(encoding="utf-8")
    rows = [line for line in readme.splitlines() if line.startswith("| room") or line.startswith("| S2")]
    assert len(rows) == 6
    assert " ".join(TEXT.split()).partition(" |")[0] in readme
    assert {line.count(" | ") for line in rows} == {6}
