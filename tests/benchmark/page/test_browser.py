"""The page in a real browser: the explorer, sorting, sources, accessibility."""

import gzip
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from numpy.typing import NDArray

from agents.policy import contains
from benchmark.analysis.population import Population, optimal_values
from benchmark.analysis.walk import CIRCLE, HORIZON, walk
from benchmark.page import build
from envs import ACTIONS
from envs.scene import colour_limits
from tests.benchmark.page.conftest import Open, Opened, rows_of

Learners = dict[tuple[str, str, str], Population]
TABLE, NET, POLICY = ("a-table_b", "index"), ("dqn", "coordinates"), ("ppo", "one_hot")


def number(text: str) -> float:
    return np.nan if text == "none" else float(text.replace("−", "-").replace(",", ""))


def shown_maps(population: Population) -> list[int]:
    """Returns the places of the maps that the explorer shows among all maps: every second and the last."""
    return [*range(0, len(population.map_indices) - 1, 2), len(population.map_indices) - 1]


def names(masks: NDArray[np.bool_]) -> set[str]:
    return {name for name, is_in in zip(ACTIONS, masks, strict=True) if is_in}


def readout(opened: Opened, side: str) -> list[list[str]]:
    """Returns the lines of a panel's table of values."""
    return [line.split("\t") for line in opened.panel(side, ".readout tbody").inner_text().splitlines()]


@pytest.mark.parametrize(
    ("key", "place", "cell"),
    [(("room", *TABLE), 3, (2, 3)), (("S2", *TABLE), -1, (5, 5)), (("S2", *POLICY), -1, (9, 11)),
     (("room", *NET), -1, (0, 0))],
)  # fmt: skip
def test_explorer_shows_what_was_stored(
    opened: Opened, learners: Learners, key: tuple[str, str, str], place: int, cell: tuple[int, int]
) -> None:
    population = learners[key]
    observed = cell[0] * population.model.scenario.grid.columns + cell[1]
    chosen = shown_maps(population)[place]
    for side in ("left", "right"):
        opened.choose(side, *key)
    opened.to_map(range(len(shown_maps(population)))[place])
    opened.cell("right", *cell).hover()
    assert f"Row {cell[0]}, column {cell[1]}" in opened.panel("right", ".readout").inner_text()
    lines = readout(opened, "right")
    arrays, step = population.agents[0], population.map_indices[chosen]
    assert [line[0] for line in lines] == list(ACTIONS)
    values = arrays["values"][chosen, observed]
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
    means = (
        population.unbounded_scores[0, step],
        arrays["success"][step],
        population.unbounded_scores[:, step].mean(),
    )
    assert [number(text) for text in found.groups()] == pytest.approx(means, abs=0.0006)


def test_mean_score_in_the_explorer_links_to_its_row(opened: Opened, results: Path) -> None:
    link = opened.panel("left", ".about a.n")
    file, _, row = str(link.get_attribute("href")).partition("#row=")
    link.click()
    cells = dict(line.split("\t") for line in opened.page.locator("dialog tbody").inner_text().splitlines())
    header, *rows = rows_of(results / file)
    assert cells == dict(zip(header, rows[int(row) - 2], strict=True))
    assert [cells[key] for key in ("scenario", "algorithm", "step")] == ["room", "a-table_b", "8000"]


def fills(opened: Opened, side: str = "left") -> list[str]:
    """Returns the colours of a map's moves."""
    shapes = opened.panel(side, ".map svg > g:first-child polygon")
    return list(shapes.evaluate_all("shapes => shapes.map((shape) => shape.getAttribute('fill'))"))


def test_slider_shows_learning_and_the_address_keeps_it(opened: Opened, open_page: Open) -> None:
    for side in ("left", "right"):
        opened.choose(side, "S2", *TABLE)
    opened.walk(3)
    assert "3 steps from" in opened.panel("left", ".walked").inner_text()
    opened.to_map(0)
    assert len(set(fills(opened))) == 1  # a table knows nothing at first
    opened.to_map(7)
    assert len(set(fills(opened))) > 8
    assert opened.page.locator("#step-text").inner_text() == "5,600 of 8,000"
    assert opened.panel("left", ".walked").inner_text() == "The agent is at row 0, column 0."
    opened.page.locator("#shown").select_option("difference")
    opened.page.wait_for_function("location.hash.endsWith('difference')")
    again = open_page(fragment=opened.page.evaluate("location.hash"))
    assert fills(again) == fills(opened)
    assert again.page.locator("#shown").input_value() == "difference"


