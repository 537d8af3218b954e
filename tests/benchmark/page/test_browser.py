"""The page in a real browser: the explorer, sorting, sources, accessibility."""

import base64
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from numpy.typing import NDArray
from PIL import Image

from agents.policy import contains
from benchmark.__main__ import main
from benchmark.analysis.walk import CIRCLE, HORIZON, Walk, walk
from benchmark.page import build, script
from benchmark.reports import Item, Report, texts
from benchmark.reports.published import Published
from benchmark.reports.texts import load
from envs import ACTIONS, Model, Scenario, compile_scenario
from envs.scene import colour_limits
from tests.benchmark.page.pages import Open, Opened, number, rows_of, unpacked

SCENARIOS = Path(__file__).parents[3] / "envs" / "scenarios"


@pytest.mark.parametrize(
    ("scenario", "algorithm", "observation", "step", "cell"),
    [("S1", "q_learning", "index", 4800, (4, 6)), ("S3", "dqn", "coordinates", 10000, (3, 2)),
     ("S2", "ppo", "one_hot", 1600, (9, 11))],
)  # fmt: skip
def test_explorer_shows_the_numbers_of_the_files(
    opened: Opened, results: Path, scenario: str, algorithm: str, observation: str, step: int,
    cell: tuple[int, int],
) -> None:  # fmt: skip
    opened.choose("right", scenario, algorithm, observation)
    folder = results / "compare_deep"
    opened.to_step(step, folder)
    opened.cell("right", *cell).hover()
    readout = opened.panel("right").locator(".readout")
    assert f"Row {cell[0]}, column {cell[1]}" in readout.inner_text()

    where = f"algorithm == '{algorithm}' and observation == '{observation}'"
    maps = pd.read_csv(folder / f"agent_{scenario}.csv").query(where)
    row = maps.query(f"step == {step} and row == {cell[0]} and column == {cell[1]}").iloc[0]
    lines = [line.split("\t") for line in readout.locator("tbody").inner_text().splitlines()]
    assert [line[0] for line in lines] == list(ACTIONS)
    assert [number(line[1]) for line in lines] == pytest.approx([row[action] for action in ACTIONS])
    greedy = [line[0] for line in lines if "greedy" in line[4]]
    assert "|".join(greedy) == row["greedy"]
    # The link leads to that row, which the dialog shows as it is in the file.
    target = str(readout.locator("a.n").first.get_attribute("href"))
    place_in_file = int(target.partition("#row=")[2])
    written = rows_of(folder / f"agent_{scenario}.csv")[place_in_file - 1]
    assert written[2:5] == [str(step), str(cell[0]), str(cell[1])]
    for link, file in ((0, f"agent_{scenario}.csv"), (1, "optimum.csv")):
        target = str(readout.locator("a.n").nth(link).get_attribute("href"))
        readout.locator("a.n").nth(link).click()
        dialog = opened.page.locator("dialog[open]")
        assert file in dialog.locator("h2").inner_text()
        lines_of_file = rows_of(folder / file)
        shown = dict(zip(lines_of_file[0], lines_of_file[int(target.partition("#row=")[2]) - 1], strict=True))
        cells = [line.split("\t") for line in dialog.locator("tbody").inner_text().splitlines()]
        assert dict(cells) == shown
        opened.page.keyboard.press("Escape")
        assert opened.page.locator("dialog[open]").count() == 0

    score = pd.read_csv(folder / "agent.csv").query(
        f"{where} and scenario == '{scenario}' and step == {step}"
    )
    link_text = opened.panel("right").locator(".about a.n").first.inner_text()
    assert number(link_text) == pytest.approx(score["score"].iloc[0], abs=0.0005)


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
    opened.walk(round(row["steps"].iloc[-1]))
    summary = opened.panel("left").locator(".walked").inner_text()
    assert f"{round(row['steps'].iloc[-1])} steps from row 0, column 0" in summary
    assert ("success" in summary) == (row["success"].iloc[-1] == 1)


def fills(opened: Opened, side: str = "left") -> list[str]:
    """Returns the colours of a map's moves."""
    shapes = opened.panel(side).locator(".map svg > g").first.locator("polygon")
    return list(shapes.evaluate_all("shapes => shapes.map((shape) => shape.getAttribute('fill'))"))


