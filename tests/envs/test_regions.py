"""Zones of the regions, by hand."""

import pytest

from envs import ZONES, load_scenario
from envs.arrays import Codes
from envs.inputs import parse
from envs.regions import Cell, Grid, Regions, zones

SIGNS = {"outside": ".", "target": "+", "uncomfortable": "x", "issuer": "I"}


def drawn(values: Codes, columns: int) -> list[str]:
    signs = [SIGNS[ZONES[zone]] for zone in values]
    return ["".join(signs[i : i + columns]) for i in range(0, len(signs), columns)]


@pytest.mark.parametrize(
    ("name", "place", "expected"),  # from the third row on; all others are outside
    [
        # The paper's
        ("S1", ((6, 8),), [
            "............", "............",
            "......+++++.",
            "......+xxx+.",
            "......+xIx+.",
            "......+xxx+.",
            "......+++++.",
        ]),
        # Uncomfortable is what is within 0.45 m = 1.5 cells: eight cells around each person, since
        # diagonal ones are 0.42 m away. Within 0.75 m = 2.5 cells are those two away in a row or
        # column, and one more aside (0.67 m), not those two away in both (0.85 m).
        ("TwoStrangers", ((4, 3), (5, 6)), [
            "..+++.......",
            ".+xxx+++....",
            ".+xIxxxx+...",
            ".+xxxxIx+...",
            "..+++xxx+...",
            ".....+++....",
        ]),
        # They are 1.27 m apart. The centre is the corner between four cells, 0.64 m from both, so
        # the ring is 0.34 to 0.94 m from it: the four cells around it (0.21 m) lie within. Cells
        # 0.5 and 1.5 aside are 0.47 m away, 1.5 and 1.5 0.64 m, 0.5 and 2.5 0.76 m, 1.5 and 2.5
        # 0.87 m; 2.5 and 2.5 (1.06 m) are too far.
        ("TwoTalking", ((3, 4), (6, 7)), [
            "...xxx++....",
            "...xIx+++...",
            "...xxxx++...",
            "...++xxxx...",
            "...+++xIx...",
            "....++xxx...",
        ]),
        # They are 1.08, 1.08 and 1.2 m apart. The centre is [5, 5], 0.6, 0.671 and 0.671 m from
        # them, 0.647 m on average, so the ring is 0.347 to 0.947 m from it: the cell and its four
        # neighbours (0.3 m) lie within, the next are 0.42 m away. Three cells in a row or column
        # are 0.9 m, and one aside 0.949 m, too far.
        ("ThreeTalking", ((3, 5), (6, 3), (6, 7)), [
            "....xxx.....",
            "...+xIx+....",
            "...+xxx+....",
            "..xxxxxxx...",
            "..xIxxxIx...",
            "..xxx+xxx...",
            ".....+......",
        ]),
    ],
)  # fmt: skip
def test_zones_by_hand(name: str, place: tuple[Cell, ...], expected: list[str]) -> None:
    scenario = load_scenario(name)
    outside = ["." * 12]
    rows = drawn(scenario.layout.zone[scenario.layout.places.index(place), 0], 12)
    assert rows == [*2 * outside, *expected, *(8 - len(expected)) * outside]


ROOM = Grid(rows=7, columns=7, start="anywhere")


def test_a_cell_on_the_border_belongs_to_the_region() -> None:
    # 0.3 * 3 is a little less than 0.9 in floating point; the cell on the border belongs to the
    # region.
    border = {
        "uncomfortable": {"kind": "circle", "radius": 0.1},
        "target": {"kind": "circle", "radius": 0.9},
    }
    narrow = ROOM.model_copy(update={"metres_per_cell": 0.3})
    zone = zones(parse(Regions, border | {"unit": "metres"}, "by hand"), "up", (3, 3), narrow)
    assert drawn(zone, 7)[3] == "+++I+++"
