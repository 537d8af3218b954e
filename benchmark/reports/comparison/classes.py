"""An item of a comparison: the best table and the best net of each class, chosen on other runs."""

from collections.abc import Iterator
from itertools import product
from typing import Final

import pandas as pd

from benchmark.analysis.intervals import proportion
from benchmark.drawing.tables import decimals_of, inert, link
from benchmark.experiments import Experiment, Learner
from benchmark.reports.comparison import figures
from benchmark.reports.comparison.cells import MEANINGS, place_of, populations
from benchmark.reports.comparison.verdicts import Row
from benchmark.reports.item import item, number
from envs.observations import seen_as

_KINDS: Final = {"tabular": "table", "deep": "net"}  # by family
_POLICIES: Final = ("greedy", "stochastic")
_SEEN: Final = ("cells", "offset")


@item(
    "classes",
    "exploratory: for each class, success of the learner that did best in the search",
    meanings={
        **MEANINGS,
        "kind": "table or net",
        "sees": "whether it observes cells or the offset",
        "learner": "the learner of this class with the largest `search_area`",
        "search_area": "mean area under its curve of success on fresh runs of the search",
    },
)
def classes(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Finds the best learner of each class, if there are both policies and some learners see the offset.

    Where the issuer is not seen, both forms of observation are the same, and only that of cells has a row.
    """
    cells = {}
    classes: dict[tuple[str, str, str], list[Learner]] = {}
    for names, learner, rows in populations(runs, experiment):
        cells[rows["scenario"].iloc[0], rows["condition"].iloc[0], learner.name] = place_of(names), rows
        if learner.chosen is not None and not learner.reference_for:
            classes.setdefault(_class_of(learner), []).append(learner)
    if {policy for _, policy, _ in classes} != {*_POLICIES} or "offset" not in {sees for *_, sees in classes}:
        return
    best = {key: max(learners, key=_area) for key, learners in classes.items()}
    for scenario, condition in dict.fromkeys(key[:2] for key in cells):
        for kind, policy, sees in product(_KINDS.values(), _POLICIES, _SEEN):
            if (kind, policy, sees) not in best:
                continue
            learner = best[kind, policy, sees]
            names, rows = cells[scenario, condition, learner.name]
            population = experiment.population(condition, scenario, learner.name)
            if sees == "cells" or "offset" in seen_as(population.scenario, learner.observation).observe:
                yield {
                    **names,
                    "kind": kind,
                    "policy": policy,
                    "sees": sees,
                    "learner": learner.name,
                    "search_area": _area(learner),
                    "n": len(rows),
                    "success": proportion(rows["success"].to_numpy()),
                }


def _area(learner: Learner) -> float:
    assert learner.chosen is not None
    return learner.chosen.score


def _class_of(learner: Learner) -> tuple[str, str, str]:
    return _KINDS[learner.family], learner.declared.policy, _SEEN[learner.observation.startswith("offset")]


@classes.shown
def _(table: pd.DataFrame) -> pd.DataFrame:
    """Shows two by two classes side by side, by scenario and what is seen, below the learners' names."""
    learners: dict[str, dict[str, str]] = {}  # by what they see
    shown: dict[tuple[str, str], dict[str, str]] = {}
    digits = decimals_of(table["success"], is_bounded=True)
    for _, row in figures.labelled(table).iterrows():
        scenario, sees, title = row["scenario"], row["sees"], f"{row['policy']} {row['kind']}"
        learners.setdefault(sees, {"scenario": "learner", "sees": sees})[title] = inert(row["learner"])
        entries = shown.setdefault((scenario, sees), {"scenario": scenario, "sees": sees})
        entries[title] = link(number(row["success"], digits), "classes", row)
    return pd.DataFrame([*learners.values(), *shown.values()]).fillna("-")
