"""Scenarios: grid, people, regions, change and rewards, read from TOML and checked.

`envs.model` computes a scenario's dynamics. The shipped scenarios are in `envs/scenarios/*.toml`; comments
there say what each is about, and in S1 to S3 which term of the paper a value has.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Set
from functools import cached_property, lru_cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, Self, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, ValidationError, WrapValidator, model_validator
from pydantic import ValidatorFunctionWrapHandler as Handler

from envs.inputs import Line, Name, Table, check_file_name, override, parse, read_toml, require, unknown_name
from envs.regions import HEADINGS, ZONES, Cell, Egg, Heading, Regions, zones

SCENARIO_DIRECTORY = Path(__file__).parent / "scenarios"
MAX_STATES = 100_000
# What can be observed, in the order of an observation.
COMPONENTS: Final = ("agent", "offset", "issuer", "phase", "wrong_pings")

Reward = Annotated[float, Field(ge=-1e6, le=1e6)]
Steps = Annotated[int, Field(ge=1, le=1000)]
_CERTAINTY_TOLERANCE: Final = 1e-9  # of a sum of probabilities


def _checked_place(value: object, handler: Handler) -> object:
    if isinstance(value, list):  # from JSON, where strict validation would have accepted it as a tuple
        value = tuple(tuple(item) if isinstance(item, list) else item for item in value)
    try:
        return handler(value)
    except ValidationError as error:
        accepted = 'a cell [ROW, COLUMN], a list of at least one cell, or "anywhere"'
        raise ValueError(f"accepted: {accepted}") from error


# A cell, or cells of which one is drawn at the start of every episode; "anywhere": wherever it is allowed.
_Cells = Annotated[tuple[Cell, ...], Field(min_length=1)]
Place = Annotated[Cell | _Cells | Literal["anywhere"], WrapValidator(_checked_place)]


class Grid(Table):
    """Size of the floor, the cell in which episodes start, and walls."""

    omitted_at_default: ClassVar[Set[str]] = {"walls", "metres_per_cell"}

    rows: Annotated[int, Field(ge=1, le=1000)]
    """Number of rows; together at most 100,000 cells."""
    columns: Annotated[int, Field(ge=1, le=1000)]
    """Number of columns."""
    start: Place
    """Where the agent starts, outside every region."""
    walls: str = ""
    """A line of text per row: "#" is a wall, "." floor. Nobody can enter a wall."""
    metres_per_cell: Annotated[float, Field(gt=0, le=100)] | None = None
    """Width of a cell, for regions in metres."""

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    @cached_property
    def position(self) -> NDArray[np.int_]:
        """(C, 2) row and column of each cell."""
        return np.stack(np.divmod(np.arange(self.rows * self.columns), self.columns), axis=1)

    @cached_property
    def offset(self) -> NDArray[np.int_]:
        """(offsets, 2) rows and columns from one cell to another, for all offsets on the grid."""
        rows, columns = self.size
        offsets = np.divmod(np.arange((2 * rows - 1) * (2 * columns - 1)), 2 * columns - 1)
        return np.asarray(np.stack(offsets, axis=1) - (rows - 1, columns - 1))

    @cached_property
    def is_wall(self) -> NDArray[np.bool_]:
        """(C,) which cells are walls."""
        signs = "".join(self.walls.split()) or "." * (self.rows * self.columns)
        return np.array([sign == "#" for sign in signs])

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        (rows, columns), lines = self.size, self.walls.split()
        size = f"rows x columns = {rows} x {columns}"
        require(rows * columns <= MAX_STATES, size, f"at most {MAX_STATES} cells")
        is_complete = [len(line) for line in lines] == [columns] * rows and set(self.walls) <= set("#. \n")
        accepted = f'{rows} lines of {columns} characters, "#" a wall, "." floor'
        require(is_complete or not lines, "walls", accepted)
        return self


class PlainFeedback(Table):
    """No reward, or minus the issuer's L1 distance from the agent, relative to the farthest start.

    Delayed feedback, also by distance, comes with the action after the PING, and never if the PING ends the
    episode. The issuer must not move then, since the model does not remember where it stood at the PING.
    """

    kind: Literal["none", "distance", "delayed"]
    """Which of the three."""


class NoisyFeedback(Table):
    """Feedback by distance plus a number drawn at each PING, uniformly between minus and plus `noise`."""

    kind: Literal["noisy"]
    """This kind."""
    noise: Annotated[float, Field(gt=0, le=1e6)]
    """Half the width of the interval that the number is drawn from."""


class BoundedFeedback(Table):
    """Drawn at each PING, uniformly between two bounds; or `high` if it is correct, `low` if it is wrong."""

    kind: Literal["uniform", "binary"]
    """Drawn between the bounds, or one of them."""
    low: Reward
    """Smallest reward, or that for a wrong PING."""
    high: Reward
    """Largest reward, or that for a correct PING."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        is_ordered = self.kind == "binary" or self.low < self.high
        require(is_ordered, f"low = {self.low}", f"less than high = {self.high}")
        return self


