"""Where people stand in a scenario, the zones around them, and where episodes may start.

An episode has one of J places of the person, drawn at its start. It goes through P phases, which
pass by the ticks of a clock: a phase of three steps has three ticks, one with `next` a single tick.
J = P = 1 unless the scenario says otherwise.
"""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, cast

import numpy as np

from envs.arrays import Bools, Codes, Floats, Ints, read_only_property
from envs.inputs import require
from envs.people import Group, Issuer, Onlookers, Person, Phase, Walk
from envs.regions import (
    ISSUER,
    OUTSIDE,
    TARGET,
    TOLERANCE,
    Cell,
    Grid,
    Regions,
    Ring,
    connected,
    ring_zones,
    zones,
)

SEEN, NEW_PLACE, NEW_WAY = range(3)
MAX_ZONES = 10_000_000  # cells, over all phases and all ways in which people may stand


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the person with its group, (J,), in each of P phases; C cells."""

    grid: Grid
    stages: tuple[Phase, ...]  # (P,) declared phases, or positions on walks, or one that never ends
    others: tuple[tuple[Person, ...], ...]  # (P, others) the other people
    ways: Ints  # (J, people) cells of the person and the group at the start; rows are sorted
    zone: Codes  # (J, P, C) index into `envs.regions.ZONES`
    is_start: Bools  # (J, first ticks, C) where episodes may start
    novelty: Ints  # (J,) SEEN if episodes with the person in a place are trained, else what is new
    onlookers: Ints  # (J, onlookers) their cells; J are then combinations of a place and a way

    def at(self, places: Ints, **changes: Any) -> "Layout":
        """Returns a layout with some of the places, which may be repeated, and other changes."""
        arrays = ("ways", "zone", "is_start", "novelty", "onlookers")
        return replace(self, **{name: getattr(self, name)[places] for name in arrays} | changes)

    @read_only_property
    def ticks(self) -> Ints:
        """(ticks,) the phase of each tick of the clock."""
        return _ticks(self.stages)

    @read_only_property
    def following(self) -> tuple[Ints, Floats]:
        """The K ticks that may follow each tick, (ticks, K), and their probabilities."""
        n = len(self.ticks)
        stages = self.stages
        if stages[0].next is None:
            return (np.arange(n)[:, None] + 1) % n, np.ones((n, 1))
        index = {stage.name: i for i, stage in enumerate(stages)}
        n_outcomes = 1 + max(len(stage.next or {}) for stage in stages)
        ticks = np.arange(n)[:, None].repeat(n_outcomes, axis=1)
        probability = np.zeros(ticks.shape)
        for i, stage in enumerate(stages):
            chances = stage.next or {}
            for k, (name, chance) in enumerate(chances.items(), start=1):
                ticks[i, k], probability[i, k] = index[name], chance
            probability[i, 0] = max(1.0 - math.fsum(chances.values()), 0.0)
        return ticks, probability

    @cached_property
    def places(self) -> tuple[tuple[Cell, ...], ...]:
        """(J,) the cells of the person and the group when an episode starts."""
        cells = self.grid.position[self.ways]
        return tuple(tuple(map(tuple, place)) for place in cells.tolist())

    @read_only_property
    def standing(self) -> Ints:
        """(J, P, people) the cells of the person and the group, in each place and phase."""
        standing = np.repeat(self.ways[:, None], len(self.stages), axis=1)
        for p, stage in enumerate(self.stages):
            if stage.position is not None:
                standing[:, p] = self.grid.index(stage.position)
        return standing

    @read_only_property
    def issuer_cells(self) -> Ints:
        """(I,) the cells where the person or someone of the group may stand, rising."""
        return np.unique(self.standing)

    @read_only_property
    def starts(self) -> Ints:
        """(starts, 3) place, tick and cell of every start of an episode, also in unseen places."""
        return np.column_stack(np.nonzero(self.is_start))

    @read_only_property
    def has_start(self) -> Bools:
        """(J,) whether an episode may start in a place."""
        return np.asarray(self.is_start.any(axis=(1, 2)))


@lru_cache(maxsize=64)
def draw_places(layout: Layout, n: int | None, unseen: int, draw: int) -> Layout:
    """Returns a layout with n places that have a start, and further unseen ones; None takes all.

    The first places are the same for every n.
    """
    order = np.flatnonzero(layout.has_start)
    if n is not None:
        places = layout.grid.position[layout.ways].tolist()
        order = np.array(sorted(order, key=lambda j: _rank(places[j], draw))[: n + unseen], int)
    chosen = np.sort(order)
    return layout.at(chosen, novelty=np.where(np.isin(chosen, order[:n]), SEEN, NEW_PLACE))


def shown_cells(cells: Sequence[Cell], fraction: float, draw: int) -> list[Cell]:
    """Returns the cell that is shown for each of some cells; a drawn fraction is permuted."""
    order = sorted(cells, key=lambda cell: _rank([cell], draw))[: round(fraction * len(cells))]
    following = dict(zip(order, [*order[1:], *order[:1]], strict=True))
    return [following.get(cell, cell) for cell in cells]


@lru_cache(maxsize=8)
def draw_onlookers(layout: Layout, onlookers: Onlookers, draw: int) -> Layout:
    """Returns a layout whose places are repeated with different ways in which onlookers stand."""
    grid = layout.grid
    n_ways = onlookers.ways
    seen, new = (np.flatnonzero(layout.novelty == kind) for kind in (SEEN, NEW_PLACE))
    n_trained = max(n_ways, len(seen))
    n_new_ways = len(seen) if len(new) else 0
    place = np.concatenate([np.resize(seen, n_trained), new, seen[:n_new_ways]])
    old_ways = [np.arange(n) % n_ways for n in (n_trained, len(new))]
    way = np.concatenate([*old_ways, n_ways + np.arange(n_new_ways)])
    order = place.argsort(kind="stable")
    place, way = place[order], way[order]  # (J,) each
    novelty = np.where(way < n_ways, layout.novelty[place], NEW_WAY)

    is_floor = ~grid.is_wall
    is_floor[[grid.index(person.position) for people in layout.others for person in people]] = False
    is_free = np.repeat(is_floor[None], len(place), axis=0)  # (J, C)
    np.put_along_axis(is_free, layout.ways[place], False, axis=1)
    cells = random_orders(n_ways + n_new_ways, len(is_floor), "onlookers", draw)[way]  # (J, C)
    is_free = np.take_along_axis(is_free, cells, axis=1)
    is_first = is_free & (is_free.cumsum(axis=1) <= onlookers.people)
    standing = cells[is_first].reshape(len(place), onlookers.people)
    return layout.at(place, novelty=novelty, onlookers=standing)


def random_orders(n: int, size: int, *names: object) -> Ints:
    """Returns n random orders of the numbers below a size, (n, size), from a stream of names."""
    key = hashlib.sha256(json.dumps(names).encode()).digest()[:16]
    words = np.random.Philox(key=int.from_bytes(key, "little")).random_raw(n * size)
    return words.reshape(n, size).argsort(axis=1, kind="stable")


def _ticks(stages: Sequence[Phase]) -> Ints:
    return np.repeat(np.arange(len(stages)), [stage.steps or 1 for stage in stages])


def _rank(place: Sequence[object], draw: int) -> bytes:
    """Returns the key by which a cell, or a group's cells, are drawn, the same in all rooms."""
    parts = cast("Cell", place[0]) if len(place) == 1 else place  # of one person, the cell
    return hashlib.sha256(json.dumps([draw, *parts]).encode()).digest()


