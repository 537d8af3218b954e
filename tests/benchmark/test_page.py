"""The page: made of published files alone, every number in the row it links to, used in a real browser."""

import base64
import csv
import gzip
import json
import re
import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from benchmark.__main__ import main
from benchmark.drawing.tables import show
from benchmark.page import build as page
from envs import ACTIONS, InputError

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The published results, with the page that today's code makes of them."""
    directory = tmp_path_factory.mktemp("page") / "results"
    ignored = shutil.ignore_patterns("runs.db*", "*_smoke", "*_partial", ".*", "index.html")
    shutil.copytree(RESULTS, directory, ignore=ignored)
    assert page.write(directory) == directory / "index.html"
    return directory


@pytest.fixture(scope="module")
def text(results: Path) -> str:
    return (results / "index.html").read_text(encoding="utf-8")


def rows_of(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


class Links(HTMLParser):
    """Collects the links of a page, with their texts."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, str, str]] = []  # class, target, text
        self._open: tuple[str, str] | None = None
        self._text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "a":
            values = dict(attrs)
            self._open = values.get("class") or "", values.get("href") or ""
            self._text = ""

    def handle_data(self, data: str) -> None:
        self._text += data

    def handle_endtag(self, tag: str) -> None:
        if tag == "a" and self._open is not None:
            self.found.append((*self._open, self._text))
            self._open = None


def links(text: str) -> list[tuple[str, str, str]]:
    parser = Links()
    parser.feed(text)
    return parser.found


# The file


def without_pictures(text: str) -> str:
    """Returns the page without what libraries of other builds compress otherwise."""
    text = re.sub(r'base64,[^"]+"', 'base64,"', text)
    return re.sub(r'(id="data">)[^<]+<', r"\1<", text)


def unpacked(text: str) -> Any:
    """Returns the data in a page's text."""
    packed = text.partition('id="data">')[2].partition("<")[0]
    data = json.loads(gzip.decompress(base64.b64decode(packed)))
    return data["explorer"] | {"csv": data["csv"]}


def test_published_page_is_what_the_code_makes(results: Path, text: str) -> None:
    published = (RESULTS / "index.html").read_text(encoding="utf-8")
    assert without_pictures(published) == without_pictures(text), "index.html is out of date: run make report"
    assert unpacked(published) == unpacked(text)
    index = (results / "README.md").read_text(encoding="utf-8")
    assert (RESULTS / "README.md").read_text(encoding="utf-8") == index


def test_same_files_make_the_same_page(results: Path, text: str) -> None:
    page.write(results)
    assert (results / "index.html").read_text(encoding="utf-8") == text


def test_page_is_small_and_whole(text: str) -> None:
    assert len(text.encode()) <= 4_000_000
    assert "does not earn its keep" in text
    assert not re.findall(r'(?:src|action|data)="(?!data:)[^"]', text)
    assert not re.findall(r"@import|url\(|<link(?! rel=\"icon\")", text)


def test_every_link_leads_somewhere(results: Path, text: str) -> None:
    found = links(text)
    assert len(found) > 500
    for _, target, _ in found:
        file, _, fragment = target.partition("#")
        if not file:
            assert f'id="{fragment}"' in text, target
        elif not file.startswith("https://arxiv.org/"):
            assert (results / file).exists(), target


def numbers_in(row: list[str], like: str) -> set[str]:
    """Returns what the numbers of a CSV row look like when they are shown as a number of the page is."""
    cells = [float(cell) for cell in row if re.fullmatch(r"-?[\d.]+(e[+-]\d+)?|-?inf", cell)]
    decimals = len(like.partition(".")[2])
    return {show(cell) for cell in cells} | {f"{cell:.{decimals}f}" for cell in cells}


def test_every_number_is_in_the_row_that_it_links_to(results: Path, text: str) -> None:
    checked = 0
    for kind, target, shown in links(text):
        file, _, place = target.partition("#row=")
        if kind != "n" or not place.isdecimal():
            continue  # of several rows
        row = rows_of(results / file)[int(place) - 1]
        if file.endswith("sensitivity.csv"):
            assert shown in row
        elif match := re.fullmatch(r"([−\d.,]+|inf) \[([−\d.,]+), ([−\d.,]+)\]", shown):
            assert {one.replace("−", "-") for one in match.groups()} <= numbers_in(row, "")
        elif re.fullmatch(r"[-−\d.,]+", shown):
            number = shown.replace("−", "-").replace(",", "")
            assert {number, f"{float(number):,.0f}"} & numbers_in(row, number), (shown, target)
        else:
            continue  # in other units
        checked += 1
    assert checked > 500


def test_data_of_the_explorer_are_the_files(results: Path, text: str) -> None:
    data = unpacked(text)
    assert len(data["blocks"]) == 33
    for name in ("compare_deep/curves.csv", "reproduce/claims.csv", "compare_deep/improvement.csv"):
        assert data["csv"][name] == (results / name).read_text(encoding="utf-8")


def test_page_of_the_replication_alone(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    text = page.write(tmp_path).read_text(encoding="utf-8")
    assert "The paper's claims" in text
    assert 'id="comparison"' not in text
    data = unpacked(text)
    assert {block["algorithm"] for block in data["blocks"]} == {"q_learning"}
    assert data["curves_file"] == "learning.csv"


def test_nothing_to_tell(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="there are no results of reproduce or compare_deep to report; make reproduce and"
    ):
        page.write(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("file", "content", "expected"),
    [
        ("manifest.json", "{}", "damaged, or made by another version of this project"),
        ("claims.csv", "claim,value\nx,1\n", "damaged, or made by another version of this project"),
        ("agent_S2.csv", None, "damaged, or made by another version of this project"),
    ],
)
def test_damaged_results_get_a_sentence(
    results: Path, tmp_path: Path, file: str, content: str | None, expected: str
) -> None:
    shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    if content is None:
        (tmp_path / "reproduce" / file).unlink()
    else:
        (tmp_path / "reproduce" / file).write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=expected):
        page.write(tmp_path)
    assert not (tmp_path / "index.html").exists()


# In a browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed: the page is not tried in a browser (apt install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


class Opened:
    """The page in a browser, and what it said and asked for."""

    def __init__(self, browser: Browser, results: Path, fragment: str = "", **options: Any) -> None:
        self.page: Page = browser.new_page(**({"viewport": {"width": 1280, "height": 900}} | options))
        self.said: list[str] = []
        self.requested: list[str] = []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.requested.append(request.url))
        self.page.goto((results / "index.html").as_uri() + fragment)
        if options.get("java_script_enabled", True):
            self.page.wait_for_selector("#explore:not([hidden])")

    def panel(self, side: str) -> Any:
        return self.page.locator(f".panel[data-side={side}]")

    def choose(self, side: str, scenario: str, algorithm: str, observation: str) -> None:
        for name, value in (("scenario", scenario), ("algorithm", algorithm), ("observation", observation)):
            self.panel(side).locator(f"select[name={name}]").select_option(value)

    def to_step(self, place: int) -> None:
        self.page.locator("#step").fill(str(place))