AnyFeedback = PlainFeedback | NoisyFeedback | BoundedFeedback
Feedback = Annotated[AnyFeedback, Field(discriminator="kind")]
FEEDBACK: Final = {  # in words, by kind
    "none": "no feedback",
    "uniform": "random feedback",
    "distance": "feedback by distance",
    "noisy": "noisy feedback by distance",
    "delayed": "delayed feedback by distance",
    "binary": "binary feedback",
}


class Walk(Table):
    """A walk in straight lines from the issuer's position to each corner in turn, and back; then again.

    The issuer looks where it goes.
    """

    corners: Annotated[tuple[Cell, ...], Field(min_length=1, max_length=100)]
    """Where the walk turns: each is in the row or column of the one before."""
    steps: Steps = 1
    """Steps of the agent for each cell of the walk."""


class Issuer(Table):
    """The person whose personal space matters, and the reward that this person adds to every PING."""

    omitted_at_default: ClassVar[Set[str]] = {"heading", "walk", "places", "unseen", "permuted"}

    position: Place
    """Where the issuer stands when an episode starts."""
    places: Annotated[int, Field(ge=1, le=MAX_STATES)] | None = None
    """How many of the cells of `position` it may stand in, drawn once, see `draw`; all by default."""
    unseen: Annotated[int, Field(ge=0, le=MAX_STATES)] = 0
    """Further cells, drawn after these: part of the observations, but no episode starts with it there."""
    permuted: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of its cells whose coordinates are permuted: as coordinates, an agent observes another cell."""
    feedback: Feedback
    """The reward that the issuer adds to every PING."""
    heading: Heading = "up"
    """Where the issuer looks."""
    walk: Walk | None = None
    """How the issuer walks; by default it does not."""


class Person(Table):
    """A person with regions, who stays in one cell."""

    omitted_at_default: ClassVar[Set[str]] = {"heading"}

    position: Cell
    """Where the person stands."""
    feedback: Feedback
    """The reward that the person adds to a PING if no other person is nearer."""
    regions: Regions
    heading: Heading = "up"
    """Where the person looks."""


# Names and probabilities. Sorted, so that equal phases have equal hashes and draw alike.
Chances = Annotated[
    dict[str, Annotated[float, Field(gt=0, le=1)]],
    Field(max_length=20),
    AfterValidator(lambda chances: dict(sorted(chances.items()))),
]


class Phase(Table):
    """What is different about the issuer for some time, and how the phase ends.

    Either every phase lasts a number of `steps`, and the first follows the last; or every phase names with
    which probability which other phase follows after each step (`next`), and stays otherwise. What a phase
    does not give is as in the scenario's other tables.
    """

    omitted_at_default: ClassVar[Set[str]] = {"position", "heading", "regions", "steps", "next"}

    name: Annotated[Line, Field(min_length=1, max_length=40)]
    """Name of the phase, for pictures and for `next`."""
    position: Cell | None = None
    """Where the issuer stands in this phase."""
    heading: Heading | None = None
    """Where the issuer looks in this phase."""
    regions: Regions | None = None
    """The regions around the issuer in this phase."""
    steps: Steps | None = None
    """How many steps the phase lasts."""
    next: Chances | None = None
    """With which probability which other phase follows after each step, by name; the sum is at most 1."""


class Rewards(Table):
    """The grid's rewards, by event."""

    issuer_reached: Reward
    """For a move onto a person's cell, which ends the episode."""
    target_ping: Reward
    """For a PING in the target region, which ends the episode with success."""
    last_wrong_ping: Reward
    """For the wrong PING that ends the episode, see `ping_limit`."""
    wrong_ping: Reward
    """For an earlier wrong PING outside all regions."""
    wrong_ping_uncomfortable: Reward
    """For an earlier wrong PING in an uncomfortable region."""
    uncomfortable: Reward
    """For a move that ends in an uncomfortable region."""
    other: Reward
    """For any other move."""


