"""The page in a real browser: the explorer, sorting, sources, accessibility."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from matplotlib.colors import to_hex
from numpy.typing import NDArray
from playwright.sync_api import Browser

from agents.dynamic_programming import solve
from agents.policy import ALL_ACTIONS, contains, greedy_masks
from benchmark.analysis.records import Records, optimal_values
from benchmark.drawing.film import CIRCLE, HORIZON, walk
from benchmark.drawing.tables import read_csv, write_csv
from benchmark.folder import MANIFEST, write_manifest
from benchmark.publish.document import Document
from benchmark.publish.page import build
from benchmark.studies import explorer
from envs import ACTIONS, load_scenario
from envs.observations import compile_seen
from envs.scenario import ScenarioLike
from envs.scene import COLOUR_MAP, colour_limits
from tests.benchmark.populations import population as blank
from tests.benchmark.publish.page.conftest import LABELS, NET, POLICY, TABLE, Learners, Open, Opened, rows_of
from tests.support import markdown_parser, reseal

Everything = tuple[Path, dict[str, Records]]  # a folder, and the runs there by scenario
Explore = Callable[..., tuple[Opened, Records]]


def number(text: str) -> float:
    return np.nan if text == "none" else float(text.replace("−", "-").replace(",", ""))


def shown_maps(population: Records) -> list[int]:
    """Returns the places of the maps that the explorer shows among all maps: every second and the last.

    Of two, it is the last.
    """
    last = len(population.map_indices) - 1
    return [*(range(0, last, 2) if last > 1 else []), last]


def names(masks: NDArray[np.bool_]) -> set[str]:
    return {name for name, is_in in zip(ACTIONS, masks, strict=True) if is_in}


def readout(opened: Opened, side: str) -> list[list[str]]:
    """Returns the lines of a panel's table of values."""
    return [line.split("\t") for line in opened.panel(side, ".readout tbody").inner_text().splitlines()]


def test_explorer_shows_what_was_stored(opened: Opened, learners: Learners) -> None:
    cases = (
        (("room", *TABLE), 3, 17),
        (("S2", *TABLE), -1, 65),
        (("S2", *POLICY), -1, 119),
        (("room", *NET), -1, 0),
    )
    for key, place, observed in cases:
        population = learners[key]
        maps = shown_maps(population)
        opened.choose_both(*key)
        assert opened.page.locator("#step").is_enabled() == (len(maps) > 1)
        if len(maps) > 1:
            opened.to_map(range(len(maps))[place])
        cell = divmod(observed, population.model.scenario.grid.columns)
        opened.cell("right", *cell).hover()
        assert f"Row {cell[0]}, column {cell[1]}" in opened.panel("right", ".readout").inner_text()
        lines = readout(opened, "right")
        arrays, step = population.agents[0], population.map_indices[maps[place]]
        assert [line[0] for line in lines] == list(ACTIONS)
        values = arrays["values"][maps[place], observed]
        assert [number(line[1]) for line in lines] == pytest.approx(values, nan_ok=True, abs=0.0006)
        greedy = contains(arrays["greedy"][step, observed][None])[0]
        assert {line[0] for line in lines if "greedy" in line[4]} == names(greedy)
        optimum = optimal_values(population)[observed]
        best = optimum >= optimum.max() - 1e-9
        assert {line[0] for line in lines if "optimal" in line[4]} == names(best)
        expected = best / best.sum() if key[1] == "ppo" else optimum
        assert [number(line[2]) for line in lines] == pytest.approx(expected, abs=0.0006)
        about = opened.panel("right", ".about").inner_text()
        found = re.search(r"score (\S+), success probability (\S+?)\. Mean score of all runs: (\S+) ", about)
        assert found is not None
        assert ("This net has diverged" in about) == np.isnan(values).any()
        scores = population.unbounded_scores()[:, step]
        means = scores[0], arrays["success"][step], scores.mean()
        assert [number(text) for text in found.groups()] == pytest.approx(means, abs=0.0006)
    # The scale of a table's values ends at the limits of every back end.
    opened.choose_both("S2", *TABLE)
    population = learners["S2", *TABLE]
    shown = population.agents[0]["values"][shown_maps(population)].astype(float)
    ends = opened.panel("left", ".legend").inner_text().replace("≤", "").split("≥")
    limits = colour_limits(shown[:, ~population.model.is_over[population.model.fresh_state]])
    assert [number(text) for text in ends] == pytest.approx(limits, abs=0.006)