@pytest.fixture
def opened(browser: Browser, results: Path) -> Iterator[Opened]:
    one = Opened(browser, results)
    yield one
    assert one.said == []
    assert [url for url in one.requested if not url.startswith("data:")] == one.requested[:1]
    assert one.requested[0].startswith("file:")
    one.page.close()


def number(text: str) -> float:
    return float(text.replace("−", "-"))


@pytest.mark.parametrize(
    ("scenario", "algorithm", "observation", "place", "cell"),
    [("S1", "q_learning", "index", 12, (4, 6)), ("S3", "dqn", "coordinates", 25, (3, 2)),
     ("S2", "ppo", "one_hot", 5, (9, 11))],
)  # fmt: skip
def test_explorer_shows_the_numbers_of_the_files(
    opened: Opened, results: Path, scenario: str, algorithm: str, observation: str, place: int,
    cell: tuple[int, int],
) -> None:  # fmt: skip
    opened.choose("right", scenario, algorithm, observation)
    opened.to_step(place)
    opened.panel("right").locator(".map svg > g").first.locator("> g").nth(cell[0] * 12 + cell[1]).hover()
    readout = opened.panel("right").locator(".readout")
    assert f"Row {cell[0]}, column {cell[1]}" in readout.inner_text()

    folder = results / "compare_deep"
    where = f"algorithm == '{algorithm}' and observation == '{observation}'"
    maps = pd.read_csv(folder / f"agent_{scenario}.csv").query(where)
    row = maps.query(f"step == {place * 400} and row == {cell[0]} and column == {cell[1]}").iloc[0]
    lines = [line.split("\t") for line in readout.locator("tbody").inner_text().splitlines()]
    assert [line[0] for line in lines] == list(ACTIONS)
    assert [number(line[1]) for line in lines] == pytest.approx([row[action] for action in ACTIONS])
    greedy = [line[0] for line in lines if "greedy" in line[4]]
    assert "|".join(greedy) == row["greedy"]
    # The link leads to that row, which the dialog shows as it is in the file.
    target = readout.locator("a.n").first.get_attribute("href")
    place_in_file = int(target.partition("#row=")[2])
    written = rows_of(folder / f"agent_{scenario}.csv")[place_in_file - 1]
    assert written[2:5] == [str(place * 400), str(cell[0]), str(cell[1])]
    for link, file in ((0, f"agent_{scenario}.csv"), (1, "optimum.csv")):
        target = str(readout.locator("a.n").nth(link).get_attribute("href"))
        readout.locator("a.n").nth(link).click()
        dialog = opened.page.locator("dialog[open]")
        assert file in dialog.locator("h2").inner_text()
        lines_of_file = rows_of(folder / file)
        shown = dict(zip(lines_of_file[0], lines_of_file[int(target.partition("#row=")[2]) - 1], strict=True))
        told = [line.split("\t") for line in dialog.locator("tbody").inner_text().splitlines()]
        assert dict(told) == shown
        opened.page.keyboard.press("Escape")
        assert opened.page.locator("dialog[open]").count() == 0

    score = pd.read_csv(folder / "agent.csv").query(f"{where} and scenario == '{scenario}'").iloc[place]
    told = opened.panel("right").locator(".told a.n").first.inner_text()
    assert number(told) == pytest.approx(score["score"], abs=0.0005)


