"""Tile coding: features by hand; learners equal to the table's, and to loops in plain Python."""

from typing import Any

import numpy as np
import pytest

from agents import load_algorithm
from envs import Model, load_scenario
from envs.observations import compile_seen
from envs.tiles import tiles_of
from tests.agents import Changes
from tests.agents.test_tabular import MOVES
from tests.agents.words import equal_to_textbook


def model_of(scenario: str, observation: str, **overrides: Any) -> Model:
    return compile_seen(load_scenario(scenario, overrides), observation)


CROWD: Changes = {"grid.rows": 5, "grid.columns": 6, "issuer.places": 3, "onlookers.ways": 5}


@pytest.mark.parametrize(
    ("scenario", "observation", "shape"),
    [
        # S1 shows the agent's cell alone. The first tiling has its edges before rows 4 and 8. The
        # second is displaced by 1 and 3 halves of a width, that is, modulo a width, by 2 cells
        # along both, so its edges are before rows and columns 2, 6 and 10.
        ("S1", "coordinates", (10, 12)),
        ("Anywhere", "offset_coordinates", (19, 23)),  # with cells on both sides
    ],
)
def test_tiles_of_two_tilings_by_hand(
    scenario: str, observation: str, shape: tuple[int, int]
) -> None:
    tiles = tiles_of(model_of(scenario, observation), 2, 4).tiles.reshape(*shape, 2)
    rows, columns = np.indices(shape)
    per_row, per_shifted = -(-shape[1] // 4), -(-(shape[1] + 2) // 4)
    first = rows // 4 * per_row + columns // 4
    assert (tiles[..., 0] == first).all()
    second = (rows + 2) // 4 * per_shifted + (columns + 2) // 4
    assert (tiles[..., 1] == first.max() + 1 + second).all()


@pytest.mark.parametrize("name", ["linear_q_lambda", "linear_sarsa_lambda"])
@pytest.mark.parametrize(
    ("scenario", "overrides", "changes"),
    [
        ("S2", {}, {"n_tilings": 4, "epsilon": 0.2}),
        (
            "S2",
            MOVES,
            {
                "n_tilings": 5,
                "tile_width": 2,
                "ties": "lowest",
                "initial_value": 0.3,
                "halved_after": 500,
            },
        ),
        # With one tiling of single cells, the textbook's loop learns a table.
        ("MoodyHidden", {}, {"n_tilings": 1, "tile_width": 1, "halved_after": 900}),
        (
            "S2",
            MOVES,
            {"n_tilings": 3, "ties": "lowest", "halved_after": 500, "backward_passes": 2},
        ),
        # The agent with each person has tilings in common, or of its own.
        (
            "Crowd",
            CROWD,
            {"parts": "shared_pairs", "n_tilings": 2, "epsilon": 0.2, "initial_value": 0.3},
        ),
        (
            "Crowd",
            CROWD,
            {"parts": "agent_pairs", "n_tilings": 3, "epsilon": 0.2, "backward_passes": 1},
        ),
    ],
)
def test_kernel_equals_a_loop_in_plain_python(
    name: str, scenario: str, overrides: Changes, changes: Changes
) -> None:
    model = model_of(scenario, "coordinates", **overrides)
    settings: Any = load_algorithm(name).settings(budget=2000, time_limit=50, **changes)
    features = tiles_of(model, settings.n_tilings, settings.tile_width, settings.parts)
    tiles = features.tiles[features.rows].reshape(model.n_observations, -1)
    assert settings.tile_width > 1 or (tiles[:, 0] == np.arange(model.n_observations)).all()
    equal_to_textbook(name, model, settings, "coordinates", (0, 1, 700, 2000), tiles)
