"""Tables of a replication: final values, the maximum Q, learning, and the distance from the exact optimum."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.intervals import interquartile_mean, mean_with_interval
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
    """Tabulates the exact score of the greedy policy, and the share of optimal agents, over training.

    `score_iqm` is the interquartile mean (Agarwal et al. 2021): scores have no lower bound, since a
    greedy policy may bump a wall until the horizon, and the mean shows it.
    """
    frames = []
    for population in populations:
        weights = population.weights
        columns: dict[str, Any] = {"scenario": population.scenario, "step": population.evaluation_steps}
        for name, values in (
            ("score", population.scores),
            ("success", population.arrays["success"]),
            ("optimal_share", (population.scores >= 1 - OPTIMUM_TOLERANCE).astype(np.float64)),
            ("return", population.arrays["grid_return"]),
            ("scenario_return", population.arrays["scenario_return"]),
        ):
            columns |= mean_with_interval(name, weights @ values / len(values))
            if name == "score":
                columns |= interquartile_mean("score_iqm", population.scores)
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def optimal(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the exact anchors and what the greedy policies reached at the end of training."""
    rows = []
    for population in populations:
        scores = population.scores[:, -1]
        weights = population.weights
        row: dict[str, Any] = {"scenario": population.scenario, "agents": len(scores)}
        for name, (random, best) in population.anchors.items():
            learned = population.arrays[name][:, -1]
            samples = weights @ (best - learned) / len(learned)
            regret = mean_with_interval("regret", samples[:, None])
            row |= {f"{name}_random": random, f"{name}_optimal": best, f"{name}_learned": learned.mean()}
            row |= {f"{name}_{key}": value[0] for key, value in regret.items()}
        row["optimal_share"] = (scores >= 1 - OPTIMUM_TOLERANCE).mean()
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
