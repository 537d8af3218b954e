"""Populations made by hand, for tests of what is computed from them."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.analysis.population import Population
from benchmark.experiments import load_experiment, specifications


def population(scenario: str = "S1", n: int = 4, **arrays: NDArray[Any]) -> Population:
    """Returns a population with these arrays, in which otherwise nothing has been learned.

    N agents, T = 4 evaluation steps, O = 120 cells, A = 5 actions, R = 60 records of max Q.
    """
    experiment = load_experiment("reproduce_smoke")
    specification = specifications(experiment, "default", scenario, "q_learning", "index")[0]
    blank: dict[str, NDArray[Any]] = {
        "q": np.zeros((n, 120, 5)),
        "stochastic": np.zeros((n, 0, 120, 5)),
        "values": np.zeros((n, 4, 120, 5), dtype=np.float32),
        "greedy": np.full((n, 4, 120), 31, dtype=np.uint8),
        "max_q": np.zeros((n, 60)),
        "table_max_q": np.zeros((n, 60)),
        "grid_return": np.zeros((n, 4)),
        "success": np.zeros((n, 4)),
        "scenario_return": np.zeros((n, 4)),
    }
    return Population(json.loads(specification.content), by_agent(blank | arrays, n), range(n), [{}] * n)


def by_agent(arrays: dict[str, NDArray[Any]], n: int) -> list[dict[str, NDArray[Any]]]:
    """Returns the arrays of each of n agents."""
    return [{name: values[i] for name, values in arrays.items()} for i in range(n)]
