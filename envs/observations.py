"""Forms of observation: what the agent sees of its cell, as tables with one row per cell."""

from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envs.inputs import unknown_name
from envs.model import Model

OBSERVATIONS: Final = ("index", "one_hot", "coordinates")


def observation_table(model: Model, kind: str) -> NDArray[np.int64] | NDArray[np.float32]:
    """Returns the observations of all cells.

    Args:
      model: Compiled scenario with O cells.
      kind: `"index"`: the cell's number, (O,) int64; `"one_hot"`: (O, O) float32;
        `"coordinates"`: (O, 2) float32, row and column, each divided by its maximum.

    Raises:
      InputError: Unknown `kind`.
    """
    n_cells = model.n_observations
    if kind == "index":
        return np.arange(n_cells)
    if kind == "one_hot":
        return np.eye(n_cells, dtype=np.float32)
    if kind != "coordinates":
        unknown_name("observation", "form", str(kind), OBSERVATIONS)
    grid = model.scenario.grid
    return (model.position / np.maximum((grid.rows - 1, grid.columns - 1), 1)).astype(np.float32)


def observation_space(table: NDArray[Any]) -> spaces.Discrete | spaces.Box:
    """Returns the space of the rows of an observation table."""
    if table.ndim == 1:
        return spaces.Discrete(len(table))
    return spaces.Box(0.0, 1.0, table.shape[1:], np.float32)
