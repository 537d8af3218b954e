"""The figures of a search."""

import math
from collections.abc import Sequence
from typing import Final

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from benchmark.analysis.intervals import mean_over_scenarios
from benchmark.drawing.maps import gallery
from benchmark.drawing.style import WIDTH, figure_of, name_rows
from benchmark.experiments import Learner
from benchmark.studies.data import style_of
from benchmark.studies.item import drawing
from benchmark.studies.search import tables
from benchmark.studies.search.analysis import ALL, SearchAnalysis
from envs import compile_scenario

_AXES: Final = {"area": "mean area under the curve of success", "earliness": "mean earliness"}
_MAX_PANELS: Final = 5  # scenarios that have a panel each
_PANELS_IN_A_ROW: Final = 3


@tables.picks.figure(
    "Probability that the best of b trials beats the best of b trials of the reference, by means over all "
    "scenarios and, if there are few, in each. Of a learner's forms of input with the same reference, only "
    "the one with the best trial is shown."
)
def picks(analysis: SearchAnalysis, table: pd.DataFrame) -> Figure | None:
    """Draws a panel for all scenarios, and perhaps one for each, with a line per learner."""
    experiment = analysis.data.experiment
    compared = [each for each in experiment.learners.values() if _of(table, each)["beats"].notna().any()]
    learners = _best_forms(table, [each for each in compared if each.family == "deep"] or compared)
    if not learners:
        return None
    panels = [ALL, *(experiment.scenarios if len(experiment.scenarios) <= _MAX_PANELS else ())]
    n_rows, n = math.ceil(len(panels) / _PANELS_IN_A_ROW), table["trials"].max()
    ticks = [b for b in table["trials"].unique() if 1.4 * b <= n or b == n]  # at a distance from each other
    height = 2.1 * n_rows + 0.22 * len(learners) + 0.5
    with figure_of(n_rows, min(len(panels), _PANELS_IN_A_ROW), (WIDTH, height)) as (figure, axes):
        for axis, scenario in zip(axes.flat, panels, strict=False):
            axis.axhline(0.5, color="0.35", lw=0.8, ls=":")
            for learner in learners:
                rows = _of(table[table["scenario"] == scenario], learner)
                axis.plot(rows["trials"], rows["beats"], ms=5, lw=1.4, **style_of(learner.name, experiment))
            title = "all scenarios" if scenario == ALL else scenario
            axis.set(xscale="log", ylim=(-0.03, 1.03), title=title)
            axis.set_xticks(ticks, ticks)
            axis.xaxis.set_minor_locator(NullLocator())
        figure.supxlabel("trials of either learner, b", fontsize="medium")
        figure.supylabel("probability of a better pick", fontsize="medium")
        names = [(learner, _of(table, learner)["reference"].iloc[0]) for learner in learners]
        titles = [f"{learner.title} against {experiment.learners[name].title}" for learner, name in names]
        figure.legend(axes[0, 0].lines[1:], titles, loc="outside upper left", frameon=False)
    return figure


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


@drawing("scenes", "the scenarios of the search", "The scenarios of the search.")
def scenes(analysis: SearchAnalysis, _: pd.DataFrame) -> Figure:
    """Draws where settings are searched for."""
    scenarios = analysis.data.experiment.scenarios.values()
    return gallery([compile_scenario(scenario) for scenario in scenarios])


def _best_forms(table: pd.DataFrame, learners: Sequence[Learner]) -> list[Learner]:
    """Returns, of those with the same variant and reference, the learner with the best trial."""
    last = {each.name: _of(table[table["scenario"] == ALL], each).iloc[-1] for each in learners}
    ranked = sorted(learners, key=lambda learner: last[learner.name]["expected"])
    best = {(each.variant, last[each.name]["reference"]): each.name for each in ranked}
    return [learner for learner in learners if learner.name in best.values()]


def _of(frame: pd.DataFrame, learner: Learner) -> pd.DataFrame:
    is_own = frame["variant"] == learner.variant
    return frame[is_own & (frame["observation"] == learner.observation)]
