"""The runs of a comparison, learner after learner, and one summary row per learner and scenario."""

from collections.abc import Iterator
from typing import Any

import pandas as pd

from benchmark.analysis.frames import KEYS, by_population
from benchmark.analysis.intervals import Estimate, student
from benchmark.experiments import Experiment, Learner
from benchmark.studies.comparison.columns import EFFORT
from benchmark.studies.comparison.declared import own_learners

Row = dict[str, Any]


def names_of(experiment: Experiment) -> list[str]:
    """Lists the columns that name a population in tables."""
    n_conditions = len(experiment.conditions)
    return [name for name in KEYS if name != "learner" and (name != "condition" or n_conditions > 1)]


def own_rows(frame: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Returns the rows of `runs` or `curves` learner after learner, without planners.

    Learners are in the order declared, but references behind their learners.
    """
    names: list[str] = []
    for own in own_learners(experiment):
        names += [own, *(name for name, other in experiment.learners.items() if other.reference_for == own)]
    rank = frame["learner"].map({name: i for i, name in enumerate(names)})
    return frame.loc[rank.dropna().sort_values(kind="stable").index]


def populations(
    frame: pd.DataFrame, experiment: Experiment, *without: str
) -> Iterator[tuple[Row, Learner, pd.DataFrame]]:
    """Yields each population: the columns that name it in tables, its learner, and its rows.

    Without some of the columns, it yields several populations as one.
    """
    names = [name for name in names_of(experiment) if name not in without]
    for keys, rows in by_population(own_rows(frame, experiment), *without):
        yield {name: keys[name] for name in names}, experiment.learners[keys["learner"]], rows


def wrong_pings(runs: pd.DataFrame) -> Estimate:
    """Returns wrong PINGs per 1,000 steps of the whole training, with Student's interval."""
    rate = student((runs["training_wrong_pings"] / runs["budget"] * 1000).to_numpy())
    return rate._replace(low=max(rate.low, 0.0))


def effort(learner: Learner) -> dict[str, float]:
    """Returns what was spent on the search for a learner's settings: trials, steps and CPU seconds."""
    chosen = learner.chosen
    spent = (0, 0, 0.0) if chosen is None else (chosen.trials, chosen.steps, chosen.cpu_time_s)
    return dict(zip(EFFORT.split(), spent, strict=True))


def cells_of(runs: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Returns a row for each population: what names it, and the means that contrasts are computed from."""
    cells = []
    for keys, rows in by_population(own_rows(runs, experiment)):
        rate = wrong_pings(rows)
        cells.append(
            {**keys, **rows.iloc[0][["policy", "random_success"]], "n": len(rows)}
            | {name: float(rows[name].to_numpy().mean()) for name in ("success", "score")}
            | {"wrong_pings": rate.value, "wrong_pings_reach": rate.high - rate.value}
        )
    return pd.DataFrame(cells)