def test_slider_shows_learning_and_the_address_keeps_it(
    opened: Opened, results: Path, open_page: Open
) -> None:
    opened.to_map(0)
    assert len(set(fills(opened))) == 1  # a table knows nothing at first
    opened.to_step(4000, results / "compare_deep")
    assert len(set(fills(opened))) > 8
    assert opened.page.locator("#step-text").inner_text() == "4,000 of 10,000"
    opened.page.locator("#shown").select_option("difference")
    opened.page.wait_for_function("location.hash.endsWith('difference')")
    again = open_page(fragment=opened.page.evaluate("location.hash"))
    assert fills(again) == fills(opened)
    assert again.page.locator("#shown").input_value() == "difference"


@pytest.mark.parametrize("fragment", ["%", "nowhere.%E0.x~~nothing~7~~", "S2.dqn~.~-3~"])
def test_mistyped_address_is_taken_as_far_as_it_goes(open_page: Open, fragment: str) -> None:
    readout = open_page(fragment=f"#explorer={fragment}").panel("left").locator(".readout")
    assert "Row 0, column 0" in readout.inner_text()


def test_address_names_the_experiment(open_page: Open) -> None:
    agent = "S1.q_learning.index"
    opened = open_page(fragment=f"#explorer={agent}.reproduce~{agent}.compare_deep~2000~values")
    for side, expected in (("left", "reproduce"), ("right", "compare_deep")):
        assert opened.panel(side).locator("select[name=experiment]").input_value() == expected
        source = opened.panel(side).locator(".about a.n").first.get_attribute("href")
        assert str(source).startswith(f"{expected}/agent.csv#row=")
    assert fills(opened, "left") != fills(opened, "right")  # two experiments draw from different streams


@pytest.mark.parametrize("scenario", ["S1", "S2"])
def test_scale_ends_at_the_limits_of_every_back_end(opened: Opened, results: Path, scenario: str) -> None:
    for side in ("left", "right"):
        opened.choose(side, scenario, "dqn", "one_hot")
    maps = pd.read_csv(results / "compare_deep" / f"agent_{scenario}.csv")
    maps = maps.query("algorithm == 'dqn' and observation == 'one_hot'")
    values = maps[~((maps["row"] == 6) & (maps["column"] == 8))][list(ACTIONS)]  # not where the issuer stands
    low, high = colour_limits(values.to_numpy())
    legend = opened.panel("left").locator(".legend")
    assert legend.locator(".low").inner_text() == f"≤ {low:.2f}".replace("-", "−").rstrip("0").rstrip(".")
    assert legend.locator(".high").inner_text() == f"≥ {high:.2f}".rstrip("0").rstrip(".")


def boxes(opened: Opened) -> list[dict[str, float]]:
    """Returns the boxes around the outlines of the left map, in cells."""
    paths = opened.panel("left").locator(".map svg > path")
    found = paths.evaluate_all("all => all.map((path) => { const { x, y, width, height } = path.getBBox(); "
                               "return { x, y, width, height }; })")  # fmt: skip
    return [{key: (length - (20 if key == "x" else 0)) / 30 for key, length in box.items()} for box in found]


def test_outlines_surround_the_regions(opened: Opened) -> None:
    # In S1 the issuer stands at row 6, column 8; the regions reach two cells and one cell away from it.
    target = {"x": 6, "y": 4, "width": 5, "height": 5}
    uncomfortable = {"x": 7, "y": 5, "width": 3, "height": 3}
    assert boxes(opened) == [target, target, uncomfortable, uncomfortable]  # a border and a line each


