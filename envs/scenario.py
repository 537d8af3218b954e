"""Scenarios: grid, people, regions, change and rewards, read from TOML and checked.

`envs.model` computes a scenario's dynamics. The shipped scenarios are in `envs/scenarios/*.toml`; comments
there say what each is about, and in S1 to S3 which term of the paper a value has.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence, Set
from functools import cached_property, lru_cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from envs import inputs
from envs.inputs import InputError, Label, Name, Table, require
from envs.people import MAX_STATES, Group, Issuer, OwnFeedback, Person, Place, Reward, Steps, Walk
from envs.regions import TOLERANCE, ZONES, Cell, Heading, Regions, Ring, connected, ring_zones, zones
from envs.sources import find_modules_in

SCENARIO_DIRECTORY = Path(__file__).parent / "scenarios"
MAX_CELLS: Final = 100_000
_MOST_STATES_OF_PLACE: Final = 100_000  # which are compiled together
_MOST_ZONES: Final = 100_000_000  # of cells, over all ways in which people may stand, and phases
_AT_ONCE: Final = 1_000_000  # of them, to save memory
# What can be seen of where people stand relative to the agent, see `envs.observations`.
RELATIVE: Final = ("offset", "nearest", "two_nearest", "centre")
# What can be observed, in the order of an observation.
COMPONENTS: Final = ("agent", *RELATIVE, "issuer", "phase", "wrong_pings")

_CERTAINTY_TOLERANCE: Final = 1e-9  # of a sum of probabilities
Observed = Literal["agent", "offset", "nearest", "two_nearest", "centre", "issuer", "phase", "wrong_pings"]


class Grid(Table):
    """Size of the floor, the cell in which episodes start, and walls."""

    omitted_at_default: ClassVar[Set[str]] = {"walls", "metres_per_cell"}

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

    @cached_property
    def position(self) -> NDArray[np.int_]:
        """(C, 2) row and column of each cell."""
        return np.stack(np.divmod(np.arange(self.rows * self.columns), self.columns), axis=1)

    @cached_property
    def is_wall(self) -> NDArray[np.bool_]:
        """(C,) which cells are walls."""
        signs = "".join(self.walls.split()) or "." * (self.rows * self.columns)
        return np.array([sign == "#" for sign in signs])

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        (rows, columns), lines = self.size, self.walls.split()
        size = f"rows x columns = {rows} x {columns}"
        require(rows * columns <= MAX_CELLS, size, f"at most {MAX_CELLS} cells")
        is_complete = [len(line) for line in lines] == [columns] * rows and set(self.walls) <= set("#. \n")
        accepted = f'{rows} lines of {columns} characters, "#" a wall, "." floor'
        require(is_complete or not lines, "walls", accepted)
        return self


# Names and probabilities. Sorted, so that equal phases have equal hashes and draw alike.
Chances = Annotated[
    dict[str, Annotated[float, Field(gt=0, le=1)]],
    Field(max_length=20),
    AfterValidator(lambda chances: dict(sorted(chances.items()))),
]


class Phase(Table):
    """What is different about the person for some time, and how the phase ends.

    Either every phase lasts a number of `steps`, and the first follows the last; or every phase names with
    which probability which other phase follows after each step (`next`), and stays otherwise. What a phase
    does not give is as in the scenario's other tables.
    """

    omitted_at_default: ClassVar[Set[str]] = {"position", "heading", "regions", "steps", "next"}

    name: Annotated[Label, Field(min_length=1, max_length=40)]
    """Name of the phase, for pictures and for `next`."""
    position: Cell | None = None
    """Where the person stands in this phase."""
    heading: Heading | None = None
    """Where the person looks in this phase."""
    regions: Regions | None = None
    """The regions around the person in this phase."""
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

    An episode has one of J places of the person, drawn at its start. It goes through P phases, which pass by
    the ticks of a clock: a phase of three steps has three ticks, one with `next` a single tick. J = P = 1
    unless the scenario says otherwise.
    """

    omitted_at_default: ClassVar[Set[str]] = {"observe", "group", "others", "phases", "first_phase", "draw"}

    name: Name
    """The stem of the file."""
    description: Annotated[str, Field(max_length=10_000)]
    """What the scenario is about, for readers."""
    grid: Grid
    issuer: Issuer
    regions: Regions
    ping_limit: Annotated[int, Field(ge=1, le=10**9)]
    """Which wrong PING ends the episode."""
    rewards: Rewards
    observe: tuple[Observed, ...] = ("agent",)
    """What the agent sees, in this order: its own cell ("agent"), or people's cells relative to it, in rows
    and columns ("offset": of all in the person's group; "nearest", "two_nearest", "centre"); the cells of the
    person and the group ("issuer"); the phase; the number of wrong PINGs."""
    group: Group | None = None
    """People who are drawn together with the person; by default none."""
    others: Annotated[tuple[Person, ...], Field(max_length=20)] = ()
    """Other people."""
    phases: Annotated[tuple[Phase, ...], Field(max_length=1000)] = ()
    """What changes about the person over time."""
    first_phase: Literal["first", "any"] = "first"
    """In which phase an episode starts; "any": at any step of any phase, all equally likely."""
    draw: Annotated[int, Field(ge=0, le=10**9)] = 0
    """Which places and which permutation are drawn, if any. The first n places are the same for every n."""

    @cached_property
    def stages(self) -> tuple[Phase, ...]:
        """(P,) the phases; those of walks are where people are, and without any there is a single one."""
        if not self._walks:
            return self.phases or (Phase(name="always"),)
        issuer = self._walks.get("issuer")
        n = self._round // self._beat
        spots = [issuer[i % len(issuer)] if issuer else (None, None) for i in range(n)]
        steps, numbered = self._beat, enumerate(spots, start=1)
        return tuple(Phase(name=f"{i}", position=at, heading=to, steps=steps) for i, (at, to) in numbered)

    @cached_property
    def _walks(self) -> dict[str, list[tuple[Cell, Heading]]]:
        """Cell and heading in every beat of a round of each person who walks, by the person's key."""
        return {
            key: [spot for spot in walk.route(position) for _ in range(walk.steps // self._beat)]
            for key, (position, walk) in self._walkers.items()
        }

    @property
    def _walkers(self) -> dict[str, tuple[Cell, Walk]]:
        people: dict[str, Issuer | Person] = {"issuer": self.issuer}
        people |= {f"others.{i}": person for i, person in enumerate(self.others)}
        return {key: (cast("Cell", who.position), who.walk) for key, who in people.items() if who.walk}

    @property
    def _beat(self) -> int:  # steps during which nobody leaves a cell
        return math.gcd(*(walk.steps for _, walk in self._walkers.values()))

    @property
    def _round(self) -> int:  # steps until everybody is back
        return math.lcm(*(walk.steps * len(walk.route(at)) for at, walk in self._walkers.values()))

    @cached_property
    def others_at(self) -> tuple[tuple[Person, ...], ...]:
        """(P, others) the other people in each phase."""
        in_phase: list[list[Person]] = [[] for _ in self.stages]
        for i, person in enumerate(self.others):
            spots = self._walks.get(f"others.{i}", [])
            walking = [person.model_copy(update={"position": at, "heading": to}) for at, to in spots]
            for p, people in enumerate(in_phase):
                people.append(walking[p % len(walking)] if walking else person)
        return tuple(map(tuple, in_phase))

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
    def places(self) -> tuple[tuple[Cell, ...], ...]:
        """(J,) where the issuer and its group may stand when an episode starts, unseen places included."""
        cells = self.grid.position[self._ways[self._drawn_indices]]
        return tuple(tuple(map(tuple, place)) for place in cells.tolist())

    @cached_property
    def standing(self) -> NDArray[np.int_]:
        """(J, P, people) the cells of the issuer and its group, in each place and phase."""
        standing = np.repeat(self._ways[self._drawn_indices, None], len(self.stages), axis=1)
        for p, stage in enumerate(self.stages):
            if stage.position is not None:
                standing[:, p] = stage.position @ np.array([self.grid.columns, 1])
        return standing

    def people_in(self, place: int, phase: int) -> tuple[Person, ...]:
        """Returns the issuer with its group, and the others, in a place and phase."""
        stage, cells = self.stages[phase], self.grid.position[self.standing[place, phase]].tolist()
        heading, regions = stage.heading or self.issuer.heading, stage.regions or self.regions
        new, feedback = Person.model_construct, self.issuer.feedback
        same: dict[str, Any] = {"heading": heading, "regions": regions, "feedback": feedback}
        return *(new(position=(*cell,), **same) for cell in cells), *self.others_at[phase]

    @cached_property
    def issuer_cells(self) -> tuple[Cell, ...]:
        """(I,) where the issuer or someone of its group may stand at some time, by row and then by column."""
        return tuple(divmod(index, self.grid.columns) for index in np.unique(self.standing).tolist())

    @cached_property
    def shown_cells(self) -> tuple[Cell, ...]:
        """(I,) the coordinates shown for each cell; a permuted one has those of the next drawn."""
        n_permuted = round(self.issuer.permuted * len(self.issuer_cells))
        order = sorted(self.issuer_cells, key=self._rank)[:n_permuted]
        following = dict(zip(order, [*order[1:], *order[:1]], strict=True))
        return tuple(following.get(cell, cell) for cell in self.issuer_cells)

    @cached_property
    def zone(self) -> NDArray[np.int8]:
        """(J, P, C) index into `envs.regions.ZONES`: the zone of every cell in each place and phase."""
        return np.asarray(self._zones[self._drawn_indices])

    @cached_property
    def every_start(self) -> NDArray[np.int_]:
        """(starts, 3) place, tick and cell of every start of an episode, also in unseen places."""
        place, tick, cell = np.nonzero(self._is_start[self._drawn_indices])
        return np.column_stack([place, tick, cell])

    @property
    def is_seen(self) -> NDArray[np.bool_]:
        """(J,) whether episodes with the issuer in a place are trained."""
        return np.isin(self._drawn_indices, self._drawn_order[: self.issuer.places])

    @property
    def _drawn_indices(self) -> NDArray[np.int_]:  # (J,) rising, of the G
        return np.sort(self._drawn_order)

    @cached_property
    def _drawn_order(self) -> NDArray[np.int_]:  # (J,) the same, in the order in which they are drawn
        free, n = np.flatnonzero(self._is_start.any(axis=(1, 2))), self.issuer.places
        if n is None:
            return free
        ranks = [*map(self._rank, self.grid.position[self._ways[free]].tolist())]
        return free[sorted(range(len(free)), key=ranks.__getitem__)[: n + self.issuer.unseen]]

    def _rank(self, place: Sequence[object]) -> bytes:
        """Returns what a cell, or a group's cells, are drawn by; the same in all rooms."""
        parts = cast("Cell", place[0]) if len(place) == 1 else place  # of one person, the cell
        return hashlib.sha256(json.dumps([self.draw, *parts]).encode()).digest()

    def drawn(self, draw: int) -> Self:
        """Returns the scenario with another draw; itself if it draws nothing."""
        if self.issuer.places is None and not self.issuer.permuted:
            return self
        return self._changed({"draw": draw}, "_ways", "_zones", "_is_start")

    def seen_as(self, relative: str) -> Self:
        """Returns the scenario with one of `RELATIVE` observed in place of the agent's and people's cells."""
        others = tuple(name for name in self.observe if name in ("phase", "wrong_pings"))
        same = "_ways", "_zones", "_is_start", "_drawn_order"
        seen = self._changed({"observe": (relative, *others)}, *same)
        try:
            seen._check_observations()
        except ValueError as error:
            raise InputError(f"{self.name}: {error}.") from error
        return seen

    def _changed(self, update: Mapping[str, object], *same: str) -> Self:
        other = self.model_copy(update=update)
        other.__dict__.update({name: getattr(self, name) for name in same})
        return other

    @property
    def hidden(self) -> tuple[str, ...]:
        """What does not follow from what is observed: other components, "clock" and "feedback to come"."""
        n_places, n_phases, n_people = self.standing.shape
        _, place = np.unique(self.standing.reshape(-1, n_people), axis=0, return_inverse=True)
        contexts = np.column_stack([place.ravel(), np.tile(np.arange(n_phases), n_places)])
        seen = [i for i, name in enumerate(("issuer", "phase")) if name in self.observe]
        is_relative = "agent" not in self.observe

        def n_values(*parts: int) -> int:
            return len(np.unique(contexts[:, parts], axis=0)) if parts else 1

        is_hidden = {
            "agent's cell" if is_relative else "issuer": n_values(*seen, 0) > n_values(*seen),
            "rest of the group": is_relative and n_people > self.n_seen,
            "phase": n_values(*seen, 1) > n_values(*seen),
            "wrong_pings": self.ping_limit > 1 and "wrong_pings" not in self.observe,
            "clock": len(self.ticks) > len(self.stages) > 1,
            "feedback to come": self.is_delayed,
        }
        return tuple(name for name in is_hidden if is_hidden[name])

    @property
    def n_people(self) -> int:
        """How many people are drawn, the issuer included."""
        return self.group.people if self.group else 1

    @property
    def n_seen(self) -> int:
        """How many people's offsets are observed, if any are; the centre of all counts as one."""
        return min({"nearest": 1, "centre": 1, "two_nearest": 2}.get(self.observe[0], 6), self.n_people)

    @cached_property
    def observed_sizes(self) -> dict[str, tuple[int, int]]:
        """How many values each observed component has, at most, and numbers its one-hot form."""
        (n_places, n_phases, n), n_cells = self.standing.shape, len(self.grid.position)
        n_offsets = math.prod(2 * length - 1 for length in self.grid.size)
        n_centres = math.prod(2 * n * (length - 1) + 1 for length in self.grid.size)
        n_seen, most = self.n_seen, n_offsets
        if n_seen > 1:
            most = min(n_offsets**n_seen, n_places * n_phases * n_cells)
        sizes = {
            **dict.fromkeys(RELATIVE, (most, n_offsets * n_seen)),
            "agent": (n_cells, n_cells),
            "centre": (n_centres, n_centres),
            "issuer": (len(self.issuer_cells) if n == 1 else n_places, len(self.issuer_cells)),
            "phase": (n_phases, n_phases),
            "wrong_pings": (self.ping_limit, self.ping_limit),
        }
        return {name: sizes[name] for name in self.observe}

    @property
    def n_observations(self) -> int:
        """The product of these sizes: O, or more if some combinations of offsets never occur."""
        return math.prod(size for size, _ in self.observed_sizes.values())

    @property
    def has_front(self) -> bool:
        """Whether it matters where someone looks."""
        return any(shape.kind == "egg" for regions in self._regions for shape in regions.shapes)

    @property
    def _regions(self) -> list[Regions]:  # of all people, in all phases
        further = chain((person.regions for person in self.others), (phase.regions for phase in self.phases))
        return [regions for regions in (self.regions, *further) if regions]

    @property
    def moves(self) -> bool:
        """Whether someone moves during an episode."""
        return bool(self._walks) or any(stage.position is not None for stage in self.stages)

    @property
    def is_delayed(self) -> bool:
        """Whether some feedback comes with the action after a PING."""
        feedback = [self.issuer.feedback, *(person.feedback for person in self.others)]
        return any(one is not None and one.kind == "delayed" for one in feedback)

    @property
    def own_feedback(self) -> list[OwnFeedback]:
        """The feedback by functions of users."""
        feedback = [self.issuer.feedback, *(person.feedback for person in self.others)]
        return [one for one in feedback if isinstance(one, OwnFeedback)]

    @cached_property
    def _ways(self) -> NDArray[np.int_]:
        """(G, people) all ways in which the issuer and its group may stand, as cells; rising in a group."""
        grid, group = self.grid, self.group
        cells = _cells(self.issuer.position, grid)
        taken = [row * grid.columns + column for row, column in self._taken]
        cells = cells[~(grid.is_wall[cells] | np.isin(cells, taken))]
        self._check_ways(len(cells), 1)
        if group is None:
            return cells[:, None]
        cells = np.sort(cells)
        # The difference of two of these numbers says how many rows and columns two cells are apart.
        number = grid.position[cells] @ (2 * grid.columns - 1, 1)
        apart = np.hypot(*np.ix_(*(np.arange(1 - n, n) for n in grid.size))).ravel()
        if self.regions.unit == "metres":
            apart = apart * (grid.metres_per_cell or 1.0)
        # As in regions, rounding must not decide.
        may_join = (apart >= group.apart[0] - TOLERANCE) & (apart <= group.apart[1] + TOLERANCE)
        groups = np.arange(len(cells))[:, None]
        for n_placed in range(2, group.people + 1):
            found: list[NDArray[np.int_]] = []
            for some in np.array_split(groups, 1 + groups.size * len(cells) // _AT_ONCE):
                is_next = may_join[number - number[some][:, :, None] + len(apart) // 2].all(axis=1)
                before, joining = np.nonzero(is_next & (np.arange(len(cells)) > some[:, -1:]))
                found.append(np.column_stack([some[before], joining]))
                self._check_ways(sum(map(len, found)), n_placed)
            groups = np.concatenate(found)
        return np.asarray(cells[groups])

    @cached_property
    def _taken(self) -> frozenset[Cell]:  # by others, at some time
        return frozenset(person.position for people in self.others_at for person in people)

    @property
    def _first_phases(self) -> NDArray[np.int_]:  # of the ticks in which episodes may start
        return self.ticks if self.first_phase == "any" else self.ticks[:1]

    def _check_ways(self, n: int, n_placed: int) -> None:
        most = _MOST_ZONES // (len(self.grid.position) * max(len(self.stages), len(self._first_phases)))
        who = f"{n_placed} of the {self.n_people} people of the group" if self.group else "the person"
        ways = f"{n:,} ways{' or more' * (n_placed > 1)}"  # all of them are not counted then
        narrower = ", or a narrower range of group.apart" if self.group else ""
        accepted = f"at most {most:,} with so many cells and phases; list fewer cells{narrower}"
        require(n <= most, f"issuer.position: {who} can stand in {ways}", accepted)

    @cached_property
    def _zones(self) -> NDArray[np.int8]:
        """(G, P, C) the zone of every cell in each phase, of all ways to stand."""
        grid, placed, width = self.grid, self._ways, self.grid.metres_per_cell or 1.0
        zone = np.zeros((len(placed), len(self.stages), grid.rows * grid.columns), dtype=np.int8)
        for p, stage in enumerate(self.stages):
            regions, heading = stage.regions or self.regions, stage.heading or self.issuer.heading
            cells, member = np.unique(placed, return_inverse=True)
            spots = [stage.position] if stage.position else [*map(tuple, grid.position[cells].tolist())]
            windows = (zones(regions, heading, spot, grid.size, width) for spot in spots)
            around = np.array([*windows], dtype=np.int8).reshape(-1, zone.shape[2])
            member = member.reshape(placed.shape) if stage.position is None else 0 * placed
            for some in np.array_split(np.arange(len(placed)), 1 + zone.size // _AT_ONCE):
                for column in member[some].T:  # uncomfortable if it is so to anyone
                    zone[some, p] = np.maximum(zone[some, p], around[column])
                if isinstance(regions.target, Ring):
                    unit = width if regions.unit == "metres" else 1.0
                    ring = ring_zones(regions.target, grid.position[placed[some]], grid.position, unit)
                    zone[some, p] = np.maximum(zone[some, p], ring)
            for person in self.others_at[p]:
                zone[:, p, person.position @ np.array([grid.columns, 1])] = ZONES.index("issuer")
                if person.regions is not None:
                    its = zones(person.regions, person.heading, person.position, grid.size, width)
                    zone[:, p] = np.maximum(zone[:, p], its)
        zone[:, :, grid.is_wall] = ZONES.index("outside")
        return zone

    @cached_property
    def _is_start(self) -> NDArray[np.bool_]:
        """(G, first ticks, C) where episodes may start: outside regions, with a way to a target region."""
        grid, n_ways, first = self.grid, len(self._ways), self._first_phases
        allowed = np.isin(np.arange(len(grid.position)), _cells(grid.start, grid))
        is_start = np.zeros((n_ways, len(first), len(allowed)), dtype=np.bool_)
        for some in np.array_split(np.arange(n_ways), 1 + self._zones.size // _AT_ONCE):
            zone = self._zones[some]
            # In some phase. Nobody passes walls, or someone who never moves.
            is_target = (zone == ZONES.index("target")).any(axis=1)
            is_free = (zone != ZONES.index("issuer")).any(axis=1) & ~grid.is_wall
            has_way = connected(*(cells.reshape(-1, *grid.size) for cells in (is_target, is_free)))
            is_allowed = (has_way.reshape(is_free.shape) & allowed)[:, None]
            is_start[some] = (zone[:, first] == ZONES.index("outside")) & is_allowed
        return is_start

    @property
    def has_pockets(self) -> bool:
        """Whether starts are left out because no way leads to a target; until version 0.9 they were not."""
        allowed = np.isin(np.arange(len(self.grid.position)), _cells(self.grid.start, self.grid))
        is_outside = self._zones[:, self._first_phases] == ZONES.index("outside")
        has_target = (self._zones == ZONES.index("target")).any(axis=(1, 2), keepdims=True)
        return bool((is_outside & (allowed & ~self.grid.is_wall) & has_target & ~self._is_start).any())

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        ordered = tuple(name for name in COMPONENTS if name in self.observe)
        observe = f"observe = {list(self.observe)}"
        first = ("agent", *RELATIVE)
        accepted = f"one of {', '.join(first)}, and others at most once each, in the order {list(COMPONENTS)}"
        has_one = len({*ordered} & {*first}) == 1
        require(has_one and self.observe == ordered, observe, accepted)
        is_in_cells = all(regions.unit == "cells" for regions in self._regions)
        accepted = '"cells", unless grid.metres_per_cell is given'
        require(is_in_cells or self.grid.metres_per_cell is not None, 'regions.unit = "metres"', accepted)
        is_ring = any(isinstance(regions.target, Ring) for regions in self._regions)
        require(not is_ring or self.group is not None, 'target.kind = "ring"', "a ring around a [group]")
        self._check_phases()
        self._check_walks()
        self._check_cells()
        self._check_sizes()
        self._check_starts()
        self._check_observations()
        return self

    def _check_observations(self) -> None:
        n, accepted = self.n_observations, f"at most {MAX_STATES}"
        require(n <= MAX_STATES, f"observe = {list(self.observe)}: {n} observations", accepted)

    def _check_phases(self) -> None:
        inputs.distinct(tuple(phase.name for phase in self.phases), "phases: name ")
        for i, phase in enumerate(self.phases):
            where, chances, is_timed = f"phases.{i}", phase.next or {}, phase.next is None
            is_alike = (phase.steps is not None) == is_timed == (self.phases[0].next is None)
            require(is_alike, f"{where} ({phase.name})", "steps in every phase, or next in every phase")
            others = [other.name for other in self.phases if other is not phase]
            for name in chances:
                accepted = ", ".join(others) or "no phase"
                require(name in others, f"{where}.next: {name} is not another phase", accepted)
            total = math.fsum(chances.values())
            require(total <= 1 + _CERTAINTY_TOLERANCE, f"{where}.next: the sum {total:g}", "at most 1")

    def _check_walks(self) -> None:
        walkers = self._walkers
        require(not walkers or not self.phases, f"{next(iter(walkers), '')}.walk and phases", "one of them")
        is_moved = self.issuer.walk or any(phase.position is not None for phase in self.phases)
        if is_moved:
            moved_by = "issuer.walk" if self.issuer.walk else "phases with positions"
            require(self.group is None, f"{moved_by} and group", "one of them")
            where = f"{moved_by} with issuer.position = {json.dumps(self.issuer.position)}"
            require(isinstance(self.issuer.position[0], int), where, "a cell")
        for key, (position, walk) in walkers.items():
            self._check_inside(f"{key}.position", position)
            for first, last in pairwise([position, *walk.corners, position]):
                self._check_inside(f"{key}.walk.corners", last)
                is_straight = (first[0] == last[0]) != (first[1] == last[1])
                where = f"{key}.walk.corners: from {json.dumps(first)} to {json.dumps(last)}"
                require(is_straight, where, "another cell of the same row or column, also on the way back")
        if is_moved or walkers:
            where = 'feedback.kind = "delayed" with someone who moves'
            require(not self.is_delayed, where, "any other kind")
        if walkers:
            n, whose = self._round, ", ".join(f"{key}.walk" for key in walkers)
            where = f"{whose}: it takes {n:,} steps until everybody is back"
            most = _MOST_STATES_OF_PLACE // (len(self.grid.position) * self.ping_limit)
            require(n <= most, where, f"at most {most:,}, with so many cells and so large a ping_limit")

    def _check_cells(self) -> None:
        positions = {
            "issuer.position": _listed(self.issuer.position),
            "grid.start": _listed(self.grid.start),
            **{f"others.{i}.position": [person.position] for i, person in enumerate(self.others)},
            **{f"phases.{i}.position": _listed(phase.position) for i, phase in enumerate(self.phases)},
            **{f"{key}.walk.corners": [cell for cell, _ in spots] for key, spots in self._walks.items()},
        }
        for key, cells in positions.items():
            for cell in cells:
                self._check_cell(key, cell)
        for stage, others in zip(self.stages, self.others_at, strict=True):
            own = _listed(stage.position or self.issuer.position)
            cells = [*(own if len(own) == 1 else ()), *(person.position for person in others)]
            for cell in cells:
                where = f"{', '.join(self._walkers) or 'others'}: two people at once in {json.dumps(cell)}"
                require(cells.count(cell) == 1, where, "another position or walk")

    def _check_cell(self, key: str, cell: Cell) -> None:
        self._check_inside(key, cell)
        where = f"{key} = {json.dumps(cell)}"
        is_wall = bool(self.grid.is_wall[cell[0] * self.grid.columns + cell[1]])
        require(not is_wall, f"{where} is a wall", "another cell")
        who, is_way = key.removesuffix(".walk.corners").removesuffix(".position"), ".walk." in key
        others = [other for i, other in enumerate(self.others) if who != f"others.{i}"]
        standing = {other.position for other in others if not (is_way and other.walk)}
        taken = self._taken if key == "issuer.position" else standing
        require(cell not in taken, f"{where} is taken by another person", "another cell")

    def _check_inside(self, key: str, cell: Cell) -> None:
        (row, column), (rows, columns) = cell, self.grid.size
        accepted = f"rows 0 to {rows - 1}, columns 0 to {columns - 1}"
        is_inside = 0 <= row < rows and 0 <= column < columns
        require(is_inside, f"{key} = {json.dumps(cell)} is off the grid", accepted)

    def _check_sizes(self) -> None:
        issuer, whose = self.issuer, "the group" if self.group else "the person"
        n_states = len(self.grid.position) * self.ping_limit * len(self.ticks) * (1 + self.is_delayed)
        twice = " x 2 for delayed feedback" * self.is_delayed
        where = f"cells x ping_limit x ticks of the phases{twice} = {n_states} states for each position"
        require(n_states <= _MOST_STATES_OF_PLACE, f"{where} of {whose}", f"at most {_MOST_STATES_OF_PLACE}")
        n_positions = len(_cells(issuer.position, self.grid))
        if self.group is not None:
            n_positions = int(self._is_start.any(axis=(1, 2)).sum())
        if issuer.places is not None:
            n_positions = min(n_positions, issuer.places + issuer.unseen)
        n_states *= n_positions
        factors = f"cells x ping_limit x positions of {whose} x ticks of the phases{twice}"
        require(n_states <= MAX_STATES, f"{factors} = {n_states} states", f"at most {MAX_STATES}")
        n = n_states * (1 + max(len(stage.next or {}) for stage in self.stages))
        where = f"phases: {n_states} states, with phases that may follow: {n}"
        require(n <= MAX_STATES, where, f"at most {MAX_STATES}")

    def _check_starts(self) -> None:
        group, position = self.group, json.dumps(self.issuer.position)
        if group is not None:
            where = f"group: nowhere do {group.people} people stand {list(group.apart)} apart"
            require(len(self._ways) > 0, where, "another range of group.apart, or more cells")
        listed = [] if group else _listed(self.issuer.position)
        has_target = (self._zones == ZONES.index("target")).any(axis=(1, 2)).tolist()  # in some phase
        without = [place for place, has in zip(listed, has_target, strict=False) if not has]
        where = f"with the person at {json.dumps(without[0])}" if without else "wherever people stand"
        where = f"regions: {where}, the agent can enter no target region"
        accepted = "a target shape that reaches beyond the uncomfortable one"
        require(any(has_target) and not without, where, accepted)
        whose = f"the person at {position}{' or another person' * bool(self.others)}"
        for cell in _listed(self.grid.start):
            where, index = f"grid.start = {json.dumps(cell)}", cell[0] * self.grid.columns + cell[1]
            is_outside = bool((self._zones[:, self._first_phases, index] == ZONES.index("outside")).any())
            require(is_outside, f"{where} lies inside a region of {whose}", "a cell outside every region")
            accepted = "a cell that walls and people do not cut off"
            is_start = bool(self._is_start[:, :, index].any())
            require(is_start, f"{where}: no way leads from there to a target region", accepted)
        is_free = np.asarray(self._is_start.any(axis=(1, 2)))
        unused = [place for place, free in zip(listed, is_free.tolist(), strict=False) if not free]
        where = f"issuer.position = {json.dumps(unused[0] if unused else self.issuer.position)}"
        where += " leaves no start that is outside every region and has a way to a target region"
        accepted = "other cells, smaller regions, fewer walls, or another grid.start"
        require(bool(is_free.any()) and not unused, where, accepted)
        n, unseen, most = self.issuer.places, self.issuer.unseen, int(is_free.sum())
        require(n is not None or not unseen, f"issuer.unseen = {unseen}", "0, or issuer.places as well")
        where = f"issuer.places = {n} with issuer.unseen = {unseen}"
        can = "the group can stand in so many ways" if group else "the person can stand in so many cells"
        require((n or 0) + unseen <= most, where, f"at most {most} together: {can}")


ScenarioLike = str | Path | Scenario | Mapping[str, object]


def _cells(place: Place, grid: Grid) -> NDArray[np.int_]:
    if place == "anywhere":
        return np.arange(grid.rows * grid.columns)
    return np.asarray(np.array(_listed(place)) @ np.array([grid.columns, 1]))


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
        return inputs.parse(Scenario, inputs.override(scenario, overrides or {}, source), source)
    path = Path(scenario)
    if path.suffix != ".toml":
        path, names = SCENARIO_DIRECTORY / f"{scenario}.toml", scenario_names()
        if str(scenario) not in names:
            inputs.unknown_name("scenarios", "scenario", str(scenario), names, "the path of a .toml file")
    inputs.check_file_name(path, "the scenario is")
    changed = inputs.override(inputs.read_toml(path), overrides or {}, str(path))
    checked = _checked(json.dumps(changed, default=str), path)
    if checked.own_feedback:
        find_modules_in(str(path.parent.resolve()))
    return checked


@lru_cache(maxsize=256)  # experiments load the same scenarios again and again
def _checked(values: str, path: Path) -> Scenario:
    return inputs.parse(Scenario, json.loads(values), str(path), name=path.stem)
