"""An item of a comparison, with a table and a figure: runs without any success."""

from collections.abc import Iterator

import pandas as pd
from matplotlib.figure import Figure

from benchmark.analysis.frames import by_population
from benchmark.analysis.intervals import proportion
from benchmark.drawing.style import figure_of
from benchmark.studies import item
from benchmark.studies.comparison.analysis import ComparisonAnalysis


@item("lost", "runs without any success")
def lost(analysis: ComparisonAnalysis) -> Iterator[dict[str, object]]:
    for keys, rows in by_population(analysis.data.runs):
        yield {**keys, "share": proportion((rows["success"] == 0).to_numpy())}


@lost.figure("Share of runs without any success.")
def draw_lost(_: ComparisonAnalysis, table: pd.DataFrame) -> Figure:
    with figure_of(1, 1, (4.0, 2.0)) as (figure, axes):
        axes[0, 0].bar(table.index, table["share"])
    return figure
