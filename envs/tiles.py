"""Tile coding: which binary features an observation has (Sutton & Barto 2018, section 9.5.4).

A tiling divides the space of all positions into tiles, cubes of so many cells a side, and an observation has
one feature of each tiling: the tile that it lies in. Tiling t is displaced against the first one by t times
the first odd numbers, one for each coordinate, in units of the width divided by the number of tilings (Miller
and Glanz 1996). Only tiles that some observation lies in have a number, so none is hashed.

Axis letters: O observations.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from envs.inputs import InputError
from envs.model import Model, kept_with_model, numbered

MAX_FEATURES: Final = 5_000_000  # features of all observations; training takes up to 160 bytes of each


def check_tiles(n_observations: int, n_tilings: int) -> None:
    """Refuses, by an InputError, features that do not fit into memory."""
    if n_observations * n_tilings > MAX_FEATURES:
        found = f"n_tilings = {n_tilings}: a feature of each for {n_observations:,} observations"
        raise InputError(f"{found}; accepted: at most {MAX_FEATURES:,} features in all.")


@kept_with_model
def tiles_of(model: Model, n_tilings: int, width: int) -> NDArray[np.int32]:
    """Returns the features of every observation, (O, n_tilings), numbered from 0.

    Positions are tiled jointly, by tiles `width` cells wide. Components without a position, such as a phase,
    are not tiled: each combination of their values has tiles of its own.
    """
    check_tiles(model.n_observations, n_tilings)
    positions, others, per_cell = [], [], []
    for component, value in zip(model.components, model.values, strict=True):
        if component.per_cell:
            positions.append(component.numbers[value])
            per_cell += [component.per_cell] * positions[-1].shape[1]
        else:
            others.append(value)
    cells = np.concatenate(positions, axis=1)
    odd, unit = 2 * np.arange(cells.shape[1]) + 1, np.array(per_cell)
    tiles, n_tiles = np.empty((model.n_observations, n_tilings), dtype=np.int32), 0
    for t in range(n_tilings):
        # Whole numbers avoid rounding: everything is multiplied by n_tilings.
        tile = (cells * n_tilings + t * odd % n_tilings * width * unit) // (width * unit * n_tilings)
        first, number = numbered([*tile.T, *others])
        tiles[:, t] = n_tiles + number
        n_tiles += len(first)
    tiles.flags.writeable = False
    return tiles
