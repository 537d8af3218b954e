"""The map on the page: its currencies and sliders, and the verdicts that they end in."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe

from benchmark.__main__ import main
from benchmark.folder import Folder
from benchmark.publish.page import build
from tests.benchmark.publish.page.conftest import Open, Opened
from tests.benchmark.studies.test_map import EXPERIMENT
from tests.support import reseal


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a small map."""
    folder = tmp_path_factory.mktemp("map_page")
    (folder / "small.toml").write_text(EXPERIMENT, encoding="utf-8")
    arguments = ["run", str(folder / "small.toml"), "--report", "--jobs", "1", "--results", str(folder)]
    assert main(arguments) == 0
    return folder / "small"


def move(opened: Opened, name: str, index: int) -> str:
    """Moves a slider; returns what it says."""
    opened.page.locator(f"#map-{name}").fill(str(index))
    return opened.page.locator(f"#map-{name} + output").inner_text()


def table_of(opened: Opened) -> set[tuple[str, ...]]:
    """Returns the rows of the table of learners."""
    rows = opened.page.locator("#map-table tbody tr").all()
    return {tuple(row.locator("td").all_inner_texts()) for row in rows}


def test_sliders_end_in_verdicts_and_a_table_whose_numbers_are_in_the_files(
    open_page: Open, folder: Path
) -> None:
    opened = open_page(folder)
    verdicts = opened.page.locator("#map-verdicts")
    cells = pd.read_csv(folder / "cells.csv")
    for i, n in ((0, 1), (2, 4), (4, 16)):  # 2 and 8 are in other grids
        assert move(opened, "places", i) == str(n)
        assert f"With {n} place" in verdicts.inner_text()
        expected = set()
        own = (cells["grid"] == "places") & (cells["places"] == n) & (cells["variant"] != "check")
        for _, row in cells[own].iterrows():
            learner = f"{row['variant']}, {row['observation']}"
            title = Folder(folder).title(learner)
            expected.add((title, f"{row['n_solved']} of {row['n']}", f"{row['steps']:,.0f}"))
        assert table_of(opened) == expected
    verdict = "shared table of offsets: fewer steps than table (12 pairs of runs)"
    assert verdicts.locator("li").all_inner_texts() == [verdict]
    # Where nothing was trained with as many places, the nearest number is shown, and said to be another one.
    said = opened.page.locator("#map-places + output")
    for where, text, verdict in (
        ("5 × 6 cells, 100 % of coordinates permuted", "4, the only number here", "With 4 places"),
        ("6 × 7 cells", "1, the only number here", "With 1 place in"),
        ("5 × 6 cells", "1", "With 1 place in a room of 5 × 6 cells:"),
    ):
        opened.page.locator("#map-where").select_option(label=where)
        assert said.inner_text() == text
        assert verdict in verdicts.inner_text()


def test_currencies_change_the_lines(open_page: Open, folder: Path) -> None:
    opened = open_page(folder)
    seen = set()
    for currency, unit in (("steps", "steps"), ("disagreements", "wrong PINGs"), ("cpu_time_s", "seconds")):
        opened.page.locator(f"#map input[value={currency}]").check()
        figure = opened.page.locator("#map svg")
        assert f"Median {unit}" in str(figure.get_attribute("aria-label"))
        seen.add(figure.inner_html())
        assert f"median {unit}" in opened.page.locator("#map-table").inner_text()
        assert all(re.fullmatch(r"[\d.,]+|never learns", took) for *_, took in table_of(opened))
    assert len(seen) == 3
    found = Axe().run(opened.page, context="#map")
    assert found.response["violations"] == []


def test_without_scripts_the_picture_and_the_headline_stay(open_page: Open, folder: Path) -> None:
    opened = open_page(folder, java_script_enabled=False)
    assert not opened.page.locator("#map").is_visible()
    assert opened.page.locator("#finding img").is_visible()
    assert "compared with the table: faster at" in opened.page.locator("#finding").inner_text()


def test_it_leads_the_page_of_all_results(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "when", ignore=shutil.ignore_patterns("index.html", ".*"))
    reseal(tmp_path / "when", experiment="when")
    page = build.write(tmp_path).read_text(encoding="utf-8")
    assert 'data-folder="when/"' in page
    assert page.index('id="report-when"') < page.index('id="map"')


def test_an_experiment_may_be_called_as_a_part_of_the_page(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "map", ignore=shutil.ignore_patterns("index.html", ".*"))
    page = re.sub("src='data:[^']*'", "", build.write(tmp_path, "map").read_text(encoding="utf-8"))
    ids = re.findall(r'<[^>]* id="([^"]*)"', page)
    assert len(ids) == len({*ids})
    assert {"map", "report-map"} <= {*ids}
