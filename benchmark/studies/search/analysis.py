"""A search for settings: which runs it has, which settings it chooses, and what these reach.

First, every trial of every learner runs in all scenarios. Then trial 0, and the trials of each part of the
search with the largest means, run again with fresh seeds. The one with the largest mean on these is the pick
of its part, so mere luck is not enough; trial 0 is a candidate in the first part. The best pick is chosen.
In each scenario, the trial that is best there runs again, too. Means are of a measure of each run: the area
under its curve of exact success or, with `[solved]`, how early it has learned.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product
from math import nan
from typing import Final

import numpy as np
import pandas as pd

from benchmark.analysis.frames import Floats, Group, tables
from benchmark.analysis.intervals import Estimate, combined
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Learner
from benchmark.experiments.search import Chosen, Finalist, Search
from benchmark.studies.data import Data
from benchmark.studies.study import Declared
from envs.inputs import override

Row = dict[str, object]

COLUMNS: Final = ("area", "earliness", "cpu_time_s")  # columns of runs that a search needs, if they exist
ALL: Final = "all"  # stands for all scenarios


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a search has found for a learner. I scenarios."""

    learner: Learner
    searched: Floats
    """Measures of every trial on the first seeds, (trials, I, N)."""
    fresh: Mapping[tuple[int, str], Floats]
    """Measures on fresh seeds, (N,), by trial and scenario."""
    finalists: Sequence[Sequence[int]]
    """The best trials of every part on the first seeds."""

    @cached_property
    def picks(self) -> list[int]:
        """The best trial of every part on fresh seeds; of equal ones the first finalist, and trial 0 last."""
        first, *others = self.finalists
        return [max(part, key=self.mean) for part in ([*first, 0], *others)]

    def mean(self, trial: int) -> float:
        """Returns the mean of a finalist or of trial 0 on fresh seeds."""
        return float(np.mean(self.again(trial)))

    def again(self, trial: int) -> list[Floats]:
        """Returns the fresh measures of a finalist or of trial 0 in every scenario."""
        return [measures for (other, _), measures in self.fresh.items() if other == trial]


@dataclass(frozen=True, eq=False)
class SearchAnalysis:
    """What a search has found for every learner."""

    data: Data[Declared]
    measure: str
    """The column of runs that the search compares."""
    outcomes: Sequence[Outcome]
    chosen: Mapping[str, Chosen]
    """The chosen settings, and the effort: all trials, and fresh runs of those that are ranked."""

    def settings(self, learner: Learner, trial: int) -> Row:
        """Returns the searched settings of a trial, by dotted key."""
        experiment = self.data.experiment
        condition, scenario = [*experiment.declared.conditions][trial], next(iter(experiment.scenarios))
        settings = experiment.population(condition, scenario, learner.name).first.settings
        return {key: value_at(settings, key) for key in learner.declared.search}

    @cached_property
    def trials(self) -> pd.DataFrame:
        """Every trial of every learner: settings, and means over the first runs and, if any, fresh ones."""
        names, missing = [*self.data.experiment.scenarios], np.array([nan])
        rows = [
            {
                "variant": outcome.learner.variant,
                "observation": outcome.learner.observation,
                "trial": trial,
                "settings": text_of(self.settings(outcome.learner, trial)),
                self.measure: float(measures.mean()),
                f"fresh_{self.measure}": float(
                    np.mean([outcome.fresh.get((trial, name), missing).mean() for name in names])
                ),
                **dict(zip(names, measures.mean(axis=1).tolist(), strict=True)),
            }
            for outcome in self.outcomes
            for trial, measures in enumerate(outcome.searched)
        ]
        return pd.DataFrame(rows)


def analyse(data: Data[Declared]) -> SearchAnalysis:
    """Finds what was chosen for every learner."""
    experiment, runs = data.experiment, data.runs
    found = [*outcomes(experiment, runs)]
    chosen = {each.learner.name: _chosen(experiment, runs, each) for each in found}
    return SearchAnalysis(data, measure_of(experiment), found, chosen)


def stages(experiment: Experiment, _: Declared, store: Store) -> Iterator[list[Group]]:
    """Yields the runs of both stages; the caller stores the first before it asks for the second."""
    search, names = experiment.declared.search, [*experiment.scenarios]
    assert search is not None
    first = [Group(each, each.runs()) for each in experiment.populations]
    yield first
    runs, fresh, conditions = (
        tables(first, store, COLUMNS)[0],
        list[Group](),
        [*experiment.declared.conditions],
    )
    for learner in experiment.learners.values():
        searched = _searched(experiment, runs, learner)
        again = product([*chain(*finalists(searched, search)), 0], names)
        for trial, name in dict.fromkeys([*again, *zip(best_by_scenario(searched), names, strict=True)]):
            population = experiment.population(conditions[trial], name, learner.name)
            fresh.append(Group(population, population.runs(search.fresh)))
    yield fresh


def measure_of(experiment: Experiment) -> str:
    """Returns the column of runs that a search compares."""
    return "area" if experiment.declared.solved is None else "earliness"


