"""What is computed of a map, once: what runs took until they had learned, and how contrasts ended."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmark.analysis.intervals import median, proportion
from benchmark.experiments import Population
from benchmark.studies.data import Data
from benchmark.studies.item import expanded
from benchmark.studies.map import looks
from benchmark.studies.map.declared import MapDeclared, name_of
from envs import InputError
from envs.people import NoisyFeedback


@dataclass(frozen=True, eq=False)
class MapAnalysis:
    """What the tables and figures of a map show."""

    data: Data[MapDeclared]
    curves: looks.Rows  # of each population
    runs: looks.Rows
    learned: Mapping[Population, looks.Runs]  # what the runs took, see `looks.until_learned`
    contrasts: Sequence[looks.Contrast]
    distinct: Sequence[looks.Contrast]  # those of several grids once
    cells: pd.DataFrame  # one row for each population, with the learner's name as its index


def analyse(data: Data[MapDeclared]) -> MapAnalysis:
    """Analyses a map; raises an InputError if no contrast has enough runs."""
    experiment = data.experiment
    curves, runs = (looks.rows_of(experiment, frame) for frame in (data.curves, data.runs))
    learned = looks.learned_at(experiment, curves, runs)
    contrasts = looks.contrasts_of(experiment, data.declared, learned)
    if not contrasts:
        raise InputError(f"{experiment.name}: no contrast has enough runs yet: run the experiment first.")
    first = next(iter(learned.values()))
    distinct = {looks.digests(contrast.x, contrast.y): contrast for contrast in contrasts}
    rows = [expanded(_cell(population, runs[population], own)) for population, own in first.items()]
    cells = pd.DataFrame(rows, index=[population.learner.name for population in first])
    return MapAnalysis(data, curves, runs, first, contrasts, [*distinct.values()], cells)


def _cell(population: Population, runs: pd.DataFrame, learned: looks.Runs) -> dict[str, object]:
    """Summarises a population; a run that never learns takes infinitely many steps."""
    is_solved = np.isfinite(learned["steps"])
    of_picks = [np.median(steps) for steps in looks.by_pick(learned["steps"], population)]
    return learner_of(population) | {
        "n": len(learned),
        "budget": population.first.settings.budget,
        "n_solved": int(is_solved.sum()),
        "solved": proportion(is_solved),
        "success": proportion(learned["success"]),
        "steps": median(learned["steps"]),
        "picks": len(of_picks),
        "steps_fastest": min(of_picks),
        "steps_slowest": max(of_picks),
        "disagreements": median(learned["disagreements"]),
        "unseen_success": proportion(runs["unseen_success"].to_numpy()),
        "unseen_budget": proportion(runs["unseen_budget"].to_numpy()),
    }


def point_of(population: Population) -> dict[str, object]:
    """Returns the columns that name a population's point, and say what the scenario is there."""
    scenario, issuer = population.scenario, population.scenario.issuer
    return name_of(population) | {
        "rows": scenario.grid.rows,
        "columns": scenario.grid.columns,
        "places": len({*scenario.layout.places}) - issuer.unseen,
        "unseen": issuer.unseen,
        "feedback": issuer.feedback.kind,
        "noise": issuer.feedback.noise if isinstance(issuer.feedback, NoisyFeedback) else 0.0,
        "permuted": issuer.permuted,
    }


def learner_of(population: Population) -> dict[str, object]:
    """Returns the columns of `point_of`, and those that name the learner."""
    learner = population.learner
    return point_of(population) | {"variant": learner.variant, "observation": learner.observation}
