"""Forms of observation, as tables of all observations.

A form is what is observed and its encoding. Most forms are egocentric: instead of its own cell and people's
cells, the agent observes people's positions relative to itself. "offset" gives those of all people, "nearest"
that of the nearest, "two_nearest" those of two, and "centre" the centre of all; for a single person, these
are the same. Where the person is not seen, they equal the form of cells with the same encoding.
"""

from itertools import product
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envs.inputs import InputError, unknown_name
from envs.model import Model, compile_scenario
from envs.scenario import RELATIVE, Scenario
from envs.tiles import tiles_of

_ENCODINGS: Final = ("index", "one_hot", "factored", "tiles", "coordinates", "centred")
SPARSE: Final = ("one_hot", "factored", "tiles")  # encodings by numbers that are mostly 0, else 1
# What each form observes, and its encoding: "tiles" has ("", "tiles"), and "offset" has ("offset", "index").
_PARTS: Final = {
    "_".join(filter(None, (seen, "" if seen and encoding == "index" else encoding))): (seen, encoding)
    for seen, encoding in product(("", *RELATIVE), _ENCODINGS)
}
ENCODINGS: Final = {form: encoding for form, (_, encoding) in _PARTS.items()}
OBSERVATIONS: Final = tuple(ENCODINGS)
INDICES: Final = tuple(form for form, encoding in ENCODINGS.items() if encoding == "index")
VECTORS: Final = tuple(form for form, encoding in ENCODINGS.items() if encoding != "index")
MAX_TABLE: Final = 100_000_000  # numbers in the table of all observations
N_TILINGS: Final = 16
TILE_WIDTH: Final = 3  # cells
_CENTRED: Final = 2.0  # the largest centred coordinate


def check_sparse(n_observations: int, n_features: int, observation: str = "one_hot") -> None:
    """Refuses, by an InputError, a table of observations in a sparse form that does not fit into memory."""
    if n_observations * n_features > MAX_TABLE:
        found = f"{n_observations:,} observations of {n_features:,} numbers each"
        accepted = f'at most {MAX_TABLE:,} numbers in all, or "coordinates" or "index"'
        raise InputError(f"observation {observation}: {found}; accepted: {accepted}.")


def check_form(observation: str) -> None:
    """Refuses an unknown form by an InputError."""
    if observation not in _PARTS:
        unknown_name("observation", "form", str(observation), OBSERVATIONS)


def is_relative(observation: str) -> bool:
    """Returns whether a form gives people's positions relative to the agent, where they are seen."""
    return bool(_PARTS.get(observation, ("", ""))[0])


def seen_as(scenario: Scenario, observation: str) -> Scenario:
    """Returns a scenario with the components that an agent is given in a form."""
    check_form(observation)
    relative, _ = _PARTS[observation]
    if not relative or "issuer" not in scenario.observe:
        return scenario
    return scenario.seen_as(relative)


def compile_seen(scenario: Scenario, observation: str) -> Model:
    """Compiles a scenario for agents that are given observations in a form, see `seen_as`."""
    seen = seen_as(scenario, observation)
    is_exact = seen.observe[0] == "agent" or seen.n_seen == 1  # else only those offsets count that occur
    if ENCODINGS.get(observation) == "one_hot" and is_exact:
        check_sparse(seen.n_observations, sum(width for _, width in seen.observed_sizes.values()))
    return compile_scenario(seen)


def observation_ones(model: Model, observation: str) -> tuple[NDArray[np.integer[Any]], int]:
    """Returns which numbers of a sparse form are 1, (O, ones), and how many numbers there are."""
    encoding = ENCODINGS[observation]
    if encoding == "tiles":
        tiles = tiles_of(model, N_TILINGS, TILE_WIDTH)
        return tiles, int(tiles.max()) + 1
    blocks: list[NDArray[np.int_]] = []  # (O, ones) which numbers of a block are 1
    widths = [0]
    for part, value in zip(model.components, model.values, strict=True):
        if encoding == "one_hot":
            blocks.append(part.ones[value])
            widths.append(part.width)
        else:
            blocks += [*part.numbers[value].T[..., None]]
            widths += (part.largest + 1).tolist()
    *starts, width = np.cumsum(widths).tolist()
    ones = [block + start for block, start in zip(blocks, starts, strict=True)]
    return np.concatenate(ones, axis=1), width


def observation_table(model: Model, kind: str) -> NDArray[np.int64] | NDArray[np.float32]:
    """Returns all observations.

    Args:
      model: Compiled scenario with O observations; for the forms of the offset by `compile_seen`.
      kind: The form. Index: (O,) int64. Others: (O, D) float32.
        One-hot: a block per component, with a 1 at its value. Factored: a block per coordinate, so one for
        the row and one for the column of a cell. Tiles: a number for each tile, see `envs.tiles`, of
        `N_TILINGS` tilings. Coordinates: those of all components in turn, each scaled to [0, 1]. Centred: the
        same, scaled to [-2, 2], roughly the range of standardized values.
    """
    check_form(kind)
    encoding = ENCODINGS[kind]
    if encoding == "index":
        return np.arange(model.n_observations)
    if encoding in SPARSE:
        ones, width = observation_ones(model, kind)
        check_sparse(len(ones), width, kind)
        table = np.zeros((len(ones), width), dtype=np.float32)
        np.put_along_axis(table, ones, 1, axis=1)
        return table
    parts = zip(model.components, model.values, strict=True)
    scaled = np.concatenate([(part.numbers / part.largest)[value] for part, value in parts], axis=1)
    return (scaled if encoding == "coordinates" else (2 * scaled - 1) * _CENTRED).astype(np.float32)


def observation_space(table: NDArray[Any], observation: str) -> spaces.Discrete | spaces.Box:
    """Returns the space of the rows of an observation table in a form."""
    if table.ndim == 1:
        return spaces.Discrete(len(table))
    low, high = (-_CENTRED, _CENTRED) if ENCODINGS[observation] == "centred" else (0.0, 1.0)
    return spaces.Box(low, high, table.shape[1:], np.float32)
