"""The grid and the regions around people: their shapes, the zones of cells, and outlines.

The C cells are numbered `row * columns + column`. A region holds every cell whose centre lies in
its shape.
"""

from itertools import product
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, WrapValidator, model_validator
from pydantic import ValidatorFunctionWrapHandler as Handler

from envs.arrays import Bools, Codes, Floats, Ints, read_only_property
from envs.inputs import InputError, Table, require

ZONES = ("outside", "target", "uncomfortable", "issuer")  # ordered by nearness
OUTSIDE, TARGET, UNCOMFORTABLE, ISSUER = range(len(ZONES))
Cell = tuple[int, int]  # (row, column), (0, 0) top left
Heading = Literal["up", "down", "left", "right"]
HEADINGS: dict[Heading, Cell] = {"up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}
Length = Annotated[float, Field(ge=0, le=1000)]  # in cells, or in metres

Corner = tuple[
    int, int
]  # (row, column); cell (r, c) lies between the corners (r, c) and (r + 1, c + 1)
# The corners at which a closed line turns, from the leftmost of its topmost corners, with the
# enclosed cells on its right.
Loop = tuple[Corner, ...]
_DIRECTIONS = (0, 1), (1, 0), (0, -1), (-1, 0)  # right, down, left, up
# of a cell: where its upper, right, lower, left edge begins
_CORNERS = ((0, 0), (0, 1), (1, 1), (1, 0))

MAX_CELLS = 100_000
# Lengths that are rounded in metres must not decide whether a cell on the border belongs to a
# region.
TOLERANCE = 1e-9


def _checked_place(value: object, handler: Handler) -> object:
    if isinstance(
        value, list
    ):  # from JSON, where strict validation would have accepted it as a tuple
        value = tuple(tuple(item) if isinstance(item, list) else item for item in value)
    try:
        return handler(value)
    except ValidationError as error:
        accepted = 'a cell [ROW, COLUMN], a list of at least one cell, or "anywhere"'
        raise ValueError(f"accepted: {accepted}") from error


# A cell, or cells of which one is drawn at the start of every episode; "anywhere": wherever it is
# allowed.
_Cells = Annotated[tuple[Cell, ...], Field(min_length=1)]
Place = Annotated[Cell | _Cells | Literal["anywhere"], WrapValidator(_checked_place)]


def listed(place: Place | None) -> list[Cell]:
    """Returns the different cells that a place lists: none for "anywhere"."""
    match place:
        case None | "anywhere":
            return []
        case (int(row), int(column)):
            return [(row, column)]
        case cells:
            return [*dict.fromkeys(cells)]


class Grid(Table):
    """Size of the floor, the cell in which episodes start, and walls."""

    rows: Annotated[int, Field(ge=1, le=1000)]
    """Number of rows; together at most 100,000 cells."""
    columns: Annotated[int, Field(ge=1, le=1000)]
    """Number of columns."""
    start: Place
    """Where the agent starts, outside every region, and with a way to a target region."""
    walls: str = ""
    """A line of text per row: "#" is a wall, "." floor. Nobody can enter a wall."""
    metres_per_cell: Annotated[float, Field(gt=0, le=100)] | None = None
    """Width of a cell, for regions in metres."""

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    @read_only_property
    def position(self) -> Ints:
        """(C, 2) row and column of each cell."""
        return np.stack(np.divmod(np.arange(self.rows * self.columns), self.columns), axis=1)

    @read_only_property
    def is_wall(self) -> Bools:
        """(C,) which cells are walls."""
        signs = "".join(self.walls.split()) or "." * (self.rows * self.columns)
        return np.array([sign == "#" for sign in signs])

    def index(self, cell: Cell) -> int:
        """Returns the number of a cell."""
        return cell[0] * self.columns + cell[1]

    def cells_of(self, place: Place) -> Ints:
        """Returns the numbers of the different cells of a place."""
        if place == "anywhere":
            return np.arange(len(self.position))
        return np.array([*map(self.index, listed(place))])

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        (rows, columns), lines = self.size, self.walls.split()
        size = f"rows x columns = {rows} x {columns}"
        require(rows * columns <= MAX_CELLS, size, f"at most {MAX_CELLS} cells")
        is_complete = [len(line) for line in lines] == [columns] * rows and set(self.walls) <= set(
            "#. \n"
        )
        accepted = f'{rows} lines of {columns} characters, "#" a wall, "." floor'
        require(is_complete or not lines, "walls", accepted)
        return self


class Round(Table):
    """A square or circle around the person, by Chebyshev or Euclidean distance."""

    kind: Literal["square", "circle"]
    """Whether the distance is Chebyshev ("square") or Euclidean ("circle")."""
    radius: Length
    """The largest distance that belongs to the region."""


class Egg(Table):
    """Two half ellipses that meet beside the person, who keeps more room in front than behind.

    It reaches two thirds of `front` to either side and half of it behind, as in Kirby, Simmons and
    Forlizzi (2009), "COMPANION: A Constraint-Optimizing Method for Person-Acceptable Robot
    Navigation".
    """

    kind: Literal["egg"]
    """This shape."""
    front: Annotated[float, Field(ge=1e-9, le=1000)]
    """How far it reaches ahead."""


class Ring(Table):
    """The ring on which people of a group stand, around the space between them.

    This is the o-space (Kendon 1990, "Conducting Interaction", chapter 7). Here, the middle of the
    ring is as far from the centre of the people as they are on average. What lies within it is
    uncomfortable, too.
    """

    kind: Literal["ring"]
    """This shape, for the target region of a `group`."""
    width: Annotated[float, Field(gt=0, le=1000)]
    """From the ring's inner to its outer edge."""


AnyShape = Round | Egg | Ring
Shape = Annotated[AnyShape, Field(discriminator="kind")]


class Regions(Table):
    """The regions around a person: squares by their radii, or any two shapes.

    The target region is what lies in its shape and not in the uncomfortable one. Radii are
    Chebyshev distances in cells. Lengths of shapes are in cells, or in metres if `unit` says so.
    """

    uncomfortable_radius: Annotated[int, Field(ge=0, le=1000)] | None = None
    """Radius of a square; together with `target_radius`, in place of shapes."""
    target_radius: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Radius of the square around both regions; more than `uncomfortable_radius`."""
    unit: Literal["cells", "metres"] = "cells"
    """Unit of the lengths of shapes; metres need `grid.metres_per_cell`."""
    uncomfortable: Shape | None = None
    """Shape of the uncomfortable region."""
    target: Shape | None = None
    """Shape of the target region with what lies inside it; for people who talk, a ring around all
    of them."""

    @model_validator(mode="after")
    def _nested(self) -> Self:
        inner = self.uncomfortable_radius
        outer = self.target_radius
        given = tuple(
            value is not None for value in (inner, outer, self.uncomfortable, self.target)
        )
        if given not in ((True, True, False, False), (False, False, True, True)):
            keys = "uncomfortable_radius and target_radius"
            raise ValueError(f"accepted: the keys {keys}, or the tables uncomfortable and target")
        if inner is not None and outer is not None:
            accepted = f"more than uncomfortable_radius = {inner}"
            require(outer > inner, f"target_radius = {outer}", accepted)
            require(self.unit == "cells", 'unit = "metres"', '"cells", since radii are in cells')
        is_around = isinstance(self.uncomfortable, Ring)
        require(not is_around, 'uncomfortable.kind = "ring"', "square, circle or egg")
        return self

    def cell_width(self, grid: Grid) -> float:
        """Returns the width of a grid's cells in the unit of lengths."""
        return grid.metres_per_cell or 1.0 if self.unit == "metres" else 1.0

    @property
    def shapes(self) -> tuple[AnyShape, AnyShape]:
        """The shapes of the uncomfortable region, and of the target region with its inside."""
        return (
            self.uncomfortable or Round(kind="square", radius=self.uncomfortable_radius or 0),
            self.target or Round(kind="square", radius=self.target_radius or 0),
        )


def zones(regions: Regions, heading: Heading, cell: Cell, grid: Grid) -> Codes:
    """Returns the zone of every cell around a person, (C,) index into ZONES."""
    down, right = (grid.position - cell).T * regions.cell_width(grid)
    row, column = HEADINGS[heading]
    ahead = down * row + right * column
    aside = right * -row + down * column
    inner, outer = (_holds(shape, ahead, aside) for shape in regions.shapes)
    inside = [(down == 0) & (right == 0), inner, outer]
    return np.select(inside, [ISSUER, UNCOMFORTABLE, TARGET], OUTSIDE).astype(np.int8)


def ring_zones(ring: Ring, people: Ints, cell: Ints, width: float) -> Codes:
    """Returns the zone of every cell around the centre of each group, (groups, C) index into ZONES.

    The cells of people are (groups, people, 2), all cells (C, 2); `width` is that of a cell.
    """
    centre, radius = circles(people)
    distance = np.hypot(*np.moveaxis(cell - centre[:, None], 2, 0))  # (groups, C)
    beyond = (distance - radius[:, None]) * width
    inside = [abs(beyond) <= ring.width / 2 + TOLERANCE, beyond < 0]
    return np.select(inside, [TARGET, UNCOMFORTABLE], 0).astype(np.int8)


def circles(people: Ints) -> tuple[Floats, Floats]:
    """Returns the circles amid rings: centres, (groups, 2), and radii, (groups,), in cells.

    The cells of people are as in `ring_zones`.
    """
    centre = people.mean(axis=1)
    return centre, np.hypot(*np.moveaxis(people - centre[:, None], 2, 0)).mean(axis=1)


def _holds(shape: AnyShape, ahead: Floats, aside: Floats) -> Bools:
    if isinstance(shape, Ring):  # around a group, not around a person
        return np.zeros(ahead.shape, dtype=np.bool_)
    if isinstance(shape, Egg):
        length = np.where(ahead >= 0, shape.front, shape.front / 2)
        return np.hypot(ahead / length, aside / (shape.front * 2 / 3)) <= 1 + TOLERANCE
    is_square = shape.kind == "square"
    distance = np.maximum(abs(ahead), abs(aside)) if is_square else np.hypot(ahead, aside)
    return distance <= shape.radius + TOLERANCE


def connected(cells: Bools, free: Bools) -> Bools:
    """Returns which free cells connect with one of `cells`; all are (grids, rows, columns)."""
    margin = (0, 0), (0, 1), (0, 1)  # not free, so rolling does not connect opposite sides
    free = np.pad(free, margin)
    reached = np.pad(cells, margin) & free
    n_reached = -1
    while n_reached < (n_reached := reached.sum()):
        for step, axis in product((-1, 1), (1, 2)):
            reached |= np.roll(reached, step, axis) & free
    return reached[:, :-1, :-1]


def target_distance(regions: Regions, cell: Cell, size: tuple[int, int]) -> Ints:
    """Returns the Chebyshev distance of every cell from the target region around a person, (C,).

    The region counts as complete even if the grid's edge cuts it. Shapes raise an InputError.
    """
    if regions.uncomfortable_radius is None or regions.target_radius is None:
        raise InputError("regions: the distance from the target region needs radii.")
    row, column = np.indices(size).reshape(2, -1)
    distance = np.maximum(abs(row - cell[0]), abs(column - cell[1]))
    outside = distance - regions.target_radius
    within = regions.uncomfortable_radius + 1 - distance
    return np.asarray(np.maximum(np.maximum(outside, within), 0))


def outlines(inside: Bools) -> tuple[Loop, ...]:
    """Returns the border of cells, (rows, columns), as closed loops; beyond the grid is outside.

    >>> outlines(np.array([[False, True, True]]))
    (((0, 1), (0, 3), (1, 3), (1, 1)),)
    """
    padded = np.pad(inside, 1)
    edges = set()  # the corner where each begins, and its direction: right, down, left or up
    for row, column in np.argwhere(inside).tolist():
        for ahead, (down, right) in enumerate(_CORNERS):
            beyond = _DIRECTIONS[ahead - 1]
            if not padded[row + 1 + beyond[0], column + 1 + beyond[1]]:
                edges.add((row + down, column + right, ahead))
    loops = []
    while edges:
        row, column, ahead = min(edges)
        loop = list[Corner]()
        before = ahead + 3
        while (row, column, ahead) in edges:
            edges.remove((row, column, ahead))
            if ahead != before:
                loop.append((row, column))
            before = ahead
            row += _DIRECTIONS[ahead][0]
            column += _DIRECTIONS[ahead][1]
            # Two edges begin where cells touch only at a corner: the line turns right and follows
            # its cell.
            for turn in (3, 0, 1):
                if (row, column, (before + turn) % 4) in edges:
                    ahead = (before + turn) % 4
        loops.append(tuple(loop))
    return tuple(loops)