def fills(opened: Opened, side: str = "left") -> list[str]:
    """Returns the colours of a map's moves."""
    shapes = opened.panel(side, ".map svg > g:first-child polygon")
    return list(shapes.evaluate_all("shapes => shapes.map((shape) => shape.getAttribute('fill'))"))


@pytest.mark.slow
def test_slider_shows_learning_and_the_address_keeps_it(opened: Opened, open_page: Open) -> None:
    opened.choose_both("S2", *TABLE)
    opened.walk(3)
    assert "3 steps from" in opened.panel("left", ".walked").inner_text()
    opened.to_map(0)
    assert len(set(fills(opened))) == 1  # a table knows nothing at first
    opened.to_map(7)
    assert len(set(fills(opened))) > 8
    assert opened.page.locator("#step-text").inner_text() == "5,600 of 8,000"
    assert opened.panel("left", ".walked").inner_text() == "The agent is at row 0, column 0."
    opened.page.locator("#shown").select_option("difference")
    opened.wait_until("location.hash.endsWith('difference')")
    again = open_page(fragment=opened.page.evaluate("location.hash"))
    assert fills(again) == fills(opened)
    assert again.page.locator("#shown").input_value() == "difference"


@pytest.mark.slow
def test_address_is_followed_as_far_as_it_goes(open_page: Open) -> None:
    opened = open_page(fragment="#explorer=%")
    for fragment in ("%", "nowhere.%E0.x~~nothing~7~~", "S2.dqn.~.~-3~"):
        opened.page.evaluate(f"location.hash = '#explorer={fragment}'")
        assert "Row 0, column 0" in opened.panel("left", ".readout").inner_text()
    agent = "room.a-table_b.index"
    opened.page.evaluate(f"location.hash = '#explorer={agent}.reproduce~{agent}.compare_deep~1600~ping'")
    opened.wait_until("document.getElementById('step-text').textContent === '1,600 of 8,000'")
    for side, expected in (("left", "reproduce"), ("right", "compare_deep")):
        assert opened.panel(side, "select[name=experiment]").input_value() == expected
        source = opened.panel(side, ".about a.n").get_attribute("href")
        assert str(source).startswith(f"{expected}/curves.csv#row=")
    assert opened.page.locator("#shown").input_value() == "ping"
    # What a choice changes is said.
    said = opened.panel("left", ".changed")
    opened.panel("left", "select[name=seed]").select_option("1")
    opened.choose("left", "room", *NET)
    assert said.inner_text() == ""
    opened.page.evaluate(
        "location.hash = '#explorer=room.ppo.one_hot.nowhere~room.dqn.coordinates.reproduce'"
    )
    said.get_by_text("The experiment is now reproduce: there is no nowhere here.").wait_for()
    for side in ("left", "right"):  # without values there is one view, and a reason
        opened.panel(side, "select[name=seed]").select_option("1")
    assert opened.page.locator("#shown option:enabled").all_inner_texts() == ["greedy policy: is it optimal?"]
    assert opened.page.locator("#shown-why").inner_text() == "Of these agents, only the policy is published."


