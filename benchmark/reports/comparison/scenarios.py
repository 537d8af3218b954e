"""Items of a comparison: what each scenario is, and which cells of it learners take for the target."""

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from agents.memoryless import SEARCH
from benchmark.analysis.frames import RecordsOf
from benchmark.analysis.intervals import proportion
from benchmark.analysis.records import Records, anchors
from benchmark.drawing.maps import gallery, in_words
from benchmark.execution.store import evaluated
from benchmark.experiments import Experiment, Population
from benchmark.reports.comparison.cells import CELL, MEANINGS, populations
from benchmark.reports.comparison.declared import reporting_of
from benchmark.reports.comparison.verdicts import Row
from benchmark.reports.item import item
from envs import ZONES, Model
from envs.observations import compile_seen


@item(
    "region",
    "cells where an agent values PING, compared with the target region",
    {**CELL, "cells_marked": "cells marked", "precision": "", "recall": "", "overlap": ""},
    meanings={
        "cells_marked": "cells in which the action value of PING is above 0, or, of a stochastic policy, "
        "PING is the likeliest action; mean over runs",
        "n_marking": "runs that mark at least one cell",
        "precision": "share of the marked cells that is in the target region, mean over runs that mark any",
        "recall": "share of the target region that is marked, mean over runs",
        "overlap": "cells both marked and in the target region, per cell that is either, mean over runs",
    },
    best="overlap",
)
def region(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Compares the marked cells with the target region."""
    for names, learner, rows in populations(runs, experiment):
        right, marked = rows["target_cells_marked"].to_numpy(), rows["cells_marked"].to_numpy()
        population = experiment.population(rows["condition"].iloc[0], names["scenario"], learner.name)
        model = compile_seen(population.scenario, learner.observation)
        n_target = (model.zone_of_cell == ZONES.index("target")).sum()
        yield {
            **names,
            "n": len(rows),
            "cells_marked": marked.mean(),
            "n_marking": int((marked > 0).sum()),
            "precision": proportion(right[marked > 0] / marked[marked > 0]),
            "recall": proportion(right / n_target),
            "overlap": proportion(rows["region_overlap"].to_numpy()),
        }


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
