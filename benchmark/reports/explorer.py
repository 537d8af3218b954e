"""The page's explorer: what one agent of every learner knows over training, and how all others end.

Values over training are those of the first seed's agent, which was chosen before any result was seen. Of the
other agents there is the final greedy policy. The exact optimum goes with both, for every discount that a
learner has. All of it is one file of compressed JSON, which the page holds as it is.
"""

import base64
import gzip
import json
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from agents.policy import greedy_masks
from benchmark.analysis.population import OPTIMUM_TOLERANCE, Population, optimal_values
from benchmark.execution.store import VALUE_DECIMALS
from benchmark.reports.item import Item, writing
from envs import ACTIONS, EVENTS, Model
from envs import scene as scenes
from envs.scene import CellMap, cell_map

FILE: Final = "agents.json.gz"
MOST_AGENTS: Final = 100  # of a population, whose final policies are shown
_PALETTE: Final = ("path", "over", "no value")  # colours of `envs.scene` that the page's script uses
_NO_NUMBER: Final = -(2**31)  # stands for NaN among packed values


class Shown(NamedTuple):
    """A learner and its agents in one scenario."""

    algorithm: str  # the variant's name
    observation: str
    population: Population


def explorer_item(lister: Callable[[Any], Iterable[Shown]]) -> Item:
    """Returns the item with the explorer's file.

    Args:
      lister: Returns what is shown of a report's data. Left out are learners that one map does not show, and
        scenarios in which chance acts.
    """

    @writing(
        "agents", "what the explorer on the page shows: maps and final policies, as compressed JSON", FILE
    )
    def agents(data: Any, directory: Path) -> None:
        shown = [each for each in lister(data) if _is_shown(each.population.model)]
        if shown:
            (directory / FILE).write_bytes(compressed(packed(shown)))

    return agents


def _is_shown(model: Model) -> bool:
    """Returns whether one map shows what is observed, and the agent walks on it as in the scenario.

    On an egocentric map the issuer stays, there are no walls, and episodes start at other distances.
    """
    scenario = model.scenario
    is_around = cell_map(model).scene.origin is not None and not scenario.grid.is_wall.any()
    is_same = len(scenario.stages) == 1 and scenario.issuer.feedback.kind in ("none", "uniform", "binary")
    return (model.has_cell_maps or (is_around and is_same)) and model.n_outcomes == 1


