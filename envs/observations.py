"""Forms of observation, as tables of all observations.

Most forms are egocentric: instead of its own cell and people's cells, the agent observes people's positions
relative to itself. "offset" gives those of all people, "nearest" that of the nearest, "two_nearest" those of
two, and "centre" the centre of all; for a single person, these are the same. Where the person is not seen,
they equal "index", "one_hot" and "coordinates".
"""

from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envs.inputs import InputError, unknown_name
from envs.model import Model, compile_scenario
from envs.scenario import RELATIVE, Scenario

# Every form, and how it is encoded.
ENCODINGS: Final = {"index": "index", "one_hot": "one_hot", "coordinates": "coordinates"} | {
    f"{relative}{suffix}": suffix[1:] or "index"
    for relative in RELATIVE
    for suffix in ("", "_one_hot", "_coordinates")
}
OBSERVATIONS: Final = tuple(ENCODINGS)
INDICES: Final = tuple(form for form, encoding in ENCODINGS.items() if encoding == "index")
VECTORS: Final = tuple(form for form, encoding in ENCODINGS.items() if encoding != "index")
COORDINATES: Final = tuple(form for form, encoding in ENCODINGS.items() if encoding == "coordinates")
MAX_TABLE: Final = 50_000_000  # numbers in the table of all one-hot observations


def check_one_hot(n_observations: int, n_features: int) -> None:
    """Refuses, by an InputError, a table of one-hot observations that does not fit into memory."""
    if n_observations * n_features > MAX_TABLE:
        found = f"{n_observations:,} observations of {n_features:,} numbers each"
        accepted = f'at most {MAX_TABLE:,} numbers in all, or "coordinates" or "index"'
        raise InputError(f"observation one_hot: {found}; accepted: {accepted}.")


def check_form(observation: str) -> None:
    """Refuses an unknown form by an InputError."""
    if observation not in OBSERVATIONS:
        unknown_name("observation", "form", str(observation), OBSERVATIONS)


def seen_as(scenario: Scenario, observation: str) -> Scenario:
    """Returns a scenario with the components that an agent is given in a form."""
    check_form(observation)
    relative = observation.removesuffix("_coordinates").removesuffix("_one_hot")
    if relative not in RELATIVE or "issuer" not in scenario.observe:
        return scenario
    return scenario.seen_as(relative)


def compile_seen(scenario: Scenario, observation: str) -> Model:
    """Compiles a scenario for agents that are given observations in a form, see `seen_as`."""
    seen = seen_as(scenario, observation)
    is_exact = seen.observe[0] == "agent" or seen.n_seen == 1  # else only those offsets count that occur
    if ENCODINGS.get(observation) == "one_hot" and is_exact:
        check_one_hot(seen.n_observations, sum(width for _, width in seen.observed_sizes.values()))
    return compile_scenario(seen)


def observation_blocks(model: Model) -> NDArray[np.int64]:
    """Returns which columns of the one-hot form are 1, (O, ones): one or more of each component's block."""
    starts = np.cumsum([0, *(component.width for component in model.components)])
    values = zip(model.components, values_of(model), starts[:-1], strict=True)
    return np.concatenate([component.ones[value] + start for component, value, start in values], axis=1)


def values_of(model: Model) -> tuple[NDArray[np.int_], ...]:
    """Returns the value of each component, (O,), in all observations."""
    sizes = [component.size for component in model.components]
    return np.unravel_index(np.arange(model.n_observations), sizes[::-1])[::-1]


def observation_table(model: Model, kind: str) -> NDArray[np.int64] | NDArray[np.float32]:
    """Returns all observations.

    Args:
      model: Compiled scenario with O observations; for the forms of the offset by `compile_seen`.
      kind: The form. Index: (O,) int64. One-hot: a block per component, (O, sum of their widths) float32.
        Coordinates: those of all components in turn, (O, D) float32, each scaled to [0, 1].
    """
    check_form(kind)
    if ENCODINGS[kind] == "index":
        return np.arange(model.n_observations)
    if ENCODINGS[kind] == "one_hot":
        columns, width = observation_blocks(model), sum(component.width for component in model.components)
        check_one_hot(len(columns), width)
        table = np.zeros((len(columns), width), dtype=np.float32)
        np.put_along_axis(table, columns, 1, axis=1)
        return table
    values = zip(model.components, values_of(model), strict=True)
    scaled = [(part.numbers / part.largest)[value] for part, value in values]
    return np.concatenate(scaled, axis=1).astype(np.float32)


def observation_space(table: NDArray[Any]) -> spaces.Discrete | spaces.Box:
    """Returns the space of the rows of an observation table."""
    if table.ndim == 1:
        return spaces.Discrete(len(table))
    return spaces.Box(0.0, 1.0, table.shape[1:], np.float32)
