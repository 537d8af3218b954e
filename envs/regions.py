"""The regions around the issuer: the zone of each cell, its distance from the target region, and borders.

The only place that knows the regions' shape. Everything else reads zones, distances and outlines. Cells are
numbered `row * columns + column`, O of them.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from envs.scenario import Scenario

ZONES: Final = ("outside", "target", "uncomfortable", "issuer")

Corner = tuple[
    int, int
]  # (row, column) of a grid line crossing; cell (r, c) has corners (r, c) to (r + 1, c + 1)
Loop = tuple[
    Corner, ...
]  # a closed line: the corners at which it turns, clockwise, from its topmost leftmost one


def zones(scenario: Scenario) -> NDArray[np.int8]:
    """Returns the zone of every cell, (O,) index into ZONES."""
    distance = _from_issuer(scenario)
    regions = scenario.regions
    inside = [distance == 0, distance <= regions.uncomfortable_radius, distance <= regions.target_radius]
    names = "issuer", "uncomfortable", "target"
    return np.select(inside, [ZONES.index(name) for name in names], ZONES.index("outside")).astype(np.int8)


def target_distance(scenario: Scenario) -> NDArray[np.int_]:
    """Returns how far every cell is from the target region, (O,) cells, by Chebyshev distance.

    The region counts as whole, also where the grid's edge cuts it.
    """
    distance, regions = _from_issuer(scenario), scenario.regions
    outside, within = distance - regions.target_radius, regions.uncomfortable_radius + 1 - distance
    return np.maximum(np.maximum(outside, within), 0)


def outlines(inside: NDArray[np.bool_]) -> tuple[Loop, ...]:
    """Returns the border of a set of cells as closed loops; cells beyond the grid count as outside.

    Args:
      inside: (rows, columns) which cells belong to the set.

    >>> outlines(np.array([[False, True, True]]))
    (((0, 1), (0, 3), (1, 3), (1, 1)),)
    """
    padded = np.pad(inside, 1)
    following: dict[Corner, list[Corner]] = {}  # edges, with the set on their right
    for row, column in np.argwhere(padded).tolist():
        top, left = row - 1, column - 1
        corners = ((top, left), (top, left + 1), (top + 1, left + 1), (top + 1, left))
        neighbours = ((row - 1, column), (row, column + 1), (row + 1, column), (row, column - 1))
        for i, neighbour in enumerate(neighbours):
            if not padded[neighbour]:
                following.setdefault(corners[i], []).append(corners[(i + 1) % 4])
    loops = []
    while following:
        start = min(following)
        line: list[Corner] = [(start[0] + 1, start[1]), start]
        while len(line) == 2 or line[-1] != start:
            ways = following[line[-1]]
            # Where two cells touch at a corner alone, the line turns right and keeps to its cell.
            ways.sort(key=lambda way: _turn(line[-2], line[-1], way))
            line.append(ways.pop(0))
            if not ways:
                del following[line[-2]]
        closed = line[1:-1]  # the start once
        turns = zip([closed[-1], *closed[:-1]], closed, [*closed[1:], closed[0]], strict=True)
        loops.append(tuple(at for before, at, after in turns if _turn(before, at, after)))
    return tuple(loops)


def _turn(before: Corner, at: Corner, to: Corner) -> int:
    """Returns -1 for a turn to the right, 0 for straight on, 1 for a turn to the left."""
    (r0, c0), (r1, c1), (r2, c2) = before, at, to
    return int(np.sign((r1 - r0) * (c2 - c1) - (c1 - c0) * (r2 - r1)))


def _from_issuer(scenario: Scenario) -> NDArray[np.int_]:
    """Returns every cell's Chebyshev distance from the issuer, (O,)."""
    row, column = np.indices((scenario.grid.rows, scenario.grid.columns)).reshape(2, -1)
    issuer = scenario.issuer.position
    return np.asarray(np.maximum(abs(row - issuer[0]), abs(column - issuer[1])))