def compressed(data: object) -> bytes:
    """Returns data as JSON, compressed to less than half."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return gzip.compress(text.encode(), mtime=0)


def packed(shown: Sequence[Shown]) -> dict[str, Any]:
    """Returns what the explorer shows. An agent refers to its scene and its optimum by their places."""
    populations = [each.population for each in shown]
    maps = {each.model.scenario: cell_map(each.model) for each in populations}
    solved = {(each.model.scenario, each.discount): each for each in populations}
    colours = mpl.colormaps[scenes.COLOUR_MAP](np.linspace(0, 1, 33))
    return {
        "actions": list(ACTIONS),
        "events": list(EVENTS),
        "decimals": VALUE_DECIMALS,
        "no_number": _NO_NUMBER,
        "colours": [to_hex(colour) for colour in colours],
        "palette": {name: "#{:02x}{:02x}{:02x}".format(*scenes.COLOURS[name]) for name in _PALETTE},
        "clipped_share": scenes.CLIPPED_SHARE,
        "scenes": [_scene(each) for each in maps.values()],
        "optima": [_optimum(each) for each in solved.values()],
        "agents": [
            _learner(each)
            | {
                "scene": [*maps].index(each.population.model.scenario),
                "optimum": [*solved].index((each.population.model.scenario, each.population.discount)),
            }
            for each in shown
        ],
    }


def typical_agent(population: Population) -> int:
    """Returns the index of a typical agent: the one with the median mean score over training.

    Scores count as 0 to 1. Of an even number of agents, it is the lower median; of agents with the same mean,
    the one with the lowest seed.
    """
    means = np.clip(population.unbounded_scores, 0, 1).mean(axis=1).round(9)
    median = np.sort(means)[(len(means) - 1) // 2]
    return min(np.flatnonzero(means == median).tolist(), key=lambda agent: population.seeds[agent])


def _learner(shown: Shown) -> dict[str, Any]:
    """Returns a learner's first agent at every second map and the last, and the final policies of the others.

    `kind` says what the maps hold: `q` for action values, or `probability` for the action probabilities of a
    stochastic policy.
    """
    population = shown.population
    last = len(population.map_indices) - 1
    chosen = [*range(0, last, 2), last]
    places = population.map_indices[chosen]
    first = population.agents[0]
    n_shown = min(len(population.seeds), MOST_AGENTS)
    cells = cell_map(population.model).observation
    policies = np.stack([agent["greedy"][-1, cells] for agent in population.agents[:n_shown]])
    return {
        "scenario": population.scenario,
        "algorithm": shown.algorithm,
        "observation": shown.observation,
        "method": population.specification["algorithm"],
        "horizon": population.horizon,
        "unit": population.specification["settings"].get("budget_unit", "steps"),
        "kind": "probability" if first["stochastic"].shape[0] else "q",
        "discount": population.discount,
        "steps": [population.evaluation_steps[place] for place in places],
        "score": _listed(population.unbounded_scores[0, places]),
        "success": _listed(first["success"][places]),
        "values": _integers(first["values"][chosen][:, cells]),
        "greedy": _bytes(first["greedy"][places][:, cells]),
        "seeds": list(population.seeds[:n_shown]),
        "final": {
            "score": _listed(population.unbounded_scores[:n_shown, -1]),
            "success": _listed(population.arrays["success"][:n_shown, -1]),
            "greedy": _bytes(policies),
        },
    }


def _optimum(population: Population) -> dict[str, Any]:
    """Returns optimal values and actions before the first wrong PING, by cell."""
    q = optimal_values(population, cell_map(population.model).model)
    return {"values": _integers(q[None]), "optimal": _bytes(greedy_masks(q, OPTIMUM_TOLERANCE))}


def _scene(shown: CellMap) -> dict[str, Any]:
    """Returns a scene and everything that a walk looks up: (O,), (S,) and flattened (S, A) lists."""
    model = shown.model
    return shown.scene.as_json() | {
        "start": int(model.observation[model.start]),
        "fresh": model.fresh_state.tolist(),
        "observation": model.observation.tolist(),
        "next": model.next_state.ravel().tolist(),
        "terminated": model.terminated.ravel().astype(int).tolist(),
        "event": model.event.ravel().tolist(),
        "grid_reward": model.grid_reward.ravel().tolist(),
        "issuer_reward": np.round(model.issuer_reward, 6).ravel().tolist(),
        "issuer_noise": float(model.issuer_noise.max()),
    }


def _listed(values: NDArray[np.float64]) -> list[float | None]:
    """Returns numbers for JSON, which has no NaN."""
    return [None if math.isnan(value) else round(value, 6) for value in values.tolist()]


def _integers(maps: NDArray[Any]) -> list[int]:
    """Returns maps, (V, O, A), as integers, each less that of the map before: most are zero, and zip well."""
    scaled = np.rint(maps.astype(np.float64) * 10**VALUE_DECIMALS)
    # Only the values of nets about to diverge exceed two million; their digits are noise.
    whole = np.where(np.isnan(scaled), _NO_NUMBER, np.clip(scaled, _NO_NUMBER + 1, -_NO_NUMBER - 1))
    return [int(change) for change in np.diff(whole.astype(np.int64), axis=0, prepend=0).ravel()]


def _bytes(masks: NDArray[np.uint8]) -> str:
    """Returns masks of actions as one byte each, in base64."""
    return base64.b64encode(masks.astype(np.uint8).tobytes()).decode("ascii")
