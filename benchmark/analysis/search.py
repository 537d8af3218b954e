"""The stages of a search for settings: which runs it has, given those that are stored.

First, every trial of every learner, in all scenarios. Then, with fresh seeds, the trials of the largest mean
area under the curve of exact success; that with the largest mean on these seeds is chosen, so one that was
merely lucky is not. Beside them trial 0, and in each scenario the trial that is best there. Last, with other
seeds, the chosen settings, and the same with one of them at other values.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.analysis.frames import Group, tables
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Learner, Population
from benchmark.experiments.search import Chosen, Search
from envs.inputs import override, parse

Areas = NDArray[np.float64]
Fresh = Mapping[tuple[int, str], Areas]  # (N,) on fresh seeds, by trial and scenario
COLUMNS: Final = ("area", "cpu_time_s")  # of runs, that a search needs
SEARCHED, FRESH, AROUND = "search", "fresh", "around"  # stages


class Outcome(NamedTuple):
    """What a search has found for a learner. I scenarios."""

    learner: Learner
    searched: Areas  # (trials, I, N) of every trial, on the first seeds
    fresh: Fresh
    chosen: int  # the finalist with the largest mean on fresh seeds


def everywhere(fresh: Fresh, trial: int) -> list[Areas]:
    """Returns the fresh areas of a finalist or of trial 0 in every scenario."""
    return [areas for (other, _), areas in fresh.items() if other == trial]


def finalists(searched: Areas, n: int) -> list[int]:
    """Returns the n best trials by (trials, I, N) areas, the best first; of equal ones the first."""
    order = np.argsort(-searched.mean(axis=(1, 2)), kind="stable")
    return [int(trial) for trial in order[:n]]


def best_apart(searched: Areas) -> list[int]:
    """Returns the best trial of each scenario, by (trials, I, N) areas."""
    return [int(trial) for trial in searched.mean(axis=2).argmax(axis=0)]


def searched_areas(runs: pd.DataFrame, experiment: Experiment, learner: Learner) -> Areas:
    """Returns the areas of a learner's trials on the first seeds, (trials, I, N)."""
    rows = runs[(runs["learner"] == learner.name) & (runs["stage"] == SEARCHED)]
    return rows["area"].to_numpy().reshape(len(experiment.conditions), len(experiment.scenarios), -1)


def outcomes(experiment: Experiment, runs: pd.DataFrame) -> list[Outcome]:
    """Returns what a search has found for every learner, by its runs of the first two stages."""
    assert experiment.declared.search is not None
    all_outcomes = []
    for learner in experiment.learners.values():
        searched = searched_areas(runs, experiment, learner)
        again = runs[(runs["learner"] == learner.name) & (runs["stage"] == FRESH)]
        fresh = {
            (int(str(trial)), str(scenario)): rows["area"].to_numpy()
            for (trial, scenario), rows in again.groupby(["trial", "scenario"], sort=False)
        }
        means = {
            trial: float(np.mean(everywhere(fresh, trial)))
            for trial in finalists(searched, experiment.declared.search.finalists)
        }
        all_outcomes.append(Outcome(learner, searched, fresh, max(means, key=lambda trial: means[trial])))
    return all_outcomes


def settings_of(experiment: Experiment, learner: Learner, trial: int) -> dict[str, object]:
    """Returns the settings that a trial has, but for the budget and the time limit."""
    condition = [*experiment.conditions.values()][trial]
    own = experiment.declared.settings | learner.declared.settings
    searched = {key: value for key, value in own.items() if key not in ("budget", "time_limit")}
    return override(searched, condition.settings_changes(learner.variant), learner.name)


def chosen(experiment: Experiment, store: Store) -> dict[str, Chosen]:
    """Returns the chosen settings of every learner and the effort, by its name; all runs are stored."""
    groups = [group for groups in stages(experiment, store) for group in groups]
    return chosen_by(experiment, tables(groups, store, COLUMNS)[0])


def chosen_by(experiment: Experiment, runs: pd.DataFrame) -> dict[str, Chosen]:
    """Returns the same, given the runs of all stages."""
    results = {}
    for outcome in outcomes(experiment, runs):
        name = outcome.learner.name
        tried = runs[(runs["learner"] == name) & (runs["stage"] != AROUND)]
        results[name] = Chosen(
            trial=outcome.chosen,
            settings=settings_of(experiment, outcome.learner, outcome.chosen),
            score=round(float(np.mean(everywhere(outcome.fresh, outcome.chosen))), 6),
            trials=len(outcome.searched) - 1,
            runs=len(tried),
            steps=int(tried["budget"].sum()),
            cpu_time_s=round(float(tried["cpu_time_s"].sum()), 3),
        )
    return results


def stages(experiment: Experiment, store: Store) -> Iterator[list[Group]]:
    """Yields the runs of each stage, as long as those before are stored."""
    search, names = experiment.declared.search, [*experiment.scenarios]
    assert search is not None
    populations: dict[tuple[str, int, str], Population] = {}  # by learner, trial and scenario
    for population in experiment.populations:
        trial = int(population.condition.axes["trial"])
        populations[population.learner.name, trial, population.scenario.name] = population
    first = [
        Group(population, population.runs(), {"stage": SEARCHED}) for population in experiment.populations
    ]
    yield first
    if _is_pending(first, store):
        return
    runs, _ = tables(first, store, COLUMNS)
    fresh = []
    for learner in experiment.learners.values():
        searched = searched_areas(runs, experiment, learner)
        again = product([*finalists(searched, search.finalists), 0], names)
        for trial, name in dict.fromkeys([*again, *zip(best_apart(searched), names, strict=True)]):
            population = populations[learner.name, trial, name]
            fresh.append(Group(population, population.runs(search.fresh), {"stage": FRESH}))
    yield fresh
    if _is_pending(fresh, store):
        return
    runs = pd.concat([runs, tables(fresh, store, COLUMNS)[0]])
    around: list[Group] = []
    for learner, _, _, chosen in outcomes(experiment, runs):
        around += _around([populations[learner.name, chosen, name] for name in names], search)
    yield around


def _around(chosen: Sequence[Population], search: Search) -> Iterator[Group]:
    """Yields runs with the chosen settings in every scenario, and with one of them at another value."""
    learner, settings = chosen[0].learner, chosen[0].first.settings
    changed = {("", ""): settings}
    for key, axis in learner.declared.search.items():
        for value in axis.marks:
            content = override(settings.model_dump(mode="json"), {key: value}, learner.name)
            other = parse(type(settings), content, f"{learner.name}: {key} = {value}")
            if other != settings:
                changed[key, json.dumps(value)] = other
    for ((key, value), other), population in product(changed.items(), chosen):
        first = replace(population.first, settings=other)
        runs = [first.with_seed(seed) for seed in search.around(len(population.seeds))]
        yield Group(population, runs, {"stage": AROUND, "setting": key, "value": value})


def _is_pending(groups: Sequence[Group], store: Store) -> bool:
    return bool(driver.pending([run for group in groups for run in group.runs], store))