@pytest.mark.parametrize("fragment", ["%", "nowhere.%E0.x~~nothing~7~~", "S2.dqn.~.~-3~"])
def test_mistyped_address_is_taken_as_far_as_it_goes(open_page: Open, fragment: str) -> None:
    readout = open_page(fragment=f"#explorer={fragment}").panel("left", ".readout")
    assert "Row 0, column 0" in readout.inner_text()


def test_address_is_followed_and_names_the_experiment(opened: Opened) -> None:
    agent = "room.a-table_b.index"
    opened.page.evaluate(f"location.hash = '#explorer={agent}.reproduce~{agent}.compare_deep~1600~ping'")
    opened.page.wait_for_function("document.getElementById('step-text').textContent === '1,600 of 8,000'")
    for side, expected in (("left", "reproduce"), ("right", "compare_deep")):
        assert opened.panel(side, "select[name=experiment]").input_value() == expected
        source = opened.panel(side, ".about a.n").get_attribute("href")
        assert str(source).startswith(f"{expected}/curves.csv#row=")
    assert opened.page.locator("#shown").input_value() == "ping"


def test_scale_ends_at_the_limits_of_every_back_end(opened: Opened, learners: Learners) -> None:
    for side in ("left", "right"):
        opened.choose(side, "S2", *TABLE)
    population = learners["S2", *TABLE]
    values = population.agents[0]["values"][shown_maps(population)].astype(float)
    low, high = colour_limits(values[:, ~population.model.is_over[population.model.fresh_state]])
    legend = [
        number(text) for text in opened.panel("left", ".legend").inner_text().replace("≤", "").split("≥")
    ]
    assert legend == pytest.approx([low, high], abs=0.006)


def test_outlines_surround_the_regions(opened: Opened) -> None:
    # The issuer stands at row 3, column 5. The regions reach two cells and one cell away from it, so the edge
    # of the 5 x 7 cells cuts the target region.
    found = opened.panel("left", ".map svg > path").evaluate_all(
        "all => all.map((path) => path.getBBox()).map((box) => [box.x, box.y, box.width, box.height])"
    )
    boxes = [[(x - 20) / 30, y / 30, width / 30, height / 30] for x, y, width, height in found]
    assert boxes == [[3, 1, 4, 4]] * 2 + [[4, 2, 3, 3]] * 2  # a border and a line each


def test_explorer_by_keyboard_alone(opened: Opened) -> None:
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
    opened.page.wait_for_function("document.getElementById('step').value >= 2")
    opened.page.keyboard.press("Enter")
    assert opened.page.locator("#learn").get_attribute("aria-pressed") == "false"


@pytest.mark.parametrize("column", [4, 5])
def test_tables_sort(opened: Opened, column: int) -> None:
    table = opened.page.locator("#compare_deep [data-item=summary]")

    def shown() -> list[float]:
        texts = [cell.split(" ")[0] for cell in table.locator(f"td:nth-child({column})").all_inner_texts()]
        return [np.inf if text == "never" else number(text) for text in texts]

    written = shown()
    assert written not in (sorted(written), sorted(written, reverse=True))
    for expected in (sorted(written), sorted(written, reverse=True), written):
        table.locator(f"th:nth-child({column}) button").click()
        assert shown() == expected


