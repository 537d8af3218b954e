"""The runs of a comparison, learner after learner, and what each population of them comes to."""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import pandas as pd

from benchmark.analysis.frames import KEYS, by_population
from benchmark.analysis.intervals import Estimate, student
from benchmark.experiments import Experiment, Learner
from benchmark.reports.comparison.declared import Pair, is_own

# Columns with their labels, and what columns of several tables mean
CELL: Final = dict.fromkeys(("scenario", "condition", "learner"), "")
PAIR: Final = dict.fromkeys(("scenario", "condition", "x", "y"), "")
EFFORT: Final = {
    "settings_tried": "settings tried",
    "search_steps": "steps of the search",
    "search_cpu_s": "CPU seconds of the search",
}
MEANINGS: Final = {
    "settings_tried": "trials of the search for its settings; 0 without a search",
    "search_steps": "environment steps of the search for its settings; 0 without a search",
    "search_cpu_s": "CPU seconds of the search for its settings; 0 without a search",
    "policy": "the evaluated policy, greedy or stochastic",
    "random_success": "success of the random policy, exact",
    "runs": "runs, over all scenarios",
    "wrong_pings": "wrong PINGs per 1,000 steps of the whole training",
}
_PLACE: Final = ["scenario", "condition", "learner"]


def names_of(experiment: Experiment) -> list[str]:
    """Lists the columns that name a population in tables."""
    return [
        name for name in KEYS if name != "learner" and (name != "condition" or len(experiment.conditions) > 1)
    ]


def own_rows(frame: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Returns the rows of `runs` or `curves` learner after learner, without planners.

    Learners are in the order declared, but references behind their learners.
    """
    names: list[str] = []
    for own in filter(is_own, experiment.learners.values()):
        references = [name for name, other in experiment.learners.items() if other.reference_for == own.name]
        names += [own.name, *references]
    rank = frame["learner"].map({name: i for i, name in enumerate(names)})
    return frame.loc[rank.dropna().sort_values(kind="stable").index]


def populations(
    frame: pd.DataFrame, experiment: Experiment
) -> Iterator[tuple[dict[str, str], Learner, pd.DataFrame]]:
    """Yields each population: the columns that name it in tables, its learner, and its rows."""
    names = names_of(experiment)
    for keys, rows in by_population(own_rows(frame, experiment)):
        yield {name: keys[name] for name in names}, experiment.learners[keys["learner"]], rows


def place_of(names: Mapping[str, str]) -> dict[str, str]:
    """Returns the columns that name the scenario and the condition, of those that name a population."""
    return {axis: names[axis] for axis in ("scenario", "condition") if axis in names}


def wrong_pings(runs: pd.DataFrame) -> Estimate:
    """Returns wrong PINGs per 1,000 steps of the whole training, with Student's interval."""
    rate = student((runs["training_wrong_pings"] / runs["budget"] * 1000).to_numpy())
    return rate._replace(low=max(rate.low, 0.0))


def effort(learner: Learner) -> dict[str, float]:
    """Returns what was spent on the search for a learner's settings: trials, steps and CPU seconds."""
    chosen = learner.chosen
    spent = (0, 0, 0.0) if chosen is None else (chosen.trials, chosen.steps, chosen.cpu_time_s)
    return dict(zip(EFFORT, spent, strict=True))


def cells_of(runs: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Returns a row for each population: what names it, and the means that contrasts are computed from."""
    cells = []
    for keys, rows in by_population(own_rows(runs, experiment)):
        first, rate = rows.iloc[0], wrong_pings(rows)
        cells.append(
            {**keys, "policy": first["policy"], "random_success": first["random_success"], "n": len(rows)}
            | {name: float(rows[name].to_numpy().mean()) for name in ("success", "score")}
            | {"wrong_pings": rate.value, "wrong_pings_reach": rate.high - rate.value}
        )
    return pd.DataFrame(cells)


def matched(cells: pd.DataFrame, pair: Pair) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns the cells that the first side names, and those that differ from them by what the sides name."""
    x = cells[np.logical_and.reduce([cells[axis] == name for axis, name in pair.x.items()])]
    index = pd.MultiIndex.from_frame(cells[_PLACE])
    others = index.get_indexer(pd.MultiIndex.from_frame(x.assign(**pair.y)[_PLACE]))
    is_there = others >= 0
    return x[is_there].reset_index(drop=True), cells.iloc[others[is_there]].reset_index(drop=True)
