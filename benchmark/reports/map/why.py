"""How hard each point of a map is, by measures that need no learner."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from agents.hardness import Hardness, hardness
from benchmark.reports.item import item, no_rows
from benchmark.reports.map.data import Maps
from envs import Scenario
from envs.observations import compile_seen


@item("measures", "measures of every point, for the places of its first run", where=no_rows)
def measures(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates `agents.hardness`, beside the median steps.

    Points at which a learner does the same count once: those that differ in unseen places, or for a table in
    permuted coordinates. They are known by the wrong PINGs of the first run.
    """
    seen: set[tuple[str, bytes]] = set()
    for cell, ends in data.ends.items():
        scenario = data.scenario(cell).drawn(data.experiment.algorithms[cell.variant].first_seed)
        key = cell.learner, ends.spent[1, 0].tobytes()
        if data.is_reference(cell) or key in seen or scenario.following[0].shape[1] > 1:
            continue  # the last: what follows an action is random
        seen.add(key)
        found = _hardness(scenario, cell.observation, data.experiment.horizon)
        steps = float(np.median(ends.took()[0]))
        names = {"algorithm": cell.variant, "observation": cell.observation, "n": ends.n}
        yield {**data.key(cell), **names, **found._asdict(), "steps": steps}


@lru_cache(maxsize=1024)
def _hardness(scenario: Scenario, observation: str, horizon: int) -> Hardness:
    return hardness(compile_seen(scenario, observation), horizon)
