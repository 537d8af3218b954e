"""The page in a real browser: the explorer, tables, hostile texts, accessibility."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from matplotlib.colors import to_hex
from numpy.typing import NDArray
from playwright.sync_api import Browser

from agents.dynamic_programming import solve
from agents.policy import ALL_ACTIONS, contains, greedy_masks
from benchmark.analysis.records import Records
from benchmark.drawing.film import walk
from benchmark.drawing.style import colour_map
from benchmark.drawing.tables import read_csv, write_csv
from benchmark.folder import MANIFEST, write_manifest
from benchmark.publish.page import build
from benchmark.studies import explorer
from envs import ACTIONS, load_scenario
from envs.observations import compile_seen
from envs.scene import COLOUR_MAP
from tests.benchmark.populations import population as blank
from tests.benchmark.publish.page.conftest import NET, POLICY, TABLE, Learners, Open, Opened
from tests.support import reseal

BAD, GOOD = (to_hex(colour_map(COLOUR_MAP)(share)) for share in (0.0, 1.0))
Everything = tuple[Path, dict[str, Records]]  # a folder, and the runs there by scenario


def number(text: str) -> float:
    return {"none": np.nan, "never": np.inf}.get(text) or float(text.replace("−", "-").replace(",", ""))


def readout(opened: Opened, cell: int) -> list[list[str]]:
    """Returns the lines of the right panel's table of numbers, by pointing at a cell."""
    opened.cells("right").nth(cell).hover()
    return [line.split("\t") for line in opened.panel("right", ".readout tbody").inner_text().splitlines()]


@pytest.mark.parametrize(
    ("scenario", "learner", "place", "cell"),
    [("room", TABLE, 3, 17), ("S2", TABLE, 10, 65), ("S2", POLICY, 3, 119), ("room", NET, 1, 0)],
)
def test_explorer_shows_what_was_stored(
    opened: Opened, learners: Learners, scenario: str, learner: str, place: int, cell: int
) -> None:
    population = learners[scenario, learner.partition(" ")[0]]
    last = len(population.map_indices) - 1
    maps = [*(range(0, last, 2) if last > 1 else []), last]  # every second
    shown = maps[place if last > 1 else 0]
    opened.choose(scenario, learner)
    if last > 1:
        opened.page.locator("#step").fill(str(place))
    arrays, step = population.agents[0], population.map_indices[shown]
    lines = readout(opened, cell)
    assert [line[0] for line in lines] == list(ACTIONS)
    assert [number(line[1]) for line in lines] == pytest.approx(
        arrays["values"][shown, cell], nan_ok=True, abs=0.0006
    )
    greedy = contains(arrays["greedy"][step, cell][None])[0]
    assert ["greedy" in line[3] for line in lines] == greedy.tolist()
    settings = population.run.settings
    horizon = None if settings.discount_factor < 1 else population.run.horizon
    optimum = solve(population.model, settings.discount_factor, horizon).q[cell]
    assert [number(line[2]) for line in lines] == pytest.approx(optimum, abs=0.0006)
    assert ["optimal" in line[3] for line in lines] == (optimum >= optimum.max() - 1e-9).tolist()
    about = opened.panel("right", ".about").inner_text()
    found = re.search(r"score (\S+), success (\S+)\.$", about)
    assert found is not None
    expected = population.unbounded_scores()[0, step], arrays["success"][step]
    assert [number(text) for text in found.groups()] == pytest.approx(expected, abs=0.0006)
    assert ("diverged" in about) == (learner == NET)
    assert opened.panel("right", ".curve circle").count() == (len(maps) if last > 1 else 0)


def test_training_is_played_and_other_seeds_have_their_last_policy(
    opened: Opened, learners: Learners
) -> None:
    opened.choose("S2", TABLE)
    shapes = opened.panel("left", ".map polygon[visibility=visible]")
    opened.page.locator("#step").focus()
    opened.page.keyboard.press("Home")
    assert opened.page.locator("#step-text").inner_text() == "0 of 8,000"
    assert shapes.count() == 0  # a table knows nothing at first
    opened.page.locator("#learn").click()
    opened.page.wait_for_timeout(1200)
    opened.page.locator("#learn").click()
    assert shapes.count() > 0
    opened.choose("S2", POLICY)
    opened.panel("right", "select[name=seed]").select_option("1")
    masks = learners["S2", "ppo"].agents[1]["greedy"][-1]
    for cell in (3, 50):
        greedy = ["greedy" in line[3] for line in readout(opened, cell)]
        assert greedy == contains(masks[cell][None])[0].tolist()


