"""Forms of observation, as tables of all observations.

A form is what is observed and its encoding. In forms that begin with "offset" or "relative", the
agent observes where people are relative to itself, instead of its own cell and people's cells:
those who count, or everybody. Where the person is not seen, they equal the form of cells with the
same encoding.

"planes" is the room as an image, for convolutional nets.
"""

import json
import math
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envs.arrays import Bytes, Ints, Singles
from envs.inputs import InputError, unknown_name
from envs.model import Model, compile_scenario
from envs.scenario import Scenario, load_scenario
from envs.tiles import tiles_of

_ENCODINGS = ("index", "one_hot", "factored", "tiles", "coordinates", "centred")
SPARSE = ("one_hot", "factored", "tiles")  # encodings by numbers that are mostly 0, else 1
IMAGES = ("planes",)
NUMBERS = ("coordinates", "centred")  # encodings by a number for each coordinate
_PLANES = ("agent", "people", "onlookers", "walls")  # and one for each further component
# What each form observes, and its encoding: "tiles" has ("", "tiles"), and "offset" has ("offset",
# "index").
_PARTS = {
    "_".join(filter(None, (seen, "" if seen and encoding == "index" else encoding))): (
        seen,
        encoding,
    )
    for seen, encoding in (*product(("", "offset"), _ENCODINGS), *product(["relative"], NUMBERS))
} | {form: ("", form) for form in IMAGES}
ENCODINGS = {form: encoding for form, (_, encoding) in _PARTS.items()}
OBSERVATIONS = tuple(ENCODINGS)
INDICES = tuple(form for form, encoding in ENCODINGS.items() if encoding == "index")
VECTORS = tuple(form for form in ENCODINGS if form not in (*INDICES, *IMAGES))
MAX_TABLE = 100_000_000  # numbers in the table of all observations
N_TILINGS = 16
TILE_WIDTH = 3  # cells
_CENTRED = 2.0  # the largest centred coordinate


def _check_size(n_observations: int, n_features: int, observation: str) -> None:
    """Refuses, by an InputError, a table of observations that does not fit into memory."""
    if n_observations * n_features > MAX_TABLE:
        raise InputError(
            f"observation {observation}: {n_observations:,} observations of {n_features:,} numbers "
            f"each; accepted: at most {MAX_TABLE:,} numbers in all, or a smaller form, such as "
            "coordinates, centred, factored, planes, index, or one of offsets."
        )


def _check_planes(scenario: Scenario) -> None:
    """Refuses, by an InputError, a scenario that planes cannot show, or SB3 would mistake."""
    first = scenario.observe[0]
    shape = planes_shape(scenario)
    where = f"observation planes: {scenario.name} with observe = {json.dumps(scenario.observe)}"
    if first != "agent":
        raise InputError(f'{where}; accepted: cells, so "agent" instead of "{first}".')
    if shape[0] > min(shape[1:]):  # Stable-Baselines3 takes the shortest side for the channels
        raise InputError(
            f"{where} has {shape[0]} planes of {shape[1]} x {shape[2]} cells; accepted: at least "
            "as many rows and columns as planes."
        )
    _check_size(scenario.n_observations, math.prod(shape), "planes")


def check_form(observation: str) -> None:
    """Refuses an unknown form by an InputError."""
    if str(observation) not in _PARTS:
        unknown_name("observation", "form", str(observation), OBSERVATIONS)


@lru_cache(maxsize=256)
def seen_as(scenario: Scenario, observation: str) -> Scenario:
    """Returns a scenario with the components that an agent is given in a form."""
    check_form(observation)
    seen, _ = _PARTS[observation]
    if observation in IMAGES:
        _check_planes(scenario)
    if not seen or "issuer" not in scenario.observe:
        return scenario
    further = [name for name in scenario.observe if name in ("phase", "wrong_pings")]
    return load_scenario(scenario, {"observe": [seen, *further]})


def compile_seen(scenario: Scenario, observation: str) -> Model:
    """Compiles a scenario for agents that are given observations in a form, see `seen_as`."""
    check_form(observation)
    return compile_scenario(seen_as(scenario, observation))


