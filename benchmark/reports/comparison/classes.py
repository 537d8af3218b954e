"""An item of a comparison: the best table and the best net of each class, chosen on other runs."""

from collections.abc import Iterator
from itertools import product
from typing import Any, Final

import pandas as pd

from benchmark.analysis.intervals import proportion
from benchmark.drawing.tables import link
from benchmark.reports.comparison import figures
from benchmark.reports.comparison.declared import Learner
from benchmark.reports.comparison.runs import Runs
from benchmark.reports.folder import Folder
from benchmark.reports.item import item
from envs.words import listed

_KINDS: Final = {"tabular": "table", "deep": "net"}  # by family
_POLICIES: Final = ("greedy", "stochastic")
_SEEN: Final = ("cells", "offset")


@item(
    "classes",
    "exploratory: in each class, the learner with the largest area in its search, which used other runs",
    {
        **dict.fromkeys(["scenario", "condition"], ""),
        "kind": "table or net",
        **dict.fromkeys(["policy", "sees", "learner"], ""),
        "n": "runs",
        "success": "success probability",
    },
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


@classes.sentence
def _(table: pd.DataFrame, _: Folder) -> str | None:
    """Tells the means over the scenarios in which both forms of observation differ."""
    rows = table[table["scenario"].isin(table.loc[table["sees"] == "offset", "scenario"])]
    scenarios = rows["scenario"].unique()
    if "condition" in table or not len(scenarios):
        return None
    few = len(scenarios) <= figures.FEW
    where = (
        f"in {listed(scenarios)}" if few else f"in the {len(scenarios)} scenarios where the issuer is seen"
    )
    parts = [
        f"{policy} {kind} that sees {'the offset' if seen == 'offset' else 'cells'} (`{learner}`) "
        f"{link(f'{each.success.mean():.2f}', 'classes', each)}"
        for (kind, policy, seen, learner), each in rows.groupby(
            ["kind", "policy", "sees", "learner"], sort=False
        )
    ]
    return (
        f"Exploratory: mean success {where} of the learner of each class that the search found best, on "
        f"other runs: {'; '.join(parts)}."
    )