def test_scene_is_painted_as_it_is_given(results: Path, tmp_path: Path, open_page: Open) -> None:
    """A region of two parts, and states in another order: the script must not know better."""
    text = (results / "index.html").read_text(encoding="utf-8")
    data = unpacked(text)
    rng = np.random.default_rng(1)
    for scene in data["explorer"]["scenes"]:
        corner = [[0, 10], [0, 12], [2, 12], [2, 10]]
        scene["outlines"][0]["loops"].append(corner)
        n_states = len(scene["observation"])
        place = rng.permutation(n_states)  # of each state, in the new order
        order = np.argsort(place)
        scene["fresh"] = place[scene["fresh"]].tolist()
        scene["observation"] = np.array(scene["observation"])[order].tolist()
        scene["next"] = place[np.array(scene["next"])].reshape(n_states, -1)[order].ravel().tolist()
        for name in ("terminated", "event", "grid_reward", "issuer_reward"):
            scene[name] = np.array(scene[name]).reshape(n_states, -1)[order].ravel().tolist()
    before, _, after = text.partition('id="data">')
    (tmp_path / "index.html").write_text(
        f'{before}id="data">{script.pack(data)}<{after.partition("<")[2]}', encoding="utf-8"
    )
    fragment = "#explorer=S2.q_learning.index~S3.dqn.one_hot~10000~values"
    as_given, as_published = open_page(tmp_path, fragment), open_page(results, fragment)
    for opened in (as_given, as_published):
        opened.walk(30)
    for side in ("left", "right"):
        walks = [opened.panel(side).locator(".walk").inner_text() for opened in (as_given, as_published)]
        assert walks[0] == walks[1]
        assert len(walks[0].splitlines()) > 10
    assert boxes(as_given)[0] == {"x": 6, "y": 0, "width": 6, "height": 9}


def test_another_address_is_followed_on_the_open_page(opened: Opened) -> None:
    opened.page.evaluate("location.hash = '#explorer=S3.ppo.coordinates~S2.dqn.one_hot~1600~ping'")
    opened.page.wait_for_function("document.getElementById('step-text').textContent === '1,600 of 10,000'")
    assert opened.panel("left").locator("select[name=scenario]").input_value() == "S3"
    assert opened.panel("right").locator("select[name=algorithm]").input_value() == "dqn"
    assert opened.page.locator("#shown").input_value() == "ping"


def test_explorer_by_keyboard_alone(opened: Opened) -> None:
    opened.panel("left").locator(".map").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowLeft"):
        opened.page.keyboard.press(key)
    assert "Row 1, column 0" in opened.panel("left").locator(".readout").inner_text()
    opened.page.keyboard.press("Enter")
    assert "The agent is at row 1, column 0." in opened.panel("left").locator(".walked").inner_text()
    opened.page.locator("#step").focus()
    opened.page.keyboard.press("Home")
    assert opened.page.locator("#step-text").inner_text().startswith("0 of")
    opened.page.locator("#learn").focus()
    opened.page.keyboard.press("Enter")
    opened.page.wait_for_function("document.getElementById('step').value >= 2")
    opened.page.keyboard.press("Enter")
    assert opened.page.locator("#learn").get_attribute("aria-pressed") == "false"


def test_tables_sort(opened: Opened) -> None:
    table = opened.page.locator("#cost table.sortable").first
    column = table.locator("th").evaluate_all("all => all.findIndex((head) => head.matches('.number'))") + 1

    def shown() -> list[float]:
        cells = table.locator(f"tbody td:nth-child({column})").all_inner_texts()
        return [number(cell.split(" ")[0].replace(",", "")) for cell in cells]

    written = shown()
    assert written not in (sorted(written), sorted(written, reverse=True))
    for expected in (sorted(written), sorted(written, reverse=True), written):
        table.locator(f"th:nth-child({column}) button").click()
        assert shown() == expected


def test_number_of_several_rows_shows_them_all(opened: Opened, results: Path) -> None:
    link = opened.page.locator("a.n[href*='curves.csv#row=']").first
    first, last = map(int, str(link.get_attribute("href")).partition("#row=")[2].split("-"))
    link.click()
    shown = opened.page.locator("dialog tbody tr")
    assert shown.count() == last - first + 1
    expected = rows_of(results / "compare_deep" / "curves.csv")[first - 1]
    assert shown.first.locator("td").all_inner_texts() == expected


def test_without_javascript_all_but_the_explorer_is_there(open_page: Open) -> None:
    opened = open_page(java_script_enabled=False)
    text = opened.page.locator("body").inner_text()
    assert "The task" in text
    assert "The explorer needs JavaScript" in text
    assert opened.page.locator("table:visible").count() >= 4
    assert opened.page.locator("img:visible").count() >= 6
    assert opened.page.locator("#explore:visible").count() == 0


