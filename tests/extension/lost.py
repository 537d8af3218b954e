"""An item of a comparison, with a table, a figure and a sentence: runs without any success."""

from typing import Any

from benchmark.analysis.intervals import proportion
from benchmark.drawing.style import figure_of
from benchmark.drawing.tables import link
from benchmark.reports.item import item


@item("lost", "runs without any success", {"scenario": "", "learner": "", "share": "share of runs"})
def lost(runs: Any) -> Any:
    return [cell.row(share=proportion(cell.final("success") == 0)) for cell in runs]


@lost.figure("Share of runs without any success.")
def _(tables: Any, _: Any) -> Any:
    with figure_of(1, 1, (4.0, 2.0)) as (figure, axes):
        axes[0, 0].bar(tables["lost"].index, tables["lost"]["share"])
    return figure


@lost.sentence
def _(table: Any, _: Any) -> str:
    return f"Mean share without any success: {link(f'{table.share.mean():.3g}', 'lost', table)}."
