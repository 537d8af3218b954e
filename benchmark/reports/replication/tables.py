"""Tables of a replication: final values, the maximum Q, learning, and the distance from the exact optimum.

Means of numbers in [0, 1] have exact binomial 95 % intervals. Means of scores and returns have none: a greedy
policy may bump into a wall until the horizon, and no method bounds such a mean if failures are rare.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.intervals import proportion_interval
from benchmark.analysis.population import OPTIMUM_TOLERANCE, Population, optimal_values
from envs import ACTIONS


def q_values(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the final Q-values over agents: one row per scenario, cell and action."""
    frames = []
    for population in populations:
        q = population.arrays["q"]
        row, column = population.model.position.repeat(len(ACTIONS), axis=0).T
        frames.append(
            pd.DataFrame(
                {
                    "scenario": population.scenario,
                    "row": row,
                    "column": column,
                    "action": np.tile(ACTIONS, population.model.n_observations),
                }
                | _spread(q.reshape(len(q), -1))
            )
        )
    return pd.concat(frames, ignore_index=True)


def max_q(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the maximum Q of the visited cell, and of the table, over agents at each record."""
    frames = []
    for population in populations:
        table = _spread(population.arrays["table_max_q"])
        frames.append(
            pd.DataFrame(
                {"scenario": population.scenario, "step": population.recorded_steps}
                | _spread(population.arrays["max_q"])
                | {f"table_{name}": table[name] for name in ("mean", "min", "max")}
            )
        )
    return pd.concat(frames, ignore_index=True)


def learning(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates success, the score of the greedy policy, and the share of optimal agents, over training.

    `score` is the mean over agents of scores clipped to [0, 1], and `unbounded_score` that of the scores.
    """
    frames = []
    for population in populations:
        columns: dict[str, Any] = {"scenario": population.scenario, "step": population.evaluation_steps}
        for name, values in (
            ("success", population.arrays["success"]),
            ("score", np.clip(population.scores, 0.0, 1.0)),
            ("optimal_share", _is_optimal(population.scores)),
        ):
            columns |= _bounded(name, values)
        columns["unbounded_score"] = population.scores.mean(axis=0)
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def success(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates success and the share of optimal agents after training, a row per population."""
    rows = []
    for population in populations:
        row: dict[str, Any] = {
            "scenario": population.scenario,
            "agents": len(population.seeds),
            "first_seed": population.seeds[0],
            "last_seed": population.seeds[-1],
        }
        row |= _bounded("success", population.arrays["success"][:, -1])
        row |= _bounded("optimal_share", _is_optimal(population.scores[:, -1]))
        rows.append(row)
    return pd.DataFrame(rows)


def optimal(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the exact anchors and what the greedy policies reached at the end of training."""
    rows = []
    for population in populations:
        scores = population.scores[:, -1]
        row: dict[str, Any] = {"scenario": population.scenario, "agents": len(scores)}
        for name, (random, best) in population.anchors.items():
            learned = population.arrays[name][:, -1].mean()
            row |= {
                f"{name}_random": random,
                f"{name}_optimal": best,
                f"{name}_learned": learned,
                f"{name}_regret": best - learned,
            }
        row["optimal_share"] = _is_optimal(scores).mean()
        model = population.model
        start = model.observation[model.start]
        row["start_value_optimal"] = optimal_values(population).max(axis=1)[start]
        row["start_value_learned"] = largest_values(population)[start]
        row["cells_differing"] = differing(population)[~model.is_over[model.fresh_state]].mean()
        rows.append(row)
    return pd.DataFrame(rows)


def optimal_cells(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates Q* and the learned Q: one row per scenario, cell and action.

    Q* is that of an agent that knows its state, with no wrong PING so far, discounted and with the
    issuer's mean rewards, as the learner's is. `largest_learned` is the mean over agents of their largest
    Q in the cell (and so no less than the largest of the means); `differs` is the share of agents whose
    greedy action there is not an optimal one.
    """
    frame = q_values(populations)[["scenario", "row", "column", "action", "mean"]]
    frame = frame.rename(columns={"mean": "q_learned"})
    frame["q_optimal"] = np.concatenate([optimal_values(p).ravel() for p in populations])
    frame["difference"] = frame["q_learned"] - frame["q_optimal"]
    frame["is_optimal"] = np.concatenate(
        [contains(greedy_masks(optimal_values(p), OPTIMUM_TOLERANCE)).ravel() for p in populations]
    )
    frame["largest_learned"] = np.concatenate([largest_values(p).repeat(len(ACTIONS)) for p in populations])
    frame["differs"] = np.concatenate([differing(p).repeat(len(ACTIONS)) for p in populations])
    return frame


def largest_values(population: Population) -> NDArray[np.float64]:
    """Returns the mean over agents of their largest Q in every cell, (O,)."""
    return np.asarray(population.arrays["q"].max(axis=-1).mean(axis=0))


def differing(population: Population) -> NDArray[np.float64]:
    """Returns the share of agents whose greedy action is not an optimal one, (O,).

    An agent with several best actions, which it draws from, counts by the share that is not optimal.
    """
    best = contains(greedy_masks(optimal_values(population), OPTIMUM_TOLERANCE))  # (O, A)
    greedy = contains(population.arrays["greedy"][:, -1])  # (N, O, A)
    wrong = (greedy & ~best).sum(axis=-1) / greedy.sum(axis=-1)
    return np.asarray(wrong.mean(axis=0))


def _spread(values: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Returns mean, sample standard deviation and extremes over agents of (N, ...) values."""
    std = values.std(axis=0, ddof=1)
    return {"mean": values.mean(axis=0), "std": std, "min": values.min(axis=0), "max": values.max(axis=0)}


def _is_optimal(scores: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns which scores are those of an optimal policy."""
    return scores >= 1 - OPTIMUM_TOLERANCE


def _bounded(name: str, values: NDArray[Any]) -> dict[str, Any]:
    """Returns columns of the mean over agents of (N, ...) numbers in [0, 1]: `name`, and its interval."""
    mean = values.mean(axis=0)
    low, high = proportion_interval(mean, len(values))
    return {name: mean, f"{name}_low": low, f"{name}_high": high}