def test_outlines_and_keys(opened: Opened) -> None:
    # The issuer stands at row 3, column 5. The regions reach two cells and one cell away from it, so the edge
    # of the 5 x 7 cells cuts the target region.
    found = opened.panel("left", ".map .things path").evaluate_all(
        "all => all.map((path) => path.getBBox()).map((box) => [box.x, box.y, box.width, box.height])"
    )
    boxes = [[(x - 20) / 30, y / 30, width / 30, height / 30] for x, y, width, height in found]
    assert boxes == [[3, 1, 4, 4]] * 2 + [[4, 2, 3, 3]] * 2  # a border and a line each
    # All works by keyboard alone.
    opened.panel("left", ".map").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowLeft", "Enter"):
        opened.page.keyboard.press(key)
    assert "Row 1, column 0" in opened.panel("left", ".readout").inner_text()
    assert "The agent is at row 1, column 0." in opened.panel("left", ".walked").inner_text()
    opened.page.locator("#step").focus()
    opened.page.keyboard.press("Home")
    assert opened.page.locator("#step-text").inner_text().startswith("0 of")
    opened.page.locator("#learn").focus()
    opened.page.keyboard.press("Enter")
    opened.wait_until("document.getElementById('step').value >= 2")
    opened.page.keyboard.press("Enter")
    assert opened.page.locator("#learn").get_attribute("aria-pressed") == "false"


def test_tables_sort_and_numbers_are_marked_in_their_rows(opened: Opened, results: Path) -> None:
    opened.unfold()
    table = opened.page.locator("#report-compare_deep [data-item=summary]")

    def shown(column: int) -> list[float]:
        texts = [cell.split(" ")[0] for cell in table.locator(f"td:nth-child({column})").all_inner_texts()]
        return [np.inf if text == "never" else number(text) for text in texts]

    for column in (4, 5):
        written = shown(column)
        assert written not in (sorted(written), sorted(written, reverse=True))
        for expected in (sorted(written), sorted(written, reverse=True), written):
            table.locator(f"th:nth-child({column}) button").click()
            assert shown(column) == expected
    header, *rows = rows_of(results / "compare_deep" / "summary.csv")
    for link, n_rows in (
        ("#report-compare_deep .sortable a.n", 1),
        ("#report-compare_deep > details > p a.n", len(rows)),
    ):
        number_link = opened.page.locator(link).first
        text = number_link.inner_text()
        number_link.click()
        summary = opened.page.locator("dialog p").first.inner_text()
        assert summary.startswith(f"Shown as {text}")
        assert ("the mean of score over these lines" in summary) == (n_rows > 1)
        assert "score" in opened.page.locator("dialog th.cited").all_inner_texts()
        body = opened.page.locator("dialog tbody")
        if n_rows == 1:
            assert [line.split("\t")[0] for line in body.inner_text().splitlines()] == header
        else:
            assert body.locator("tr").count() == n_rows
            mean = float(np.mean([float(row[header.index("score")]) for row in rows]))
            assert number(text) == pytest.approx(mean, abs=0.0006)
        opened.page.keyboard.press("Escape")


def test_without_javascript_all_but_the_explorer_is_there(open_page: Open) -> None:
    opened = open_page(java_script_enabled=False)
    for summary in opened.page.get_by_text("Details, figures and tables").all():
        summary.click()
    text = opened.page.locator("body").inner_text()
    assert "how close is close enough" in text
    assert "The explorer needs JavaScript" in text
    assert opened.page.locator("table:visible").count() == 3
    assert opened.page.locator("img:visible").count() == 4
    assert opened.page.locator("#explore:visible").count() == 0


ENDINGS = {
    "target_ping": "PING in the target region: success.",
    "issuer_reached": "The agent ran into the person, and the episode ended.",
    "last_wrong_ping": "One wrong PING too many, and the episode ended.",
    CIRCLE: "and would do so until the limit of {} steps.",
    HORIZON: "The limit of {} steps is reached.",
}


