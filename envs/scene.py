"""What a map of a scenario looks like, for figures, films, texts and the page.

Lengths are in cells; cell (r, c) covers rows r to r + 1 and columns c to c + 1.
"""

from dataclasses import dataclass

import numpy as np

from envs.arrays import Bools, Floats, Ints
from envs.model import MOVES, Model, kept_with_model
from envs.regions import HEADINGS, OUTSIDE, ZONES, Loop, Ring, circles, outlines

Colour = tuple[int, int, int]

SYMBOLS = {
    "outside": ".",
    "target": "+",
    "uncomfortable": "x",
    "issuer": "I",
    "wall": "#",
    "bystander": "B",
    "onlooker": "o",
}
# Okabe and Ito's colour-blind-safe palette, the regions lightened; distinct in grey, too.
COLOURS: dict[str, Colour] = {
    "outside": (250, 250, 250),
    "target": (150, 215, 195),
    "uncomfortable": (225, 150, 95),
    "issuer": (225, 150, 95),
    "wall": (85, 85, 95),
    "line": (200, 200, 200),
    "person": (60, 60, 60),
    "agent": (0, 114, 178),
    "path": (213, 94, 0),  # the agent and its path on a map of values
    "over": (138, 138, 138),  # a cell in which the episode is over, on a map of values
    "no value": (250, 250, 250),
}
# The borders that are drawn, from the outermost: label, and whether the line is dashed.
BORDERS = {
    "target": ("target region's outer edge", False),
    "uncomfortable": ("uncomfortable region's edge", True),
}
COLOUR_MAP = "cividis"  # colour map of values, wherever they are drawn
DIVERGING = "PuOr"  # colour map of values of both signs; its middle is zero
CLIPPED_SHARE = 0.01  # share of values beyond each end of a colour scale; outliers would stretch it
_ASIDE = MOVES[:, ::-1]
# For each move, (row, column) from the cell's centre: the corners of its triangle, the third of
# which is the centre, and those of its arrowhead, the first of which is the tip.
TRIANGLES = np.stack([MOVES - abs(_ASIDE), MOVES + abs(_ASIDE), 0 * MOVES], axis=1) / 2
_BASE = 0.27 * MOVES
ARROWHEADS = np.stack([0.46 * MOVES, _BASE + 0.13 * _ASIDE, _BASE - 0.13 * _ASIDE], axis=1)
# distances of the nose's tip and base from a person's centre, and half its base
NOSE = (0.5, 0.2, 0.25)


@dataclass(frozen=True)
class Glyph:
    """A sign in a cell."""

    # "issuer" (a star; everybody with regions), "bystander" (an open circle), "onlooker" (a
    # diamond), "start"
    kind: str
    cell: int
    heading: tuple[int, int] | None = None  # (row, column) where a person looks, if that matters

    @property
    def nose(self) -> Floats:
        """(3, 2) corners of a triangle, (row, column) from the centre; (0, 2) without a heading."""
        if self.heading is None:
            return np.zeros((0, 2))
        tip, base, half = NOSE
        ahead = np.array(self.heading)
        return np.stack(
            [tip * ahead, base * ahead + half * ahead[::-1], base * ahead - half * ahead[::-1]]
        )


@dataclass(frozen=True, eq=False)
class Scene:
    """A map without values; O cells."""

    rows: int
    columns: int
    zone: tuple[str, ...]  # (O,) one of ZONES; "outside" for a bystander's cell
    position: Ints  # (O, 2) row and column of each cell
    is_over: Bools  # (O,) in which cells the episode is over, so that nothing can be done
    is_wall: Bools  # (O,)
    outlines: dict[str, tuple[Loop, ...]]  # of the regions in `BORDERS`
    glyphs: tuple[Glyph, ...]
    phase: str  # its name; empty if there is only one
    # row, column and radius of the circle of people who talk
    circle: tuple[float, float, float] | None

    @property
    def n_cells(self) -> int:
        """O."""
        return self.rows * self.columns

    def cells_of(self, kind: str) -> list[int]:
        """Returns the cells of the glyphs of a kind."""
        return [glyph.cell for glyph in self.glyphs if glyph.kind == kind]

    def as_json(self) -> dict[str, object]:
        """Returns what the page's script draws; a zone is its number in `ZONES`."""
        return ({"circle": self.circle} if self.circle else {}) | {
            "zone": "".join(str(ZONES.index(zone)) for zone in self.zone),
            "outlines": [*self.outlines.values()],
            "glyphs": [
                {"kind": it.kind, "cell": it.cell, "nose": it.nose.tolist()} for it in self.glyphs
            ],
        }


@kept_with_model
def scene_of(model: Model, context: int = 0) -> Scene:
    """Returns the map of a model's cells in one position and phase, see `Model.context`."""
    scenario = model.scenario
    layout = model.scenario.layout
    grid = scenario.grid
    states = model.states_of(context)
    zone = model.zone[states].reshape(grid.size)
    position, phase = divmod(context, len(layout.stages))
    people = [
        Glyph(
            "issuer" if person.regions else "bystander",
            row * grid.columns + column,
            HEADINGS[person.heading] if person.regions and scenario.has_front else None,
        )
        for person in scenario.people_in(position, phase)
        for row, column in [person.position]
    ]
    np.put(zone, [glyph.cell for glyph in people if glyph.kind == "bystander"], OUTSIDE)
    onlookers = [Glyph("onlooker", cell) for cell in layout.onlookers[position].tolist()]
    circle = None
    if isinstance((layout.stages[phase].regions or scenario.regions).target, Ring):
        centres, radii = circles(grid.position[layout.standing[position, phase]][None])
        circle = (*(centres[0] + 0.5).tolist(), float(radii[0]))
    is_in_place = model.context[model.starts] // len(layout.stages) == position
    starts = np.unique(model.cell[model.starts[is_in_place]]).tolist()  # one of many is not marked
    is_floor = ~grid.is_wall.reshape(grid.size)
    return Scene(
        rows=grid.rows,
        columns=grid.columns,
        zone=tuple(ZONES[index] for index in zone.ravel()),
        position=grid.position,
        is_over=model.is_over[states],
        is_wall=grid.is_wall,
        # ZONES are ordered by nearness.
        outlines={region: outlines(is_floor & (zone >= ZONES.index(region))) for region in BORDERS},
        glyphs=(
            *people,
            *onlookers,
            *(Glyph("start", cell) for cell in starts if len(starts) == 1),
        ),
        phase=layout.stages[phase].name if len({stage.name for stage in layout.stages}) > 1 else "",
        circle=circle,
    )


def colour_limits(values: Floats) -> tuple[float, float]:
    """Returns the ends of a colour scale for values without outliers; (0, 1) if none are finite."""
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = np.percentile(known, [100 * CLIPPED_SHARE, 100 * (1 - CLIPPED_SHARE)]).tolist()
    return low, max(high, low + 1e-9)
