"""Scenarios: grid, people, regions, change and rewards, read from TOML and checked.

`envs.layout` finds where people stand and episodes start, `envs.model` computes a scenario's dynamics. The
shipped scenarios are in `envs/scenarios/*.toml`; comments there say what each is about, and in S1 to S3 which
term of the paper a value has.
"""

import json
import math
from collections.abc import Iterable, Mapping, Set
from functools import cached_property, lru_cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from envs import inputs
from envs.inputs import InputError, Name, Table, require
from envs.layout import Layout, draw_onlookers, draw_places, resolve, timeline, walkers
from envs.people import MAX_STATES, Group, Issuer, Onlookers, OwnFeedback, Person, Phase, Reward
from envs.regions import ZONES, Cell, Grid, Regions, Ring, listed
from envs.sources import find_modules_in

SCENARIO_DIRECTORY = Path(__file__).parent / "scenarios"
_MAX_STATES_OF_PLACE: Final = 100_000  # states that are compiled together
# What can be observed, in the order of an observation.
COMPONENTS: Final = ("agent", "offset", "issuer", "phase", "wrong_pings")

Observed = Literal["agent", "offset", "issuer", "phase", "wrong_pings"]


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
    """A checked scenario, named after its file."""

    omitted_at_default: ClassVar[Set[str]] = {
        *("observe", "group", "onlookers", "others", "phases", "first_phase", "draw")
    }

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
    """What the agent sees, in this order: its own cell ("agent"), or the cells of the person and the group
    relative to it, in rows and columns ("offset"); the cells of the person and the group ("issuer"); the
    phase; the number of wrong PINGs."""
    group: Group | None = None
    """People who are drawn together with the person; by default none."""
    onlookers: Onlookers | None = None
    """People who are seen, but do not matter; by default none."""
    others: Annotated[tuple[Person, ...], Field(max_length=20)] = ()
    """Other people."""
    phases: Annotated[tuple[Phase, ...], Field(max_length=1000)] = ()
    """What changes about the person over time."""
    first_phase: Literal["first", "any"] = "first"
    """In which phase an episode starts; "any": at any step of any phase, all equally likely."""
    draw: Annotated[int, Field(ge=0, le=10**9)] = 0
    """Which places and which permutation are drawn, if any. The first n places are the same for every n."""

    @cached_property
    def layout(self) -> Layout:
        """Where people stand and episodes start, in the places that are drawn."""
        layout = draw_places(self._every_way, self.issuer.places, self.issuer.unseen, self.draw)
        return draw_onlookers(layout, self.onlookers, self.draw) if self.onlookers else layout

    @cached_property
    def _every_way(self) -> Layout:
        # Scenarios that differ only in what is drawn or observed share it.
        issuer = self.issuer.model_copy(update={"places": None, "unseen": 0, "permuted": 0.0})
        tables = self.group, self.regions, self.others, self.phases, self.first_phase
        return resolve(self.grid, issuer, *tables)

    def people_in(self, place: int, phase: int) -> tuple[Person, ...]:
        """Returns the issuer with its group, and the others, in a place and phase."""
        stage, cells = self.layout.stages[phase], self.layout.standing[place, phase]
        heading, regions = stage.heading or self.issuer.heading, stage.regions or self.regions
        new, feedback = Person.model_construct, self.issuer.feedback
        same: dict[str, Any] = {"heading": heading, "regions": regions, "feedback": feedback}
        positions = map(tuple, self.grid.position[cells].tolist())
        return *(new(position=position, **same) for position in positions), *self.layout.others[phase]

    def drawn(self, draw: int) -> Self:
        """Returns the scenario with another draw; itself if it draws nothing."""
        if self.issuer.places is None and not self.issuer.permuted and not self.onlookers:
            return self
        return self.model_copy(update={"draw": draw})

    def seen_by_offset(self) -> Self:
        """Returns the scenario with offsets observed in place of the agent's and people's cells."""
        others = tuple(name for name in self.observe if name in ("phase", "wrong_pings"))
        seen = self.model_copy(update={"observe": ("offset", *others)})
        try:
            seen._check_observations()
        except ValueError as error:
            raise InputError(f"{self.name}: {error}.") from error
        return seen

    @property
    def hidden(self) -> tuple[str, ...]:
        """What observations do not determine: other components, "clock" and "feedback to come"."""
        layout = self.layout
        n_places, n_phases, n_people = layout.standing.shape
        _, place = np.unique(layout.standing.reshape(-1, n_people), axis=0, return_inverse=True)
        contexts = np.column_stack([place.ravel(), np.tile(np.arange(n_phases), n_places)])
        seen = [i for i, name in enumerate(("issuer", "phase")) if name in self.observe]
        is_relative = "agent" not in self.observe

        def n_values(*parts: int) -> int:
            return len(np.unique(contexts[:, parts], axis=0)) if parts else 1

        is_hidden = {
            "agent's cell" if is_relative else "issuer": n_values(*seen, 0) > n_values(*seen),
            "phase": n_values(*seen, 1) > n_values(*seen),
            "wrong_pings": self.ping_limit > 1 and "wrong_pings" not in self.observe,
            "clock": len(layout.ticks) > n_phases > 1,
            "feedback to come": self.is_delayed,
        }
        return tuple(name for name in is_hidden if is_hidden[name])

    @property
    def n_people(self) -> int:
        """How many people are drawn, the issuer included."""
        return self.group.people if self.group else 1

    @cached_property
    def observed_sizes(self) -> dict[str, tuple[int, int]]:
        """The largest number of values of each observed component, and the width of its one-hot form."""
        (n_places, n_phases, n), n_cells = self.layout.standing.shape, len(self.grid.position)
        n_offsets = math.prod(2 * length - 1 for length in self.grid.size)
        most = n_offsets if n == 1 else min(n_offsets**n, n_places * n_phases * n_cells)
        n_issuer_cells = len(self.layout.issuer_cells)
        issuer = n_issuer_cells if n == 1 else n_places, n_issuer_cells
        if self.onlookers:
            issuer = n_places, n_cells * (1 + self.onlookers.badge) * (n + self.onlookers.people)
        sizes = {
            "agent": (n_cells, n_cells),
            "offset": (most, n_offsets * n),
            "issuer": issuer,
            "phase": (n_phases, n_phases),
            "wrong_pings": (self.ping_limit, self.ping_limit),
        }
        return {name: sizes[name] for name in self.observe}

    @property
    def n_positions(self) -> int:
        """How many positions are observed: of the agent, of people, or relative ones."""
        if self.observe[0] == "offset":
            return self.n_people
        n_people = self.n_people + (self.onlookers.people if self.onlookers else 0)
        return 1 + n_people * ("issuer" in self.observe)

    @property
    def n_observations(self) -> int:
        """The product of these sizes: O, or more if some combinations of offsets never occur."""
        return math.prod(size for size, _ in self.observed_sizes.values())

    @property
    def has_front(self) -> bool:
        """Whether it matters where someone looks."""
        return any(shape.kind == "egg" for regions in self._regions for shape in regions.shapes)

    @property
    def _regions(self) -> list[Regions]:  # those of all people, in all phases
        further = chain((person.regions for person in self.others), (phase.regions for phase in self.phases))
        return [regions for regions in (self.regions, *further) if regions]

    @property
    def is_delayed(self) -> bool:
        """Whether some feedback comes with the action after a PING."""
        feedback = [self.issuer.feedback, *(person.feedback for person in self.others)]
        return any(each is not None and each.kind == "delayed" for each in feedback)

    @property
    def own_feedback(self) -> list[OwnFeedback]:
        """The feedback by functions of users."""
        feedback = [self.issuer.feedback, *(person.feedback for person in self.others)]
        return [each for each in feedback if isinstance(each, OwnFeedback)]

    @property
    def has_pockets(self) -> bool:
        """Whether starts are left out because no way leads to a target; until version 0.9 they were not."""
        every, is_allowed = self._every_way, np.zeros(len(self.grid.position), dtype=np.bool_)
        is_allowed[self.grid.cells_of(self.grid.start)] = True
        is_outside = every.zone[:, every.first_phases] == ZONES.index("outside")
        has_target = (every.zone == ZONES.index("target")).any(axis=(1, 2), keepdims=True)
        return bool((is_outside & (is_allowed & ~self.grid.is_wall) & has_target & ~every.is_start).any())

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        ordered = tuple(name for name in COMPONENTS if name in self.observe)
        observe = f"observe = {list(self.observe)}"
        accepted = f"agent or offset, and others at most once each, in the order {list(COMPONENTS)}"
        has_one = len({*ordered} & {"agent", "offset"}) == 1
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
            require(total <= 1 + 1e-9, f"{where}.next: the sum {total:g}", "at most 1")

    def _check_walks(self) -> None:
        walking = walkers(self.issuer, self.others)
        require(not walking or not self.phases, f"{next(iter(walking), '')}.walk and phases", "one of them")
        is_moved = self.issuer.walk or any(phase.position is not None for phase in self.phases)
        if is_moved:
            moved_by = "issuer.walk" if self.issuer.walk else "phases with positions"
            require(self.group is None, f"{moved_by} and group", "one of them")
            where = f"{moved_by} with issuer.position = {json.dumps(self.issuer.position)}"
            require(isinstance(self.issuer.position[0], int), where, "a cell")
        for key, (position, walk) in walking.items():
            self._check_inside(f"{key}.position", position)
            for first, last in pairwise([position, *walk.corners, position]):
                self._check_inside(f"{key}.walk.corners", last)
                is_straight = (first[0] == last[0]) != (first[1] == last[1])
                where = f"{key}.walk.corners: from {json.dumps(first)} to {json.dumps(last)}"
                require(is_straight, where, "another cell of the same row or column, also on the way back")
        if self.onlookers:
            require(not is_moved, "onlookers and a person who moves", "one of them")
        if is_moved or walking:
            where = 'feedback.kind = "delayed" with someone who moves'
            require(not self.is_delayed, where, "any other kind")
        if walking:
            n = math.lcm(*(walk.steps * len(walk.route(at)) for at, walk in walking.values()))
            whose = ", ".join(f"{key}.walk" for key in walking)
            where = f"{whose}: it takes {n:,} steps until everybody is back"
            most = _MAX_STATES_OF_PLACE // (len(self.grid.position) * self.ping_limit)
            require(n <= most, where, f"at most {most:,}, with so many cells and so large a ping_limit")

    def _check_cells(self) -> None:
        others, walking = self.others, walkers(self.issuer, self.others)
        stages, others_at = timeline(self.issuer, others, self.phases)
        first, still = ({it.position for it in others if not (is_still and it.walk)} for is_still in (0, 1))
        at_some_time = {person.position for people in others_at for person in people}
        self._check_floor("issuer.position", listed(self.issuer.position), at_some_time)
        self._check_floor("grid.start", listed(self.grid.start), first)
        for i, person in enumerate(others):
            occupied = {other.position for other in others if other is not person}
            self._check_floor(f"others.{i}.position", [person.position], occupied)
        for i, phase in enumerate(self.phases):
            self._check_floor(f"phases.{i}.position", listed(phase.position), first)
        for key, (position, walk) in walking.items():
            self._check_floor(f"{key}.walk.corners", [cell for cell, _ in walk.route(position)], still)
        for stage, people in zip(stages, others_at, strict=True):
            own = listed(stage.position or self.issuer.position)
            cells = [*(own if len(own) == 1 else ()), *(person.position for person in people)]
            for cell in cells:
                where = f"{', '.join(walking) or 'others'}: two people at once in {json.dumps(cell)}"
                require(cells.count(cell) == 1, where, "another position or walk")

    def _check_floor(self, key: str, cells: Iterable[Cell], occupied: Set[Cell]) -> None:
        """Refuses cells off the grid, in a wall or taken by others."""
        for cell in cells:
            self._check_inside(key, cell)
            where = f"{key} = {json.dumps(cell)}"
            require(not self.grid.is_wall[self.grid.index(cell)], f"{where} is a wall", "another cell")
            require(cell not in occupied, f"{where} is taken by another person", "another cell")

    def _check_inside(self, key: str, cell: Cell) -> None:
        (row, column), (rows, columns) = cell, self.grid.size
        accepted = f"rows 0 to {rows - 1}, columns 0 to {columns - 1}"
        is_inside = 0 <= row < rows and 0 <= column < columns
        require(is_inside, f"{key} = {json.dumps(cell)} is off the grid", accepted)

    def _check_sizes(self) -> None:
        issuer, whose = self.issuer, "the group" if self.group else "the person"
        stages, others_at = timeline(issuer, self.others, self.phases)
        n_ticks = sum(stage.steps or 1 for stage in stages)
        n_states = len(self.grid.position) * self.ping_limit * n_ticks * (1 + self.is_delayed)
        twice = " x 2 for delayed feedback" * self.is_delayed
        where = f"cells x ping_limit x ticks of the phases{twice} = {n_states} states for each position"
        require(n_states <= _MAX_STATES_OF_PLACE, f"{where} of {whose}", f"at most {_MAX_STATES_OF_PLACE}")
        n_positions = len(self.grid.cells_of(issuer.position))
        if self.group is not None:
            n_positions = int(self._every_way.has_start.sum())
        if issuer.places is not None:
            n_positions = min(n_positions, issuer.places + issuer.unseen)
        if crowd := self.onlookers:
            occupied = {person.position for people in others_at for person in people}
            most = int((~self.grid.is_wall).sum()) - len(occupied) - self.n_people
            where = f"onlookers.people = {crowd.people}"
            require(crowd.people <= most, where, f"at most {most}, a free cell for each")
            n_seen = max(n_positions - issuer.unseen, 1)
            n_positions = max(crowd.ways, n_seen) + issuer.unseen * -(-crowd.ways // n_seen)
            whose += " and ways of onlookers"
        n_outcomes = 1 + max(len(stage.next or {}) for stage in stages)
        times = f" x {n_outcomes} phases that may follow" * (n_outcomes > 1)
        where = f"cells x ping_limit x positions of {whose} x ticks of the phases{twice}{times}"
        n = n_states * n_positions * n_outcomes
        require(n <= MAX_STATES, f"{where} = {n} states", f"at most {MAX_STATES}")

    def _check_starts(self) -> None:
        every, group, position = self._every_way, self.group, json.dumps(self.issuer.position)
        if group is not None:
            where = f"group: nowhere do {group.people} people stand {list(group.apart)} apart"
            require(len(every.ways) > 0, where, "another range of group.apart, or more cells")
        own = [] if group else listed(self.issuer.position)
        has_target = (every.zone == ZONES.index("target")).any(axis=(1, 2)).tolist()  # in some phase
        without = [place for place, has in zip(own, has_target, strict=False) if not has]
        where = f"with the person at {json.dumps(without[0])}" if without else "wherever people stand"
        where = f"regions: {where}, the agent can enter no target region"
        accepted = "a target shape that reaches beyond the uncomfortable one"
        require(any(has_target) and not without, where, accepted)
        whose = f"the person at {position}{' or another person' * bool(self.others)}"
        for cell in listed(self.grid.start):
            where, index = f"grid.start = {json.dumps(cell)}", self.grid.index(cell)
            is_outside = bool((every.zone[:, every.first_phases, index] == ZONES.index("outside")).any())
            require(is_outside, f"{where} lies inside a region of {whose}", "a cell outside every region")
            accepted = "a cell that walls and people do not cut off"
            is_start = bool(every.is_start[:, :, index].any())
            require(is_start, f"{where}: no way leads from there to a target region", accepted)
        unused = [place for place, free in zip(own, every.has_start.tolist(), strict=False) if not free]
        where = f"issuer.position = {json.dumps(unused[0] if unused else self.issuer.position)}"
        where += " leaves no start that is outside every region and has a way to a target region"
        accepted = "other cells, smaller regions, fewer walls, or another grid.start"
        require(bool(every.has_start.any()) and not unused, where, accepted)
        n, unseen, most = self.issuer.places, self.issuer.unseen, int(every.has_start.sum())
        require(n is not None or not unseen, f"issuer.unseen = {unseen}", "0, or issuer.places as well")
        where = f"issuer.places = {n} with issuer.unseen = {unseen}"
        can = "the group can stand in so many ways" if group else "the person can stand in so many cells"
        require((n or 0) + unseen <= most, where, f"at most {most} together: {can}")


ScenarioLike = str | Path | Scenario | Mapping[str, object]


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