def test_number_is_marked_in_the_dialog(opened: Opened, results: Path) -> None:
    link = opened.page.locator("#comparison table a.n[href*='summary.csv#row=']").first
    target, shown = str(link.get_attribute("href")), link.inner_text().split(" ")[0]
    link.click()
    assert shown in opened.page.locator("dialog p").first.inner_text()
    lines = rows_of(results / "compare_deep" / "summary.csv")
    row = dict(zip(lines[0], lines[int(target.partition("#row=")[2]) - 1], strict=True))
    marked = opened.page.locator("dialog th.cited").all_inner_texts()
    assert marked
    assert {float(row[name]) for name in marked} == {float(shown)}


def test_mean_of_several_lines_says_so(opened: Opened, results: Path) -> None:
    link = opened.page.locator("li a.n[href*='curves.csv#row=']").first
    first, last = map(int, str(link.get_attribute("href")).partition("#row=")[2].split("-"))
    link.click()
    summary = opened.page.locator("dialog p").first.inner_text()
    found = re.fullmatch(r"Shown as (\S+), the mean of (\w+) over these lines\.", summary)
    assert found is not None
    frame = pd.read_csv(results / "compare_deep" / "curves.csv").iloc[first - 2 : last - 1]
    assert float(found[1]) == pytest.approx(frame[found[2]].mean(), rel=0.005)


ENDINGS = {
    "target_ping": "PING in the target region: success.",
    "issuer_reached": "The agent ran into the issuer, and the episode ended.",
    "last_wrong_ping": "One wrong PING too many, and the episode ended.",
    CIRCLE: "and would do so until the limit of {horizon} steps.",
    HORIZON: "The limit of {horizon} steps is reached.",
}


def walks_of(folder: Path) -> dict[tuple[str, str, str, int], tuple[Model, Walk, NDArray[np.bool_]]]:
    """Returns Python's walk by every map of a folder, and which of its steps had a choice."""
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    found = {}
    for scenario, declared in manifest["scenarios"].items():
        model = compile_scenario(Scenario.model_validate_json(json.dumps(declared)))
        maps = pd.read_csv(folder / f"agent_{scenario}.csv")
        for (arm, observation, step), rows in maps.groupby(["algorithm", "observation", "step"]):
            is_greedy = np.array(
                [[action in names.split("|") for action in ACTIONS] for names in rows["greedy"]]
            )
            masks = (is_greedy @ (1 << np.arange(len(ACTIONS)))).astype(np.uint8)
            taken = walk(model, masks, manifest["horizon"])
            had_choice = is_greedy[list(taken.cells[:-1])].sum(axis=1) > 1
            found[scenario, str(arm), str(observation), int(str(step))] = model, taken, had_choice
    return found