def observation_ones(model: Model, observation: str) -> tuple[NDArray[np.integer[Any]], int]:
    """Returns which numbers of a sparse form are 1, (O, ones), and how many numbers there are."""
    encoding = ENCODINGS[observation]
    if encoding == "tiles":
        tiles = tiles_of(model, N_TILINGS, TILE_WIDTH).tiles
        return tiles, int(tiles.max()) + 1
    blocks: list[Ints] = []  # (O, ones) which numbers of a block are 1
    widths = [0]
    for part, value in model.parts:
        if encoding == "one_hot":
            blocks.append(part.ones[value])
            widths.append(part.width)
        else:
            blocks += [*part.numbers[value].T[..., None]]
            widths += (part.largest + 1).tolist()
    *starts, width = np.cumsum(widths).tolist()
    ones = [block + start for block, start in zip(blocks, starts, strict=True)]
    return np.concatenate(ones, axis=1), width


def planes_shape(scenario: Scenario) -> tuple[int, int, int]:
    """Returns how many planes show a scenario, and the rows and columns of each."""
    n_further = len({"phase", "wrong_pings"}.intersection(scenario.observe))
    return len(_PLANES) + n_further, *scenario.grid.size


def _planes(model: Model) -> Bytes:
    """Returns the room as an image, (O, planes, rows, columns), of numbers 0 and 255.

    People stand where the component "issuer" shows them. If they have badges, these say who counts.
    """
    scenario = model.scenario
    o = np.arange(model.n_observations)
    _check_planes(scenario)
    table = np.zeros((len(o), *planes_shape(scenario)), np.uint8)
    table[:, _PLANES.index("walls")] = 255 * scenario.grid.is_wall.reshape(scenario.grid.size)
    n_further = 0
    for part, value in model.parts:
        match part.name:
            case "agent":
                table[o, _PLANES.index("agent"), *part.numbers[value].T] = 255
            case "issuer":
                n_people = np.count_nonzero(part.per_cell) // 2
                for i, person in enumerate(np.split(part.numbers, n_people, axis=1)):
                    row, column, *badge = person[value].T
                    counts = badge[0] == 1 if badge else i < scenario.n_people
                    plane = np.where(counts, _PLANES.index("people"), _PLANES.index("onlookers"))
                    table[o, plane, row, column] = 255
            case _:
                shade = np.rint(255 * part.numbers / part.largest)[value]
                table[:, len(_PLANES) + n_further] = shade[:, :, None]
                n_further += 1
    return table


def observation_table(model: Model, kind: str) -> Ints | Singles | Bytes:
    """Returns all observations.

    Args:
      model: Compiled scenario with O observations; for forms of offsets by `compile_seen`.
      kind: The form. Index: (O,) int64. Planes: (O, planes, rows, columns) uint8. Others: (O, D)
        float32. One-hot: a block per component, with a 1 at its value. Factored: a block per
        coordinate, so one for the row and one for the column of a cell. Tiles: a number for each
        tile, see `envs.tiles`, of `N_TILINGS` tilings. Coordinates: those of all components in
        turn, each scaled to [0, 1]. Centred: the same, scaled to [-2, 2], roughly the range of
        standardized values. Planes: 255 in the agent's cell, in people's, in onlookers' and in
        walls, else 0. The phase and the number of wrong PINGs have a plane each, which holds the
        number in every cell, scaled to [0, 255].
    """
    check_form(kind)
    encoding = ENCODINGS[kind]
    if encoding == "index":
        return np.arange(model.n_observations)
    if encoding in IMAGES:
        return _planes(model)
    if encoding in SPARSE:
        ones, width = observation_ones(model, kind)
        _check_size(len(ones), width, kind)
        table = np.zeros((len(ones), width), dtype=np.float32)
        np.put_along_axis(table, ones, 1, axis=1)
        return table
    numbers = [(part.numbers / part.largest)[value] for part, value in model.parts]
    scaled = np.concatenate(numbers, axis=1)
    return (scaled if encoding == "coordinates" else (2 * scaled - 1) * _CENTRED).astype(np.float32)


def observation_space(table: NDArray[Any], observation: str) -> spaces.Discrete | spaces.Box:
    """Returns the space of the rows of an observation table in a form."""
    if table.ndim == 1:
        return spaces.Discrete(len(table))
    if observation in IMAGES:
        return spaces.Box(0, 255, table.shape[1:], np.uint8)
    low, high = (-_CENTRED, _CENTRED) if ENCODINGS[observation] == "centred" else (0.0, 1.0)
    return spaces.Box(low, high, table.shape[1:], np.float32)