@pytest.mark.parametrize("scenario", ["S1", "S2", "S3"])
@pytest.mark.parametrize("algorithm", ["q_learning_tuned", "dqn"])
def test_walk_takes_as_many_steps_as_exact_evaluation_says(
    opened: Opened, results: Path, scenario: str, algorithm: str
) -> None:
    agents = pd.read_csv(results / "compare_deep" / "agent.csv")
    row = (
        agents.query(f"scenario == '{scenario}' and algorithm == '{algorithm}'").groupby("observation").last()
    )
    observation = row.index[-1]
    opened.choose("left", scenario, algorithm, observation)
    opened.to_step(25)
    for _ in range(round(row["steps"].iloc[-1])):
        opened.page.locator("#walk-one").click()
    told = opened.panel("left").locator(".walked").inner_text()
    assert f"{round(row['steps'].iloc[-1])} steps from row 0, column 0" in told
    assert ("success" in told) == (row["success"].iloc[-1] == 1)


def test_slider_shows_learning_and_the_address_keeps_it(
    opened: Opened, browser: Browser, results: Path
) -> None:
    def fills(one: Opened) -> list[str]:
        shapes = one.panel("left").locator(".map svg > g").first.locator("polygon")
        return list(shapes.evaluate_all("shapes => shapes.map((one) => one.getAttribute('fill'))"))

    opened.to_step(0)
    assert len(set(fills(opened))) == 1  # a table knows nothing at first
    opened.to_step(10)
    assert len(set(fills(opened))) > 8
    assert opened.page.locator("#step-told").inner_text() == "4,000 of 10,000"
    opened.page.locator("#shown").select_option("difference")
    opened.page.wait_for_function("location.hash.endsWith('difference')")
    fragment = opened.page.evaluate("location.hash")
    again = Opened(browser, results, fragment)
    assert fills(again) == fills(opened)
    assert again.page.locator("#shown").input_value() == "difference"
    again.page.close()


@pytest.mark.parametrize("fragment", ["%", "nowhere.%E0.x~~nothing~7~~", "S2.dqn~.~-3~"])
def test_mistyped_address_is_taken_as_far_as_it_goes(browser: Browser, results: Path, fragment: str) -> None:
    one = Opened(browser, results, f"#explorer={fragment}")
    assert one.said == []
    assert "Row 0, column 0" in one.panel("left").locator(".readout").inner_text()
    one.page.close()