def test_script_walks_as_python_does(opened: Opened, results: Path) -> None:
    walks = walks_of(results / "compare_deep")
    kinds: dict[tuple[str, bool], list[tuple[str, str, str, int]]] = {}
    for key, (_, taken, had_choice) in walks.items():
        kinds.setdefault((taken.ending, bool(had_choice.any())), []).append(key)
    assert {(CIRCLE, False), ("target_ping", False), ("target_ping", True)} <= set(kinds)
    chosen = [key for alike in kinds.values() for key in alike[:: len(alike) // 2 + 1]]
    for key in chosen:
        model, taken, had_choice = walks[key]
        *agent, step = key
        opened.page.evaluate(f"location.hash = '#explorer={'.'.join(agent)}~{'.'.join(agent)}~{step}~values'")
        label = f"Map of {agent[1]}, {agent[2]}, in {agent[0]}, step {step}, "
        opened.page.wait_for_function(
            "label => document.querySelector('.map').ariaLabel.startsWith(label)", arg=label
        )
        assert_walks(opened, model, taken, had_choice)


def assert_walks(
    opened: Opened, model: Model, taken: Walk, had_choice: NDArray[np.bool_], horizon: int = 200
) -> None:
    """Checks that the left agent walks from the start as Python's walk does."""
    opened.page.locator("#walk-again").click()
    opened.walk(len(taken.actions) + 5)
    summary = opened.panel("left").locator(".walked").inner_text()
    n_steps = len(taken.actions)
    assert summary.startswith(f"{n_steps} step{'s' if n_steps > 1 else ''} from row 0, column 0.")
    assert summary.endswith(ENDINGS[taken.ending].format(horizon=horizon))
    lines = opened.panel("left").locator(".walk tbody").inner_text().splitlines()[::-1]
    cells = [re.findall(r"\t([^\t]+)\t([A-Z]+)( \(tie of \d\))?\t", line)[0] for line in lines]
    positions = model.position[list(taken.cells[:-1])].tolist()
    assert [where for where, _, _ in cells] == [f"row {row}, column {column}" for row, column in positions]
    assert [action for _, action, _ in cells] == [ACTIONS[action] for action in taken.actions]
    assert [bool(tie) for _, _, tie in cells] == had_choice.tolist()


def test_walk_starts_again_when_training_goes_on(opened: Opened) -> None:
    opened.walk(3)
    assert "3 steps from" in opened.panel("left").locator(".walked").inner_text()
    opened.to_map(7)
    for side in ("left", "right"):
        assert opened.panel(side).locator(".walked").inner_text() == "The agent is at row 0, column 0."


def test_page_without_snapshots(results: Path, tmp_path: Path, open_page: Open) -> None:
    shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    for file in (tmp_path / "reproduce").glob("agent*.csv"):
        file.unlink()
    build.write(tmp_path)
    opened = open_page(tmp_path)
    assert opened.page.locator("#explorer, a[href='#explorer']").count() == 0
    assert opened.page.locator("th button").count() > 0  # tables sort
    opened.page.locator("table a.n").first.click()
    assert opened.page.locator("dialog[open] tbody tr").count() > 0


ANOTHER = """
description = "Two <b>scenes</b> | of different size."
report = "comparison"
scenarios = ["room.toml", "S2"]
horizon = 100
evaluation_every = 100
map_every = 200
settings = { time_limit = 50 }
[algorithms."a-table_b"]
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
def another(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of an experiment with other scenes, budgets and rewards, and a net that diverges."""
    folder = tmp_path_factory.mktemp("another")
    scene = (SCENARIOS / "S1.toml").read_text(encoding="utf-8")
    for key, value in (("rows", 5), ("columns", 7), ("position", [3, 5]), ("target_ping", 100.0)):
        scene, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", scene)
        assert count == 1
    (folder / "room.toml").write_text(scene, encoding="utf-8")
    text = ANOTHER.replace('"room.toml"', json.dumps(str(folder / "room.toml")))
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(folder / "mine.toml"), "--report", "--jobs", "1", "--results", str(folder)]) == 0
    return folder / "mine"


def test_page_of_another_experiment(another: Path, open_page: Open) -> None:
    text = (another / "index.html").read_text(encoding="utf-8")
    assert "Two &lt;b&gt;scenes&lt;/b&gt; | of different size." in text
    index = (another.parent / "README.md").read_text(encoding="utf-8")
    assert r"Two &#60;b>scenes&#60;/b> \| of different size." in index
    opened = open_page(another)
    assert opened.page.locator("#step-text").inner_text() == "1,000 of 1,000"
    assert opened.page.locator("select[name=experiment]:visible").count() == 0
    opened.choose("left", "room", "a-table_b", "index")
    opened.choose("right", "room", "dqn", "coordinates")
    about = opened.panel("right").locator(".about").inner_text()
    assert about.startswith("At step 300: Q-values, discount 0.99.")
    assert "This net has diverged" in about
    # A correct PING pays far more than in the paper.
    optimum = pd.read_csv(another / "optimum.csv").query("scenario == 'room' and discount == 1")
    shown = opened.panel("left").locator(".readout tbody tr").first.locator("td").nth(1).inner_text()
    assert number(shown) == pytest.approx(optimum["UP"].iloc[0])
    assert number(shown) > 90
    # The target region reaches two cells from row 3, column 5, and is cut by the edge of the 5 x 7 cells.
    assert boxes(opened)[0] == {"x": 3, "y": 1, "width": 4, "height": 4}
    opened.panel("left").locator(".readout a.n").nth(1).click()
    row = rows_of(another / "optimum.csv")[1]
    cells = [line.split("\t") for line in opened.page.locator("dialog tbody").inner_text().splitlines()]
    assert [value for _, value in cells] == row
    opened.page.keyboard.press("Escape")
    opened.page.wait_for_function("location.hash.includes('a-table_b')")
    again = open_page(another, opened.page.evaluate("location.hash"))
    assert again.panel("left").locator("select[name=algorithm]").input_value() == "a-table_b"


