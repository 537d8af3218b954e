"""An item of a comparison: what each scenario is, and what is possible in it."""

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from agents.memoryless import SEARCH
from benchmark.analysis.frames import RecordsOf
from benchmark.analysis.records import Records, anchors
from benchmark.drawing.maps import gallery, in_words
from benchmark.execution.store import evaluated
from benchmark.experiments import Experiment, Population
from benchmark.reports.comparison.cells import MEANINGS
from benchmark.reports.comparison.declared import reporting_of
from benchmark.reports.comparison.verdicts import Row
from benchmark.reports.item import item
from envs import Model
from envs.observations import compile_seen


@item(
    "scenarios",
    "what each scenario is, and what is possible in it",
    {
        **dict.fromkeys(["scenario", "description", "observed", "hidden"], ""),
        **dict.fromkeys(["cells", "states", "observations"], ""),
        "random_return": "random return",
        "random_success": "random success",
        "optimal_return": "optimal return",
        "memoryless_return": "best return of a memoryless policy found",
        "memoryless_success": "success of that policy",
    },
    meanings={
        **MEANINGS,
        "description": "what the scenario is about",
        "cells": "cells of the grid",
        "states": "number of states",
        "observations": "number of observations",
        "observed": "what is observed",
        "hidden": "what varies and is not observed",
        "random_return": "expected return of the random policy",
        "optimal_return": "expected return of the optimal policy of an agent that knows the state",
        "restarts": "searches of the planner, each from a random start",
        "memoryless_return": "best return of a policy over observations that the planner has found",
        "memoryless_success": "success of that policy",
        "memoryless_score": "that return as a score",
    },
)
def scenarios(runs: pd.DataFrame, experiment: Experiment, records: RecordsOf) -> Iterator[Row]:
    """Describes scenarios, unless they are pooled, by the first learner's view of them."""
    if len(experiment.scenarios) <= 1 or reporting_of(experiment).pool == "scenarios":
        return
    there = {*runs[["scenario", "condition", "learner"]].itertuples(index=False, name=None)}
    models = _models(reversed(experiment.populations))  # as the first learner sees them
    for name in experiment.scenarios:
        model = models[name]
        random, optimal = anchors(model, experiment.declared.horizon, "start")["grid_return"]
        row: Row = {
            "scenario": name,
            "description": model.scenario.description,
            "cells": len(model.position),
            "states": len(model.observation),
            "observations": model.n_observations,
            "observed": in_words(model.scenario.observe),
            "hidden": in_words(model.scenario.hidden) or "nothing",
            "random_return": random,
            "random_success": runs.loc[runs["scenario"] == name, "random_success"].iloc[0],
            "optimal_return": optimal,
        }
        searches = [
            _found(records(population), population.learner.declared.policy)
            for population in experiment.populations
            if population.learner.algorithm is SEARCH
            and population.scenario.name == name
            and (name, population.condition.name, population.learner.name) in there
        ]
        if searches:
            returns, success, score = np.concatenate(searches, axis=1)
            best = returns.argmax()
            row["restarts"] = len(returns)
            row |= {"memoryless_return": returns[best], "memoryless_success": success[best]}
            row["memoryless_score"] = score[best]
        yield row


def _found(search: Records, policy: str) -> NDArray[np.float64]:
    """Returns the return, the success and the score of each policy that the planner has found, (3, N)."""
    returns, success = (
        search.arrays[evaluated(name, policy, "start")] for name in ("grid_return", "success")
    )
    return np.stack([returns, success, search.unbounded_scores(policy).round(9)])[:, :, -1]


@scenarios.figure("The scenarios.")
def _(experiment: Experiment) -> Figure:
    return gallery([*_models(experiment.populations).values()])


def _models(populations: Iterable[Population]) -> dict[str, Model]:
    """Returns each scenario as the last learner sees it."""
    return {
        population.scenario.name: compile_seen(population.scenario, population.learner.observation)
        for population in populations
        if population.learner.family != "planner"
    }
