"""Tile coding: which binary features an observation has (Sutton & Barto 2018, section 9.5.4).

A tiling divides the space of all positions into tiles, cubes of so many cells a side, and an
observation has one feature of each tiling: the tile that it lies in. Tiling t is displaced against
the first one by t times the first odd numbers, one for each coordinate, in units of the width
divided by the number of tilings (Miller and Glanz 1996). Only tiles that some observation lies in
have a number, so none is hashed.

The positions of the agent and of people can also be tiled in several sets, each with tilings of its
own, or all with the same ones, so that people share weights.

Axis letters: O observations, V sets of positions.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from envs.arrays import Indices, Ints
from envs.inputs import InputError
from envs.model import Model, kept_with_model, numbered

MAX_FEATURES = 5_000_000  # features of all observations; training takes up to 160 bytes of each
MAX_ROWS = 40_000_000  # entries of `Tiles.rows`, and of `Tiles.tiles`

Parts = Literal["joint", "agent_pairs", "shared_pairs"]


class Tiles(NamedTuple):
    """The features of observations: o has rows `rows[o]` of `tiles`, a row for each set."""

    rows: Indices  # (O, V)
    tiles: Indices  # (rows, n_tilings) features, numbered from 0


def _check(n_each: int, n: int, most: int, found: str) -> None:
    if n * n_each > most:
        raise InputError(f"{found} for {n:,} observations; accepted: at most {most:,} in all.")


@kept_with_model
def tiles_of(model: Model, n_tilings: int, width: int, parts: Parts = "joint") -> Tiles:
    """Returns the features of every observation.

    Tiles are `width` cells wide. `parts` says which positions are tiled together: all ("joint"), or
    the agent's with each person's, in tiles of this person's own ("agent_pairs") or the same for
    all people ("shared_pairs"), so that an observation may have a tile twice. Of positions relative
    to the agent, pairs have each by itself. Components without a position, such as a phase, and
    badges are not tiled: each combination of their values has tiles of its own. In pairs, that is
    the badge of their own person alone.
    """
    positions: list[tuple[Ints, Ints]] = []  # (O, D) numbers, and (D,) per cell
    others = []
    for component, value in model.parts:
        if component.per_cell.any():
            n = len(component.per_cell) // component.ones.shape[1]  # numbers of each person
            spans = (slice(at, at + n) for at in range(0, len(component.per_cell), n))
            positions += [
                (component.numbers[value, span], component.per_cell[span]) for span in spans
            ]
        else:
            others.append(value)
    n_observations = model.n_observations
    each = f"n_tilings = {n_tilings}: a feature of each"
    n_agents = int(model.scenario.observe[0] == "agent")
    sets = [[*positions[:n_agents], person] for person in positions[n_agents:]]
    if parts == "joint" or len(sets) < 2:
        _check(n_tilings, n_observations, MAX_FEATURES, each)
        tiles = _tile(*_joined(positions), others, n_tilings, width)
        return Tiles(np.arange(n_observations, dtype=np.int32)[:, None], tiles)
    _check(len(sets), n_observations, MAX_ROWS, f"parts = {parts}: {len(sets)} sets of positions")
    rows = np.empty((n_observations, len(sets)), dtype=np.int32)
    tables = []
    n_rows = n_tiles = 0
    n_alike = len(sets) if parts == "shared_pairs" else 1  # sets that have the same tiles
    for v in range(0, len(sets), n_alike):
        alike = [*map(_joined, sets[v : v + n_alike])]
        cells = np.concatenate([cells for cells, _ in alike])
        per_cell = alike[0][1]
        further = [np.tile(value, n_alike) for value in others]
        first, number = numbered([*cells.T, *further])
        tiles = _tile(cells[first], per_cell, [value[first] for value in further], n_tilings, width)
        tables.append(n_tiles + tiles)
        rows[:, v : v + n_alike] = n_rows + number.reshape(n_alike, -1).T
        n_rows = n_rows + len(first)
        n_tiles = int(tables[-1].max()) + 1
        _check(n_tilings, n_rows, MAX_ROWS, f"parts = {parts}, {each}")
        found = f"parts = {parts}, tile_width = {width}: {n_tiles:,} features"
        _check(1, n_tiles, MAX_FEATURES, found)
    return Tiles(rows, np.concatenate(tables))


def _joined(positions: Sequence[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    cells, per_cell = zip(*positions, strict=True)
    return np.concatenate(cells, axis=1), np.concatenate(per_cell)


def _tile(
    cells: Ints, per_cell: Ints, others: Sequence[Ints], n_tilings: int, width: int
) -> Indices:
    """Tiles positions jointly; returns each observation's tiles, (O, n_tilings)."""
    exact = cells[:, per_cell == 0]
    cells = cells[:, per_cell > 0]
    unit = per_cell[per_cell > 0]
    odd = 2 * np.arange(cells.shape[1]) + 1
    tiles = np.empty((len(cells), n_tilings), dtype=np.int32)
    n_tiles = 0
    for t in range(n_tilings):
        # Whole numbers avoid rounding: everything is multiplied by n_tilings.
        tile = (cells * n_tilings + t * odd % n_tilings * width * unit) // (
            width * unit * n_tilings
        )
        first, number = numbered([*tile.T, *exact.T, *others])
        tiles[:, t] = n_tiles + number
        n_tiles += len(first)
    return tiles
