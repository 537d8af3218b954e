"""Scenarios: grid, people, regions, change and rewards, read from TOML and checked.

`envs.layout` finds where people stand and episodes start, `envs.model` computes a scenario's
dynamics. The shipped scenarios are in `envs/scenarios/*.toml`; comments there say what each is
about, and in S1 to S3 which term of the paper a value has.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import Field, model_validator

from envs import inputs
from envs.arrays import read_only
from envs.inputs import Count, Name, Table, require
from envs.layout import Layout, draw_onlookers, draw_places, resolve, timeline, walkers
from envs.people import (
    MAX_STATES,
    Feedback,
    Group,
    Issuer,
    Onlookers,
    OwnFeedback,
    Person,
    Phase,
    Reward,
)
from envs.regions import Cell, Grid, Regions, Ring, listed
from envs.sources import search_beside

SCENARIO_DIRECTORY = Path(__file__).parent / "scenarios"
_MAX_STATES_OF_PLACE = 100_000  # states that are compiled together
# What can be observed, in the order of an observation.
Observed = Literal["agent", "offset", "relative", "issuer", "phase", "wrong_pings"]
COMPONENTS = get_args(Observed)


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

    name: Name
    """The stem of the file."""
    description: Annotated[str, Field(max_length=10_000)]
    """What the scenario is about, for readers."""
    grid: Grid
    issuer: Issuer
    regions: Regions
    ping_limit: Count
    """Which wrong PING ends the episode."""
    rewards: Rewards
    observe: tuple[Observed, ...] = ("agent",)
    """What the agent sees, in this order: its own cell ("agent"), or cells relative to it, in rows
    and columns, of the person and the group ("offset") or of onlookers, too ("relative"); the cells
    of all of these ("issuer"); the phase; the number of wrong PINGs."""
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
    """Which places and which permutation are drawn, if any. The first n places are the same for
    every n."""

    @cached_property
    def layout(self) -> Layout:
        """Where people stand and episodes start, in the places that are drawn."""
        layout = draw_places(self._every_way, self.issuer.places, self.issuer.unseen, self.draw)
        drawn = draw_onlookers(layout, self.onlookers, self.draw) if self.onlookers else layout
        return read_only(drawn)

    @cached_property
    def _every_way(self) -> Layout:
        # Scenarios that differ only in what is drawn or observed share it.
        issuer = self.issuer.model_copy(update={"places": None, "unseen": 0, "permuted": 0.0})
        tables = self.group, self.regions, self.others, self.phases, self.first_phase
        return read_only(resolve(self.grid, issuer, *tables))

    def people_in(self, place: int, phase: int) -> tuple[Person, ...]:
        """Returns the issuer with its group, and the others, in a place and phase."""
        stage = self.layout.stages[phase]
        cells = self.layout.standing[place, phase]
        member = partial(
            Person.model_construct,
            heading=stage.heading or self.issuer.heading,
            regions=stage.regions or self.regions,
            feedback=self.issuer.feedback,
        )
        positions = map(tuple, self.grid.position[cells].tolist())
        return *(member(position=each) for each in positions), *self.layout.others[phase]

    def drawn(self, draw: int) -> Self:
        """Returns the scenario with another draw; itself if it draws nothing."""
        if self.issuer.places is None and not self.issuer.permuted and not self.onlookers:
            return self
        return self.model_copy(update={"draw": draw})

    @property
    def n_people(self) -> int:
        """How many people are drawn, the issuer included."""
        return self.group.people if self.group else 1

    @cached_property
    def n_observations(self) -> int:
        """The product of the components' sizes: O, or more if some offsets never occur together."""
        (n_places, n_phases, n), n_cells = self.layout.standing.shape, len(self.grid.position)
        n_offsets = math.prod(2 * length - 1 for length in self.grid.size)
        offset = n_offsets if n == 1 else min(n_offsets**n, n_places * n_phases * n_cells)
        is_whole = n > 1 or self.onlookers  # a value for each way to stand, else for each cell
        sizes = {
            "agent": n_cells,
            "offset": offset,
            "relative": n_places * n_cells if self.onlookers else offset,
            "issuer": n_places if is_whole else len(self.layout.issuer_cells),
            "phase": n_phases,
            "wrong_pings": self.ping_limit,
        }
        return math.prod(sizes[name] for name in self.observe)

    @property
    def has_front(self) -> bool:
        """Whether it matters where someone looks."""
        return any(shape.kind == "egg" for regions in self._regions for shape in regions.shapes)

    @property
    def _regions(self) -> list[Regions]:  # those of all people, in all phases
        owners: list[Any] = [self, *self.others, *self.phases]
        return [owner.regions for owner in owners if owner.regions]

    @property
    def is_delayed(self) -> bool:
        """Whether some feedback comes with the action after a PING."""
        return any(each.kind == "delayed" for each in self._feedback)

    @property
    def own_feedback(self) -> list[OwnFeedback]:
        """The feedback by functions of users."""
        return [each for each in self._feedback if isinstance(each, OwnFeedback)]

    @property
    def _feedback(self) -> list[Feedback]:
        return [self.issuer.feedback, *(each.feedback for each in self.others if each.feedback)]

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        ordered = tuple(name for name in COMPONENTS if name in self.observe)
        observe = f"observe = {list(self.observe)}"
        has_one = len({*ordered} & {"agent", "offset", "relative"}) == 1
        require(
            has_one and self.observe == ordered,
            observe,
            "agent, offset or relative, and others at most once each, in the order "
            f"{list(COMPONENTS)}",
        )
        for regions in self._regions:
            has_unit = regions.unit == "cells" or self.grid.metres_per_cell is not None
            accepted = '"cells", unless grid.metres_per_cell is given'
            require(has_unit, 'regions.unit = "metres"', accepted)
        for regions in self._regions:
            has_centre = self.group is not None or not isinstance(regions.target, Ring)
            require(has_centre, 'target.kind = "ring"', "a ring around a [group]")
        self._check_phases()
        self._check_walks()
        self._check_cells()
        self._check_sizes()
        self._check_starts()
        n = self.n_observations
        require(n <= MAX_STATES, f"{observe}: {n} observations", f"at most {MAX_STATES}")
        return self

    def _check_phases(self) -> None:
        inputs.distinct(tuple(phase.name for phase in self.phases), "phases: name ")
        for i, phase in enumerate(self.phases):
            where = f"phases.{i}"
            chances = phase.next or {}
            is_timed = phase.next is None
            is_alike = (phase.steps is not None) == is_timed == (self.phases[0].next is None)
            require(
                is_alike, f"{where} ({phase.name})", "steps in every phase, or next in every phase"
            )
            others = [other.name for other in self.phases if other is not phase]
            for name in chances:
                found = f"{where}.next: {name} is not another phase"
                require(name in others, found, ", ".join(others) or "no phase")
            total = math.fsum(chances.values())
            require(total <= 1 + 1e-9, f"{where}.next: the sum {total:g}", "at most 1")

    def _check_walks(self) -> None:
        walking = walkers(self.issuer, self.others)
        position = self.issuer.position
        for key in walking:
            require(not self.phases, f"{key}.walk and phases", "one of them")
        is_moved = self.issuer.walk or any(phase.position is not None for phase in self.phases)
        if is_moved:
            moved_by = "issuer.walk" if self.issuer.walk else "phases with positions"
            is_alone = isinstance(position[0], int) and not self.group and not self.onlookers
            accepted = "a cell as issuer.position, and neither group nor onlookers"
            require(is_alone, f"{moved_by} with issuer.position = {json.dumps(position)}", accepted)
        for key, (first_cell, walk) in walking.items():
            for first, last in pairwise([first_cell, *walk.corners, first_cell]):
                is_straight = (first[0] == last[0]) != (first[1] == last[1])
                where = f"{key}.walk.corners: from {json.dumps(first)} to {json.dumps(last)}"
                accepted = "another cell of the same row or column, also on the way back"
                require(is_straight, where, accepted)
                self._check_floor(f"{key}.walk.corners", last)
        if is_moved or walking:
            where = 'feedback.kind = "delayed" with someone who moves'
            require(not self.is_delayed, where, "any other kind")
        if walking:
            n = math.lcm(*(walk.steps * len(walk.route(at)) for at, walk in walking.values()))
            where = f"{', '.join(walking)}: it takes {n:,} steps until everybody is back"
            most = _MAX_STATES_OF_PLACE // (len(self.grid.position) * self.ping_limit)
            accepted = f"at most {most:,}, with so many cells and so large a ping_limit"
            require(n <= most, where, accepted)

    def _check_cells(self) -> None:
        spots = {
            "issuer.position": listed(self.issuer.position),
            "grid.start": listed(self.grid.start),
        }
        spots |= {f"others.{i}.position": [person.position] for i, person in enumerate(self.others)}
        spots |= {
            f"phases.{i}.position": listed(phase.position) for i, phase in enumerate(self.phases)
        }
        for key, (position, walk) in walkers(self.issuer, self.others).items():
            spots[f"{key}.walk.corners"] = [cell for cell, _ in walk.route(position)]
        for key, cells in spots.items():
            for cell in cells:
                self._check_floor(key, cell)
        for stage, people in zip(*timeline(self.issuer, self.others, self.phases), strict=True):
            own = listed(stage.position or self.issuer.position)
            n_people = Counter([*own, *(person.position for person in people)])
            for cell, n in n_people.items():
                where = f"two people at once in {json.dumps(cell)}"
                require(n == 1, where, "other positions or walks")

    def _check_floor(self, key: str, cell: Cell) -> None:
        (row, column), (rows, columns) = cell, self.grid.size
        where = f"{key} = {json.dumps(cell)}"
        accepted = f"rows 0 to {rows - 1}, columns 0 to {columns - 1}"
        require(0 <= row < rows and 0 <= column < columns, f"{where} is off the grid", accepted)
        require(not self.grid.is_wall[self.grid.index(cell)], f"{where} is a wall", "another cell")

    def _check_sizes(self) -> None:
        issuer = self.issuer
        crowd = self.onlookers
        stages, others_at = timeline(issuer, self.others, self.phases)
        n_ticks = sum(stage.steps or 1 for stage in stages)
        n_states = len(self.grid.position) * self.ping_limit * n_ticks * (1 + self.is_delayed)
        what = "cells x ping_limit x ticks of the phases"
        where = f"{what} = {n_states} states for each position of the person"
        require(n_states <= _MAX_STATES_OF_PLACE, where, f"at most {_MAX_STATES_OF_PLACE}")
        n_places = len(self.grid.cells_of(issuer.position))
        if self.group is not None:
            n_places = int(self._every_way.has_start.sum())
        if issuer.places is not None:
            n_places = min(n_places, issuer.places + issuer.unseen)
        if crowd:
            occupied = {person.position for people in others_at for person in people}
            most = int((~self.grid.is_wall).sum()) - len(occupied) - self.n_people
            where = f"onlookers.people = {crowd.people}"
            require(crowd.people <= most, where, f"at most {most}, a free cell for each")
            n_seen = max(n_places - issuer.unseen, 1)
            n_places = max(crowd.ways, n_seen) + (n_places if issuer.unseen else 0)
        n_outcomes = 1 + max(len(stage.next or {}) for stage in stages)
        n = n_states * n_places * n_outcomes
        where = f"{what} x places x phases that may follow = {n} states"
        require(n <= MAX_STATES, where, f"at most {MAX_STATES}")

    def _check_starts(self) -> None:
        every = self._every_way
        group = self.group
        position = self.issuer.position
        if group is not None:
            where = f"group: nowhere do {group.people} people stand {list(group.apart)} apart"
            require(len(every.ways) > 0, where, "another range of group.apart, or more cells")
        for cell in listed(self.grid.start):
            is_start = bool(every.is_start[:, :, self.grid.index(cell)].any())
            accepted = "a cell outside every region, from which a way leads to a target region"
            require(is_start, f"grid.start = {json.dumps(cell)}", accepted)
        free = zip([] if group else listed(position), every.has_start.tolist(), strict=False)
        unused = [place for place, has_start in free if not has_start]
        require(
            bool(every.has_start.any()) and not unused,
            f"issuer.position = {json.dumps(unused[0] if unused else position)}"
            " leaves no start that is outside every region and has a way to a target region",
            "other cells, smaller regions, fewer walls, or another grid.start",
        )
        n = self.issuer.places
        unseen = self.issuer.unseen
        most = int(every.has_start.sum())
        where = f"issuer.unseen = {unseen}"
        require(n is not None or not unseen, where, "0, or issuer.places as well")
        accepted = f"at most {most} together, the ways in which people can stand"
        require((n or 0) + unseen <= most, f"issuer.places = {n} with {where}", accepted)


