"""Populations made by hand, for tests of what reports compute from them."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policy import ALL_ACTIONS
from benchmark.analysis.population import Population
from benchmark.experiments import load_experiment, specifications
from benchmark.reports.comparison.data import Data
from benchmark.reports.comparison.protocol import Learner


def compared(scenario: str = "S1", n: int = 4, **arrays: NDArray[Any]) -> Population:
    """Returns runs of the small comparison with these arrays, in which otherwise nothing was learned.

    They are evaluated at 0, 100, 200, 300 and 400 steps.
    """
    experiment = load_experiment("compare_deep_smoke")
    specification = specifications(experiment, "default", scenario, "q_learning", "index", [0])[0]
    blank: dict[str, NDArray[Any]] = {
        "q": np.zeros((n, 120, 5)),
        "stochastic": np.zeros((n, 0, 120, 5)),
        "greedy": np.full((n, 5, 120), ALL_ACTIONS, dtype=np.uint8),
        "disagreements": np.zeros((n, 5), dtype=np.int64),
        "diverged_at": np.full(n, -1),
    }
    for prefix, points in (("", 5), ("every_cell_", 5), ("stochastic_", 0), ("stochastic_every_cell_", 0)):
        for field in ("grid_return", "success", "steps", "wrong_pings"):
            blank[f"{prefix}{field}"] = np.zeros((n, points))
        blank[f"{prefix}zone_steps"] = np.zeros((n, points, 4))
    return Population(json.loads(specification.content), blank | arrays, range(n), [{}] * n)


def with_scores(scores: NDArray[np.float64], scenario: str = "S1") -> Population:
    """Returns runs whose greedy policies have these scores, (N, T) or, at the end of training, (N,)."""
    random, optimal = compared().anchors["grid_return"]
    if scores.ndim == 1:
        scores = np.column_stack([np.zeros((len(scores), 4)), scores])
    return compared(scenario, len(scores), grid_return=random + scores * (optimal - random))


def data_of(**learners: Mapping[str, Population]) -> Data:
    """Returns a comparison of learners with these populations by scenario."""
    return Data({Learner(name, "index"): populations for name, populations in learners.items()})
