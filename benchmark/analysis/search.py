"""The stages of a search for settings: which runs it has, given those that are stored.

First, every trial of every learner, in all scenarios. Then, with fresh seeds, the trials of the largest mean
and trial 0; that with the largest mean on these seeds is chosen, so one that was merely lucky is not. Beside
them, in each scenario, the trial that is best there. Last, unless the search leaves it out, the chosen
settings with other seeds, also with one of them changed to each other value that is accepted. Means are of a
measure of each run: the area under its curve of exact success or, with `[solved]`, how early it has learned.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice, product
from math import comb, nan
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from benchmark.analysis.frames import Floats, Group, tables
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Learner, Population
from benchmark.experiments.search import Chosen, Finalist, Search
from envs.inputs import InputError, override, parse
from envs.scenario import RELATIVE

Fresh = Mapping[tuple[int, str], Floats]  # (N,) on fresh seeds, by trial and scenario
COLUMNS: Final = ("area", "earliness", "cpu_time_s")  # of runs, that a search needs as far as they have them
SEARCHED, FRESH, AROUND = "search", "fresh", "around"  # stages
ALL: Final = "all"  # scenarios together


class Outcome(NamedTuple):
    """What a search has found for a learner. I scenarios."""

    learner: Learner
    searched: Floats  # (trials, I, N) of every trial, on the first seeds
    fresh: Fresh
    ranked: Sequence[int]  # by their mean on fresh seeds, the chosen first: finalists, and trial 0 if first


def measure_of(experiment: Experiment) -> str:
    """Returns the column of runs that a search compares."""
    return "area" if experiment.declared.solved is None else "earliness"


def everywhere(fresh: Fresh, trial: int) -> list[Floats]:
    """Returns the fresh measures of a finalist or of trial 0 in every scenario."""
    return [measures for (other, _), measures in fresh.items() if other == trial]


def finalists(searched: Floats, n: int) -> list[int]:
    """Returns the n best trials by (trials, I, N) measures, the best first; of equal ones the first."""
    order = np.argsort(-searched.mean(axis=(1, 2)), kind="stable")
    return [int(trial) for trial in order[:n]]


def best_apart(searched: Floats) -> list[int]:
    """Returns the best trial of each scenario, by (trials, I, N) measures."""
    return [int(trial) for trial in searched.mean(axis=2).argmax(axis=0)]


def searched_measures(runs: pd.DataFrame, experiment: Experiment, learner: Learner) -> Floats:
    """Returns the measures of a learner's trials on the first seeds, (trials, I, N)."""
    rows = runs[(runs["learner"] == learner.name) & (runs["stage"] == SEARCHED)]
    measures = rows[measure_of(experiment)].to_numpy()
    return measures.reshape(len(experiment.conditions), len(experiment.scenarios), -1)


def outcomes(experiment: Experiment, runs: pd.DataFrame) -> list[Outcome]:
    """Returns what a search has found for every learner, by its runs of the first two stages."""
    assert experiment.declared.search is not None
    all_outcomes, measure = [], measure_of(experiment)
    for learner in experiment.learners.values():
        searched = searched_measures(runs, experiment, learner)
        again = runs[(runs["learner"] == learner.name) & (runs["stage"] == FRESH)]
        fresh = {
            (int(str(trial)), str(scenario)): measures.to_numpy()
            for (trial, scenario), measures in again.groupby(["trial", "scenario"], sort=False)[measure]
        }
        best = finalists(searched, experiment.declared.search.finalists)
        means = {trial: float(np.mean(everywhere(fresh, trial))) for trial in (*best, 0)}
        ranked = sorted(best, key=means.__getitem__, reverse=True)
        ranked = [0, *ranked] if means[0] > means[ranked[0]] else ranked
        all_outcomes.append(Outcome(learner, searched, fresh, ranked))
    return all_outcomes


def settings_of(experiment: Experiment, learner: Learner, trial: int) -> dict[str, object]:
    """Returns the settings that a trial has, but for the budget and the time limit."""
    condition = [*experiment.conditions.values()][trial]
    own = experiment.declared.settings | learner.declared.settings
    searched = {key: value for key, value in own.items() if key not in ("budget", "time_limit")}
    return override(searched, condition.settings_changes(learner.variant), learner.name)


def chosen(experiment: Experiment, store: Store) -> dict[str, Chosen]:
    """Returns the chosen settings of every learner and the effort, by its name; all runs are stored."""
    groups = [group for groups in islice(stages(experiment, store), 2) for group in groups]
    return chosen_by(experiment, tables(groups, store, COLUMNS)[0])


def chosen_by(experiment: Experiment, runs: pd.DataFrame) -> dict[str, Chosen]:
    """Returns the same, given the runs of the first two stages, or of all.

    The effort is that of the trials and of the fresh runs of those that are ranked.
    """
    results = {}
    for outcome in outcomes(experiment, runs):
        name = outcome.learner.name
        is_final = (runs["stage"] == FRESH) & runs["trial"].isin([*map(str, outcome.ranked)])
        tried = runs[(runs["learner"] == name) & ((runs["stage"] == SEARCHED) | is_final)]
        best = list[Finalist]()
        for trial in outcome.ranked[:3]:
            settings = settings_of(experiment, outcome.learner, trial)
            score = round(float(np.mean(everywhere(outcome.fresh, trial))), 6)
            best.append(Finalist(trial=trial, settings=settings, score=score))
        results[name] = Chosen(
            **dict(best[0]),
            others=tuple(best[1:]),
            trials=len(outcome.searched) - 1,
            runs=len(tried),
            steps=int(tried["budget"].sum()),
            cpu_time_s=round(float(tried["cpu_time_s"].sum()), 3),
        )
    return results


