"""The page in a real browser: the explorer, sorting, sources, accessibility."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from numpy.typing import NDArray
from PIL import Image

from benchmark.__main__ import main
from benchmark.analysis.walk import CIRCLE, HORIZON, Walk, walk
from benchmark.page import build, script
from envs import ACTIONS, Model, Scenario, compile_scenario
from envs.scene import colour_limits
from tests.benchmark.page.pages import Open, Opened, number, rows_of, unpacked

SCENARIOS = Path(__file__).parents[3] / "envs" / "scenarios"


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
    opened.to_map(place)
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
    target = str(readout.locator("a.n").first.get_attribute("href"))
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
        cells = [line.split("\t") for line in dialog.locator("tbody").inner_text().splitlines()]
        assert dict(cells) == shown
        opened.page.keyboard.press("Escape")
        assert opened.page.locator("dialog[open]").count() == 0

    score = pd.read_csv(folder / "agent.csv").query(f"{where} and scenario == '{scenario}'").iloc[place]
    link_text = opened.panel("right").locator(".about a.n").first.inner_text()
    assert number(link_text) == pytest.approx(score["score"], abs=0.0005)


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
    opened.to_map(25)
    opened.walk(round(row["steps"].iloc[-1]))
    summary = opened.panel("left").locator(".walked").inner_text()
    assert f"{round(row['steps'].iloc[-1])} steps from row 0, column 0" in summary
    assert ("success" in summary) == (row["success"].iloc[-1] == 1)


def fills(opened: Opened, side: str = "left") -> list[str]:
    """Returns the colours of a map's moves."""
    shapes = opened.panel(side).locator(".map svg > g").first.locator("polygon")
    return list(shapes.evaluate_all("shapes => shapes.map((shape) => shape.getAttribute('fill'))"))


def test_slider_shows_learning_and_the_address_keeps_it(opened: Opened, open_page: Open) -> None:
    opened.to_map(0)
    assert len(set(fills(opened))) == 1  # a table knows nothing at first
    opened.to_map(10)
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
    assert legend.locator(".low").inner_text() == f"≤ {low:.2f}".replace("-", "−").rstrip("0")
    assert legend.locator(".high").inner_text() == f"≥ {high:.2f}".rstrip("0")


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
    table = opened.page.locator("table", has_text="Score over all scenarios")

    def means() -> list[float]:
        cells = table.locator("tbody td:nth-child(5)").all_inner_texts()
        return [number(cell.split(" ")[0]) for cell in cells]

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


def test_without_javascript_all_but_the_explorer_is_there(open_page: Open) -> None:
    opened = open_page(java_script_enabled=False)
    text = opened.page.locator("body").inner_text()
    assert "Finding" in text
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
    CIRCLE: "and would do so until the limit of 200 steps.",
    HORIZON: "The limit of 200 steps is reached.",
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
        label = f"Map of {agent[1]}, {agent[2]}, in {agent[0]}, step {step}."
        opened.page.wait_for_function(
            "label => document.querySelector('.map').ariaLabel.startsWith(label)", arg=label
        )
        opened.page.locator("#walk-again").click()
        opened.walk(len(taken.actions) + 5)
        summary = opened.panel("left").locator(".walked").inner_text()
        n_steps = len(taken.actions)
        assert summary.startswith(f"{n_steps} step{'s' if n_steps > 1 else ''} from row 0, column 0.")
        assert summary.endswith(ENDINGS[taken.ending])
        lines = opened.panel("left").locator(".walk tbody").inner_text().splitlines()[::-1]
        cells = [re.findall(r"\t([^\t]+)\t([A-Z]+)( \(tie of \d\))?\t", line)[0] for line in lines]
        positions = model.position[list(taken.cells[:-1])].tolist()
        assert [where for where, _, _ in cells] == [
            f"row {row}, column {column}" for row, column in positions
        ]
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
    assert r"Two <b>scenes</b> \| of different size." in index
    opened = open_page(another)
    assert opened.page.locator("#step-text").inner_text() == "1,000 of 1,000"
    assert opened.page.locator("select[name=experiment]:visible").count() == 0
    opened.choose("left", "room", "a [table].b", "index")
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
    opened.page.wait_for_function("location.hash.includes('%2E')")
    again = open_page(another, opened.page.evaluate("location.hash"))
    assert again.panel("left").locator("select[name=algorithm]").input_value() == "a [table].b"


def test_film_of_scenes_and_budgets_that_differ(another: Path) -> None:
    with Image.open(another / "learning.webp") as film:
        assert getattr(film, "n_frames", 1) == 7  # steps 0, 200, ... 1000, and 300
        # Each column is as wide as its widest scene, of 7 and 12 cells.
        assert film.width >= (7 + 12) * 21 + 10


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_accessibility(open_page: Open, scheme: str, width: int) -> None:
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
