"""The figure of a search."""

from typing import Final

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmark.analysis.intervals import mean_over_scenarios
from benchmark.drawing.style import WIDTH, figure_of, name_rows
from benchmark.experiments import Learner
from benchmark.studies.data import style_of
from benchmark.studies.search import tables
from benchmark.studies.search.analysis import SearchAnalysis

_AXES: Final = {"area": "mean area under the curve of success", "earliness": "mean earliness"}


@tables.trials.figure(
    "What each trial of the search reached, and what the chosen settings reach in fresh runs."
)
def trials(analysis: SearchAnalysis, table: pd.DataFrame) -> Figure:
    """Draws a row per learner."""
    with figure_of(1, 1, (WIDTH, 0.3 * len(analysis.outcomes) + 1.2)) as (figure, axes):
        axis = axes[0, 0]
        for y, outcome in enumerate(analysis.outcomes):
            reached = _of(table, outcome.learner)[analysis.measure]
            style = style_of(outcome.learner.name, analysis.data.experiment)
            axis.plot(reached[1:], [y] * (len(reached) - 1), "|", ms=9, mew=0.9, color="0.55")
            axis.plot(outcome.mean(0), y, "x", ms=7, mew=2, color="black")
            for trial in outcome.picks:
                value, *ends = mean_over_scenarios(outcome.again(trial))
                axis.plot(ends, [y, y], lw=3, alpha=0.5, color=style["color"])
                axis.plot(value, y, style["marker"], ms=7, color=style["color"], mec="white", mew=0.4)
        titles = [outcome.learner.title for outcome in analysis.outcomes]
        name_rows(axis, titles)
        axis.set(xlim=(-0.02, 1.0), xlabel=_AXES[analysis.measure])
        handles = [
            Line2D([], [], ls="", marker="|", ms=9, color="0.55", label="a trial"),
            Line2D([], [], ls="", marker="x", mew=2, color="black", label="trial 0, as declared"),
            Line2D([], [], lw=3, marker="o", color="0.4", label="chosen settings, 95 % interval"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False)
    return figure


def _of(frame: pd.DataFrame, learner: Learner) -> pd.DataFrame:
    is_own = frame["variant"] == learner.variant
    return frame[is_own & (frame["observation"] == learner.observation)]
