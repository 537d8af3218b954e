"""Records made by hand, for tests of what is computed from them."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policy import ALL_ACTIONS
from benchmark.experiment import load_experiment
from benchmark.records import Records
from benchmark.study import Data, Functions
from envs import load_scenario
from envs.observations import compile_seen
from envs.scenario import ScenarioLike

RUN = load_experiment("reproduce", smoke=True).populations[0].first


def population(
    scenario: ScenarioLike = "S1",
    n: int = 4,
    *,
    budget: int = 600,
    every: int = 200,
    map_every: int | None = None,
    observation: str = "index",
    **arrays: Any,
) -> Records:
    """Returns records of a population with these arrays, in which nothing else has been learned.

    N agents, T evaluation steps, V maps, O observations, A = 5 actions, R = 60 records of max Q.
    """
    described, maps = load_scenario(scenario), map_every or every
    settings = RUN.settings.model_copy(update={"budget": budget, "record_every": budget // 60})
    run = replace(
        RUN,
        scenario=described,
        observation=observation,
        settings=settings,
        evaluation_every=every,
        map_every=maps,
    )
    points, table = budget // every + 1, (compile_seen(described, observation).n_observations, 5)
    fields = ("grid_return", "scenario_return", "success", "steps", "wrong_pings", "disagreements")
    blank: dict[str, NDArray[Any]] = {
        "q": np.zeros((n, *table)),
        "stochastic": np.zeros((n, 0, *table)),
        "values": np.zeros((n, budget // maps + 1, *table), dtype=np.float32),
        "greedy": np.full((n, points, table[0]), ALL_ACTIONS, dtype=np.uint8),
        **{name: np.zeros((n, points)) for name in fields},
        **{name: np.zeros((n, 60)) for name in ("max_q", "table_max_q")},
    }
    agents = [{name: values[i] for name, values in (blank | arrays).items()} for i in range(n)]
    return Records([run.with_seed(i) for i in range(n)], agents, [{}] * n)


def with_tables(data: Data, functions: Functions) -> Data:
    """Returns data with the tables that a study makes of them."""
    for name, function in functions.items():
        data.tables[name] = function(data)
    return data
