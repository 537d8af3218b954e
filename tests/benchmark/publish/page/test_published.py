"""The page of the published results: its list, contents, numbers and map."""

import re
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from benchmark.experiments import PUBLISHED
from benchmark.folder import Folder
from benchmark.publish.document import SPEED, document_of
from benchmark.publish.page import build
from tests.benchmark.publish.page.conftest import Open, Opened
from tests.benchmark.publish.page.test_browser import violations
from tests.benchmark.publish.page.test_build import Page, check_links, check_numbers
from tests.support import ROOT, reseal


def test_published_list_is_what_the_code_makes(published: Path) -> None:
    made, there = ((path / "README.md").read_text(encoding="utf-8") for path in (published, ROOT / "results"))
    assert made == there, "README.md is out of date: run make report"
    page = (published / "index.html").read_text(encoding="utf-8")
    assert len(page.encode()) <= 4_500_000
    assert "&lt;table" not in page
    assert page.count('id="map"') == 1  # none for several scenes with the same numbers of places


def test_every_published_experiment_has_its_own_question(published: Path) -> None:
    asked = [document_of(published / name).question for name in (*PUBLISHED, SPEED)]
    assert len({*asked}) == len(asked)


def test_contents_lead_to_all_reports_in_the_order_of_readme(published: Path) -> None:
    page = Page(published / "index.html")
    names = [f"report-{name}" for name in (*PUBLISHED, SPEED)]
    assert names[:3] == ["report-reproduce", "report-compare_deep", "report-when"]
    assert [value for name, value in page.attributes if name == "id" and value in names] == names
    listed = page.source.partition('class="contents"')[2].partition("</ul>")[0]
    assert re.findall(r'href="#(.*?)"', listed) == [*names[:2], "explorer", *names[2:]]


def test_an_experiment_may_be_called_as_a_part_of_the_page(published: Path, tmp_path: Path) -> None:
    shutil.copytree(published / "when", tmp_path / "map")
    reseal(tmp_path / "map", experiment="map")
    page = Page(build.write(tmp_path, "map"))
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len({*ids})
    assert {"map", "report-map"} <= {*ids}


def test_links_and_numbers(published: Path) -> None:
    check_links(published)
    check_numbers(published)


@pytest.mark.slow
def test_without_javascript_there_is_no_map(open_page: Open, published: Path) -> None:
    opened = open_page(published, java_script_enabled=False)
    assert not opened.page.locator("#map").is_visible()
    assert opened.page.locator("#report-compare_deep > figure img").is_visible()  # curves


def box_of(opened: Opened, selector: str) -> dict[str, float]:
    """Returns where the first such element is in the window."""
    box = opened.page.locator(selector).first.bounding_box()
    assert box is not None
    return {"x": box["x"], "y": box["y"], "width": box["width"], "height": box["height"]}


@pytest.mark.slow
def test_published_page_answers_at_once_and_is_short(open_page: Open, published: Path) -> None:
    opened = open_page(published, viewport={"width": 1366, "height": 768})
    opened.wait_until("performance.getEntriesByName('first-contentful-paint').length")
    boxes = [box_of(opened, part) for part in ("nav", "h1", ".contents li:nth-child(3)")]
    assert boxes[0]["y"] < boxes[1]["y"] < boxes[2]["y"]
    assert all(0 <= box["x"] <= box["x"] + box["width"] <= 1366 for box in boxes)
    assert all(box["y"] + box["height"] <= 768 for box in boxes)
    assert opened.page.evaluate("document.documentElement.scrollHeight") < 15_000
    # No two headings are the same, for who moves from one to the next.
    headings = (
        opened.page.locator("#finding, #results, #more").locator("h1, h2, h3, h4, h5").all_text_contents()
    )
    assert [name for name, n in Counter(map(str.strip, headings)).items() if n > 1] == []
    # The explorer opens with a table and a net that succeed, films of their training, and all views.
    for side, family in (("left", "table"), ("right", "DQN|PPO")):
        assert opened.panel(side, ".walked").inner_text().endswith("success.")
        assert re.search(family, opened.panel(side, "select[name=learner]").input_value())
    assert opened.page.locator("#learn").is_enabled()
    assert opened.page.locator("#shown option:enabled").count() == 4
    for width, least in ((1366, 560), (1920, 800)):
        opened.page.set_viewport_size({"width": width, "height": 1080})
        assert box_of(opened, "[data-side=right] .map svg")["width"] >= least
    opened.choose("left", "LargeRoom", "Q(λ) table")
    assert box_of(opened, "[data-side=left] .map path.mark[d^=M]")["width"] >= 8
    # It is printed on at most eight pages.
    assert len(re.findall(rb"/Type\s*/Page\b", opened.page.pdf(format="A4"))) <= 8


@pytest.mark.slow
def test_map_ends_in_verdicts_and_a_table_whose_numbers_are_in_the_files(
    open_page: Open, published: Path
) -> None:
    opened, folder = open_page(published), Folder(published / "when")
    opened.unfold("#report-when > details")
    words = {"faster": "fewer steps than", "slower": "more steps than"}
    cells, contrasts = folder.frame("cells"), folder.frame("contrasts")
    slider, verdicts = opened.page.locator("#map-places"), opened.page.locator("#map-verdicts")
    places = sorted({*cells["places"][cells["grid"] == "places"]})
    for n in (places[0], 64):
        slider.fill(str(places.index(n)))
        assert opened.page.locator("#map-places + output").inner_text() == str(n)
        assert f"With {n} place" in verdicts.inner_text()
        rows = opened.page.locator("#map-table tbody tr").all()
        shown = {tuple(row.locator("td").all_inner_texts()) for row in rows}
        own = cells[cells["grid"].isin(["places", "forms"]) & (cells["places"] == n)]  # the same scenes
        titles = own["variant"].str.cat(own["observation"], ", ").map(folder.title)
        solved = own["n_solved"].astype(str).str.cat(own["n"].astype(str), " of ")
        steps = own["steps"].map(lambda value: "never learns" if np.isinf(value) else f"{value:,.0f}")
        assert len(rows) == len(shown) > 5
        assert shown <= {*zip(titles, solved, steps, strict=True)}
        said = verdicts.locator("li").all_inner_texts()
        for _, row in contrasts[(contrasts["grid"] == "places") & (contrasts["places"] == n)].iterrows():
            x, y = folder.title(row["x"]), folder.title(row["y"])
            if row["verdict"] in words and {x, y} <= {title for title, *_ in shown}:
                assert f"{x}: {words[row['verdict']]} {y} ({row['n']} pairs of runs)" in said
    # Where nothing was trained with as many places, the nearest number is shown, and said to be another one.
    where = opened.page.locator("#map-where")
    for label in where.locator("option").all_inner_texts()[1:4]:
        where.select_option(label=label)
        n = int(re.findall(r"\d+", opened.page.locator("#map-places + output").inner_text())[0])
        assert f"With {n} place" in verdicts.inner_text()
        assert label in verdicts.inner_text()
    seen = set()
    for currency, unit in (("steps", "steps"), ("disagreements", "wrong PINGs"), ("cpu_time_s", "seconds")):
        opened.page.locator(f"#map input[value={currency}]").check()
        figure = opened.page.locator("#map .chart svg")
        assert f"Median {unit}" in str(figure.get_attribute("aria-label"))
        seen.add(figure.inner_html())
        assert f"median {unit}" in opened.page.locator("#map-table").inner_text()
    assert len(seen) == 3
    assert violations(opened, "#map") == []
