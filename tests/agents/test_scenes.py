"""The shipped scenes as tasks: what can be reached, and how well."""

from collections import deque

import numpy as np
import pytest

from agents.dynamic_programming import solve
from envs import ZONES, Model, compile_scenario, load_scenario
from envs.model import MOVES


def moves_to_target(model: Model, start: int) -> int:
    """Returns the fewest moves from a cell to a target region that avoid uncomfortable cells, by breadth."""
    grid, zone = model.scenario.grid, [ZONES[index] for index in model.scenario.layout.zone[0, 0]]
    far, cells = {start: 0}, deque([start])
    while zone[at := cells.popleft()] != "target":
        for row, column in np.array(divmod(at, grid.columns)) + MOVES:
            to = int(row * grid.columns + column)
            is_floor = 0 <= row < grid.rows and 0 <= column < grid.columns and not grid.is_wall[to]
            if is_floor and zone[to] in ("outside", "target") and to not in far:
                far[to] = far[at] + 1
                cells.append(to)
    return far[at]


@pytest.mark.parametrize(
    ("name", "moves"),
    [("S1", 10), ("Walls", 13), ("LargeRoom", 24), ("Hall", 8), ("Egg", 7), ("TwoPeople", 7), ("YesNo", 10)],
)
def test_the_optimum_walks_straight_to_the_target_region(name: str, moves: int) -> None:
    model = compile_scenario(load_scenario(name))
    assert moves_to_target(model, 0) == moves
    last = 2.0 if name == "YesNo" else 1.0  # of a correct PING, with the issuer's reward
    assert solve(model, horizon=200).value[model.start] == pytest.approx(last - 0.1 * moves)