def test_another_address_is_followed_on_the_open_page(opened: Opened) -> None:
    opened.page.evaluate("location.hash = '#explorer=S3.ppo.coordinates~S2.dqn.one_hot~2000~ping'")
    opened.page.wait_for_function("document.getElementById('step').value === '5'")
    assert opened.panel("left").locator("select[name=scenario]").input_value() == "S3"
    assert opened.panel("right").locator("select[name=algorithm]").input_value() == "dqn"
    assert opened.page.locator("#shown").input_value() == "ping"


def test_explorer_by_keyboard_alone(opened: Opened) -> None:
    opened.panel("left").locator(".map").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowLeft"):
        opened.page.keyboard.press(key)
    assert "Row 1, column 0" in opened.panel("left").locator(".readout").inner_text()
    opened.page.keyboard.press("Enter")
    assert "stands at row 1, column 0" in opened.panel("left").locator(".walked").inner_text()
    opened.page.locator("#step").focus()
    opened.page.keyboard.press("Home")
    assert opened.page.locator("#step-told").inner_text().startswith("0 of")
    opened.page.locator("#learn").focus()
    opened.page.keyboard.press("Enter")
    opened.page.wait_for_function("document.getElementById('step').value >= 2")
    opened.page.keyboard.press("Enter")
    assert opened.page.locator("#learn").get_attribute("aria-pressed") == "false"


def test_tables_sort(opened: Opened) -> None:
    table = opened.page.locator("table", has_text="Score over all scenarios")

    def means() -> list[float]:
        return [number(one.split(" ")[0]) for one in table.locator("tbody td:nth-child(5)").all_inner_texts()]

    written = means()
    table.get_by_role("button", name="mean", exact=True).click()
    assert means() == sorted(written)
    table.get_by_role("button", name="mean", exact=True).click()
    assert means() == sorted(written, reverse=True)
    table.get_by_role("button", name="mean", exact=True).click()
    assert means() == written


def test_number_of_several_rows_shows_them_all(opened: Opened, results: Path) -> None:
    link = opened.page.locator("a.n[href*='curves.csv#row=']").first
    first, last = map(int, str(link.get_attribute("href")).partition("#row=")[2].split("-"))
    link.click()
    shown = opened.page.locator("dialog tbody tr")
    assert shown.count() == last - first + 1
    expected = rows_of(results / "compare_deep" / "curves.csv")[first - 1]
    assert shown.first.locator("td").all_inner_texts() == expected


def test_without_javascript_all_but_the_explorer_is_there(browser: Browser, results: Path) -> None:
    one = Opened(browser, results, java_script_enabled=False)
    text = one.page.locator("body").inner_text()
    assert "does not earn its keep" in text
    assert "The explorer needs JavaScript" in text
    assert one.page.locator("table:visible").count() >= 4
    assert one.page.locator("img:visible").count() >= 6
    assert one.page.locator("#explore:visible").count() == 0
    one.page.close()


def test_number_is_marked_in_the_dialog(opened: Opened) -> None:
    opened.page.locator(".lead a.n", has_text="0.99").first.click()
    assert "0.99" in opened.page.locator("dialog p").first.inner_text()
    marked = opened.page.locator("dialog th.cited").all_inner_texts()
    assert "value" in marked
    opened.page.keyboard.press("Escape")
    opened.page.locator("li a.n[href*='curves.csv#row=']", has_text="124").first.click()
    told = opened.page.locator("dialog").inner_text()
    assert "Shown as 124, the mean of disagreements over these lines." in told


def test_walk_that_goes_in_circles_says_so(opened: Opened, results: Path) -> None:
    agents = pd.read_csv(results / "compare_deep" / "agent.csv")
    stuck = agents.query("algorithm == 'dqn_default' and step == 10000 and success == 0").iloc[0]
    opened.choose("left", stuck["scenario"], "dqn_default", stuck["observation"])
    for _ in range(60):
        opened.page.locator("#walk-one").click()
    told = opened.panel("left").locator(".walked").inner_text()
    assert "and would until the limit of 200 steps" in told