def stages(experiment: Experiment, store: Store) -> Iterator[list[Group]]:
    """Yields the runs of each stage; whoever asks for the next one has stored those before."""
    search, names = experiment.declared.search, [*experiment.scenarios]
    assert search is not None
    populations: dict[tuple[str, int, str], Population] = {}  # by learner, trial and scenario
    first = []
    for population in experiment.populations:
        trial = int(population.condition.axes["trial"])
        populations[population.learner.name, trial, population.scenario.name] = population
        first.append(Group(population, population.runs(), {"stage": SEARCHED}))
    yield first
    runs, _ = tables(first, store, COLUMNS)
    fresh = []
    for learner in experiment.learners.values():
        searched = searched_measures(runs, experiment, learner)
        again = product([*finalists(searched, search.finalists), 0], names)
        for trial, name in dict.fromkeys([*again, *zip(best_apart(searched), names, strict=True)]):
            population = populations[learner.name, trial, name]
            fresh.append(Group(population, population.runs(search.fresh), {"stage": FRESH}))
    yield fresh
    if not search.around:
        return
    runs = pd.concat([runs, tables(fresh, store, COLUMNS)[0]])
    around: list[Group] = []
    for outcome in outcomes(experiment, runs):
        chosen = [populations[outcome.learner.name, outcome.ranked[0], name] for name in names]
        around += _around(chosen, search)
    yield around


def _around(chosen: Sequence[Population], search: Search) -> Iterator[Group]:
    """Yields runs with the chosen settings in every scenario, and with one of them at another value."""
    learner, settings = chosen[0].learner, chosen[0].first.settings
    changed = {("", ""): settings}
    for key, axis in learner.declared.search.items():
        for value in axis.marks:
            content = override(settings.model_dump(mode="json"), {key: value}, learner.name)
            with suppress(InputError):  # of settings that are not accepted, or not together
                if (other := parse(type(settings), content, learner.name)) != settings:
                    changed[key, json.dumps(value)] = other
    for ((key, value), other), population in product(changed.items(), chosen):
        first = replace(population.first, settings=other)
        runs = [first.with_seed(seed) for seed in search.seeds_around(len(population.seeds))]
        yield Group(population, runs, {"stage": AROUND, "setting": key, "value": value})


def chances(means: Floats, b: int) -> Floats:
    """Returns the probability that each of n trials is the best of b drawn without replacement, (n,).

    >>> chances(np.array([0.2, 0.8, 0.5]), 2).round(3).tolist()
    [0.0, 0.667, 0.333]
    """
    n, found = len(means), np.zeros(len(means))
    for n_better, trial in enumerate(np.argsort(-means, kind="stable")):  # of equal ones, the first is better
        found[trial] = comb(n - 1 - n_better, b - 1) / comb(n, b)
    return found


def references(trials: pd.DataFrame, families: Mapping[str, str]) -> dict[str, str]:
    """Returns with which learner each one's picks are compared, by their names.

    It is the learner whose best trial has the largest mean on fresh runs, of those that observe the same
    (cells or offsets) and are neither nets nor planners; if there are none, of all that observe the same.

    Args:
      trials: A table like trials.csv.
      families: Of variants, by name.
    """
    fresh = trials.filter(regex="^fresh_(area|earliness)$").max(axis=1)
    groups = trials.assign(best=fresh).groupby(["variant", "observation"], sort=False)
    best = groups["best"].max().reset_index()
    names = best["variant"] + ", " + best["observation"]
    best["is_other"] = ~best["variant"].map(families).isin(["deep", "planner"])
    best["observes"] = best["observation"].str.startswith(RELATIVE)
    ranked = best.sort_values(["is_other", "best"], ascending=False, kind="stable")
    first = ranked.drop_duplicates("observes").index
    of_kind = dict(zip(best["observes"][first], names[first], strict=True))
    return dict(zip(names, best["observes"].map(of_kind), strict=True))


def picked(trials: pd.DataFrame, references: Mapping[str, str]) -> Iterator[dict[str, object]]:
    """Yields how the pick from b trials compares with that of another learner, for b from 1 to all.

    A pick is the trial of the largest mean over scenarios among b that are drawn, without trial 0. Picks are
    compared by this mean, and by that in each scenario; ties count as a half.

    Args:
      trials: A table like trials.csv, whose last columns are the means in each scenario.
      references: With which learner each one is compared, by name; of one with itself, there is no result.
    """
    measure = "area" if "fresh_area" in trials else "earliness"
    scenarios = [*trials][[*trials].index(f"fresh_{measure}") + 1 :]
    parts = trials[trials["trial"] > 0].groupby(["variant", "observation"], sort=False)
    means = {", ".join(map(str, key)): rows[[measure, *scenarios]].to_numpy().T for key, rows in parts}
    for name, own in means.items():
        keys = dict(zip(("variant", "observation"), name.split(", "), strict=True))
        reference = references[name] if references[name] != name else ""
        n, other = own.shape[1], means[references[name]]
        for scenario, x, y in zip((ALL, *scenarios), own, other, strict=True):
            beaten = (np.sign(x[:, None] - y) + 1) / 2
            for b in (*(2**i for i in range(n.bit_length()) if 2**i < n), n):
                chance = chances(own[0], b)
                beats = float(chance @ beaten @ chances(other[0], b)) if reference else nan
                row = {"scenario": scenario, **keys, "reference": reference, "trials": b, "beats": beats}
                yield row | {"expected": float(chance @ x)}
