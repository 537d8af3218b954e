"""Tables of what the explorer shows: one agent of every learner over training, cell by cell.

The agent is that of the first seed, whatever came of it: chosen before it was seen. Beside it stands the
exact optimum, for each discount that a learner has.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.population import OPTIMUM_TOLERANCE, Population, optimal_values
from benchmark.drawing import tables
from envs import ACTIONS, Model

AGENT: Final = 0  # which of a population's agents is shown
DECIMALS: Final = 3  # of its values: what a map can show


class Shown(NamedTuple):
    """Who is shown, and where."""

    algorithm: str
    observation: str
    population: Population


def write(shown: Iterable[Shown], directory: Path) -> None:
    """Writes `agent.csv`, `optimum.csv`, and a scenario's maps as `agent_SCENARIO.csv`."""
    shown = list(shown)
    tables.write_csv(agents(shown), directory / "agent.csv")
    tables.write_csv(optimum(shown), directory / "optimum.csv")
    for scenario in dict.fromkeys(one.population.scenario for one in shown):
        there = [one for one in shown if one.population.scenario == scenario]
        tables.write_csv(values(there), directory / f"agent_{scenario}.csv")


def agents(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates how good the agent's greedy policy is, one row a map of it.

    `kind` says what its values are: `q`, discounted by `discount`, or the `probability` of an action.
    """
    frames = []
    for one in shown:
        population = one.population
        at = population.map_places
        columns: dict[str, Any] = {
            "scenario": population.scenario,
            "algorithm": one.algorithm,
            "observation": one.observation,
            "seed": population.seeds[AGENT],
            "kind": "probability" if population.arrays["stochastic"].shape[1] else "q",
            "discount": population.discount,
            "step": np.array(population.evaluation_steps)[at],
            "score": population.scores[AGENT, at],
        }
        for name in ("success", "steps", "wrong_pings"):
            columns[name] = population.arrays[name][AGENT, at]
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def values(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates the agent's values and greedy actions, one row a map and cell."""
    frames = []
    for one in shown:
        population = one.population
        at = population.map_places
        own = np.round(population.arrays["values"][AGENT].astype(np.float64), DECIMALS)  # (V, O, A)
        greedy = _names(population.arrays["greedy"][AGENT, at])  # (V, O)
        steps = np.repeat(np.array(population.evaluation_steps)[at], own.shape[1])
        columns = {
            "algorithm": one.algorithm,
            "observation": one.observation,
            "step": steps,
            **_cells(population.model, len(own)),
            "greedy": greedy.ravel(),
            **dict(zip(ACTIONS, own.reshape(-1, len(ACTIONS)).T, strict=True)),
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def optimum(shown: Iterable[Shown]) -> pd.DataFrame:
    """Tabulates optimal values and actions, of an agent that knows its state, with no wrong PING so far."""
    frames = []
    wanted = {(one.population.scenario, one.population.discount): one.population for one in shown}
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


def _cells(model: Model, times: int) -> dict[str, NDArray[np.int_]]:
    """Returns the row and column of every cell, some times over."""
    grid = model.scenario.grid
    row, column = np.divmod(np.arange(grid.rows * grid.columns), grid.columns)
    return {"row": np.tile(row, times), "column": np.tile(column, times)}


def _names(masks: NDArray[np.uint8]) -> NDArray[np.object_]:
    """Returns the names of the actions in each mask, as `UP|PING`."""
    names = ["|".join(np.array(ACTIONS)[row]) for row in contains(masks.ravel())]
    return np.array(names, dtype=object).reshape(masks.shape)
