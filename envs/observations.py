"""Forms of observation, as tables of all observations.

The forms that begin with "offset" are egocentric: instead of the agent's cell and the issuer's, the agent is
given the second relative to the first. Where the issuer is not seen, they are the same as the others.
"""

from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envs.inputs import InputError, unknown_name
from envs.model import Model, compile_scenario
from envs.scenario import Scenario, load_scenario

# Every form, and how it is encoded.
ENCODINGS: Final = {
    "index": "index",
    "one_hot": "one_hot",
    "coordinates": "coordinates",
    "offset": "index",
    "offset_one_hot": "one_hot",
    "offset_coordinates": "coordinates",
}
OBSERVATIONS: Final = tuple(ENCODINGS)
LARGEST_TABLE: Final = 50_000_000  # numbers, of all one-hot observations


def check_one_hot(n_observations: int, n_features: int) -> None:
    """Refuses, by an InputError, a table of one-hot observations that does not fit into memory."""
    if n_observations * n_features > LARGEST_TABLE:
        raise InputError(
            f"observation one_hot: {n_observations:,} observations of {n_features:,} numbers each; accepted: "
            f'at most {LARGEST_TABLE:,} numbers in all, or "coordinates" or "index".'
        )


def check_form(observation: str) -> None:
    """Refuses an unknown form by an InputError."""
    if observation not in OBSERVATIONS:
        unknown_name("observation", "form", str(observation), OBSERVATIONS)


def seen_as(scenario: Scenario, observation: str) -> Scenario:
    """Returns a scenario with the components that an agent is given in a form."""
    check_form(observation)
    if not observation.startswith("offset") or "issuer" not in scenario.observe:
        return scenario
    others = [name for name in scenario.observe if name not in ("agent", "offset", "issuer")]
    return load_scenario(scenario, {"observe": ["offset", *others]})


def compile_seen(scenario: Scenario, observation: str) -> Model:
    """Compiles a scenario for agents that are given observations in a form, see `seen_as`."""
    return compile_scenario(seen_as(scenario, observation))


def observation_blocks(model: Model) -> NDArray[np.int64]:
    """Returns which columns of the one-hot form are 1, (O, components): one of each component's block."""
    sizes = [component.size for component in model.components]
    values = np.unravel_index(np.arange(model.n_observations), sizes[::-1])
    return np.asarray(np.stack(values[::-1], axis=1) + np.cumsum([0, *sizes[:-1]]))


def observation_table(model: Model, kind: str) -> NDArray[np.int64] | NDArray[np.float32]:
    """Returns all observations.

    Args:
      model: Compiled scenario with O observations; for the forms of the offset by `compile_seen`.
      kind: The form. Index: (O,) int64. One-hot: a block per component, (O, sum of their sizes) float32.
        Coordinates: those of all components in turn, (O, D) float32, each scaled to [0, 1].

    Raises:
      InputError: Unknown `kind`, or too many numbers.
    """
    check_form(kind)
    if ENCODINGS[kind] == "index":
        return np.arange(model.n_observations)
    sizes = [component.size for component in model.components]
    columns = observation_blocks(model)
    if ENCODINGS[kind] == "one_hot":
        check_one_hot(len(columns), sum(sizes))
        table = np.zeros((len(columns), sum(sizes)), dtype=np.float32)
        np.put_along_axis(table, columns, 1, axis=1)
        return table
    values = columns - np.cumsum([0, *sizes[:-1]])
    blocks = [component.coordinates[values[:, i]] for i, component in enumerate(model.components)]
    return np.concatenate(blocks, axis=1).astype(np.float32)


def observation_space(table: NDArray[Any]) -> spaces.Discrete | spaces.Box:
    """Returns the space of the rows of an observation table."""
    if table.ndim == 1:
        return spaces.Discrete(len(table))
    return spaces.Box(0.0, 1.0, table.shape[1:], np.float32)