class Scenario(Table):
    """A checked scenario, named after its file.

    An episode has one of J places of the issuer, drawn at its start. It goes through P phases, which pass by
    the ticks of a clock: a phase of three steps has three ticks, one with `next` a single tick. J = P = 1
    unless the scenario says otherwise.
    """

    omitted_at_default: ClassVar[Set[str]] = {"observe", "others", "phases", "first_phase", "draw"}

    name: Name
    """The stem of the file."""
    description: str
    """What the scenario is about, for readers."""
    grid: Grid
    issuer: Issuer
    regions: Regions
    ping_limit: Annotated[int, Field(ge=1)]
    """Which wrong PING ends the episode."""
    rewards: Rewards
    observe: tuple[Literal["agent", "offset", "issuer", "phase", "wrong_pings"], ...] = ("agent",)
    """What the agent sees, in this order: its own cell, or the issuer's relative to it in rows and columns
    ("offset"); the issuer's cell; the phase; the number of wrong PINGs."""
    others: Annotated[tuple[Person, ...], Field(max_length=20)] = ()
    """Other people."""
    phases: Annotated[tuple[Phase, ...], Field(max_length=1000)] = ()
    """What changes about the issuer over time."""
    first_phase: Literal["first", "any"] = "first"
    """In which phase an episode starts; "any": at any step of any phase, all equally likely."""
    draw: Annotated[int, Field(ge=0, le=10**9)] = 0
    """Which places and which permutation are drawn, if any. The first n places are the same for every n."""

    @cached_property
    def stages(self) -> tuple[Phase, ...]:
        """(P,) the phases; those of a walk are its cells, and without any there is a single one."""
        walk = self.issuer.walk
        if walk is None:
            return self.phases or (Phase(name="always"),)
        cells: list[tuple[Cell, Heading]] = []
        for (row, column), (to_row, to_column) in pairwise(self._turns):
            step = int(np.sign(to_row - row)), int(np.sign(to_column - column))
            heading = next(name for name, direction in HEADINGS.items() if direction == step)
            n_steps = abs(to_row - row) + abs(to_column - column)
            cells += [((row + k * step[0], column + k * step[1]), heading) for k in range(n_steps)]
        return tuple(
            Phase(name=f"{i}", position=cell, heading=heading, steps=walk.steps)
            for i, (cell, heading) in enumerate(cells, start=1)
        )

    @property
    def _turns(self) -> list[Cell]:  # the cells between which the issuer walks straight, and back
        walk, position = self.issuer.walk, cast("Cell", self.issuer.position)
        return [position, *walk.corners, position] if walk else []

    @cached_property
    def ticks(self) -> NDArray[np.int_]:
        """(ticks,) the phase of each tick of the clock."""
        return np.repeat(np.arange(len(self.stages)), [stage.steps or 1 for stage in self.stages])

    @cached_property
    def following(self) -> tuple[NDArray[np.int_], NDArray[np.float64]]:
        """The K ticks that may follow each tick, (ticks, K), and their probabilities."""
        n, stages = len(self.ticks), self.stages
        if stages[0].next is None:
            return (np.arange(n)[:, None] + 1) % n, np.ones((n, 1))
        index = {stage.name: i for i, stage in enumerate(stages)}
        n_outcomes = 1 + max(len(stage.next or {}) for stage in stages)
        ticks, probability = np.arange(n)[:, None].repeat(n_outcomes, axis=1), np.zeros((n, n_outcomes))
        for i, stage in enumerate(stages):
            chances = stage.next or {}
            for k, (name, chance) in enumerate(chances.items(), start=1):
                ticks[i, k], probability[i, k] = index[name], chance
            probability[i, 0] = max(1.0 - math.fsum(chances.values()), 0.0)
        return ticks, probability

    @cached_property
    def places(self) -> tuple[Cell, ...]:
        """(J,) where the issuer may stand when an episode starts, also those of `issuer.unseen`."""
        return tuple(self.starts_by_place)

    @cached_property
    def people(self) -> tuple[tuple[tuple[Person, ...], ...], ...]:
        """(J, P, people) the issuer, and the others, in each place and phase."""
        return tuple(tuple(self._people(place, stage) for stage in self.stages) for place in self.places)

    @cached_property
    def issuer_cells(self) -> tuple[Cell, ...]:
        """(I,) where the issuer may stand at some time, by row and then by column."""
        return tuple(sorted({people[0].position for stages in self.people for people in stages}))

    @cached_property
    def shown_cells(self) -> tuple[Cell, ...]:
        """(I,) the cells whose coordinates stand for these; a permuted one has those of the next drawn."""
        n_permuted = round(self.issuer.permuted * len(self.issuer_cells))
        order = self._in_drawn_order(self.issuer_cells)[:n_permuted]
        following = dict(zip(order, [*order[1:], *order[:1]], strict=True))
        return tuple(following.get(cell, cell) for cell in self.issuer_cells)

    @cached_property
    def zone(self) -> NDArray[np.int8]:
        """(J, P, C) index into `envs.regions.ZONES`: the zone of every cell in each place and phase."""
        return np.stack([self._zones_by_place[place] for place in self.places])

    @cached_property
    def starts(self) -> NDArray[np.int_]:
        """(B, 3) place, tick and cell of every start of an episode, all equally likely."""
        return self._starts_in({*self._in_drawn_order(self.places)[: self.issuer.places]})

    @property
    def unseen_starts(self) -> NDArray[np.int_]:
        """(starts, 3) the same of episodes with the issuer in an unseen place, which are never trained."""
        n = self.issuer.places or len(self.places)
        return self._starts_in({*self._in_drawn_order(self.places)[n:]})

    def _starts_in(self, places: Set[Cell]) -> NDArray[np.int_]:
        rows = [np.zeros((0, 3), dtype=int)]
        for j, (place, starts) in enumerate(self.starts_by_place.items()):
            if place in places:
                rows.append(np.column_stack([np.full(len(starts), j), starts]))
        return np.concatenate(rows)

    def _in_drawn_order(self, cells: Iterable[Cell]) -> list[Cell]:
        def rank(cell: Cell) -> bytes:  # the same in all rooms that have the cell
            return hashlib.sha256(json.dumps([self.draw, *cell]).encode()).digest()

        return sorted(cells, key=rank)

    @property
    def draws(self) -> bool:
        """Whether `draw` makes a difference."""
        return self.issuer.places is not None or self.issuer.permuted > 0

    def drawn(self, draw: int) -> Self:
        """Returns the scenario with another draw, which needs no checks."""
        other = self.model_copy(update={"draw": draw})
        other.__dict__.update(_zones_by_place=self._zones_by_place, _free_places=self._free_places)
        return other

    @property
    def hidden(self) -> tuple[str, ...]:
        """What does not follow from what is observed: other components, "clock" and "feedback to come"."""
        contexts = {(people[0].position, i) for stages in self.people for i, people in enumerate(stages)}
        seen = [i for i, name in enumerate(("issuer", "phase")) if name in self.observe]

        def n_values(*parts: int) -> int:
            return len({tuple(context[i] for i in parts) for context in contexts})

        is_hidden = {
            "agent's cell" if "offset" in self.observe else "issuer": n_values(*seen, 0) > n_values(*seen),
            "phase": n_values(*seen, 1) > n_values(*seen),
            "wrong_pings": self.ping_limit > 1 and "wrong_pings" not in self.observe,
            "clock": len(self.ticks) > len(self.stages) > 1,
            "feedback to come": self.is_delayed,
        }
        return tuple(name for name in is_hidden if is_hidden[name])

    @property
    def observed_sizes(self) -> list[int]:
        """How many values each observed component has."""
        sizes = {
            "agent": self.grid.rows * self.grid.columns,
            "offset": len(self.grid.offset),
            "issuer": len(self.issuer_cells),
            "phase": len(self.stages),
            "wrong_pings": self.ping_limit,
        }
        return [sizes[name] for name in self.observe]

    @property
    def n_observations(self) -> int:
        """O, the product of these sizes."""
        return math.prod(self.observed_sizes)

    @property
    def has_front(self) -> bool:
        """Whether it matters where someone looks."""
        people = chain.from_iterable(self.people[0])
        return any(isinstance(shape, Egg) for person in people for shape in person.regions.shapes)

    @property
    def moves(self) -> bool:
        """Whether the issuer moves during an episode."""
        return any(stage.position is not None for stage in self.stages)

    @property
    def is_delayed(self) -> bool:
        """Whether some feedback comes with the action after a PING."""
        feedback = [self.issuer.feedback, *(person.feedback for person in self.others)]
        return any(one.kind == "delayed" for one in feedback)

    @cached_property
    def starts_by_place(self) -> dict[Cell, NDArray[np.int_]]:
        """The places of the issuer, each with (starts, 2) ticks and cells of the agent."""
        free, n = self._free_places, self.issuer.places
        drawn = {*free} if n is None else {*self._in_drawn_order(free)[: n + self.issuer.unseen]}
        return {place: starts for place, starts in free.items() if place in drawn}

    @cached_property
    def _free_places(self) -> dict[Cell, NDArray[np.int_]]:
        """The same of all cells of `issuer.position` that have a start and a target that can be entered."""
        grid = self.grid
        ticks = np.arange(len(self.ticks)) if self.first_phase == "any" else np.zeros(1, dtype=int)
        allowed = np.zeros(grid.rows * grid.columns, dtype=np.bool_)
        allowed[[row * grid.columns + column for row, column in _cells(grid.start, grid)]] = True
        starts = {}
        for place, zone in self._zones_by_place.items():
            is_free = allowed & ~grid.is_wall & (zone[self.ticks[ticks]] == ZONES.index("outside"))
            tick, cell = np.nonzero(is_free)
            if len(tick) and self._has_target(place):
                starts[place] = np.column_stack([ticks[tick], cell])
        return starts

    @cached_property
    def _zones_by_place(self) -> dict[Cell, NDArray[np.int8]]:
        """The zone of every cell in each phase, (P, C), by where the issuer can stand."""
        taken = [person.position for person in self.others]
        return {
            place: np.array([self._zones(self._people(place, stage)) for stage in self.stages])
            for place in _cells(self.issuer.position, self.grid)
            if not self._is_wall(place) and place not in taken
        }

    def _has_target(self, place: Cell) -> bool:  # that the agent can enter in some phase
        is_target = self._zones_by_place[place] == ZONES.index("target")
        return bool((is_target & ~self.grid.is_wall).any())

    def _is_wall(self, cell: Cell) -> bool:
        return bool(self.grid.is_wall[cell[0] * self.grid.columns + cell[1]])

    def _people(self, place: Cell, stage: Phase) -> tuple[Person, ...]:
        issuer = Person.model_construct(
            position=stage.position or place,
            heading=stage.heading or self.issuer.heading,
            regions=stage.regions or self.regions,
            feedback=self.issuer.feedback,
        )
        return issuer, *self.others

    def _zones(self, people: tuple[Person, ...]) -> NDArray[np.int8]:
        size, width = self.grid.size, self.grid.metres_per_cell or 1.0
        around = [zones(person.regions, person.heading, person.position, size, width) for person in people]
        nearest = np.max(around, axis=0)  # uncomfortable if it is so to anyone
        return np.where(self.grid.is_wall, ZONES.index("outside"), nearest).astype(np.int8)

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        ordered = tuple(name for name in COMPONENTS if name in self.observe)
        observe = f"observe = {list(self.observe)}"
        accepted = f"either agent or offset, and others at most once each, in the order {list(COMPONENTS)}"
        has_one = ("agent" in ordered) != ("offset" in ordered)
        require(has_one and self.observe == ordered, observe, accepted)
        regions = [*(person.regions for person in self.others), *(phase.regions for phase in self.phases)]
        is_in_cells = all(region is None or region.unit == "cells" for region in [self.regions, *regions])
        accepted = '"cells", unless grid.metres_per_cell is given'
        require(is_in_cells or self.grid.metres_per_cell is not None, 'regions.unit = "metres"', accepted)
        self._check_phases()
        self._check_walk()
        self._check_cells()
        self._check_sizes()
        self._check_starts()
        n, accepted = self.n_observations, f"at most {MAX_STATES}"
        require(n <= MAX_STATES, f"{observe}: {n} observations", accepted)
        return self

    def _check_phases(self) -> None:
        for i, phase in enumerate(self.phases):
            where, chances, is_timed = f"phases.{i}", phase.next or {}, phase.next is None
            is_alike = (phase.steps is not None) == is_timed == (self.phases[0].next is None)
            require(is_alike, f"{where} ({phase.name})", "steps in every phase, or next in every phase")
            others = [other.name for other in self.phases if other is not phase]
            is_unique = phase.name not in others
            require(is_unique, f"{where}.name = {phase.name}", "another name, since it is taken")
            for name in chances:
                accepted = ", ".join(others) or "no phase"
                require(name in others, f"{where}.next: {name} is not another phase", accepted)
            total = math.fsum(chances.values())
            require(total <= 1 + _CERTAINTY_TOLERANCE, f"{where}.next: the sum {total:g}", "at most 1")

    def _check_walk(self) -> None:
        walk = self.issuer.walk
        require(walk is None or not self.phases, "issuer.walk and phases", "one of them")
        if walk is None and all(phase.position is None for phase in self.phases):
            return
        moved_by = "phases with positions" if walk is None else "issuer.walk"
        is_cell = isinstance(self.issuer.position[0], int)
        require(is_cell, f"{moved_by} with issuer.position = {json.dumps(self.issuer.position)}", "a cell")
        for first, last in pairwise(self._turns):
            is_straight = (first[0] == last[0]) != (first[1] == last[1])
            where = f"issuer.walk.corners: from {json.dumps(first)} to {json.dumps(last)}"
            require(is_straight, where, "another cell of the same row or column, also on the way back")
        where = 'feedback.kind = "delayed" with an issuer that moves'
        require(not self.is_delayed, where, "any other kind")

    def _check_cells(self) -> None:
        walk = self.issuer.walk
        positions = {
            "issuer.position": _listed(self.issuer.position),
            "grid.start": _listed(self.grid.start),
            **{f"others.{i}.position": [person.position] for i, person in enumerate(self.others)},
            **{f"phases.{i}.position": _listed(phase.position) for i, phase in enumerate(self.phases)},
            "issuer.walk.corners": walk.corners if walk else (),
        }
        for key, cells in positions.items():
            for cell in cells:
                self._check_cell(key, cell)
        for stage in self.stages if walk else ():
            self._check_cell("issuer.walk.corners", cast("Cell", stage.position))

    def _check_cell(self, key: str, cell: Cell) -> None:
        (row, column), (rows, columns) = cell, self.grid.size
        where = f"{key} = [{row}, {column}]"
        accepted = f"rows 0 to {rows - 1}, columns 0 to {columns - 1}"
        require(0 <= row < rows and 0 <= column < columns, f"{where} is off the grid", accepted)
        require(not self._is_wall(cell), f"{where} is a wall", "another cell")
        n_others = [person.position for person in self.others].count(cell)
        is_free = n_others == key.startswith("others")
        require(is_free, f"{where} is taken by another person", "another cell")

    def _check_sizes(self) -> None:
        issuer, n_cells = self.issuer, self.grid.rows * self.grid.columns
        n_positions = n_cells if issuer.position == "anywhere" else len(_listed(issuer.position))
        if issuer.places is not None:
            n_positions = min(n_positions, issuer.places + issuer.unseen)
        n_ticks = sum(stage.steps or 1 for stage in self.stages)
        n_states = n_cells * self.ping_limit * n_positions * n_ticks * (1 + self.is_delayed)
        factors = "cells x ping_limit x positions of the issuer x ticks of the phases"
        product = f"{factors}{' x 2 for delayed feedback' * self.is_delayed} = {n_states} states"
        require(n_states <= MAX_STATES, product, f"at most {MAX_STATES}")

    def _check_starts(self) -> None:
        listed, free = _listed(self.issuer.position), self._free_places
        for place in listed:
            where = f"regions: with the issuer at {json.dumps(place)}, the agent can enter no target region"
            accepted = "a target shape that reaches beyond the uncomfortable one"
            require(self._has_target(place), where, accepted)
        used = {divmod(cell, self.grid.columns) for starts in free.values() for cell in starts[:, 1].tolist()}
        whose = f"the issuer at {json.dumps(self.issuer.position)}{' or another person' * bool(self.others)}"
        for cell in _listed(self.grid.start):
            where = f"grid.start = {json.dumps(cell)} lies inside a region of {whose}"
            require(cell in used, where, "a cell outside every region")
        unused = [place for place in listed if place not in free]
        where = f"issuer.position = {json.dumps(unused[0] if unused else self.issuer.position)}"
        accepted = "other cells, smaller regions, or another grid.start"
        is_startable = bool(free) and not unused
        require(is_startable, f"{where} leaves no start outside every region", accepted)
        n, unseen = self.issuer.places, self.issuer.unseen
        require(n is not None or not unseen, f"issuer.unseen = {unseen}", "0, or issuer.places as well")
        where = f"issuer.places = {n} with issuer.unseen = {unseen}"
        accepted = f"at most {len(free)} together: the issuer can stand in so many cells"
        require((n or 0) + unseen <= len(free), where, accepted)


