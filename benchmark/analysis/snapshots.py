"""Tables for the explorer: what one agent of every learner knows over training, and how all others end.

Values over training are those of the first seed's agent, which was chosen before any result was seen. Of the
other agents there is the final greedy policy. The exact optimum goes with both, for every discount that a
learner has.
"""

import string
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.population import OPTIMUM_TOLERANCE, Population, optimal_values
from benchmark.execution.store import VALUE_DECIMALS
from envs import ACTIONS, Model

AGENT: Final = 0  # index of the agent that is shown over training, in its population
MOST_AGENTS: Final = 100  # of a population, whose final policies are tabulated
LETTERS: Final = string.ascii_uppercase + string.ascii_lowercase[:6]  # for the masks 0 to 31, as in base64
DECIMALS: Final = VALUE_DECIMALS  # of its values and of the optimal ones


class Shown(NamedTuple):
    """A learner and its agents in one scenario."""

    algorithm: str  # the arm's name
    observation: str
    population: Population


def maps_shown(population: Population) -> NDArray[np.int_]:
    """Returns which maps of a population the explorer shows: every second one, and the last."""
    last = len(population.map_places) - 1
    return np.array([*range(0, last, 2), last])


def agents(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates how good the greedy policy of each first agent is, a row per map that is shown.

    `kind` says what the agent's maps hold: `q` for action values, discounted by `discount`, or `probability`
    for the action probabilities of a stochastic policy.
    """
    frames = []
    for algorithm, observation, population in shown:
        places = population.map_places[maps_shown(population)]
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
    """Tabulates the values and greedy actions of each first agent, a row per map that is shown and cell."""
    frames = []
    for algorithm, observation, population in shown:
        chosen = maps_shown(population)
        places = population.map_places[chosen]
        agent = population.of_agent(AGENT)
        maps = np.round(agent["values"][chosen].astype(np.float64), DECIMALS)  # (V, O, A)
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


def final_policies(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates the greedy policies that training ends with, a row per agent.

    `greedy` has a letter per cell, row by row: the mask of its greedy actions, see `LETTERS`.
    Of larger populations there are the first `MOST_AGENTS` agents.
    """
    letters = np.array(list(LETTERS))
    frames = []
    for algorithm, observation, population in shown:
        masks = population.arrays["greedy"][:MOST_AGENTS, -1]  # (N, O)
        columns = {
            "scenario": population.scenario,
            "algorithm": algorithm,
            "observation": observation,
            "seed": list(population.seeds[:MOST_AGENTS]),
            "score": population.scores[:MOST_AGENTS, -1],
            "success": population.arrays["success"][:MOST_AGENTS, -1],
            "greedy": ["".join(row) for row in letters[masks]],
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
