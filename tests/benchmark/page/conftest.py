"""The published results with the page made anew, and pages opened in a browser."""

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, sync_playwright

from benchmark.commands.doctor import BROWSERS
from benchmark.page import build
from tests.benchmark.page.pages import RESULTS, Open, Opened

CHROMIUM = next(filter(None, map(shutil.which, BROWSERS)), None)
FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


@pytest.fixture(scope="package")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The published results, with the page that today's code makes of them."""
    directory = tmp_path_factory.mktemp("page") / "results"
    ignored = shutil.ignore_patterns("runs.db*", "*_smoke", "*_partial", ".*", "index.html")
    shutil.copytree(RESULTS, directory, ignore=ignored)
    assert build.write(directory) == directory / "index.html"
    return directory


@pytest.fixture(scope="package")
def text(results: Path) -> str:
    """The page of the published results."""
    return (results / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """A headless Chromium."""
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

        def open_one(folder: Path = results, fragment: str = "", **options: Any) -> Opened:
            opened = Opened(browser, folder, fragment, **options)
            stack.callback(opened.page.close)
            pages.append(opened)
            return opened

        pages: list[Opened] = []
        yield open_one
        for opened in pages:
            assert opened.messages == []
            assert [url for url in opened.requested if not url.startswith("data:")] == opened.requested[:1]
            assert opened.requested[0].startswith("file:")


@pytest.fixture
def opened(open_page: Open) -> Opened:
    """The published page in a browser."""
    return open_page()