def test_keys_choose_a_cell_and_start_a_walk(opened: Opened) -> None:
    opened.panel("left", ".map").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowLeft", "Enter"):
        opened.page.keyboard.press(key)
    assert opened.panel("left", ".readout").inner_text().startswith("row 1, column 0: ")
    assert " from row 1, column 0, total reward " in opened.panel("left", ".walked").inner_text()
    opened.page.locator("#walk-again").click()
    opened.page.locator("#walk-all").click()
    opened.page.wait_for_timeout(700)
    assert re.match(r"[2-9] steps from row 1", opened.panel("left", ".walked").inner_text())


def test_tables_are_sorted(opened: Opened) -> None:
    opened.unfold()
    table = opened.page.locator("#report-compare_deep [data-item=summary]")
    for column in (4, 5):
        cells, head = (
            table.locator(f"td:nth-child({column})"),
            table.locator(f"th:nth-child({column}) button"),
        )
        written = [number(text.split(" ")[0]) for text in cells.all_inner_texts()]
        for is_reversed in (False, True):
            head.click()
            shown = [number(text.split(" ")[0]) for text in cells.all_inner_texts()]
            assert shown == sorted(written, reverse=is_reversed)


def test_without_javascript_all_but_the_explorer_is_there(open_page: Open) -> None:
    opened = open_page(java_script_enabled=False)
    for summary in opened.page.get_by_text("Details, figures and tables").all():
        summary.click()
    assert "The explorer needs JavaScript" in opened.page.locator("body").inner_text()
    assert opened.page.locator("table:visible").count() == 2
    assert opened.page.locator("img:visible").count() == 4
    assert opened.page.locator("#explore:visible").count() == 0


# Scenarios of all kinds


