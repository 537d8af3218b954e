"""A page made of a small experiment, opened in a browser."""

import json
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, sync_playwright

from benchmark.__main__ import main
from benchmark.analysis.records import Records
from benchmark.execution.store import Store
from benchmark.experiments import load_experiment
from benchmark.publish import document
from benchmark.publish.page import build
from benchmark.studies import STUDIES, report_of
from envs.scenario import SCENARIO_DIRECTORY
from tests.benchmark.publish.page.made import TEXT
from tests.support import reseal

STUDIES["made"] = "tests.benchmark.publish.page.made:STUDY"  # as if it were this project's
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
EXPERIMENT = f"""
description = {json.dumps(TEXT)}
note = {json.dumps(TEXT)}
report = "made"
scenarios = ["ROOM", "S2"]
horizon = 100
evaluation_every = 400
map_every = 400
[algorithms."a-table_b"]
algorithm = "q_learning"
observations = ["index"]
seeds = 2
settings = {{ budget = 8000, discount = 1.0, time_limit = 50 }}
[algorithms.dqn]
algorithm = "compiled_dqn"
observations = ["coordinates"]
seeds = 2
settings = {{ budget = 300, learning_starts = 50, learning_rate = 1e38 }}
[algorithms.ppo]
algorithm = "compiled_ppo"
observations = ["one_hot"]
seeds = 2
settings = {{ budget = 2048 }}
"""
TABLE, NET, POLICY = "a-table_b", "dqn on coordinates", "ppo on one-hot cells"
Learners = dict[tuple[str, str], Records]


class Opened:
    """A page in a browser, with its messages and requests."""

    def __init__(self, browser: Browser, folder: Path, **options: Any) -> None:
        self.page: Page = browser.new_page(**({"viewport": {"width": 1280, "height": 900}} | options))
        self.page.set_default_timeout(60_000)  # ms; on a loaded machine
        self.messages: list[str] = []
        self.requested: list[str] = []
        self.page.on("console", lambda message: self.messages.append(message.text))
        self.page.on("pageerror", lambda error: self.messages.append(str(error)))
        self.page.on("request", lambda request: self.requested.append(request.url))
        self.page.goto((folder / "index.html").as_uri())
        if options.get("java_script_enabled", True) and self.page.locator("#explore").count():
            self.page.wait_for_selector("#explore:not([hidden])")

    def panel(self, side: str, part: str = "") -> Locator:
        return self.page.locator(f".panel[data-side={side}] {part}")

    def choose(self, scenario: str, learner: str = "") -> None:
        """Chooses an agent on both sides."""
        for side in ("left", "right"):
            self.panel(side, "select[name=scenario]").select_option(scenario)
            if learner:
                self.panel(side, "select[name=learner]").select_option(learner)

    def cells(self, side: str) -> Locator:
        return self.panel(side, ".map svg > g:not([pointer-events])")

    def unfold(self) -> None:
        self.page.locator("details").evaluate_all("all => all.forEach((each) => { each.open = true })")


Open = Callable[..., Opened]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of an experiment with scenes that differ, hostile texts, and a net that diverges."""
    folder = tmp_path_factory.mktemp("made")
    scene = (SCENARIO_DIRECTORY / "S1.toml").read_text(encoding="utf-8")
    changes = {"rows": 5, "columns": 7, "position": [3, 5], "target_ping": 100.0}
    for key, value in {**changes, "description": json.dumps(TEXT)}.items():
        scene, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}".replace("\\", r"\\"), scene)
        assert count == 1
    (folder / "room.toml").write_text(scene, encoding="utf-8")
    text = EXPERIMENT.replace('"ROOM"', json.dumps(str(folder / "room.toml")))
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(folder / "mine.toml"), "--report", "--jobs", "1", "--results", str(folder)]) == 0
    return folder / "mine"


@pytest.fixture(scope="session")
def learners(made: Path) -> Learners:
    """The stored runs of the experiment, by scenario and variant."""
    with Store(made.parent / "runs.db", read_only=True) as store:
        data = report_of(load_experiment(made.parent / "mine.toml")).data(store)
        records = [data.records(population) for population in data.experiment.populations]
    return {(each.scenario, each.run.variant): each for each in records}


@pytest.fixture(scope="session")
def results(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """These results as if they were two published experiments, with their page."""
    results = tmp_path_factory.mktemp("page") / "results"
    for name in ("compare_deep", "reproduce"):
        shutil.copytree(made, results / name, ignore=shutil.ignore_patterns("index.html", ".*"))
        reseal(results / name, experiment=name)
        document.write(results / name)
    assert build.write(results) == results / "index.html"
    return results


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed, so the page is not tested in a browser: apt install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser, results: Path) -> Iterator[Open]:
    """Opens pages; in the end they must have said nothing, and asked for nothing but themselves."""
    with ExitStack() as stack:

        def open_one(folder: Path = results, **options: Any) -> Opened:
            opened = Opened(browser, folder, **options)
            stack.callback(opened.page.close)
            pages.append(opened)
            return opened

        pages: list[Opened] = []
        yield open_one
        for opened in pages:
            assert opened.messages == []
            assert [url for url in opened.requested if not url.startswith("data:")] == opened.requested[:1]


@pytest.fixture
def opened(open_page: Open) -> Opened:
    return open_page()
