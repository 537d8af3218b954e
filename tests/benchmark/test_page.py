"""The page, as text and in a real browser."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright

from agents.policy import contains
from benchmark.__main__ import main
from benchmark.experiment import load_experiment
from benchmark.folder import README, Folder
from benchmark.page import build
from benchmark.records import Records, load_records
from benchmark.store import Store
from benchmark.watch import walk
from envs import ACTIONS
from tests.support import small_experiment, variant

CHROMIUMS = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
CHROMIUM = next(filter(None, CHROMIUMS), None)
HOSTILE = (
    """</script><script>hit = 1</script><img src=x onerror="hit = 1"> ![a](https://h.invalid/a) """
    "[b](javascript:hit=1) <style>* { background: url(https://h.invalid/e) }</style> $js {{ 7 }}"
)
Open = Callable[..., Page]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results with a hostile text."""
    folder = tmp_path_factory.mktemp("made")
    text = small_experiment(
        scenarios=["S1", "S2"],
        evaluation_every=400,
        map_every=400,
        note=HOSTILE,
        report={"kind": "comparison", "question": "Is the page right?"},
        settings={"budget": 4000},
        algorithms={"table": variant(), "q": variant("watkins_q_lambda")},
    )
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    options = ["--report", "--jobs", "1", "--results", str(folder)]
    assert main(["run", str(folder / "mine.toml"), *options]) == 0
    return folder / "mine"


@pytest.fixture(scope="module")
def records(made: Path) -> Records:
    """The stored runs of the table in S1."""
    population = load_experiment(made.parent / "mine.toml").populations[0]
    with Store(made.parent / "runs.db") as store:
        return load_records(population.runs(), store)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed: apt install chromium")
    with sync_playwright() as playwright:
        flags = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser, made: Path) -> Iterator[Open]:
    """Opens the page; in the end it must have said nothing, and asked for nothing but itself."""
    messages, requested = list[str](), list[str]()

    def open_one(**options: Any) -> Page:
        page = stack.enter_context(browser.new_page(**options))
        page.set_default_timeout(60_000)  # ms; on a loaded machine
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.on("request", lambda request: requested.append(request.url))
        page.goto((made / "index.html").as_uri())
        page.wait_for_selector("#explore:not([hidden])")
        page.locator("details").evaluate_all("all => all.forEach((each) => { each.open = true })")
        return page

    with ExitStack() as stack:
        yield open_one
        assert messages == []
        assert [url for url in requested if not url.startswith("data:")] == requested[:1]


def test_a_page_of_several_folders_links_to_their_files(made: Path) -> None:
    (made / README).write_text("# A?\n\nYes.\n\n- [a.csv](a.csv), [h](https://h.invalid)\n\n## B\n")
    text = build.page(made.parent, [Folder(made)] * 2)
    assert text.count('<section id="report-mine">\n<h2>A?</h2>\n<p>Yes.</p>') == 2
    assert '<a href="#report-mine">A?</a>' in text
    assert '<a href="mine/a.csv">a.csv</a>, <a href="https://h.invalid">' in text
    assert "<h3>B</h3>" in text


def test_explorer_shows_and_walks_what_was_stored(open_page: Open, records: Records) -> None:
    page = open_page()
    panel = page.locator(".panel[data-side=right]")
    panel.locator("select[name=scenario]").select_option("S1")
    panel.locator("select[name=learner]").select_option("table")
    page.locator("#step").fill("99")  # the last
    arrays, cell = records.agents[0], records.model.start
    panel.locator(".map svg > g:not([pointer-events])").nth(cell).hover()
    lines = panel.locator(".readout tbody").inner_text().splitlines()
    found = [line.split("\t") for line in lines]
    assert [line[0] for line in found] == list(ACTIONS)
    values = [float(line[1].replace("−", "-")) for line in found]
    assert values == pytest.approx(arrays["values"][-1, cell], abs=0.0006)
    greedy = contains(arrays["greedy"][-1, cell][None])[0]
    assert ["greedy" in line[3] for line in found] == greedy.tolist()
    states, _ = walk(records.model, arrays["greedy"][-1], records.run.horizon)
    page.locator("#walk-again").click()
    step = "(button, n) => { while (n--) button.click(); }"
    page.locator("#walk-one").evaluate(step, len(states) - 1)
    points = panel.locator(".map polyline").first.get_attribute("points") or ""
    corners = [[float(n) / 30 - 0.5 for n in point.split(",")] for point in points.split()]
    assert np.rint(corners)[:, ::-1].tolist() == records.model.position[states].tolist()


def test_keys_choose_a_cell(open_page: Open) -> None:
    page = open_page()
    panel = page.locator(".panel[data-side=left]")
    panel.locator(".map").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowRight", "ArrowUp", "ArrowLeft", "Enter"):
        page.keyboard.press(key)
    assert panel.locator(".readout").inner_text().startswith("row 1, column 0: ")
    assert " from row 1, column 0, total reward " in panel.locator(".walked").inner_text()


def test_hostile_texts_run_nothing(open_page: Open) -> None:
    page = open_page()
    assert page.get_by_text("$js {{ 7 }}").count() == 1
    assert page.evaluate("typeof hit") == "undefined"
    links = "[...document.links].filter((link) => link.protocol === 'javascript:').length"
    assert page.evaluate(links) == 0


def test_page_lets_no_script_or_request_pass_but_its_own(browser: Browser, made: Path) -> None:
    page, failed = browser.new_page(), set[str | None]()
    page.goto((made / "index.html").as_uri())
    page.on("requestfailed", lambda request: failed.add(request.failure))
    page.evaluate("""() => document.body.insertAdjacentHTML("beforeend", `
        <img src="https://h.invalid/a"><img src="data:," onerror="hit = 1">
        <iframe src="https://h.invalid/c"></iframe>
        <link rel="stylesheet" href="https://h.invalid/d">
        <form action="https://h.invalid/e"></form>`)""")
    page.evaluate("[...document.forms].at(-1).submit()")
    page.evaluate("fetch('https://h.invalid/f').catch(() => null)")
    assert (failed, page.evaluate("typeof hit")) == ({"csp"}, "undefined")
    page.close()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1366, "light"), (390, "dark")])
def test_accessibility(open_page: Open, width: int, scheme: str) -> None:
    page = open_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") == width  # nothing sticks out
    violations = Axe().run(page).response["violations"]
    assert [(each["id"], each["nodes"][0]["html"]) for each in violations] == []
