"""An item of a comparison: the best table and the best net of each class, chosen on other runs."""

from collections.abc import Iterator
from itertools import product
from typing import Any, Final

import pandas as pd

from benchmark.analysis.intervals import proportion
from benchmark.drawing.tables import decimals_of, inert, link
from benchmark.reports.comparison import words
from benchmark.reports.comparison.declared import Learner
from benchmark.reports.comparison.runs import Runs
from benchmark.reports.item import item, number

_KINDS: Final = {"tabular": "table", "deep": "net"}  # by family
_POLICIES: Final = ("greedy", "stochastic")
_SEEN: Final = ("cells", "offset")


@item(
    "classes",
    "exploratory: for each class, success of the learner that did best in the search",
)
def classes(runs: Runs) -> Iterator[dict[str, Any]]:
    """`search_area` is the mean area under the curve of success on fresh runs of the search.

    Learners without a search take no part. Where the issuer is not seen, both forms of observation are the
    same, and only that of cells has a row.
    """
    best: dict[tuple[str, str, str], Learner] = {}
    for cell in runs.own:
        search = runs.searches.get(cell.learner)
        seen = _SEEN[cell.learner.observation.startswith("offset")]
        key = _KINDS[runs.declared.families[cell.learner]], cell.policy, seen
        if search is not None and (key not in best or search.score > runs.searches[best[key]].score):
            best[key] = cell.learner
    if {policy for _, policy, _ in best} != {*_POLICIES} or "offset" not in {seen for *_, seen in best}:
        return
    cells = {(cell.scenario, cell.condition, cell.learner): cell for cell in runs}
    for scenario, condition in dict.fromkeys((cell.scenario, cell.condition) for cell in runs):
        for key in product(_KINDS.values(), _POLICIES, _SEEN):
            if key not in best:
                continue
            cell = cells[scenario, condition, best[key]]
            kind, policy, seen = key
            if seen == "cells" or "offset" in cell.population.model.scenario.observe:
                yield {
                    **cell.place,
                    "kind": kind,
                    "policy": policy,
                    "sees": seen,
                    "learner": str(cell.learner),
                    "search_area": runs.searches[cell.learner].score,
                    "n": cell.n,
                    "success": proportion(cell.final("success")),
                }


@classes.shown
def _(table: pd.DataFrame) -> pd.DataFrame:
    """Shows two by two classes side by side: a row per place and what is seen, below the learners' names."""
    learners: dict[str, dict[str, str]] = {}  # by what they see
    shown: dict[tuple[str, str], dict[str, str]] = {}
    digits = decimals_of(table["success"], is_bounded=True)
    for _, row in table.iterrows():
        place, sees, title = words.place(row), row["sees"], f"{row['policy']} {row['kind']}"
        learners.setdefault(sees, {"scenario": "learner", "sees": sees})[title] = inert(row["learner"])
        at = shown.setdefault((place, sees), {"scenario": place, "sees": sees})
        at[title] = link(number(row["success"], digits), "classes", row)
    return pd.DataFrame([*learners.values(), *shown.values()]).fillna("-")
