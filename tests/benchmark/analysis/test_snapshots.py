"""Tables for the explorer, of two learners that are made up number by number."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmark.analysis import snapshots
from benchmark.analysis.population import Population
from benchmark.analysis.snapshots import Shown, typical_agent
from envs import ACTIONS, load_scenario
from tests.benchmark.populations import population as blank

UP, RIGHT, PING = (1 << ACTIONS.index(name) for name in ("UP", "RIGHT", "PING"))
N_CELLS = 120


def population(*, is_stochastic: bool) -> Population:
    """Returns two agents, the first of them shown: policies at steps 0, 100, 200 and maps at 0, 200."""
    values = np.zeros((2, 2, N_CELLS, 5), dtype=np.float32)
    values[0, 1, 13] = (0.12345, -0.5, 0.25, np.nan, 2.0)  # the last map, row 1, column 1
    values[1] = 99
    greedy = np.full((2, 3, N_CELLS), RIGHT, dtype=np.uint8)
    greedy[0, 2, 13] = UP | PING
    greedy[:, 1] = PING  # between the maps
    arrays: dict[str, Any] = {
        "values": values,
        "greedy": greedy,
        "q": np.zeros((2, 0 if is_stochastic else N_CELLS, 5)),
        "stochastic": np.zeros((2, 3 if is_stochastic else 0, N_CELLS, 5)),
        "grid_return": np.array([[-1.0, 5.0, -2.0], [9.0, 9.0, 9.0]]),
        "success": np.array([[0.0, 0.5, 1.0], [0.25, 0.25, 0.25]]),
        "steps": np.array([[10.0, 11.0, 12.0], [9.0, 9.0, 9.0]]),
        "wrong_pings": np.array([[1.0, 2.0, 3.0], [9.0, 9.0, 9.0]]),
    }
    specification = {
        "scenario": load_scenario("S1").model_dump(mode="json"),
        "algorithm": "q_learning",
        "settings": {"budget": 200, "discount": 0.5},
        "evaluation_every": 100,
        "map_every": 200,
        "horizon": 50,
    }
    return Population(specification=specification, arrays=arrays, seeds=[4, 5], provenance=[{}, {}])


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


def test_agent_of_the_first_seed_is_shown() -> None:
    frame = snapshots.agents(
        [Shown(name, "index", population(is_stochastic=name == "policy")) for name in ("table", "policy")]
    )
    assert frame["algorithm"].tolist() == ["table", "table", "policy", "policy"]
    assert frame["kind"].tolist() == ["q", "q", "probability", "probability"]
    assert set(frame["seed"]) == {4}
    assert set(frame["discount"]) == {0.5}
    assert frame["step"].tolist() == [0, 200] * 2
    assert frame["success"].tolist() == [0, 1] * 2
    assert frame["steps"].tolist() == [10, 12] * 2
    # A score is linear in the return, with the same anchors at all steps.
    assert frame["score"][0] > frame["score"][1]
    scores = population(is_stochastic=False).scores[0]
    assert frame["score"].tolist() == pytest.approx([scores[0], scores[2]] * 2)


def test_maps_hold_every_cell() -> None:
    frame = snapshots.values([Shown("table", "index", population(is_stochastic=False))])
    assert len(frame) == 2 * N_CELLS
    assert frame["step"].tolist() == [0] * N_CELLS + [200] * N_CELLS
    row = frame.query("step == 200 and row == 1 and column == 1").iloc[0]
    assert row["greedy"] == "UP|PING"
    assert row[list(ACTIONS)].tolist() == pytest.approx([0.123, -0.5, 0.25, np.nan, 2], nan_ok=True)
    others = frame.drop(index=row.name)
    assert set(others["greedy"]) == {"RIGHT"}
    assert (others[list(ACTIONS)] == 0).all(axis=None)


def test_optimum_next_to_the_target_region() -> None:
    pair = [Shown(name, "index", population(is_stochastic=False)) for name in ("table", "table_again")]
    frame = snapshots.optimum(pair)
    assert len(frame) == N_CELLS  # one scenario, one discount
    # S1 pays 1 for a correct PING and -0.1 for a move; the discount is 0.5.
    inside, before = (frame.query(f"row == 4 and column == {column}").iloc[0] for column in (6, 5))
    assert (inside["optimal"], inside["PING"]) == ("PING", pytest.approx(1.0))
    assert (before["optimal"], before["RIGHT"]) == ("RIGHT", pytest.approx(-0.1 + 0.5 * 1.0))


@pytest.mark.parametrize(
    ("map_every", "expected"),
    [(100, [0, 200, 400, 500]), (200, [0, 400, 500]), (500, [0, 500])],
)
def test_every_second_map_is_shown_and_the_last(map_every: int, expected: list[int]) -> None:
    whole = population(is_stochastic=False)
    n_maps = len(range(0, 500, map_every)) + 1
    values = np.zeros((2, n_maps, N_CELLS, 5), dtype=np.float32) + np.arange(n_maps)[:, None, None]
    arrays = dict(whole.arrays) | {
        name: np.zeros((2, 6)) for name in ("grid_return", "success", "steps", "wrong_pings")
    }
    arrays |= {"values": values, "greedy": np.full((2, 6, N_CELLS), PING, dtype=np.uint8)}
    specification = dict(whole.specification) | {
        "settings": {"budget": 500, "discount": 0.5},
        "map_every": map_every,
    }
    shown = [Shown("table", "index", Population(specification, arrays, [4, 5], [{}, {}]))]
    assert snapshots.agents(shown)["step"].tolist() == expected
    maps = snapshots.values(shown)
    assert maps["step"].drop_duplicates().tolist() == expected
    places = [min(-(-step // map_every), n_maps - 1) for step in expected]
    assert maps.groupby("step")["UP"].first().tolist() == places


def test_final_policies_of_all_agents() -> None:
    frame = snapshots.final_policies([Shown("table", "index", population(is_stochastic=False))])
    assert frame["seed"].tolist() == [4, 5]
    assert frame["success"].tolist() == [1, 0.25]
    assert frame["score"].tolist() == pytest.approx(population(is_stochastic=False).scores[:, -1])
    # In base64, I is 8, which is RIGHT; R is 17, which is UP and PING.
    assert frame["greedy"].tolist() == ["I" * 13 + "R" + "I" * (N_CELLS - 14), "I" * N_CELLS]


def test_final_policies_of_the_first_hundred_agents() -> None:
    few = population(is_stochastic=False)
    arrays = {name: np.repeat(values, 60, axis=0) for name, values in few.arrays.items()}
    many = Population(few.specification, arrays, range(120), [{}] * 120)
    frame = snapshots.final_policies([Shown("table", "index", many)])
    assert frame["seed"].tolist() == list(range(snapshots.MOST_AGENTS))
