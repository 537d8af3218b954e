"""A page in a browser, and the files that it is compared with."""

import base64
import csv
import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
from playwright.sync_api import Browser, Locator, Page

RESULTS = Path(__file__).parents[3] / "results"


class Opened:
    """A page in a browser, with its messages and requests."""

    def __init__(self, browser: Browser, folder: Path, fragment: str, **options: Any) -> None:
        """Opens the page of a folder of results, and waits for the explorer if scripts run."""
        self.page: Page = browser.new_page(**({"viewport": {"width": 1280, "height": 900}} | options))
        self.messages: list[str] = []
        self.requested: list[str] = []
        self.page.on("console", lambda message: self.messages.append(message.text))
        self.page.on("pageerror", lambda error: self.messages.append(str(error)))
        self.page.on("request", lambda request: self.requested.append(request.url))
        self.page.goto((folder / "index.html").as_uri() + fragment)
        if options.get("java_script_enabled", True) and self.page.locator("#explore").count():
            self.page.wait_for_selector("#explore:not([hidden])")

    def panel(self, side: str) -> Locator:
        """Returns the explorer's left or right panel."""
        return self.page.locator(f".panel[data-side={side}]")

    def choose(self, side: str, scenario: str, algorithm: str, observation: str) -> None:
        """Chooses the agent of a panel; of several experiments, the first that has it."""
        for name, value in (("scenario", scenario), ("algorithm", algorithm), ("observation", observation)):
            self.panel(side).locator(f"select[name={name}]").select_option(value)

    def to_map(self, place: int) -> None:
        """Moves the slider to a place."""
        self.page.locator("#step").fill(str(place))

    def to_step(self, step: int, folder: Path) -> None:
        """Moves the slider to a step; both panels show agents of this folder with the same budget."""
        steps = pd.read_csv(folder / "agent.csv").query("scenario == 'S1'")["step"].unique().tolist()
        self.to_map(steps.index(step))

    def cell(self, side: str, row: int, column: int, n_columns: int = 12) -> Locator:
        """Returns a cell of a map."""
        cells = self.panel(side).locator(".map svg > g").first.locator("> g")
        return cells.nth(row * n_columns + column)

    def walk(self, n_steps: int) -> None:
        """Lets both agents take steps."""
        self.page.locator("#walk-one").evaluate("(button, n) => { while (n--) button.click(); }", n_steps)


Open = Callable[..., Opened]


def rows_of(path: Path) -> list[list[str]]:
    """Returns the lines of a CSV file as they are written."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def number(text: str) -> float:
    """Returns a number of the page."""
    return float(text.replace("−", "-"))


def unpacked(text: str) -> Any:
    """Returns the data in a page's text."""
    packed = text.partition('id="data">')[2].partition("<")[0]
    return json.loads(gzip.decompress(base64.b64decode(packed)))