OWN = """
description = "Two <b>scenes</b> | of different size."
report = "comparison"
scenarios = ["room.toml", "S2"]
horizon = 100
evaluation_every = 100
map_every = 200
settings = { time_limit = 50 }
[algorithms."a [table].b"]
algorithm = "q_learning"
observations = ["index"]
seeds = 2
settings = { budget = 1000, discount = 1.0 }
[algorithms.dqn]
algorithm = "dqn"
observations = ["coordinates"]
seeds = 2
settings = { budget = 300, learning_starts = 50, learning_rate = 1e38 }
"""


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of an experiment of one's own: other scenes, budgets and rewards, and a net that diverges."""
    folder = tmp_path_factory.mktemp("own")
    scene = (ROOT / "envs" / "scenarios" / "S1.toml").read_text(encoding="utf-8")
    for key, value in (("rows", 5), ("columns", 7), ("position", [3, 5]), ("target_ping", 100.0)):
        scene, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", scene)
        assert count == 1
    (folder / "room.toml").write_text(scene, encoding="utf-8")
    text = OWN.replace('"room.toml"', json.dumps(str(folder / "room.toml")))
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(folder / "mine.toml"), "--report", "--results", str(folder)]) == 0
    return folder / "mine"


def test_page_of_an_experiment_of_ones_own(own: Path, browser: Browser) -> None:
    text = (own / "index.html").read_text(encoding="utf-8")
    assert "Two &lt;b&gt;scenes&lt;/b&gt; | of different size." in text
    index = (own.parent / "README.md").read_text(encoding="utf-8")
    assert r"Two <b>scenes</b> \| of different size." in index
    one = Opened(browser, own)
    assert one.page.locator("#step-told").inner_text() == "1,000 of 1,000"
    one.choose("left", "room", "a [table].b", "index")
    one.choose("right", "room", "dqn", "coordinates")
    assert (
        one.panel("right").locator(".told").inner_text().startswith("At step 300: Q-values, discount 0.99.")
    )
    assert "This net has diverged" in one.panel("right").locator(".told").inner_text()
    # What a right PING pays is far beyond the paper's rewards.
    optimum = pd.read_csv(own / "optimum.csv").query("scenario == 'room' and discount == 1")
    shown = one.panel("left").locator(".readout tbody tr").first.locator("td").nth(1).inner_text()
    assert number(shown) == pytest.approx(optimum["UP"].iloc[0])
    assert number(shown) > 90
    one.panel("left").locator(".readout a.n").nth(1).click()
    row = rows_of(own / "optimum.csv")[1]
    told = [line.split("\t") for line in one.page.locator("dialog tbody").inner_text().splitlines()]
    assert [value for _, value in told] == row
    one.page.keyboard.press("Escape")
    one.page.wait_for_function("location.hash.includes('%2E')")
    again = Opened(browser, own, one.page.evaluate("location.hash"))
    assert again.panel("left").locator("select[name=algorithm]").input_value() == "a [table].b"
    assert one.said == again.said == []


def test_film_of_scenes_and_budgets_that_differ(own: Path) -> None:
    with Image.open(own / "learning.webp") as film:
        assert getattr(film, "n_frames", 1) == 7  # steps 0, 200, ... 1000, and 300
        # Each column is as wide as its widest scene, of 7 and 12 cells.
        assert film.width >= (7 + 12) * 21 + 10


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_accessibility(browser: Browser, results: Path, scheme: str, width: int) -> None:
    fragment = "#explorer=S2.ppo.one_hot~S3.q_learning.index~4000~values"
    one = Opened(browser, results, fragment, color_scheme=scheme, viewport={"width": width, "height": 844})
    assert one.page.evaluate("document.documentElement.scrollWidth") == width  # nothing sticks out
    one.page.locator("details").evaluate_all("all => all.forEach((one) => { one.open = true })")
    one.page.locator("#walk-one").click()
    found = Axe().run(one.page).response["violations"]
    serious = [f"{v['id']}: {v['nodes'][0]['html']}" for v in found if v["impact"] in ("serious", "critical")]
    assert serious == []
    one.page.locator(".lead a.n").first.click()
    found = Axe().run(one.page, context="dialog").response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []
    one.page.close()


def test_manifest_of_the_published_results_says_what_the_page_needs() -> None:
    for name in page.PUBLISHED:
        manifest = json.loads((RESULTS / name / "manifest.json").read_text(encoding="utf-8"))
        assert set(manifest["scenarios"]) == {"S1", "S2", "S3"}
        assert manifest["command"].endswith(f"run {name} --report")
