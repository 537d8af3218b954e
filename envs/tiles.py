"""Tile coding: which binary features an observation has (Sutton & Barto 2018, section 9.5.4).

A tiling divides the space of all positions into tiles, cubes of so many cells a side, and an
observation has one feature of each tiling: the tile that it lies in. Tiling t is displaced against
the first one by t times the first odd numbers, one for each coordinate, in units of the width
divided by the number of tilings (Miller and Glanz 1996). Only tiles that some observation lies in
have a number, so none is hashed.

The positions of the agent and of people can also be tiled in several sets, each with tilings of its
own.

Axis letters: O observations, V sets of positions.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from envs.arrays import Indices, Ints
from envs.inputs import InputError
from envs.model import Model, kept_with_model, numbered
from envs.scenario import Scenario

T = TypeVar("T")

MAX_FEATURES = 5_000_000  # features of all observations; training takes up to 160 bytes of each
MAX_ROWS = 40_000_000  # entries of `Tiles.rows`, and of `Tiles.tiles`

Parts = Literal["joint", "pairs", "agent_pairs"]


class Tiles(NamedTuple):
    """The features of observations: o has rows `rows[o]` of `tiles`, a row for each set."""

    rows: Indices  # (O, V)
    tiles: Indices  # (rows, n_tilings) features, numbered from 0


def _check(n_each: int, n: int, most: int, found: str) -> None:
    if n * n_each > most:
        raise InputError(f"{found} for {n:,} observations; accepted: at most {most:,} in all.")


def _sets(positions: Sequence[T], scenario: Scenario, parts: Parts) -> list[tuple[T, ...]]:
    """Returns which positions are tiled together; an agent's comes first."""
    if parts == "pairs":
        return [*combinations(positions, 2)]
    if parts == "agent_pairs":
        n_agents = int(scenario.observe[0] == "agent")
        return [(*positions[:n_agents], person) for person in positions[n_agents:]]
    return [tuple(positions)]


@kept_with_model
def tiles_of(model: Model, n_tilings: int, width: int, parts: Parts = "joint") -> Tiles:
    """Returns the features of every observation.

    Tiles are `width` cells wide. `parts` says which positions are tiled together: all ("joint"),
    every two of them ("pairs"), or the agent's with each person's ("agent_pairs"). Of positions
    relative to the agent, "agent_pairs" tiles each by itself. Components without a position, such
    as a phase, and badges are not tiled: each combination of their values has tiles of its own.
    """
    positions: list[tuple[Ints, Ints]] = []  # (O, D) numbers, and (D,) per cell
    others = []
    for component, value in zip(model.components, model.values, strict=True):
        if component.per_cell.any():
            n = len(component.per_cell) // component.ones.shape[1]  # numbers of each person
            spans = (slice(at, at + n) for at in range(0, len(component.per_cell), n))
            positions += [
                (component.numbers[value, span], component.per_cell[span]) for span in spans
            ]
        else:
            others.append(value)
    sets, n_observations = _sets(positions, model.scenario, parts), model.n_observations
    if len(sets) < 2:
        _check(
            n_tilings, n_observations, MAX_FEATURES, f"n_tilings = {n_tilings}: a feature of each"
        )
        tiles = _tile(positions, others, n_tilings, width)
        return Tiles(np.arange(n_observations, dtype=np.int32)[:, None], tiles)
    _check(len(sets), n_observations, MAX_ROWS, f"parts = {parts}: {len(sets)} sets of positions")
    rows, tables = np.empty((n_observations, len(sets)), dtype=np.int32), []
    n_rows = n_tiles = 0
    for v, each in enumerate(sets):
        first, number = numbered([*np.concatenate([cells for cells, _ in each], axis=1).T, *others])
        some = (
            [(cells[first], per_cell) for cells, per_cell in each],
            [value[first] for value in others],
        )
        tables.append(n_tiles + _tile(*some, n_tilings, width))
        rows[:, v] = n_rows + number
        n_rows, n_tiles = n_rows + len(first), int(tables[-1].max()) + 1
        _check(
            n_tilings,
            n_rows,
            MAX_ROWS,
            f"parts = {parts}, n_tilings = {n_tilings}: a feature of each",
        )
        _check(
            1, n_tiles, MAX_FEATURES, f"parts = {parts}, tile_width = {width}: {n_tiles:,} features"
        )
    return Tiles(rows, np.concatenate(tables))


def _tile(
    positions: Sequence[tuple[Ints, Ints]], others: Sequence[Ints], n_tilings: int, width: int
) -> Indices:
    """Tiles positions jointly; returns each observation's tiles, (O, n_tilings)."""
    cells, per_cell = (np.concatenate(each, axis=-1) for each in zip(*positions, strict=True))
    exact, cells, unit = cells[:, per_cell == 0], cells[:, per_cell > 0], per_cell[per_cell > 0]
    odd = 2 * np.arange(cells.shape[1]) + 1
    tiles, n_tiles = np.empty((len(cells), n_tilings), dtype=np.int32), 0
    for t in range(n_tilings):
        # Whole numbers avoid rounding: everything is multiplied by n_tilings.
        tile = (cells * n_tilings + t * odd % n_tilings * width * unit) // (
            width * unit * n_tilings
        )
        first, number = numbered([*tile.T, *exact.T, *others])
        tiles[:, t] = n_tiles + number
        n_tiles += len(first)
    return tiles
