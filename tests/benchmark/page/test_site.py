"""The site: every key and column is described, every link leads somewhere, and what readers can run runs."""

import doctest
import json
import re
import shutil
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from benchmark.reports.columns import meaning

from agents import ALGORITHMS, load_algorithm
from benchmark.experiments.schema import Experiment, Extension
from benchmark.page import build, reference, site
from benchmark.reports import load_report
from benchmark.reports.folder import MANIFEST, Folder
from envs import InputError, Scenario
from envs.inputs import Table
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import ROOT

RESULTS = ROOT / "results"
GUIDE = (SCENARIO_DIRECTORY / "README.md").read_text(encoding="utf-8")
CELLS: list[dict[str, Any]] = json.loads(site.TOUR.read_text(encoding="utf-8"))["cells"]
SETTINGS = sorted({load_algorithm(name).settings for name in ALGORITHMS}, key=lambda each: each.__name__)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of one report, with the API of `envs` alone."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(RESULTS / "reproduce", folder / "results" / "reproduce")
    site.write(folder / "results", folder / "site", ["envs"])
    return folder / "site"


# References


@pytest.mark.parametrize("root", [Scenario, Experiment, Extension, *SETTINGS], ids=lambda each: each.__name__)
def test_every_key_has_a_meaning_and_stands_in_its_reference(root: type[Table]) -> None:
    reference_of_files = reference.scenarios() if root is Scenario else reference.experiments()
    for name, section in reference.sections(root).items():
        rows = re.findall(r"^\| `(\w+)` \| .* \| (.*) \|$", section, flags=re.MULTILINE)
        assert rows
        for key, meant in rows:
            assert meant.endswith("."), f"{name}.{key} has no docstring below it"
            assert f" | {meant} |\n" in f"{reference_of_files}\n", f"{name}.{key}"


def test_reference_says_what_is_accepted() -> None:
    rows = reference.scenarios().splitlines()
    for row in (
        "| `rows` | whole number, 1 to 1,000 | required | Number of rows; together at most 100,000 cells. |",
        '| `unit` | "cells" or "metres" | `"cells"` | Of the lengths of shapes; metres need '
        "`grid.metres_per_cell`. |",
        "| `noise` | number, above 0, at most 1,000,000 | required | Half the width of the interval that the "
        "number is drawn from. |",
        "### `issuer.feedback`, `others[].feedback`: uniform or binary",
    ):
        assert row in rows


def test_every_published_column_has_a_short_meaning() -> None:
    text, n = reference.columns(RESULTS), 0
    for folder in build.published(RESULTS):
        report = load_report(Folder(folder).manifest["report"]["kind"]).name
        for file in folder.glob("*.csv*"):
            for column in reference.header(file):
                meant = meaning(report, file.name.partition(".")[0], column)
                assert meant, f"{file}: {column}"
                assert len(meant) < 250, f"{file}: {column}"
                assert not meant.endswith(".")
                assert "{" not in meant
                assert f"`{column}`" in text
                n += 1
    assert n > 300


# Pages


def test_every_link_of_the_site_leads_to_a_file(built: Path) -> None:
    documents = [
        path for path in built.rglob("*.html") if path.parent.name != "results" or path.name != "index.html"
    ]
    assert len(documents) > 15
    for path in documents:
        html = path.read_text(encoding="utf-8")
        html = re.sub(r"<script.*?</script>|<style.*?</style>", "", html, flags=re.DOTALL)
        for link in re.findall(r'(?:href|src)="([^"#]+)', html):
            if not re.match("[a-z]+:", link):
                assert (path.parent / unquote(link)).exists(), f"{path.name}: {link}"
        anchors = {*re.findall(r'id="([^"]+)"', html)}
        assert {*re.findall(r'href="#(table-[^"]+)', html)} <= anchors, path.name


def test_site_has_page_documents_and_api(built: Path) -> None:
    names = {path.relative_to(built).as_posix() for path in built.rglob("*") if path.is_file()}
    guides = "algorithms columns commands contributing experiments glossary index reports results scenarios"
    documents = {f"{name}.html" for name in [*guides.split(), "tour"]}
    results = {f"results/{name}" for name in ("index.html", "reproduce.html", "reproduce/claims.csv")}
    assert names >= documents | results | {"tour.ipynb", "search.js"}
    assert names >= {"envs.html", "envs/model.html"}
    assert "keeps bumping into a" in (built / "envs.html").read_text(encoding="utf-8")
    assert "The largest distance that belongs to" in (built / "scenarios.html").read_text(encoding="utf-8")
    index = (built / "index.html").read_text(encoding="utf-8")
    assert 'href="contributing.html"' in index
    assert "CITATION.cff" in index
    assert 'href="CITATION.cff"' not in index  # the site has no such file


@pytest.mark.parametrize("place", [".", "results", "results/reproduce", "notes"])
def test_site_deletes_nothing_else(place: str, tmp_path: Path) -> None:
    for file in ("results/reproduce/manifest.json", "notes/mine.txt"):
        (tmp_path / file).parent.mkdir(parents=True)
        (tmp_path / file).touch()
    with pytest.raises(InputError, match=r"SITE=.*accepted: "):
        site.write(tmp_path / "results", tmp_path / place)
    assert (tmp_path / "results" / "reproduce" / "manifest.json").exists()
    assert (tmp_path / "notes" / "mine.txt").exists()
    with pytest.raises(InputError, match=r"it has .* inside"):
        site.write(tmp_path / "results", site.ROOT.parent)


def test_results_of_users_are_not_on_the_site(tmp_path: Path) -> None:
    results, folder = tmp_path / "results", tmp_path / "site"
    for name in ("reproduce", "reproduce_smoke"):
        shutil.copytree(RESULTS / "reproduce", results / name)
    (results / "mine").mkdir()
    (results / "mine" / MANIFEST).write_text('{"report": {"kind": "no_such_module:X"}}', encoding="utf-8")
    (results / "index.html").write_text("old", encoding="utf-8")
    folder.mkdir()
    for name in ("search.js", "old.html"):  # a site made before
        (folder / name).touch()
    site.write(results, folder, ["agents.tabular"])
    assert not (folder / "old.html").exists()
    assert {path.name for path in (folder / "results").iterdir() if path.is_dir()} == {"reproduce"}
    assert (folder / "results" / "index.html").read_text(encoding="utf-8") != "old"


# What readers run


def test_tour_has_ten_cells_without_outputs() -> None:
    assert len(CELLS) == 10
    code = [cell for cell in CELLS if cell["cell_type"] == "code"]
    assert [cell["outputs"] for cell in code] == [[]] * len(code)
    assert {cell["execution_count"] for cell in code} == {None}


def test_tour_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, Any] = {}
    for cell in CELLS:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    printed = capsys.readouterr().out
    assert "PING [0.11111111 0.09090909] -0.4 wrong_ping" in printed
    assert "success              1" in printed
    lines = names["axis"].lines
    assert [line.get_label() for line in lines] == ["table", "net"]
    assert all(line.get_ydata()[-1] > 0.5 for line in lines)  # both have learned


def test_example_of_the_guide_to_scenarios_is_right(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (toml,) = re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.DOTALL)
    (session,) = re.findall(r"```pycon\n(.*?)```", GUIDE, flags=re.DOTALL)
    (tmp_path / "Corridor.toml").write_text(toml, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    test = doctest.DocTestParser().get_doctest(session, {}, "README", None, 0)
    said: list[str] = []
    result = doctest.DocTestRunner().run(test, out=said.append)
    assert result.attempted == 5
    assert not result.failed, "".join(said)