ScenarioLike = str | Path | Scenario | Mapping[str, object]


def _cells(place: Place, grid: Grid) -> list[Cell]:
    if place == "anywhere":
        return [divmod(cell, grid.columns) for cell in range(grid.rows * grid.columns)]
    return _listed(place)


def _listed(place: Place | None) -> list[Cell]:
    """Returns the different cells that a place lists: none for "anywhere"."""
    match place:
        case None | "anywhere":
            return []
        case (int(row), int(column)):
            return [(row, column)]
        case cells:
            return [*dict.fromkeys(cells)]


def scenario_names() -> list[str]:
    """Returns the names of the shipped scenarios."""
    return sorted(path.stem for path in SCENARIO_DIRECTORY.glob("*.toml"))


def load_scenario(scenario: ScenarioLike, overrides: Mapping[str, object] | None = None) -> Scenario:
    """Reads a scenario and checks it.

    Args:
      scenario: The name of a shipped scenario (`"S1"`), the path of a TOML file, a `Scenario`, or a
        mapping of its values as from `Scenario.model_dump`.
      overrides: New values by dotted key, for example `{"issuer.position": [8, 6]}`.

    Raises:
      InputError: For each mistake a sentence that names the file, the key, its value and what is accepted.
    """
    if isinstance(scenario, Scenario):
        if not overrides:
            return scenario
        scenario = scenario.model_dump(mode="json")
    if isinstance(scenario, Mapping):
        source = str(scenario.get("name", "scenario"))
        return parse(Scenario, override(scenario, overrides or {}, source), source)
    path = Path(scenario)
    if path.suffix != ".toml":
        path = SCENARIO_DIRECTORY / f"{scenario}.toml"
        if str(scenario) not in scenario_names():
            unknown_name("scenarios", "scenario", str(scenario), scenario_names(), "the path of a .toml file")
    check_file_name(path, "the scenario is")
    changed = override(read_toml(path), overrides or {}, str(path))
    return _checked(json.dumps(changed, default=str), path)


@lru_cache(maxsize=256)  # experiments load the same scenarios again and again
def _checked(values: str, path: Path) -> Scenario:
    return parse(Scenario, json.loads(values), str(path), name=path.stem)
