"""What the explorer is given, of learners that are made up number by number."""

import base64
import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.dynamic_programming import solve
from benchmark.analysis.population import Population
from benchmark.reports.explorer import FILE, MOST_AGENTS, Shown, explorer_item, typical_agent
from envs import ACTIONS, ZONES, compile_scenario, load_scenario
from tests.benchmark.populations import population as blank

UP, RIGHT, PING = (1 << ACTIONS.index(name) for name in ("UP", "RIGHT", "PING"))


@pytest.mark.parametrize(
    ("scores", "seeds", "typical"),
    [
        # Means of 1, 0.5, 0.1 and 0.25, since -5 counts as 0; of an even number, the lower median.
        ([[1, 1, 1, 1], [-5, 1, 1, 0], [0, 0, 0, 0.4], [0.25, 0.25, 0.25, 0.25]], [0, 1, 2, 3], 3),
        # Means of 0.5, 0.2, 0.5, 0.9 and 0.5: of those with the median, the lowest seed.
        ([[0.5] * 4, [0.2] * 4, [0, 0, 1, 1], [0.9] * 4, [1, 0.5, 0.5, 0]], [7, 1, 9, 2, 3], 4),
        ([[0, 0, 0, 1]], [5], 0),
    ],
)
def test_typical_agent_has_the_median_mean_score(
    scores: list[list[float]], seeds: list[int], typical: int
) -> None:
    random, optimal = blank().anchors["grid_return"]
    grid_return = random + np.array(scores) * (optimal - random)
    assert typical_agent(replace(blank(n=len(seeds), grid_return=grid_return), seeds=seeds)) == typical


def population(n: int = 120) -> Population:
    """Returns agents with maps at steps 0, 100, 200, 300; those between are policies alone."""
    values = np.zeros((n, 4, 120, 5), dtype=np.float32)
    values[0, 2, 13] = (0.12345, -0.5, 0.25, np.nan, 2.0)  # row 1, column 1
    values[0, 3, 13] = (1e9, -0.5, 0.25, 0, -2.0)
    values[1:] = 99
    greedy = np.full((n, 7, 120), RIGHT, dtype=np.uint8)
    greedy[0, 6, 13] = UP | PING
    greedy[:, 1::2] = PING  # between the maps
    success = np.tile(np.arange(n)[:, None] / n, 7)
    made = blank(n=n, budget=300, every=50, map_every=100, values=values, greedy=greedy, success=success)
    settings = made.specification["settings"] | {"discount": 0.5}
    return replace(made, specification={**made.specification, "settings": settings}, seeds=range(4, n + 4))


def masks(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(-1, 120)


def test_first_agent_over_training_and_the_final_policies_of_a_hundred(tmp_path: Path) -> None:
    shown = [Shown("table", "index", population()), Shown("again", "index", population())]
    item = explorer_item(lambda data: data)
    assert item.write is not None
    contents = []
    for _ in range(2):
        item.write(shown, tmp_path)
        contents.append((tmp_path / FILE).read_bytes())
    assert contents[0] == contents[1]
    data = json.loads(gzip.decompress(contents[0]))
    assert (len(data["scenes"]), len(data["optima"])) == (1, 1)  # which both share
    agent = data["agents"][1]
    assert (agent["algorithm"], agent["kind"], agent["scene"], agent["optimum"]) == ("again", "q", 0, 0)
    assert agent["steps"] == [0, 200, 300]  # every second map, and the last
    values = np.array(agent["values"]).reshape(3, 120, 5).cumsum(axis=0)
    assert values[1, 13].tolist() == [123, -500, 250, data["no_number"], 2000]
    assert values[2, 13].tolist() == [2**31 - 1, -500, 250, 0, -2000]  # clipped
    assert not values[0].any()
    greedy = masks(agent["greedy"])
    assert (greedy[2, 13], {*np.delete(greedy.ravel(), 2 * 120 + 13)}) == (UP | PING, {RIGHT})
    assert agent["seeds"] == list(range(4, 4 + MOST_AGENTS))
    assert agent["final"]["success"] == pytest.approx(np.arange(MOST_AGENTS) / 120, abs=1e-6)
    final = masks(agent["final"]["greedy"])
    assert (final.shape, final[0, 13], final[1, 13]) == ((MOST_AGENTS, 120), UP | PING, RIGHT)
    # S1 pays 1 for a correct PING and -0.1 for a move; the discount is 0.5.
    best = np.array(data["optima"][0]["values"]).reshape(120, 5) / 10 ** data["decimals"]
    optimal = masks(data["optima"][0]["optimal"])[0]
    inside, before = 4 * 12 + 6, 4 * 12 + 5
    assert (optimal[inside], best[inside].max()) == (PING, 1.0)
    assert (optimal[before], best[before].max()) == (RIGHT, pytest.approx(-0.1 + 0.5 * 1.0))


def test_nothing_is_written_of_scenes_that_one_map_does_not_show(tmp_path: Path) -> None:
    item = explorer_item(lambda data: data)
    assert item.write is not None
    item.write([Shown("table", "index", blank("S1")), Shown("table", "parts", blank("Moody"))], tmp_path)
    assert len(json.loads(gzip.decompress((tmp_path / FILE).read_bytes()))["agents"]) == 1
    hidden = [
        Shown("table", "parts", blank("Moody")),
        Shown("t", "offset", blank("Walking", observation="offset")),
    ]
    item.write(hidden, tmp_path / "nothing")


def test_an_agent_that_sees_the_offset_is_shown_around_the_issuer(tmp_path: Path) -> None:
    values = np.zeros((1, 4, 19 * 23, 5), dtype=np.float32)
    values[0, -1, (9 + 2) * 23 + 11 - 5] = 1  # the issuer two rows below the agent, five columns to its left
    made = blank("Anywhere", 1, observation="offset", values=values)
    item = explorer_item(lambda data: data)
    assert item.write is not None
    item.write([Shown("table", "offset", made)], tmp_path)
    data = json.loads(gzip.decompress((tmp_path / FILE).read_bytes()))
    assert data["scenes"][0]["origin"] == [9, 11]
    changes = np.array(data["agents"][0]["values"]).reshape(-1, 19, 23, 5)
    assert np.argwhere(changes.any(axis=(0, 3))).tolist() == [[9 - 2, 11 + 5]]
    # Outside the regions the optimum is the scenario's, wherever the issuer stands.
    model = compile_scenario(load_scenario("Anywhere"))
    outside = model.fresh_state[model.zone_of_cell == ZONES.index("outside")]
    best = solve(model, made.discount, None if made.discount < 1 else made.horizon).value[outside]
    cell = 19 * 23 - 1 - made.model.observation[outside]
    around = np.array(data["optima"][0]["values"]).reshape(-1, 5).max(axis=1) / 10 ** data["decimals"]
    assert around[cell] == pytest.approx(best, abs=0.51 * 10 ** -data["decimals"])