def assert_walks(opened: Opened, population: Records, masks: NDArray[np.uint8]) -> None:
    """Checks that the left agent walks from the start as Python's walk does."""
    model = population.model
    walked = walk(model, masks, population.run.horizon)
    had_choice = contains(masks)[model.observation[list(walked.states[:-1])]].sum(axis=1) > 1
    opened.page.locator("#walk-again").click()
    opened.walk(len(walked.actions))
    summary = opened.panel("left", ".walked").inner_text()
    n_steps = len(walked.actions)
    where = [f"row {row}, column {column}" for row, column in model.position[list(walked.cells)].tolist()]
    assert summary.startswith(f"{n_steps} step{'s' if n_steps > 1 else ''} from {where[0]}.")
    assert summary.endswith(ENDINGS[walked.ending].format(population.run.horizon))
    lines = opened.panel("left", ".walk tbody").inner_text().splitlines()[::-1]
    cells = [line.split("\t") for line in lines]
    assert [line[1] for line in cells] == where[:-1]
    assert [line[-4].split(" ")[0] for line in cells] == [ACTIONS[action] for action in walked.actions]
    assert ["(tie of" in line[-4] for line in cells] == had_choice.tolist()
    phases = [stage.name for stage in model.scenario.layout.stages]
    if len(cells[0]) == 7:
        contexts = model.context[list(walked.states[:-1])] % len(phases)
        assert [line[2] for line in cells] == [phases[phase] for phase in contexts]


@pytest.mark.slow
def test_agent_of_any_seed_can_be_chosen(opened: Opened, learners: Learners, open_page: Open) -> None:
    for key in (("room", *NET), ("S2", *POLICY)):
        population = learners[key]
        opened.choose("left", *key)
        opened.panel("left", "select[name=seed]").select_option("1")
        about = opened.panel("left", ".about").inner_text()
        only = r"(Shown: step [\d,]+\. )?Only this agent's final greedy policy is published, so its map "
        assert re.match(only, about)
        found = re.search(r"\(seed 1\): unbounded score (\S+), success probability ([\d.]+)[. ]", about)
        assert found is not None
        expected = population.unbounded_scores()[1, -1], population.arrays["success"][1, -1]
        assert [number(text.rstrip(".")) for text in found.groups()] == pytest.approx(expected, abs=0.0006)
        masks = population.agents[1]["greedy"][-1]
        opened.cell("left", 1, 3).hover()
        greedy = {line[0] for line in readout(opened, "left") if "greedy" in line[2]}
        observed = population.model.scenario.grid.columns + 3
        assert greedy == names(contains(masks[observed][None])[0])
        assert_walks(opened, population, masks)
    # The address keeps the seed; one without seeds shows the first.
    opened.wait_until(r"/^#explorer=S2\.ppo\.[^~]*\.1\.0~/.test(location.hash)")
    address = opened.page.evaluate("location.hash")
    for fragment, seed in ((address, "1"), (address.replace(".1.0~", "~", 1), "0")):
        again = open_page(fragment=fragment)
        assert again.panel("left", "select[name=learner]").input_value() == LABELS[POLICY]
        assert again.panel("left", "select[name=seed]").input_value() == seed


def violations(opened: Opened, context: str | None = None) -> list[tuple[str, str]]:
    """Returns what axe finds in a part of the page, or in all of it, and where it is first."""
    found = Axe().run(opened.page, context=context).response["violations"]
    return [(each["id"], each["nodes"][0]["html"]) for each in found]


SEEN = dict.fromkeys(
    ("Turning", "MoodyHidden", "Walls", "TwoPeople", "Counted", "Delayed", "Anywhere"), "index"
)
SEEN["Walking"] = "offset"


