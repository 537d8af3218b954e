"""The runs of a comparison, learner after learner, and what each population of them comes to."""

from collections.abc import Hashable, Iterator, Mapping
from typing import Final

import numpy as np
import pandas as pd

from benchmark.analysis.frames import KEYS
from benchmark.analysis.intervals import Estimate, student
from benchmark.experiments import Experiment
from benchmark.reports.comparison.declared import Pair, is_own

EFFORT: Final = {  # columns, with their labels
    "settings_tried": "settings tried",
    "search_steps": "steps of the search",
    "search_cpu_s": "CPU seconds of the search",
}
_PLACE: Final = ["scenario", "condition", "learner"]  # of a population


def own_learners(frame: pd.DataFrame, experiment: Experiment) -> list[str]:
    """Lists the learners that have at least two runs everywhere, of the same seeds, without planners.

    They are in the order in which tables have them: as declared, but references behind their learners. A
    reference of a learner that is left out is left out, too.
    """
    seeds: dict[str, list[set[int]]] = {}
    for (_, _, name), rows in frame.groupby(_PLACE, observed=True):
        seeds.setdefault(str(name), []).append({*rows["seed"]})
    n_declared = pd.Series([each.learner.name for each in experiment.populations]).value_counts()
    enough = [
        learner
        for name, learner in experiment.learners.items()
        if name in seeds
        and len(seeds[name]) == n_declared[name]
        and len(set.intersection(*seeds[name])) >= 2
    ]
    names = []
    for learner in filter(is_own, enough):
        names += [learner.name, *(each.name for each in enough if each.reference_for == learner.name)]
    return names


def own_rows(frame: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Returns the rows of `runs` or `curves` learner after learner, see `own_learners`."""
    rank = {name: i for i, name in enumerate(own_learners(frame, experiment))}
    places = frame["learner"].astype(object).map(rank)
    return frame.loc[places.dropna().sort_values(kind="stable").index]


def populations(frame: pd.DataFrame, experiment: Experiment) -> Iterator[tuple[dict[str, str], pd.DataFrame]]:
    """Yields the rows of each population, and the columns that name it in tables."""
    keys = ["learner", "condition", "scenario"]
    names = ["scenario", *(["condition"] if len(experiment.conditions) > 1 else []), "algorithm", "observation"]
    for _, rows in own_rows(frame, experiment).groupby(keys, sort=False, observed=True):
        yield {name: rows[name].iloc[0] for name in names}, rows


def wrong_pings(runs: pd.DataFrame) -> Estimate:
    """Returns wrong PINGs per 1,000 steps of the whole training, with Student's interval."""
    rate = student((runs["training_wrong_pings"] / runs["budget"] * 1000).to_numpy())
    return rate._replace(low=max(rate.low, 0.0))


def effort(experiment: Experiment, learner: Hashable) -> dict[str, float]:
    """Returns what was spent on the search for a learner's settings: trials, steps and CPU seconds."""
    chosen = experiment.learners[str(learner)].chosen
    spent = (0, 0, 0.0) if chosen is None else (chosen.trials, chosen.steps, chosen.cpu_time_s)
    return dict(zip(EFFORT, spent, strict=True))


def cells_of(runs: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Returns a row for each population: what names it, and the means that contrasts are computed from."""
    cells = []
    for _, rows in populations(runs, experiment):
        first, rate = rows.iloc[0], wrong_pings(rows)
        cells.append(
            {name: first[name] for name in (*KEYS, "policy", "random_success")}
            | {name: float(rows[name].to_numpy().mean()) for name in ("success", "score")}
            | {"n": len(rows), "wrong_pings": rate.value, "wrong_pings_reach": rate.high - rate.value}
        )
    return pd.DataFrame(cells)


def matched(cells: pd.DataFrame, pair: Pair) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns the cells that the first side names, and those that differ from them by what the sides name."""
    x = cells[np.logical_and.reduce([cells[axis] == name for axis, name in pair.x.items()])]
    places = pd.MultiIndex.from_frame(cells[_PLACE])
    others = places.get_indexer(pd.MultiIndex.from_frame(x.assign(**pair.y)[_PLACE]))
    is_there = others >= 0
    return x[is_there].reset_index(drop=True), cells.iloc[others[is_there]].reset_index(drop=True)


def is_complete(runs: pd.DataFrame, experiment: Experiment) -> bool:
    """Returns whether every population has all its runs: those declared, or other seeds that all have."""
    found = runs.groupby(_PLACE, observed=True)["seed"].agg(set)
    every = {*runs["seed"]}
    return len(found) == len(experiment.populations) and all(
        found[each.scenario.name, each.condition.name, each.learner.name] in (every, {*each.seeds})
        for each in experiment.populations
    )