def finalists(searched: Floats, search: Search) -> list[list[int]]:
    """Returns the best trials of every part by (trials, I, N) measures, the best first; ties in order."""
    means = searched.mean(axis=(1, 2))
    return [sorted(part, key=lambda trial: -means[trial])[: search.finalists] for part in search.blocks]


def best_by_scenario(searched: Floats) -> list[int]:
    """Returns the best trial of each scenario, by (trials, I, N) measures."""
    return [int(trial) for trial in searched.mean(axis=2).argmax(axis=0)]


def outcomes(experiment: Experiment, runs: pd.DataFrame) -> Iterator[Outcome]:
    """Yields what a search has found for every learner, by its runs of both stages."""
    search = experiment.declared.search
    assert search is not None
    for learner in experiment.learners.values():
        searched = _searched(experiment, runs, learner)
        again = runs[(runs["learner"] == learner.name) & _is_fresh(experiment, runs)]
        groups = again.groupby(["trial", "scenario"], sort=False)[measure_of(experiment)]
        fresh = {(int(str(trial)), str(name)): rows.to_numpy() for (trial, name), rows in groups}
        yield Outcome(learner, searched, fresh, finalists(searched, search))


def _is_fresh(experiment: Experiment, runs: pd.DataFrame) -> "pd.Series[bool]":
    """Returns which runs are those of the second stage, whose seeds are fresh."""
    search = experiment.declared.search
    assert search is not None
    return runs["seed"].isin(search.fresh)


def _searched(experiment: Experiment, runs: pd.DataFrame, learner: Learner) -> Floats:
    """Returns the measures of a learner's trials on the first seeds, (trials, I, N)."""
    rows = runs[(runs["learner"] == learner.name) & ~_is_fresh(experiment, runs)]
    measures = rows[measure_of(experiment)].to_numpy()
    return measures.reshape(len(experiment.declared.conditions), len(experiment.scenarios), -1)


def _chosen(experiment: Experiment, runs: pd.DataFrame, outcome: Outcome) -> Chosen:
    """Returns the best settings of a learner and the effort of finding them."""
    learner, candidates = outcome.learner, {*chain(*outcome.finalists), *outcome.picks}
    counts = ~_is_fresh(experiment, runs) | runs["trial"].isin([*map(str, candidates)])
    tried = runs[(runs["learner"] == learner.name) & counts]
    picks = [
        Finalist(
            trial=t, settings=_declared_settings(experiment, learner, t), score=round(outcome.mean(t), 6)
        )
        for t in outcome.picks
    ]
    best = max(picks, key=lambda pick: pick.score)
    return Chosen(
        **dict(best),
        picks=tuple(picks) if len(picks) > 1 else (),
        trials=len(outcome.searched) - 1,
        runs=len(tried),
        steps=int(tried["budget"].sum()),
        cpu_time_s=round(float(tried["cpu_time_s"].sum()), 3),
    )


def _declared_settings(experiment: Experiment, learner: Learner, trial: int) -> Row:
    """Returns the settings that a trial declares or draws, but for the budget and the time limit."""
    condition = [*experiment.declared.conditions.values()][trial]
    own = experiment.declared.settings | learner.declared.settings
    kept = {key: value for key, value in own.items() if key not in ("budget", "time_limit")}
    return override(kept, condition.settings_changes(learner.variant), learner.name)


def value_at(settings: object, key: str) -> object:
    """Returns the value of a dotted key; None if it is not set."""
    for name in key.split("."):
        settings = settings.get(name) if isinstance(settings, dict) else getattr(settings, name, None)
    return settings


def text_of(settings: Row) -> str:
    """Returns searched settings as readers see them, without those that are not set."""
    texts = {key.split(".")[-1]: json.dumps(value) for key, value in settings.items() if value is not None}
    return ", ".join(f"{key} {text}" for key, text in texts.items()) or "default"


def gain(x: Sequence[Floats], y: Sequence[Floats]) -> Estimate:
    """Returns the difference of two means over scenarios, x minus y, as of independent runs."""
    # Scenarios in which both sides are the same runs change neither the difference nor its interval.
    differing = [pair for pair in zip(x, y, strict=True) if pair[0] is not pair[1]]
    sides = [side for pair in differing for side in pair]
    weights, means = [1 / len(x), -1 / len(x)] * len(differing), [float(side.mean()) for side in sides]
    if not differing:
        return Estimate(0.0, 0.0, 0.0)
    return Estimate(float(np.dot(weights, means)), *combined(weights, means, [*map(len, sides)]))


def expected_total(default: Floats, others: Floats, budget: int) -> float:
    """Returns the expected steps of all runs up to the first that has learned; inf if there may be none.

    One of the runs with the declared settings, (N,), comes first, and then others, see `expected_drawn`.
    """
    then = budget + expected_drawn(others, budget)
    return float(np.where(np.isfinite(default), default, then).mean())


def expected_drawn(others: Floats, budget: int) -> float:
    """Returns the same of runs that are drawn without replacement.

    If m of n learn, (n - m) / (m + 1) fail before, on average. The argument, (n,), holds the steps until each
    run has learned, or inf if it never does; such a run costs the budget.
    """
    learned = others[np.isfinite(others)]
    failures = (len(others) - len(learned)) / (len(learned) + 1)
    return failures * budget + float(learned.mean()) if len(learned) else np.inf
