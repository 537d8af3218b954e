"""Tile coding: which binary features an observation has (Sutton & Barto 2018, section 9.5.4).

A tiling divides the space of all positions into tiles, cubes of so many cells a side, and an observation has
one feature of each tiling: the tile that it lies in. Tiling t is displaced against the first one by t times
the first odd numbers, one for each coordinate, in units of the width divided by the number of tilings (Miller
and Glanz 1996). Only tiles that some observation lies in have a number, so none is hashed.

Axis letters: O observations.
"""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from envs import InputError, Model

_POSITIONS: Final = {"agent": 1, "issuer": 1, "offset": 2}  # how many times the room's length they span
LARGEST_TABLE: Final = 5_000_000  # features of all observations; training takes up to 160 bytes of each


def check_tiles(n_observations: int, n_tilings: int) -> None:
    """Refuses, by an InputError, features that do not fit into memory."""
    if n_observations * n_tilings > LARGEST_TABLE:
        raise InputError(
            f"n_tilings = {n_tilings}: a feature of each for {n_observations:,} observations; accepted: "
            f"at most {LARGEST_TABLE:,} features in all."
        )


@lru_cache(maxsize=16)
def tiles_of(model: Model, n_tilings: int, width: int) -> NDArray[np.int32]:
    """Returns the features of every observation, (O, n_tilings), numbered from 0.

    Positions are tiled together. Components without a position, such as a phase, are not: each of their
    values has tiles of its own.

    Args:
      model: Compiled scenario, for offsets by `compile_seen`.
      n_tilings: How many tilings.
      width: Cells along each side of a tile.
    """
    check_tiles(model.n_observations, n_tilings)
    sizes = [component.size for component in model.components]
    values = np.unravel_index(np.arange(model.n_observations), sizes[::-1])[::-1]
    farthest = np.maximum(np.array(model.scenario.grid.size) - 1, 1)
    positions, others = [], []
    for component, value in zip(model.components, values, strict=True):
        if component.name in _POSITIONS:
            cells = component.coordinates * farthest * _POSITIONS[component.name]
            positions.append(np.rint(cells).astype(np.int64)[value])
        else:
            others.append(value)
    cells = np.concatenate(positions, axis=1)
    odd = 2 * np.arange(cells.shape[1]) + 1
    tiles, n_tiles = np.empty((model.n_observations, n_tilings), dtype=np.int32), 0
    for t in range(n_tilings):
        # In whole numbers, which have no rounding: a cell is n_tilings long.
        tile = (cells * n_tilings + t * odd % n_tilings * width) // (width * n_tilings)
        parts = [*tile.T, *others]
        key = np.ravel_multi_index(parts, [int(part.max()) + 1 for part in parts])
        used, number = np.unique(key, return_inverse=True)
        tiles[:, t] = n_tiles + number
        n_tiles += len(used)
    tiles.flags.writeable = False
    return tiles