def test_number_is_marked_in_the_rows_that_it_comes_from(opened: Opened, results: Path) -> None:
    header, *rows = rows_of(results / "compare_deep" / "summary.csv")
    for link, n_rows in ((".sortable a.n", 1), ("li:nth-child(2) a.n", len(rows))):
        number_link = opened.page.locator(f"#compare_deep {link}").first
        shown = number_link.inner_text()
        number_link.click()
        summary = opened.page.locator("dialog p").first.inner_text()
        assert summary.startswith(f"Shown as {shown}")
        assert ("the mean of score over these lines" in summary) == (n_rows > 1)
        assert "score" in opened.page.locator("dialog th.cited").all_inner_texts()
        body = opened.page.locator("dialog tbody")
        if n_rows == 1:
            assert [line.split("\t")[0] for line in body.inner_text().splitlines()] == header
        else:
            assert body.locator("tr").count() == n_rows
            mean = float(np.mean([float(row[header.index("score")]) for row in rows]))
            assert number(shown) == pytest.approx(mean, abs=0.0006)
        opened.page.keyboard.press("Escape")


def test_without_javascript_all_but_the_explorer_is_there(open_page: Open) -> None:
    opened = open_page(java_script_enabled=False)
    text = opened.page.locator("body").inner_text()
    assert "The task" in text
    assert "The explorer needs JavaScript" in text
    assert opened.page.locator("table:visible").count() == 3
    assert opened.page.locator("img:visible").count() == 5
    assert opened.page.locator("#explore:visible").count() == 0


ENDINGS = {
    "target_ping": "PING in the target region: success.",
    "issuer_reached": "The agent ran into the issuer, and the episode ended.",
    "last_wrong_ping": "One wrong PING too many, and the episode ended.",
    CIRCLE: "and would do so until the limit of 100 steps.",
    HORIZON: "The limit of 100 steps is reached.",
}


def assert_walks(opened: Opened, population: Population, masks: NDArray[np.uint8]) -> None:
    """Checks that the left agent walks from the start as Python's walk does."""
    taken = walk(population.model, masks, population.horizon)
    had_choice = contains(masks)[list(taken.cells[:-1])].sum(axis=1) > 1
    opened.page.locator("#walk-again").click()
    opened.walk(len(taken.actions) + 5)
    summary = opened.panel("left", ".walked").inner_text()
    n_steps = len(taken.actions)
    assert summary.startswith(f"{n_steps} step{'s' if n_steps > 1 else ''} from row 0, column 0.")
    assert summary.endswith(ENDINGS[taken.ending])
    lines = opened.panel("left", ".walk tbody").inner_text().splitlines()[::-1]
    cells = [re.findall(r"\t([^\t]+)\t([A-Z]+)( \(tie of \d\))?\t", line)[0] for line in lines]
    positions = population.model.position[list(taken.cells[:-1])].tolist()
    assert [where for where, _, _ in cells] == [f"row {row}, column {column}" for row, column in positions]
    assert [action for _, action, _ in cells] == [ACTIONS[action] for action in taken.actions]
    assert [bool(tie) for _, _, tie in cells] == had_choice.tolist()


