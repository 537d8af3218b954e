"""An item of a comparison: a table, a figure and a sentence."""

from benchmark.drawing.style import figure_of
from benchmark.drawing.tables import link
from benchmark.reports.comparison.runs import proportion
from benchmark.reports.item import item


@item("lost", "share of runs that end as they began, without any success", {"scenario": "", "share": ""})
def lost(runs):
    for cell in runs:
        yield cell.row(share=proportion(cell.final("success") == 0))


@lost.figure("Share of runs without any success.")
def _(tables, context):
    with figure_of(1, 1, (4.0, 2.0)) as (figure, axes):
        axes[0, 0].bar(tables["lost"].index, tables["lost"]["share"])
    return figure


@lost.sentence
def _(table, folder):
    yield f"In {link(f'{table.share.max():g}', 'lost', table.loc[table.share.idxmax()])} of runs all was lost."