ScenarioLike = str | Path | Scenario | Mapping[str, object]


def scenario_names() -> list[str]:
    """Returns the names of the shipped scenarios."""
    return sorted(path.stem for path in SCENARIO_DIRECTORY.glob("*.toml"))


def load_scenario(
    scenario: ScenarioLike, overrides: Mapping[str, object] | None = None
) -> Scenario:
    """Reads a scenario and checks it.

    Args:
      scenario: The name of a shipped scenario (`"S1"`), the path of a TOML file, a `Scenario`, or a
        mapping of its values as from `Scenario.model_dump`.
      overrides: New values by dotted key, for example `{"issuer.position": [8, 6]}`.

    Raises:
      InputError: For each mistake a sentence that names the file, the key, its value and what is
        accepted.
    """
    if not isinstance(scenario, Scenario | Mapping | str | Path):
        accepted = "a name, a path, a Scenario, or a mapping of its values"
        raise inputs.InputError(f"scenario = {scenario!r}; accepted: {accepted}.")
    if not isinstance(overrides, Mapping | None):
        raise inputs.InputError(f"overrides = {overrides!r}; accepted: a mapping of values by key.")
    if isinstance(scenario, Scenario):
        if not overrides:
            return scenario
        scenario = scenario.model_dump(mode="json", exclude_unset=True)
    if isinstance(scenario, Mapping):
        source = str(scenario.get("name", "scenario"))
        return inputs.parse(Scenario, inputs.override(scenario, overrides or {}, source), source)
    path = Path(scenario)
    if path.suffix != ".toml":
        path = SCENARIO_DIRECTORY / f"{scenario}.toml"
        names = scenario_names()
        if str(scenario) not in names:
            inputs.unknown_name(
                "scenarios", "scenario", str(scenario), names, "the path of a .toml file"
            )
    inputs.check_file_name(path, "the scenario is")
    changed = inputs.override(inputs.read_toml(path), overrides or {}, str(path))
    checked = _checked(json.dumps(changed, default=str), path)
    if checked.own_feedback:
        search_beside(path)
    return checked


@lru_cache(maxsize=256)  # experiments load the same scenarios again and again
def _checked(values: str, path: Path) -> Scenario:
    return inputs.parse(Scenario, json.loads(values), str(path), name=path.stem)