@pytest.fixture(scope="module")
def everything(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Everything:
    """A page on scenarios of all kinds, with policies that are optimal but for some observations."""
    folder = tmp_path_factory.mktemp("everything")
    shutil.copytree(made, folder / "mine")
    seen = dict.fromkeys(("Turning", "MoodyHidden", "Walls", "TwoPeople", "Counted", "Anywhere"), "index")
    populations = {name: imperfect(name, form) for name, form in {**seen, "Walking": "offset"}.items()}
    explorer.write([*populations.values()], folder / "mine" / explorer.FILE)
    reseal(folder / "mine")
    build.write(folder, "mine")
    return folder / "mine", populations


def imperfect(scenario: str, observation: str) -> Records:
    """Returns runs whose policy is optimal but for some observations."""
    generator, model = np.random.default_rng(5), compile_seen(load_scenario(scenario), observation)
    masks = np.zeros(model.n_observations, dtype=np.uint8)
    masks[model.observation[::-1]] = greedy_masks(solve(model, 1.0, 200).q, 1e-9)[::-1]
    is_drawn = (masks == 0) | (generator.random(len(masks)) < 0.15)
    masks[is_drawn] = generator.integers(1, 32, is_drawn.sum())
    records = blank(scenario, 1, observation=observation, greedy=np.broadcast_to(masks, (1, 4, len(masks))))
    return replace(records, runs=[replace(records.run, variant="a-table_b")])


def assert_optimum(opened: Opened, side: str, population: Records, states: NDArray[np.integer]) -> None:
    """Checks the colours of a map, which shows these states, against exact dynamic programming."""
    model, discount = population.model, population.run.settings.discount_factor
    q = solve(model, discount, None if discount < 1 else population.run.horizon).q[states]
    masks = population.agents[0]["greedy"][-1, model.observation[states]]
    is_optimal = np.asarray(~(contains(masks) & ~contains(greedy_masks(q, 1e-9))).any(axis=1))
    can_act = np.asarray(~model.is_over[states] & (masks != ALL_ACTIONS))
    squares = opened.cells(side).locator("rect")
    fills = np.array(squares.evaluate_all("all => all.map((square) => square.getAttribute('fill'))"))
    assert {*fills[can_act & is_optimal]} == {GOOD}
    assert {*fills[can_act & ~is_optimal]} <= {BAD}
    assert not {GOOD, BAD} & {*fills[~can_act]}


def test_every_scenario_is_walked_and_solved_as_in_python(open_page: Open, everything: Everything) -> None:
    opened = open_page(everything[0])
    opened.page.locator("#shown").select_option("policy")
    for name, population in everything[1].items():
        opened.choose(name)
        opened.page.locator("#walk-again").click()
        model = population.model
        assert_optimum(
            opened, "left", population, model.start - model.cell[model.start] + np.arange(len(model.position))
        )
        walked = walk(model, population.agents[0]["greedy"][-1], population.run.horizon)
        step = "(button, n) => { while (n--) button.click(); }"
        opened.page.locator("#walk-one").evaluate(step, len(walked.actions))
        points = opened.panel("left", ".map polyline").first.get_attribute("points") or ""
        path = [[round(float(n) / 30 - 0.5) for n in reversed(point.split(","))] for point in points.split()]
        assert path == model.position[list(walked.cells)].tolist()
        summary = opened.panel("left", ".walked").inner_text()
        assert summary.startswith(f"{len(walked.actions)} step")
        assert summary.endswith("success.") == (walked.ending == "target_ping")
        n_walls = int(model.scenario.grid.is_wall.sum())
        assert opened.cells("left").locator("rect[fill='#55555f']").count() == n_walls


@pytest.mark.slow
def test_person_phase_and_wrong_pings_are_chosen(open_page: Open, everything: Everything) -> None:
    opened, population = open_page(everything[0]), everything[1]["Anywhere"]
    opened.page.locator("#shown").select_option("policy")
    opened.choose("Anywhere")
    places = [row * 12 + column for ((row, column),) in population.model.scenario.layout.places]
    opened.cells("left").nth(places[7]).dblclick()
    for side in ("left", "right"):  # which show the same room
        assert_optimum(opened, side, population, population.model.states_of(7))
    opened.panel("right", "select[name=place]").select_option("9")
    assert_optimum(opened, "left", population, population.model.states_of(9))
    turning, counted = everything[1]["Turning"], everything[1]["Counted"]
    opened.choose("Turning")
    opened.panel("left", "select[name=tick]").select_option(index=2)
    assert_optimum(opened, "left", turning, turning.model.states_of(2))
    opened.choose("Counted")
    opened.panel("left", "select[name=pings]").select_option("3")
    assert_optimum(opened, "right", counted, 3 * 120 + np.arange(120))


# Safety


HOSTILE = """</script><script>hit = 1</script><img src=x onerror="hit = 1"><svg onload="hit = 1"> ' " on="
![a](https://h.invalid/a) [b](javascript:hit=1) <style>* { background: url(https://h.invalid/e) }</style>
{{ 7 * 7 }} <base href="https://h.invalid">"""
DRAWN = """<script>hit = 1</script><image href="https://h.invalid/f"/><foreignObject><iframe
xmlns="http://www.w3.org/1999/xhtml" src="https://h.invalid/g"/></foreignObject></svg>"""
TEXTS = {"title", "description", "note", "question", "command"}


def hostile(pairs: list[tuple[str, object]]) -> dict[str, object]:
    return {key: HOSTILE if key in TEXTS else value for key, value in pairs}


def test_hostile_results_run_nothing_and_ask_for_nothing(made: Path, tmp_path: Path, open_page: Open) -> None:
    folder = shutil.copytree(made, tmp_path / "mine")
    manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"), object_pairs_hook=hostile)
    manifest["scenarios"][HOSTILE] = manifest["scenarios"]["room"]
    frame = read_csv(folder / "summary.csv").assign(remark=HOSTILE, scenario=HOSTILE)
    write_csv(frame, folder / "summary.csv")
    for figure in folder.glob("*.svg"):
        drawn = figure.read_text(encoding="utf-8")
        figure.write_text(drawn.replace("</svg>", DRAWN), encoding="utf-8")
    write_manifest(folder, manifest)
    opened = open_page(build.write(tmp_path, "mine").parent)
    opened.unfold()
    assert opened.page.evaluate("typeof hit") == "undefined"
    assert opened.page.get_by_text("{{ 7 * 7 }}").count() > 10
    assert (
        opened.page.evaluate("[...document.links].filter((link) => link.protocol === 'javascript:').length")
        == 0
    )


def test_page_lets_no_script_or_request_pass_but_its_own(results: Path, browser: Browser) -> None:
    opened, failed = Opened(browser, results), set[str | None]()
    opened.page.on("requestfailed", lambda request: failed.add(request.failure))
    opened.page.evaluate("""() => document.body.insertAdjacentHTML("beforeend", `
        <img src="https://h.invalid/a"><img src="data:," onerror="hit = 1"><a href="javascript:hit = 1">b</a>
        <iframe src="https://h.invalid/c"></iframe><link rel="stylesheet" href="https://h.invalid/d">
        <form action="https://h.invalid/e"></form><style>* { color: red }</style>`)""")
    opened.page.evaluate("[...document.links].at(-1).click(), [...document.forms].at(-1).submit()")
    opened.page.evaluate("fetch('https://h.invalid/f').catch(() => null)")
    assert sum("Content Security Policy" in message for message in opened.messages) >= 8
    assert (failed, opened.page.evaluate("typeof hit")) == ({"csp"}, "undefined")
    opened.page.close()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1366, "light"), (390, "dark")])
def test_accessibility(open_page: Open, made: Path, width: int, scheme: str) -> None:
    opened = open_page(made, viewport={"width": width, "height": 844}, color_scheme=scheme)
    opened.unfold()
    assert opened.page.evaluate("document.documentElement.scrollWidth") == width  # nothing sticks out
    violations = Axe().run(opened.page).response["violations"]
    assert [(each["id"], each["nodes"][0]["html"]) for each in violations] == []