@pytest.fixture(scope="module")
def everything(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Everything:
    """A page on scenarios of all kinds, with policies that are optimal but for some observations."""
    folder = tmp_path_factory.mktemp("everything")
    shutil.copytree(made, folder / "mine")
    populations = {name: imperfect(name, observation) for name, observation in SEEN.items()}
    explorer.write([*populations.values()], folder / "mine" / explorer.FILE)
    reseal(folder / "mine")
    build.write(folder, "mine")
    return folder / "mine", populations


def imperfect(scenario: ScenarioLike, observation: str) -> Records:
    """Returns runs whose policy is optimal but for some observations."""
    generator, model = np.random.default_rng(5), compile_seen(load_scenario(scenario), observation)
    masks = np.zeros(model.n_observations, dtype=np.uint8)
    masks[model.observation[::-1]] = greedy_masks(solve(model, 1.0, 200).q, 1e-9)[::-1]
    is_drawn = (masks == 0) | (generator.random(len(masks)) < 0.15)
    masks[is_drawn] = generator.integers(1, 32, is_drawn.sum())
    points = np.broadcast_to(masks, (1, 4, len(masks)))
    records = blank(scenario, 1, observation=observation, greedy=points)
    return replace(records, runs=[replace(records.run, variant="a-table_b")])


@pytest.fixture
def explore(everything: Everything, open_page: Open) -> Explore:
    """Opens policies of one or two of these scenarios; returns the page, and the runs of the left one."""

    def open_at(left: str, right: str = "") -> tuple[Opened, Records]:
        agents = [f"{name}.a-table_b.{SEEN[name]}" for name in (left, right or left)]
        return open_page(everything[0], f"#explorer={'~'.join(agents)}~600~policy"), everything[1][left]

    return open_at


def assert_optimum(opened: Opened, population: Records, states: NDArray[np.integer], cell: int) -> None:
    """Checks colours of the left policy map, and the numbers of a cell, against exact dynamic programming."""
    model, horizon = population.model, population.run.horizon
    discount = population.run.settings.discount_factor
    q = solve(model, discount, None if discount < 1 else horizon).q[states]
    masks = population.agents[0]["greedy"][-1, model.observation[states]]
    is_optimal = np.asarray(~(contains(masks) & ~contains(greedy_masks(q, 1e-9))).any(axis=1))
    can_act = np.asarray(~model.is_over[states] & (masks != ALL_ACTIONS))
    squares = opened.panel("left", ".map svg > g:first-child rect")
    fills = np.array(squares.evaluate_all("all => all.map((square) => square.getAttribute('fill'))"))
    assert is_optimal[can_act].sum() > 0
    assert {*fills[can_act & is_optimal]} == {colour_of(1.0)}
    assert {*fills[can_act & ~is_optimal]} <= {colour_of(0.0)}
    row, column = model.position[cell]
    opened.panel("left", ".map svg > g:first-child > g").nth(cell).hover()
    assert f"Row {row}, column {column}" in opened.panel("left", ".readout").inner_text()
    values = [number(line[2 if len(line) == 5 else 1]) for line in readout(opened, "left")]
    assert values == pytest.approx(q[cell], abs=0.0006)


def colour_of(share: float) -> str:
    return str(to_hex(mpl.colormaps[COLOUR_MAP](share)))


def test_every_scenario_is_walked_and_solved_as_in_python(explore: Explore, everything: Everything) -> None:
    opened, _ = explore("Anywhere")
    for name, population in everything[1].items():
        for side in ("left", "right"):
            opened.panel(side, "select[name=scenario]").select_option(name)
        model = population.model
        block = model.start - model.cell[model.start] + np.arange(len(model.position))
        assert_optimum(opened, population, block, int(np.flatnonzero(~model.is_over[block])[-1]))
        assert_walks(opened, population, population.agents[0]["greedy"][-1])
        n_walls = int(model.scenario.grid.is_wall.sum())
        assert opened.panel("left", ".map svg > g:first-child rect[fill='#55555f']").count() == n_walls
        n_signs = len(model.scenario.people_in(0, 0)) * (1 + model.scenario.has_front)
        assert opened.panel("left", ".map .things polygon[points]").count() == n_signs


@pytest.mark.slow
def test_the_person_is_moved_by_pointer_keys_and_menus(
    explore: Explore, everything: Everything, open_page: Open
) -> None:
    opened, population = explore("Anywhere")
    cells, menu = opened.panel("left", ".map svg > g:first-child > g"), "select[name=person]"
    places = [row * 12 + column for ((row, column),) in population.model.scenario.layout.places]

    def assert_at(person: int) -> None:
        for side in ("left", "right"):  # which show the same room
            assert opened.panel(side, menu).input_value() == str(person)
        assert_optimum(opened, population, population.model.states_of(places.index(person)), 100)

    opened.panel("left", ".map").scroll_into_view_if_needed()
    cells.nth(places[0]).hover()
    opened.page.mouse.down()
    for person in (5 * 12 + 5, 5 * 12 + 8):
        cells.nth(person).hover(force=True)
        assert opened.panel("right", menu).input_value() == str(person)  # at once
    opened.page.mouse.up()
    cells.nth(7 * 12 + 1).hover()
    assert_at(5 * 12 + 8)
    opened.panel("right", ".map").focus()
    opened.page.keyboard.press("Shift+ArrowDown")
    assert_at(6 * 12 + 8)
    opened.panel("left", menu).select_option(label="row 2, column 6")
    assert_at(2 * 12 + 6)
    # The address keeps it, and a walk starts from where episodes start with the person there.
    opened.wait_until(f"location.hash.includes('.{places.index(2 * 12 + 6) * 5}~')")
    again = open_page(everything[0], opened.page.evaluate("location.hash"))
    assert again.panel("right", menu).input_value() == str(2 * 12 + 6)
    assert "The agent is at row 0, column 0." in again.panel("left", ".walked").inner_text()


@pytest.mark.slow
def test_a_group_of_many_places_is_shown_in_some(
    made: Path, tmp_path: Path, open_page: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = {"issuer.places": 12, "others": [{"position": [9, 11]}]}
    population = imperfect(load_scenario("TwoTalking", changes), "offset")
    standing = population.model.scenario.layout.standing[:, 0].tolist()
    shutil.copytree(made, tmp_path / "mine")
    monkeypatch.setattr(explorer, "MAX_STATES", 3000)  # five places
    explorer.write([population], tmp_path / "mine" / explorer.FILE)
    reseal(tmp_path / "mine")
    build.write(tmp_path, "mine")
    address = f"#explorer={'TwoTalking.a-table_b.offset~' * 2}600~policy"
    opened, menu = open_page(tmp_path / "mine", address), "select[name=person]"
    assert "5 of 12 places are shown." in opened.panel("left", ".about").inner_text()
    assert "does not see" not in opened.panel("left", ".about").inner_text()
    key = opened.page.locator("#key").inner_text()
    assert ("bystander" in key, "circle on which people talk" in key) == (True, True)
    for i, place in enumerate((0, 2, 4, 7, 9)):
        opened.panel("left", menu).select_option(index=i)
        assert opened.panel("right", menu).input_value() == ",".join(map(str, standing[place]))
        assert_optimum(opened, population, population.model.states_of(place), 0)
    assert opened.panel("left", ".map .things polygon").count() == 2
    assert opened.panel("left", ".map .things circle").count() == 1 + 2  # bystander, and a dotted line
    # Either of them can be dragged.
    cells = opened.panel("left", ".map svg > g:first-child > g")
    opened.panel("left", ".map").scroll_into_view_if_needed()
    cells.nth(standing[9][1]).hover(force=True)
    opened.page.mouse.down()
    cells.nth(standing[4][0]).hover(force=True)
    assert str(standing[4][0]) in opened.panel("right", menu).input_value().split(",")


@pytest.mark.slow
def test_phase_and_wrong_pings_are_chosen(explore: Explore, everything: Everything) -> None:
    opened, turning = explore("Turning", "Counted")
    opened.panel("left", "select[name=phase]").select_option(label="looks down")
    assert_optimum(opened, turning, turning.model.states_of(2), 20)
    opened.choose("left", "Counted", *TABLE)
    opened.panel("left", "select[name=pings]").select_option("3")
    assert_optimum(opened, everything[1]["Counted"], 3 * 120 + np.arange(120), 20)
    assert opened.panel("right", "select[name=pings]").input_value() == "3"  # the same room


HOSTILE = """</script><script>hit = 1</script><img src=x onerror="hit = 1"><svg onload="hit = 1"> ' " on="
![a](https://h.invalid/a) [b](javascript:hit=1) [c](https://h.invalid/c) <https://h.invalid> www.h.invalid
<style>* { background: url(https://h.invalid/e) }</style> {{ 7 * 7 }} <base href="https://h.invalid">"""
DRAWN = """<script>hit = 1</script><image href="https://h.invalid/f"/><foreignObject><iframe
xmlns="http://www.w3.org/1999/xhtml" src="https://h.invalid/g"/></foreignObject></svg>"""
TEXTS = {"title", "description", "note", "question", "command", "partial"}


def hostile(pairs: list[tuple[str, object]]) -> dict[str, object]:
    return {key: HOSTILE if key in TEXTS else value for key, value in pairs}


def test_hostile_results_run_nothing_and_ask_for_nothing(made: Path, tmp_path: Path, open_page: Open) -> None:
    for name in ("compare_deep", "mine"):
        folder = shutil.copytree(made, tmp_path / name)
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"), object_pairs_hook=hostile)
        manifest["scenarios"][HOSTILE] = manifest["scenarios"]["room"]
        frame = read_csv(folder / "summary.csv").assign(remark=HOSTILE, verdict=HOSTILE, scenario=HOSTILE)
        write_csv(frame, folder / "summary.csv")
        for figure in folder.glob("*.svg"):
            drawn = figure.read_text(encoding="utf-8")
            figure.write_text(drawn.replace("</svg>", DRAWN), encoding="utf-8")
        if name == "compare_deep":
            (folder / explorer.FILE).unlink()
        write_manifest(folder, manifest | ({} if name == "mine" else {"experiment": name}))
        opened = open_page(build.write(tmp_path, name).parent)
        opened.unfold()
        if name == "compare_deep":  # all else works without agents
            assert opened.page.locator("#explorer, a[href='#explorer']").count() == 0
            assert opened.page.locator("th button").count() > 0
            opened.page.locator("table a.n").first.click()
            assert opened.page.locator("dialog[open] tbody tr").count() > 0
        assert opened.page.evaluate("typeof hit") == "undefined"
        assert opened.page.get_by_text("{{ 7 * 7 }}").count() > 10
        links = {*opened.page.evaluate("[...document.links].map((link) => link.href)")}
        assert [link for link in links if not link.startswith("file:")] == [
            "https://arxiv.org/abs/2108.03730"
        ]
        readme = Document(folder).readme()
        assert "://" not in readme
        active = r"<(script|style|base|img(?! src=.\w+\.svg))|(src|href)=.\w+:"
        assert not re.search(active, markdown_parser().render(readme))


def test_page_lets_no_script_or_request_pass_but_its_own(results: Path, browser: Browser) -> None:
    opened, failed = Opened(browser, results, ""), set[str | None]()
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
def test_accessibility(open_page: Open, made: Path) -> None:
    opened = open_page(made, "#explorer=S2.ppo.one_hot~room.a-table_b.index~1600~values")
    opened.unfold()
    for width in (1366, 768, 390):
        opened.page.emulate_media(color_scheme="dark" if width == 390 else "light")
        opened.page.set_viewport_size({"width": width, "height": 844})
        assert opened.page.evaluate("document.documentElement.scrollWidth") == width  # nothing sticks out
        cut = "document.querySelector('figure > .cut') !== null"  # the figures are 576 wide
        opened.wait_until(f"({cut}) === {str(width < 576).lower()}")
        opened.walk(1)
        if width != 768:
            assert violations(opened) == []
            opened.page.locator("#explorer a.n").first.evaluate("link => link.click()")
            assert violations(opened, "dialog") == []
            opened.page.keyboard.press("Escape")