def walkers(issuer: Issuer, others: Sequence[Person]) -> dict[str, tuple[Cell, Walk]]:
    """Returns where each person who walks starts, and the walk, by the person's key in the file."""
    people = {"issuer": issuer} | {f"others.{i}": person for i, person in enumerate(others)}
    return {key: (cast("Cell", who.position), who.walk) for key, who in people.items() if who.walk}


@lru_cache(maxsize=64)
def timeline(
    issuer: Issuer, others: tuple[Person, ...], phases: tuple[Phase, ...]
) -> tuple[tuple[Phase, ...], tuple[tuple[Person, ...], ...]]:
    """Returns the P phases, and the other people in each, (P, others).

    If people walk, nobody changes cells within a phase, and all phases together end when everybody
    is back.
    """
    walking = walkers(issuer, others)
    if not walking:
        stages = phases or (Phase(name="always"),)
        return stages, (others,) * len(stages)
    beat = math.gcd(*(walk.steps for _, walk in walking.values()))
    routes = {
        key: [
            {"position": cell, "heading": heading}
            for cell, heading in walk.route(position)
            for _ in range(walk.steps // beat)
        ]
        for key, (position, walk) in walking.items()
    }

    def moved(who: Any, key: str, i: int) -> Any:
        route = routes.get(key, [{}])
        return who.model_copy(update=route[i % len(route)])

    n = math.lcm(*map(len, routes.values()))
    stages = tuple(moved(Phase(name=f"{i + 1}", steps=beat), "issuer", i) for i in range(n))
    people = (
        tuple(moved(person, f"others.{k}", i) for k, person in enumerate(others)) for i in range(n)
    )
    return stages, tuple(people)


@lru_cache(maxsize=64)
def resolve(
    grid: Grid,
    issuer: Issuer,
    group: Group | None,
    regions: Regions,
    others: tuple[Person, ...],
    phases: tuple[Phase, ...],
    first_phase: str,
) -> Layout:
    """Returns all ways to stand, with or without a start; too many are a ValueError."""
    stages, others_at = timeline(issuer, others, phases)
    ticks = _ticks(stages)
    first = ticks if first_phase == "any" else ticks[:1]
    most = MAX_ZONES // (len(grid.position) * max(len(stages), len(first)))
    occupied = [grid.index(person.position) for people in others_at for person in people]
    cells = grid.cells_of(issuer.position)
    cells = cells[~(grid.is_wall[cells] | np.isin(cells, occupied))]
    _check_ways(len(cells), most, 1, group)
    ways = _ways_of_group(grid, cells, group, regions, most) if group else cells[:, None]
    zone = np.zeros((len(ways), len(stages), len(grid.position)), dtype=np.int8)  # (G, P, C)
    for p, stage in enumerate(stages):
        nearest = zone[:, p]
        around = stage.regions or regions
        heading = stage.heading or issuer.heading
        standing = np.full_like(ways, grid.index(stage.position)) if stage.position else ways
        cells, member = np.unique(standing, return_inverse=True)
        windows = [zones(around, heading, spot, grid) for spot in grid.position[cells]]
        window = np.array(windows, dtype=np.int8).reshape(-1, zone.shape[2])
        for column in member.reshape(ways.shape).T:  # uncomfortable if it is so to anyone
            np.maximum(nearest, window[column], out=nearest)
        if isinstance(around.target, Ring):
            people = grid.position[ways]
            ring = ring_zones(around.target, people, grid.position, around.cell_width(grid))
            np.maximum(nearest, ring, out=nearest)
        for person in others_at[p]:
            nearest[:, grid.index(person.position)] = ISSUER
            if person.regions is not None:
                its = zones(person.regions, person.heading, person.position, grid)
                np.maximum(nearest, its, out=nearest)
    zone[:, :, grid.is_wall] = OUTSIDE
    is_start = _find_starts(grid, zone, first)
    novelty = np.full(len(ways), SEEN)
    onlookers = np.zeros((len(ways), 0), np.int_)
    return Layout(grid, stages, others_at, ways, zone, is_start, novelty, onlookers)


def _check_ways(n: int, most: int, n_placed: int, group: Group | None) -> None:
    who = f"{n_placed} of the {group.people} people of the group" if group else "the person"
    ways = f"{n:,} ways{' or more' * (n_placed > 1)}"  # all of them are not counted then
    narrower = ", or a narrower range of group.apart" if group else ""
    accepted = f"at most {most:,} with so many cells and phases; list fewer cells{narrower}"
    require(n <= most, f"issuer.position: {who} can stand in {ways}", accepted)


def _ways_of_group(grid: Grid, cells: Ints, group: Group, regions: Regions, most: int) -> Ints:
    """Returns all ways in which a group may stand in some cells, (G, people)."""
    cells = np.sort(cells)
    # The difference of two of these numbers says how many rows and columns two cells are apart.
    number = grid.position[cells] @ (2 * grid.columns - 1, 1)
    apart = np.hypot(
        *np.ix_(*(np.arange(1 - n, n) for n in grid.size))
    ).ravel() * regions.cell_width(grid)
    # As in regions, rounding must not decide.
    may_join = (apart >= group.apart[0] - TOLERANCE) & (apart <= group.apart[1] + TOLERANCE)
    groups = np.arange(len(cells))[:, None]
    for n_placed in range(2, group.people + 1):
        is_next = may_join[number - number[groups][:, :, None] + len(apart) // 2].all(axis=1)
        before, joining = np.nonzero(is_next & (np.arange(len(cells)) > groups[:, -1:]))
        groups = np.column_stack([groups[before], joining])
        _check_ways(len(groups), most, n_placed, group)
    return cells[groups]


def _find_starts(grid: Grid, zone: Codes, first: Ints) -> Bools:
    """Returns where episodes may start, (G, first ticks, C): outside, with a way to a target."""
    allowed = np.isin(np.arange(len(grid.position)), grid.cells_of(grid.start))
    # In at least one phase. Walls, and people who never move, block the way.
    is_target = (zone == TARGET).any(axis=1)
    is_free = (zone != ISSUER).any(axis=1) & ~grid.is_wall
    has_way = connected(*(cells.reshape(-1, *grid.size) for cells in (is_target, is_free)))
    is_allowed = (has_way.reshape(is_free.shape) & allowed)[:, None]
    return np.asarray((zone[:, first] == OUTSIDE) & is_allowed)
