"""What is computed of a map, once: what runs took until they had learned, and how contrasts ended."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmark.analysis.frames import by_population
from benchmark.analysis.intervals import median, proportion
from benchmark.experiments import Population
from benchmark.studies.data import Data
from benchmark.studies.item import expanded
from benchmark.studies.map.contrasts import Contrast, Runs, by_pick, contrasts_of, until_learned
from benchmark.studies.map.declared import MapDeclared, name_of


@dataclass(frozen=True, eq=False)
class MapAnalysis:
    """What the tables and figures of a map show."""

    data: Data[MapDeclared]
    runs: Mapping[Population, pd.DataFrame]  # of each population
    learned: Mapping[Population, Runs]  # what the runs took, see `until_learned`
    contrasts: Sequence[Contrast]
    cells: pd.DataFrame  # one row for each population, with the learner's name as its index


def analyse(data: Data[MapDeclared]) -> MapAnalysis:
    """Analyses a map."""
    experiment, solved = data.experiment, data.experiment.declared.solved
    assert solved is not None
    populations = {(each.condition.name, each.learner.name): each for each in experiment.populations}
    curves, runs = (
        {populations[keys["condition"], keys["learner"]]: rows for keys, rows in by_population(frame)}
        for frame in (data.curves, data.runs)
    )
    learned = {
        population: until_learned(
            rows,
            solved.success,
            runs[population]["unseen_budget"].to_numpy() if population.scenario.issuer.unseen else None,
        )
        for population, rows in curves.items()
    }
    rows = [expanded(_cell(population, runs[population], own)) for population, own in learned.items()]
    cells = pd.DataFrame(rows, index=[population.learner.name for population in learned])
    return MapAnalysis(data, runs, learned, contrasts_of(experiment, data.declared, learned), cells)


def _cell(population: Population, runs: pd.DataFrame, learned: Runs) -> dict[str, object]:
    """Summarises a population; a run that never learns takes infinitely many steps."""
    is_solved = np.isfinite(learned["steps"])
    of_picks = [np.median(steps) for steps in by_pick(learned["steps"], population)]
    return {
        **learner_of(population),
        "n": len(is_solved),
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


def learner_of(population: Population) -> dict[str, str]:
    """Returns the columns that name a population: its point and its learner."""
    learner = population.learner
    return name_of(population) | {"variant": learner.variant, "observation": learner.observation}
