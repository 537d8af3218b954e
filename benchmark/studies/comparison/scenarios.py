"""An item of a comparison: what each scenario is, and what is possible in it."""

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from agents.memoryless import SEARCH
from benchmark.analysis.frames import RecordsOf, by_population
from benchmark.analysis.records import anchors
from benchmark.drawing.maps import gallery, in_words
from benchmark.execution.store import evaluated
from benchmark.experiments import Experiment, Population
from benchmark.studies.comparison.cells import Row
from benchmark.studies.comparison.columns import MEANINGS, columns
from benchmark.studies.comparison.declared import reporting_of
from benchmark.studies.item import item
from envs import Model
from envs.observations import compile_seen


@item(
    "scenarios",
    "what each scenario is, and what is possible in it",
    columns(
        "scenario description observed hidden cells states observations random_return random_success "
        "optimal_return memoryless_return memoryless_success"
    ),
    meanings=MEANINGS,
)
def scenarios(runs: pd.DataFrame, experiment: Experiment, records: RecordsOf) -> Iterator[Row]:
    """Describes scenarios, unless they are pooled, by the first learner's view of them."""
    if len(experiment.scenarios) <= 1 or reporting_of(experiment).pool == "scenarios":
        return
    models = _models(reversed(experiment.populations))  # as the first learner sees them
    planners = [name for name, learner in experiment.learners.items() if learner.algorithm is SEARCH]
    searches = runs[runs["learner"].isin(planners)]
    for name in experiment.scenarios:
        model = models[name]
        random, optimal = anchors(model, experiment.declared.horizon, "start")
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
        policies = []  # of every policy that planners have found: return, success and score
        for keys, _ in by_population(searches[searches["scenario"] == name]):
            found = records(experiment.population(keys["condition"], name, keys["learner"]))
            policy = experiment.learners[keys["learner"]].declared.policy
            names = [evaluated(result, policy, "start") for result in ("grid_return", "success")]
            scores = found.unbounded_scores(policy)
            policies.append(np.stack([*(found.arrays[result] for result in names), scores])[:, :, -1])
        if policies:
            returns, success, score = np.concatenate(policies, axis=1)
            best = returns.argmax()
            row["restarts"] = len(returns)
            row |= {"memoryless_return": returns[best], "memoryless_success": success[best]}
            row["memoryless_score"] = score[best]
        yield row


@scenarios.figure("The scenarios.")
def _(experiment: Experiment) -> Figure:
    return gallery([*_models(experiment.populations).values()])


def _models(populations: Iterable[Population]) -> dict[str, Model]:
    return {
        population.scenario.name: compile_seen(population.scenario, population.learner.observation)
        for population in populations
        if population.learner.family != "planner"
    }
