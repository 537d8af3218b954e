"""Zones, distances and outlines of the regions: by hand, and as properties of drawn sets of cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from envs import ZONES, Scenario, load_scenario
from envs.regions import outlines, target_distance

SIGNS = {"outside": ".", "target": "+", "uncomfortable": "x", "issuer": "I"}


def drawn(values: NDArray[np.int8], columns: int) -> list[str]:
    signs = [SIGNS[ZONES[zone]] for zone in values]
    return ["".join(signs[i : i + columns]) for i in range(0, len(signs), columns)]


def distances(scenario: Scenario) -> NDArray[np.int_]:
    return target_distance(scenario.regions, scenario.places[0], scenario.grid.size)


def test_zones_of_the_paper() -> None:
    assert drawn(load_scenario("S1").zone[0, 0], 12) == [
        "............",
        "............",
        "............",
        "............",
        "......+++++.",
        "......+xxx+.",
        "......+xIx+.",
        "......+xxx+.",
        "......+++++.",
        "............",
    ]


def test_zones_are_cut_by_the_edge_of_the_grid_and_grow_with_the_radii() -> None:
    overrides = {
        "grid.rows": 5,
        "grid.columns": 7,
        "grid.start": [0, 0],
        "issuer.position": [4, 6],
        "regions.uncomfortable_radius": 0,
        "regions.target_radius": 3,
    }
    assert drawn(load_scenario("S1", overrides).zone[0, 0], 7) == [
        ".......",
        "...++++",
        "...++++",
        "...++++",
        "...+++I",
    ]


def test_target_distance_by_hand() -> None:
    distance = distances(load_scenario("S1")).reshape(10, 12)
    assert distance[6].tolist() == [6, 5, 4, 3, 2, 1, 0, 1, 2, 1, 0, 1]  # the issuer's row
    assert distance[:, 7].tolist() == [4, 3, 2, 1, 0, 1, 1, 1, 0, 1]  # the column left of the issuer
    assert distance[0, 0] == 6  # six columns and four rows from the region's corner


def test_target_distance_beyond_the_edge_counts_the_whole_region() -> None:
    # The issuer in the top row: the region's rows above it are off the grid.
    scenario = load_scenario("S1", {"issuer.position": [0, 8]})
    assert distances(scenario).reshape(10, 12)[0, 5:].tolist() == [1, 0, 1, 2, 1, 0, 1]


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (["#"], [[(0, 0), (0, 1), (1, 1), (1, 0)]]),
        ([".##"], [[(0, 1), (0, 3), (1, 3), (1, 1)]]),
        (["..", ".."], []),
        (["#.", "##"], [[(0, 0), (0, 1), (1, 1), (1, 2), (2, 2), (2, 0)]]),
        # A hole: its border runs the other way round.
        (
            ["###", "#.#", "###"],
            [[(0, 0), (0, 3), (3, 3), (3, 0)], [(1, 1), (2, 1), (2, 2), (1, 2)]],
        ),
        # Cells that touch at a corner have a border each.
        (
            ["#.", ".#"],
            [[(0, 0), (0, 1), (1, 1), (1, 0)], [(1, 1), (1, 2), (2, 2), (2, 1)]],
        ),
        (
            [".#", "#."],
            [[(0, 1), (0, 2), (1, 2), (1, 1)], [(1, 0), (1, 1), (2, 1), (2, 0)]],
        ),
    ],
)
def test_outlines_by_hand(rows: list[str], expected: list[list[tuple[int, int]]]) -> None:
    inside = np.array([[sign == "#" for sign in row] for row in rows])
    assert [list(loop) for loop in outlines(inside)] == expected


@given(arrays(np.bool_, st.tuples(st.integers(1, 6), st.integers(1, 6))))
def test_outlines_enclose_exactly_the_set(inside: NDArray[np.bool_]) -> None:
    winding = np.zeros(inside.shape, dtype=int)
    length = 0
    for loop in outlines(inside):
        for (r0, c0), (r1, c1) in zip(loop, [*loop[1:], loop[0]], strict=True):
            assert (r0 == r1) != (c0 == c1)
            length += abs(r1 - r0) + abs(c1 - c0)
            # A ray from a cell to the right crosses the vertical edges there: downwards 1, upwards -1.
            winding[min(r0, r1) : max(r0, r1), :c0] += int(np.sign(r1 - r0))
        turns = [
            (b[0] - a[0] == 0) != (c[0] - b[0] == 0)
            for a, b, c in zip([loop[-1], *loop[:-1]], loop, [*loop[1:], loop[0]], strict=True)
        ]
        assert all(turns)  # no corner on a straight line
    assert (winding == inside).all()
    padded = np.pad(inside, 1).astype(int)
    assert length == abs(np.diff(padded, axis=0)).sum() + abs(np.diff(padded, axis=1)).sum()
