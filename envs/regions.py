"""The regions around the issuer: zones of cells, distances from the target region, and outlines.

This is the only place that knows the regions' shape: everything else reads zones, distances and outlines.
The O cells are numbered `row * columns + column`.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from envs.scenario import Scenario

ZONES: Final = ("outside", "target", "uncomfortable", "issuer")

# (row, column) of a crossing of grid lines; cell (r, c) lies between the corners (r, c) and (r + 1, c + 1).
Corner = tuple[int, int]
# The corners at which a closed line turns, from the leftmost of its topmost corners. The enclosed cells are
# on the right of the line, so that it runs clockwise, or anticlockwise around a hole.
Loop = tuple[Corner, ...]


def zones(scenario: Scenario) -> NDArray[np.int8]:
    """Returns the zone of every cell, (O,) index into ZONES."""
    distance = _from_issuer(scenario)
    regions = scenario.regions
    inside = [distance == 0, distance <= regions.uncomfortable_radius, distance <= regions.target_radius]
    names = "issuer", "uncomfortable", "target"
    return np.select(inside, [ZONES.index(name) for name in names], ZONES.index("outside")).astype(np.int8)


def target_distance(scenario: Scenario) -> NDArray[np.int_]:
    """Returns the Chebyshev distance of every cell from the target region, (O,).

    The region counts as complete even if the grid's edge cuts it.
    """
    distance, regions = _from_issuer(scenario), scenario.regions
    outside, within = distance - regions.target_radius, regions.uncomfortable_radius + 1 - distance
    return np.maximum(np.maximum(outside, within), 0)


def outlines(inside: NDArray[np.bool_]) -> tuple[Loop, ...]:
    """Returns the border of a set of cells as closed loops. Cells beyond the grid count as outside.

    Args:
      inside: Cells of the set, (rows, columns).

    >>> outlines(np.array([[False, True, True]]))
    (((0, 1), (0, 3), (1, 3), (1, 1)),)
    """
    padded = np.pad(inside, 1)
    following: dict[Corner, list[Corner]] = {}  # ends of the edges that start here
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
            # Two edges start where cells touch only at a corner: the line turns right and follows its cell.
            ways.sort(key=lambda way: _turn(line[-2], line[-1], way))
            line.append(ways.pop(0))
            if not ways:
                del following[line[-2]]
        closed = line[1:-1]  # without the point before the start, and the start once
        turns = zip([closed[-1], *closed[:-1]], closed, [*closed[1:], closed[0]], strict=True)
        loops.append(tuple(at for before, at, after in turns if _turn(before, at, after)))
    return tuple(loops)


def _turn(before: Corner, at: Corner, to: Corner) -> int:
    """Returns -1 for a turn to the right, 0 for straight on, 1 for a turn to the left."""
    (r0, c0), (r1, c1), (r2, c2) = before, at, to
    return int(np.sign((r1 - r0) * (c2 - c1) - (c1 - c0) * (r2 - r1)))


def _from_issuer(scenario: Scenario) -> NDArray[np.int_]:
    """Returns the Chebyshev distance of every cell from the issuer, (O,)."""
    row, column = np.indices((scenario.grid.rows, scenario.grid.columns)).reshape(2, -1)
    issuer = scenario.issuer.position
    return np.asarray(np.maximum(abs(row - issuer[0]), abs(column - issuer[1])))
