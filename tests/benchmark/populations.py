"""Records made by hand, for tests of what is computed from them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import load_algorithm
from agents.policy import ALL_ACTIONS
from benchmark.analysis.records import Records
from benchmark.experiments import RunSpecification
from envs import load_scenario
from envs.observations import compile_seen


def population(
    scenario: str = "S1",
    n: int = 4,
    algorithm: str = "q_learning",
    *,
    budget: int = 600,
    every: int = 200,
    map_every: int | None = None,
    observation: str = "index",
    **arrays: Any,
) -> Records:
    """Returns the records of a population with these arrays, in which otherwise nothing has been learned.

    N agents, T evaluation steps, V maps, O observations, A = 5 actions, R = 60 records of max Q.
    """
    learner, described = load_algorithm(algorithm), load_scenario(scenario)
    chosen = {"budget": budget}
    if algorithm == "q_learning":
        chosen["record_every"] = budget // 60
    run = RunSpecification(
        stream="made",
        condition="default",
        scenario=described,
        variant=algorithm,
        algorithm=algorithm,
        versions={},
        observation=observation,
        settings=learner.settings.model_validate(chosen),
        horizon=200,
        evaluation_every=every,
        map_every=map_every or every,
        evaluated_from=("start",),
        seed=0,
    )
    points, n_maps = budget // every + 1, budget // (map_every or every) + 1
    table = (compile_seen(described, observation).n_observations, 5)
    blank: dict[str, NDArray[Any]] = {
        "q": np.zeros((n, *table)),
        "stochastic": np.zeros((n, 0, *table)),
        "values": np.zeros((n, n_maps, *table), dtype=np.float32),
        "greedy": np.full((n, points, table[0]), ALL_ACTIONS, dtype=np.uint8),
        "disagreements": np.zeros((n, points), dtype=np.int64),
        "diverged_at": np.full(n, -1),
        **{name: np.zeros(n) for name in ("updates", "parameters")},
        **{name: np.zeros((n, 60)) for name in ("max_q", "table_max_q")},
    }
    for prefix in ("", "stochastic_"):
        for field in ("grid_return", "scenario_return", "success", "steps", "wrong_pings"):
            blank[f"{prefix}{field}"] = np.zeros((n, points))
        blank[f"{prefix}zone_steps"] = np.zeros((n, points, 4))
    provenance = [{"cpu_time_s": [0.5], "peak_memory_mb": None}] * n
    arrays = blank | arrays
    agents = [{name: values[i] for name, values in arrays.items()} for i in range(n)]
    return Records(run, agents, range(n), provenance)
