"""The site: every column is described, every link leads somewhere, and what readers can run runs."""

import doctest
import re
import shutil
import tomllib
from pathlib import Path
from urllib.parse import unquote

import pytest
from playwright.sync_api import Browser

from benchmark.publish.page import build, site
from envs import scenario_names
from envs.scenario import SCENARIO_DIRECTORY, load_scenario
from tests.support import ROOT

RESULTS = ROOT / "results"
GUIDE = (SCENARIO_DIRECTORY / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of two reports, with the API of `envs` alone."""
    folder = tmp_path_factory.mktemp("site")
    for name in ("reproduce", "speed"):
        shutil.copytree(RESULTS / name, folder / "results" / name)
    (folder / "results" / "reproduce" / "README.md").write_text("<b>by hand</b>", encoding="utf-8")
    (folder / "results" / "reproduce" / "other.html").touch()
    (folder / "results" / "mine").mkdir()
    (folder / "results" / "mine" / "manifest.json").write_text("{}", encoding="utf-8")
    site.write(folder / "results", folder / "site", ["envs"])
    return folder / "site"


# Columns


def rows_of(text: str) -> list[list[str]]:
    """Returns the cells of those rows of tables in Markdown that begin with code."""
    return [
        [cell.strip(" `") for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("| `")
    ]


def test_every_published_column_has_a_short_meaning() -> None:
    described = dict(rows_of(site.columns(RESULTS)))
    for name, meaning in described.items():
        assert re.fullmatch(r"[^{]{1,249}[^.{]", meaning), name
    for folder in build.published(RESULTS):
        for file in folder.glob("*.csv"):
            assert {*file.read_text(encoding="utf-8").partition("\n")[0].split(",")} <= {*described}, file


# Pages


@pytest.mark.slow
def test_every_link_of_the_site_leads_to_a_file(built: Path) -> None:
    documents = [path for path in built.rglob("*.html") if path != built / "results" / "index.html"]
    assert len(documents) > 15
    for path in documents:
        html = path.read_text(encoding="utf-8")
        html = re.sub(r"<script.*?</script>|<style.*?</style>", "", html, flags=re.DOTALL)
        for link in re.findall(r'(?:href|src)="([^"#]+)', html):
            if not re.match("[a-z]+:", link):
                assert (path.parent / unquote(link)).exists(), f"{path.name}: {link}"


@pytest.mark.slow
def test_site_has_page_documents_and_api(built: Path) -> None:
    names = {path.relative_to(built).as_posix() for path in built.rglob("*") if path.is_file()}
    guides = ("agents", "benchmark/commands", "benchmark/experiments", "benchmark/studies", "envs/scenarios")
    pages = (
        "CONTRIBUTING benchmark/glossary benchmark/guide columns api/envs api/envs/model index results/index"
    )
    assert names >= {*(f"{name}/README.html" for name in guides), *(f"{name}.html" for name in pages.split())}
    assert names >= {"results/reproduce/claims.csv", "results/scenes.svg", "CITATION.cff"}
    assert "results/reproduce/other.html" not in names
    assert "by hand" not in (built / "results" / "reproduce" / "README.html").read_text(encoding="utf-8")
    assert not any(name.startswith("results/mine") for name in names)
    assert "load_scenario" in (built / "api" / "envs.html").read_text(encoding="utf-8")
    guide = (built / "envs" / "scenarios" / "README.html").read_text(encoding="utf-8")
    assert "api/envs/scenario.html" in guide
    assert 'href="CONTRIBUTING.html"' in (built / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_pages_of_the_site_fit_a_phone(built: Path, browser: Browser) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 844})
    for name in ("columns", "CONTRIBUTING"):
        page.goto((built / f"{name}.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") == 390, name
        of = "[...document.querySelectorAll('table')].some(table => table.scrollWidth > table.clientWidth)"
        assert page.evaluate(of), name  # a wide table scrolls in its box
    page.close()


# What readers run


def test_every_shipped_scenario_has_a_row_in_the_gallery() -> None:
    rows = re.findall(r"^\| (\w+) \| ([^|]+) \| ([^|]+) \|$", GUIDE, flags=re.MULTILINE)[1:]
    assert sorted(name for name, *_ in rows) == scenario_names()
    assert {sentence[-1] for _, *sentences in rows for sentence in sentences} == {"."}


def test_examples_of_the_guide_to_scenarios_are_right() -> None:
    group, others, onlookers = re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.DOTALL)
    (session,) = re.findall(r"```pycon\n(.*?)```", GUIDE, flags=re.DOTALL)
    test = doctest.DocTestParser().get_doctest(session, {}, "README", None, 0)
    said: list[str] = []
    result = doctest.DocTestRunner().run(test, out=said.append)
    assert result.attempted == 7
    assert not result.failed, "".join(said)
    three = load_scenario("Anywhere", {"grid.metres_per_cell": 0.3, **tomllib.loads(group)})
    assert (three.group, three.regions) == (
        load_scenario("ThreeTalking").group,
        load_scenario("ThreeTalking").regions,
    )
    assert len(load_scenario("Anywhere", tomllib.loads(onlookers)).layout.ways) == 512
    assert load_scenario("S1", tomllib.loads(others)).layout.others[4][0].position == (2, 6)