def test_film_of_scenes_and_budgets_that_differ(another: Path) -> None:
    with Image.open(another / "learning.webp") as film:
        assert getattr(film, "n_frames", 1) == 7  # steps 0, 200, ... 1000, and 300
        # Each column is as wide as its widest scene, of 7 and 12 cells.
        assert film.width >= (7 + 12) * 21 + 10


def masks_of(letters: str) -> NDArray[np.uint8]:
    """Returns the masks of greedy actions that letters stand for, as in base64."""
    padded = letters + "A" * (-len(letters) % 4)
    bits = np.unpackbits(np.frombuffer(base64.b64decode(padded), np.uint8)).reshape(-1, 6)
    return np.asarray(bits @ (1 << np.arange(6)[::-1]), dtype=np.uint8)[: len(letters)]


def to_seed(opened: Opened, side: str, seed: object) -> None:
    """Chooses a seed."""
    opened.panel(side).locator("select[name=seed]").select_option(str(seed))


def test_any_seed_can_be_chosen(another: Path, open_page: Open) -> None:
    opened = open_page(another)
    opened.choose("left", "S2", "a-table_b", "index")
    seeds = opened.panel("left").locator("select[name=seed] option").all_inner_texts()
    assert seeds == ["0", "1"]
    to_seed(opened, "left", 1)
    for place in (0, 2):
        opened.to_map(place)
        about = opened.panel("left").locator(".about")
        assert "Of this agent only the final greedy policy is published." in about.inner_text()
        assert "(seed 1)" in about.inner_text()
    agents = pd.read_csv(another / "agents.csv", dtype={"greedy": str})
    row = agents.query("scenario == 'S2' and algorithm == 'a-table_b' and seed == 1").iloc[0]
    for link, name in enumerate(("score", "success")):
        shown = about.locator("a.n").nth(link)
        assert number(shown.inner_text()) == pytest.approx(row[name], abs=0.0005)
        assert shown.get_attribute("href") == f"agents.csv#row={int(str(row.name)) + 2}"
    about.locator("a.n").first.click()
    cells = [line.split("\t")[1] for line in opened.page.locator("dialog tbody").inner_text().splitlines()]
    assert cells == rows_of(another / "agents.csv")[int(str(row.name)) + 1]
    opened.page.keyboard.press("Escape")

    optimum = pd.read_csv(another / "optimum.csv").query("scenario == 'S2' and discount == 1")
    masks = masks_of(row["greedy"])
    for place in (0, 15, 64):
        opened.cell("left", place // 12, place % 12).hover()
        lines = opened.panel("left").locator(".readout tbody").inner_text().splitlines()
        shown_words = {line.split("\t")[0]: line.split("\t")[2] for line in lines}
        optimal = optimum["optimal"].iloc[place].split("|")
        for i, action in enumerate(ACTIONS):
            assert ("greedy" in shown_words[action]) == bool(masks[place] >> i & 1)
            assert ("optimal" in shown_words[action]) == (action in optimal)

    # The address keeps the seed; one without seeds shows the first.
    opened.page.wait_for_function("location.hash.split('~')[0].endsWith('.1')")
    address = opened.page.evaluate("location.hash")
    for fragment, expected in ((address, "1"), (address.replace(".1~", "~", 1), "0")):
        again = open_page(another, fragment)
        assert again.panel("left").locator("select[name=algorithm]").input_value() == "a-table_b"
        assert again.panel("left").locator("select[name=seed]").input_value() == expected


def test_agent_of_any_seed_walks_as_python_does(another: Path, open_page: Open) -> None:
    opened = open_page(another)
    manifest = json.loads((another / "manifest.json").read_text(encoding="utf-8"))
    agents = pd.read_csv(another / "agents.csv", dtype={"greedy": str}).query("seed == 1")
    assert len(agents) == 4
    for _, row in agents.iterrows():
        declared = json.dumps(manifest["scenarios"][row["scenario"]])
        model = compile_scenario(Scenario.model_validate_json(declared))
        masks = masks_of(row["greedy"])
        taken = walk(model, masks, manifest["horizon"])
        had_choice = contains(masks)[list(taken.cells[:-1])].sum(axis=1) > 1
        opened.choose("left", row["scenario"], row["algorithm"], row["observation"])
        to_seed(opened, "left", 1)
        assert_walks(opened, model, taken, had_choice, manifest["horizon"])


def test_final_policies_are_those_of_the_last_maps(another: Path) -> None:
    agents = pd.read_csv(another / "agents.csv", dtype={"greedy": str})
    for _, row in agents.query("seed == 0").iterrows():
        maps = pd.read_csv(another / f"agent_{row['scenario']}.csv")
        learner = (maps["algorithm"] == row["algorithm"]) & (maps["observation"] == row["observation"])
        last = maps[learner & (maps["step"] == maps[learner]["step"].max())]
        names = ["|".join(np.array(ACTIONS)[each]) for each in contains(masks_of(row["greedy"]))]
        assert names == last["greedy"].tolist()


def readouts(opened: Opened) -> list[str]:
    """Returns the titles of both readouts."""
    return [opened.panel(side).locator(".readout p").first.inner_text() for side in ("left", "right")]


def test_both_maps_follow_the_pointer(opened: Opened) -> None:
    opened.cell("left", 4, 6).hover()
    assert [title.partition(", in ")[0] for title in readouts(opened)] == ["Row 4, column 6"] * 2
    opened.cell("right", 9, 0).hover()
    assert all(title.startswith("Row 9, column 0") for title in readouts(opened))
    opened.panel("left").locator(".map").focus()
    opened.page.keyboard.press("ArrowRight")
    assert all(title.startswith("Row 9, column 1") for title in readouts(opened))


def test_maps_of_different_size_do_not_follow_each_other(another: Path, open_page: Open) -> None:
    opened = open_page(another)
    opened.choose("left", "room", "a-table_b", "index")
    opened.choose("right", "S2", "a-table_b", "index")
    opened.cell("left", 2, 3, n_columns=7).hover()
    left, right = readouts(opened)
    assert left.startswith("Row 2, column 3")
    assert right.startswith("Row 0, column 0")
    for side, ratio in (("left", 7 / 5), ("right", 12 / 10)):
        box = opened.panel(side).locator(".map svg > g").first.bounding_box()
        assert box is not None
        assert box["width"] / box["height"] == pytest.approx(ratio, rel=0.02)


def test_cells_without_preference_are_hatched(opened: Opened, results: Path) -> None:
    opened.choose("left", "S1", "q_learning", "index")
    folder = results / "compare_deep"
    maps = pd.read_csv(folder / "agent_S1.csv").query("algorithm == 'q_learning'")
    maps = maps[~((maps["row"] == 6) & (maps["column"] == 8))]  # not where the issuer stands
    for step in (0, 4000, 10000):
        opened.to_step(step, folder)
        values = maps[maps["step"] == step][list(ACTIONS)]
        n_alike = int((values.nunique(axis=1) == 1).sum())
        hatch = str(opened.panel("left").locator(".hatch").get_attribute("d"))
        assert hatch.count("M") == 3 * n_alike
        assert (n_alike == len(values)) == (step == 0)
    assert "no preference" in opened.page.locator("#key").inner_text()


def test_scores_below_zero_are_drawn_at_zero(opened: Opened, results: Path) -> None:
    opened.choose("left", "S1", "q_learning", "index")
    curve = opened.panel("left").locator(".curve")
    assert "Scores below 0 are drawn at 0." in curve.inner_text()
    lowest = float(str(curve.locator(".anchor").first.get_attribute("y1")))
    places = curve.locator("circle").evaluate_all(
        "all => all.map((circle) => Number(circle.getAttribute('cy')))"
    )
    where = "scenario == 'S1' and algorithm == 'q_learning'"
    scores = pd.read_csv(results / "compare_deep" / "agent.csv").query(where)["score"]
    assert (scores < 0).any()
    assert [place == lowest for place in places] == (scores <= 0).tolist()


def box_of(opened: Opened, selector: str) -> dict[str, float]:
    """Returns where the first such element is in the window."""
    box = opened.page.locator(selector).first.bounding_box()
    assert box is not None
    return {"x": box["x"], "y": box["y"], "width": box["width"], "height": box["height"]}


def is_in_view(opened: Opened, selector: str) -> bool:
    """Returns whether the first such element is in the window as a whole."""
    box, size = box_of(opened, selector), opened.page.viewport_size
    assert size is not None
    fits_across = box["x"] >= 0 and box["x"] + box["width"] <= size["width"]
    return fits_across and box["y"] >= 0 and box["y"] + box["height"] <= size["height"]


LAPTOP = {"width": 1366, "height": 768}


def test_explorer_fits_a_laptop(open_page: Open) -> None:
    opened = open_page(viewport=LAPTOP, reduced_motion="reduce")
    opened.page.locator("#explorer").evaluate("element => element.scrollIntoView()")
    assert is_in_view(opened, "#step")
    for side in ("left", "right"):
        panel = f".panel[data-side={side}]"
        for part in (".legend", ".map svg", ".readout table", ".curve svg"):
            assert is_in_view(opened, f"{panel} {part}"), (side, part)
        table, readout = box_of(opened, f"{panel} .readout table"), box_of(opened, f"{panel} .readout")
        assert table["width"] <= readout["width"]
        legend = box_of(opened, f"{panel} .legend")
        assert legend["y"] + legend["height"] <= box_of(opened, f"{panel} .map svg")["y"]


def test_answer_fits_the_first_screen(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, open_page: Open
) -> None:
    def led_by_curves(published: Published) -> tuple[Report, tuple[Item, ...]]:
        report, items = load(published)
        return replace(report, lead="curves"), items

    shutil.copytree(results / "compare_deep", tmp_path / "compare_deep")
    monkeypatch.setattr(texts, "load", led_by_curves)
    build.write(tmp_path)
    opened = open_page(tmp_path, viewport=LAPTOP)
    parts = ("h1", "#finding img", ".lead")
    assert all(is_in_view(opened, part) for part in parts)
    tops = [box_of(opened, part)["y"] for part in (*parts, "nav")]
    assert tops == sorted(tops)
    assert box_of(opened, "#finding img")["height"] > 768 / 2


def test_names_of_rows_stay_in_view_on_a_phone(open_page: Open, results: Path) -> None:
    opened = open_page(viewport={"width": 390, "height": 844})
    table = opened.page.locator("#comparison table", has_text="Each scenario and learner")
    first = table.locator("tbody td").first
    table.evaluate("table => { table.parentElement.scrollLeft = 300 }")
    assert table.evaluate("table => table.parentElement.scrollLeft") == 300
    box = first.bounding_box()
    assert box is not None
    assert 0 <= box["x"] <= 20
    assert box["width"] < 390 / 2
    key = pd.read_csv(results / "compare_deep" / "summary.csv").iloc[0]
    assert first.inner_text() == key["scenario"]
    others = first.evaluate("cell => getComputedStyle(cell, '::after').content")
    assert others == f'"{key["algorithm"]}\\a {key["observation"]}"'
    assert not table.locator("tbody td").nth(1).is_visible()


@pytest.mark.parametrize("has_scripts", [True, False])
def test_term_is_explained_where_it_appears(open_page: Open, results: Path, has_scripts: bool) -> None:
    opened = open_page(java_script_enabled=has_scripts)
    term = opened.page.locator("#finding .term").first
    published = Published(results / "compare_deep")
    report, _ = load(published)
    explanation = opened.page.locator(f"#{term.get_attribute('popovertarget')}")
    assert not explanation.is_visible()
    term.focus()
    opened.page.keyboard.press("Enter")
    assert explanation.is_visible()
    assert explanation.inner_text().partition(":")[0] in dict(report.words(published))
    opened.page.keyboard.press("Escape")
    assert not explanation.is_visible()
    term.click()
    assert explanation.is_visible()


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_accessibility(open_page: Open, width: int, scheme: str) -> None:
    fragment = "#explorer=S2.ppo.one_hot~S3.q_learning.index~4000~values"
    opened = open_page(fragment=fragment, color_scheme=scheme, viewport={"width": width, "height": 844})
    assert opened.page.evaluate("document.documentElement.scrollWidth") == width  # nothing sticks out
    opened.page.locator("details").evaluate_all("all => all.forEach((details) => { details.open = true })")
    opened.walk(1)
    found = Axe().run(opened.page).response["violations"]
    serious = [f"{v['id']}: {v['nodes'][0]['html']}" for v in found if v["impact"] in ("serious", "critical")]
    assert serious == []
    opened.page.locator("#explorer a.n").first.click()
    found = Axe().run(opened.page, context="dialog").response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []
