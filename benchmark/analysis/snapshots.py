"""Tables for the explorer: what one agent of every learner knows over training, cell by cell.

The agent is always that of the first seed, which was chosen before any result was seen. The exact optimum
goes with it, for every discount that a learner has.
"""

from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.population import OPTIMUM_TOLERANCE, Population, optimal_values
from benchmark.execution.store import VALUE_DECIMALS
from envs import ACTIONS, Model

AGENT: Final = 0  # index of the agent that is shown, in its population
DECIMALS: Final = VALUE_DECIMALS  # of its values and of the optimal ones


class Shown(NamedTuple):
    """A learner and its agents in one scenario, of which the explorer shows one."""

    algorithm: str  # the arm's name
    observation: str
    population: Population


def agents(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates how good each agent's greedy policy is, a row per map.

    `kind` says what the agent's maps hold: `q` for action values, discounted by `discount`, or `probability`
    for the action probabilities of a stochastic policy.
    """
    frames = []
    for algorithm, observation, population in shown:
        places = population.map_places
        is_stochastic = population.arrays["stochastic"].shape[1] > 0
        columns: dict[str, Any] = {
            "scenario": population.scenario,
            "algorithm": algorithm,
            "observation": observation,
            "seed": population.seeds[AGENT],
            "kind": "probability" if is_stochastic else "q",
            "discount": population.discount,
            "step": np.array(population.evaluation_steps)[places],
            "score": population.scores[AGENT, places],
        }
        for name in ("success", "steps", "wrong_pings"):
            columns[name] = population.arrays[name][AGENT, places]
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def values(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates each agent's values and greedy actions, a row per map and cell."""
    frames = []
    for algorithm, observation, population in shown:
        places = population.map_places
        agent = population.of_agent(AGENT)
        maps = np.round(agent["values"].astype(np.float64), DECIMALS)  # (V, O, A)
        greedy = _names(agent["greedy"][places])  # (V, O)
        columns = {
            "algorithm": algorithm,
            "observation": observation,
            "step": np.repeat(np.array(population.evaluation_steps)[places], maps.shape[1]),
            **_cells(population.model, len(maps)),
            "greedy": greedy.ravel(),
            **dict(zip(ACTIONS, maps.reshape(-1, len(ACTIONS)).T, strict=True)),
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def optimum(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates optimal values and actions before the first wrong PING, a row per cell.

    The optimal policy knows the state, that is, also the number of wrong PINGs.
    """
    frames = []
    wanted = {(item.population.scenario, item.population.discount): item.population for item in shown}
    for (scenario, discount), population in wanted.items():
        q = optimal_values(population)
        columns = {
            "scenario": scenario,
            "discount": discount,
            **_cells(population.model, 1),
            "optimal": _names(greedy_masks(q, OPTIMUM_TOLERANCE)),
            **dict(zip(ACTIONS, np.round(q, DECIMALS).T, strict=True)),
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def typical_agent(population: Population) -> int:
    """Returns the index of a typical agent: the one with the median mean score over training.

    Scores count as 0 to 1. Of an even number of agents, it is the lower median; of agents with the same mean,
    the one with the lowest seed.
    """
    means = np.clip(population.scores, 0, 1).mean(axis=1).round(9)
    median = np.sort(means)[(len(means) - 1) // 2]
    return min(np.flatnonzero(means == median).tolist(), key=lambda agent: population.seeds[agent])


def _cells(model: Model, n_maps: int) -> dict[str, NDArray[np.int_]]:
    """Returns the row and column of every cell, once per map."""
    row, column = np.tile(model.position, (n_maps, 1)).T
    return {"row": row, "column": column}


def _names(masks: NDArray[np.uint8]) -> NDArray[np.object_]:
    """Returns the names of the actions in each mask, such as `UP|PING`."""
    names = ["|".join(np.array(ACTIONS)[row]) for row in contains(masks.ravel())]
    return np.array(names, dtype=object).reshape(masks.shape)