def test_script_walks_as_python_does(opened: Opened, learners: Learners) -> None:
    kinds: dict[tuple[str, bool], list[tuple[tuple[str, str, str], int]]] = {}
    for key, population in learners.items():
        greedy = population.agents[0]["greedy"][population.map_indices]
        for chosen in shown_maps(population):
            taken = walk(population.model, greedy[chosen], population.horizon)
            had_choice = contains(greedy[chosen])[list(taken.cells[:-1])].sum(axis=1) > 1
            kinds.setdefault((taken.ending, bool(had_choice.any())), []).append((key, chosen))
    assert {(CIRCLE, False), ("target_ping", False)} <= set(kinds)
    for key, chosen in [walked for alike in kinds.values() for walked in alike[:: len(alike) // 2 + 1]]:
        population, name = learners[key], ".".join(key)
        place = population.map_indices[chosen]
        step = population.evaluation_steps[place]
        opened.page.evaluate(f"location.hash = '#explorer={name}~{name}~{step}~values'")
        label = f"Map of {key[1]}, {key[2]}, in {key[0]}, step {step}, "
        opened.page.wait_for_function(
            "label => document.querySelector('.map').ariaLabel.startsWith(label)", arg=label
        )
        assert_walks(opened, population, population.agents[0]["greedy"][place])


def test_agent_of_any_seed_can_be_chosen(opened: Opened, learners: Learners, open_page: Open) -> None:
    for key in (("room", *NET), ("S2", *POLICY)):
        population = learners[key]
        opened.choose("left", *key)
        opened.panel("left", "select[name=seed]").select_option("1")
        about = opened.panel("left", ".about").inner_text()
        only = r"(Shown: step [\d,]+\. )?Of this agent only the final greedy policy is published\. "
        assert re.match(only, about)
        found = re.search(r"\(seed 1\): score (\S+), success probability ([\d.]+)[. ]", about)
        assert found is not None
        expected = population.unbounded_scores[1, -1], population.arrays["success"][1, -1]
        assert [number(text.rstrip(".")) for text in found.groups()] == pytest.approx(expected, abs=0.0006)
        masks = population.agents[1]["greedy"][-1]
        opened.cell("left", 1, 3).hover()
        greedy = {line[0] for line in readout(opened, "left") if "greedy" in line[2]}
        observed = population.model.scenario.grid.columns + 3
        assert greedy == names(contains(masks[observed][None])[0])
        assert_walks(opened, population, masks)
    # The address keeps the seed; one without seeds shows the first.
    opened.page.wait_for_function(r"/^#explorer=S2\.ppo\.[^~]*\.1~/.test(location.hash)")
    address = opened.page.evaluate("location.hash")
    for fragment, seed in ((address, "1"), (address.replace(".1~", "~", 1), "0")):
        again = open_page(fragment=fragment)
        assert again.panel("left", "select[name=algorithm]").input_value() == "ppo"
        assert again.panel("left", "select[name=seed]").input_value() == seed


def test_page_without_agents(made: Path, tmp_path: Path, open_page: Open) -> None:
    shutil.copytree(made, tmp_path / "mine")
    (tmp_path / "mine" / "agents.json.gz").unlink()
    build.write(tmp_path, "mine")
    opened = open_page(tmp_path / "mine")
    assert opened.page.locator("#explorer, a[href='#explorer']").count() == 0
    assert opened.page.locator("th button").count() > 0  # tables sort
    opened.page.locator("table a.n").first.click()
    assert opened.page.locator("dialog[open] tbody tr").count() > 0


def test_an_egocentric_map_counts_from_the_issuer(made: Path, tmp_path: Path, open_page: Open) -> None:
    shutil.copytree(made, tmp_path / "mine")
    file = tmp_path / "mine" / "agents.json.gz"
    data = json.loads(gzip.decompress(file.read_bytes()))
    data["scenes"][0]["origin"] = [3, 5]
    file.write_bytes(gzip.compress(json.dumps(data).encode()))
    build.write(tmp_path, "mine")
    opened = open_page(tmp_path / "mine")
    numbers = opened.panel("left", ".map text").all_text_contents()
    assert numbers == ["−2", "0", *("−4", "−2", "0")]  # of five rows and seven columns, every second
    opened.cell("left", 4, 3).hover()
    assert "Row 1, column −2" in opened.panel("left", ".readout").inner_text()
    assert "Rows and columns are counted from the issuer." in opened.panel("left", ".about").inner_text()
    opened.walk(1)
    assert "1 step from row −3, column −5." in opened.panel("left", ".walked").inner_text()


def test_maps_of_the_same_size_follow_each_other(opened: Opened) -> None:
    def places() -> list[str]:
        titles = [opened.panel(side, ".readout p").first.inner_text() for side in ("left", "right")]
        return [title.partition(",")[0] + title.partition(",")[2].partition(",")[0] for title in titles]

    opened.cell("left", 4, 6).hover()
    assert places() == ["Row 4 column 6"] * 2
    opened.panel("right", ".map").focus()
    opened.page.keyboard.press("ArrowLeft")
    assert places() == ["Row 4 column 5"] * 2
    opened.choose("right", "S2", *TABLE)
    opened.cell("left", 2, 3).hover()
    assert places() == ["Row 2 column 3", "Row 0 column 0"]
    for side, ratio in (("left", 7 / 5), ("right", 12 / 10)):
        box = opened.panel(side, ".map svg > g:first-child").bounding_box()
        assert box is not None
        assert box["width"] / box["height"] == pytest.approx(ratio, rel=0.02)


def test_cells_without_preference_are_hatched_and_scores_below_zero_drawn_at_zero(
    opened: Opened, learners: Learners
) -> None:
    for side in ("left", "right"):
        opened.choose(side, "S2", *TABLE)
    population = learners["S2", *TABLE]
    shown = population.map_indices[shown_maps(population)]
    greedy, scores = population.agents[0]["greedy"][shown], population.unbounded_scores[0, shown]
    is_over = population.model.is_over[population.model.fresh_state]
    for place in (0, 3, 10):
        opened.to_map(place)
        n_alike = int((contains(greedy[place]).all(axis=1) & ~is_over).sum())
        hatch = str(opened.panel("left", ".hatch").get_attribute("d"))
        assert hatch.count("M") == 3 * n_alike
        assert (n_alike == (~is_over).sum()) == (place == 0)
    curve = opened.panel("left", ".curve")
    lowest = float(str(curve.locator(".anchor").first.get_attribute("y1")))
    places = curve.locator("circle").evaluate_all("all => all.map((one) => Number(one.getAttribute('cy')))")
    assert (scores < 0).any()
    assert [place == lowest for place in places] == (scores <= 0).tolist()


def box_of(opened: Opened, selector: str) -> dict[str, float]:
    """Returns where the first such element is in the window."""
    box = opened.page.locator(selector).first.bounding_box()
    assert box is not None
    return {"x": box["x"], "y": box["y"], "width": box["width"], "height": box["height"]}


def test_answer_and_explorer_fit_a_laptop(open_page: Open) -> None:
    fragment = "#explorer=S2.a-table_b.index~S2.ppo.one_hot~1600~values"
    opened = open_page(viewport={"width": 1366, "height": 768}, reduced_motion="reduce", fragment=fragment)

    def assert_in_view(selector: str) -> None:
        box = box_of(opened, selector)
        assert box["x"] >= 0 <= box["y"], selector
        assert box["x"] + box["width"] <= 1366, selector
        assert box["y"] + box["height"] <= 768, selector

    assert_in_view("#step")
    for side in ("left", "right"):
        panel = f".panel[data-side={side}]"
        for part in (".legend", ".map svg", ".readout table", ".curve svg"):
            assert_in_view(f"{panel} {part}")
    opened.page.evaluate("scrollTo(0, 0)")
    parts = ("h1", "#finding img", ".lead", "nav")
    for part in parts[:-1]:
        assert_in_view(part)
    tops = [box_of(opened, part)["y"] for part in parts]
    assert tops == sorted(tops)
    assert box_of(opened, "#finding img")["height"] > 768 / 2


def test_names_of_rows_stay_in_view_on_a_phone(open_page: Open) -> None:
    opened = open_page(viewport={"width": 390, "height": 844})
    table = opened.page.locator("[data-item=summary]").first
    table.evaluate("table => { table.parentElement.scrollLeft = 300 }")
    assert table.evaluate("table => table.parentElement.scrollLeft") == 300
    box = box_of(opened, "[data-item=summary] tbody td")
    assert 0 <= box["x"] <= 20
    assert box["width"] < 390 / 2


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_accessibility(open_page: Open, width: int, scheme: str) -> None:
    fragment = "#explorer=S2.ppo.one_hot~room.a-table_b.index~1600~values"
    opened = open_page(fragment=fragment, color_scheme=scheme, viewport={"width": width, "height": 844})
    assert opened.page.evaluate("document.documentElement.scrollWidth") == width  # nothing sticks out
    opened.page.locator("details").evaluate_all("all => all.forEach((details) => { details.open = true })")
    opened.walk(1)
    for context in ("body", "dialog"):
        found = Axe().run(opened.page, context=context).response["violations"]
        serious = [each for each in found if each["impact"] in ("serious", "critical")]
        assert [(each["id"], each["nodes"][0]["html"]) for each in serious] == []
        opened.page.locator("#explorer a.n").first.evaluate("link => link.click()")
