"""Items of the report on a search: what was chosen, what that bought, and what it cost."""

import json
import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from benchmark.analysis import search
from benchmark.analysis.frames import Floats
from benchmark.analysis.intervals import Estimate, combined, mean_over_scenarios
from benchmark.drawing.maps import gallery
from benchmark.drawing.style import WIDTH, figure_of
from benchmark.experiments import Experiment, Learner
from benchmark.experiments.search import Choice, Space
from benchmark.studies.comparison.figures import style_of
from benchmark.studies.item import COLUMNS, Frames, drawing, item, labelled_columns, no_rows
from envs import compile_scenario

Row = dict[str, object]

_item: Final = partial(item, meanings=COLUMNS["search"])
_columns: Final = partial(labelled_columns, COLUMNS["search_labels"])
_AXES: Final = {"area": "mean area under the curve of success", "earliness": "mean earliness"}
_FEW: Final = 5  # scenarios that a figure shows each
_IN_A_ROW: Final = 3  # panels
_PANELS: Final = {search.ALL: "all scenarios"}  # what they are called, if not by their scenario


@_item(
    "chosen",
    "the chosen settings of each learner, and what it reaches with them on fresh runs",
    _columns("learner trial settings edges default chosen gain per_scenario sensitivity found")
    | {"default": "trial 0", "chosen": "chosen settings"},
    best="chosen",
)
def chosen(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates means over scenarios on fresh runs. `found` is the mean of the best trial's first runs."""
    for outcome in search.outcomes(experiment, runs):
        learner, fresh, trial = outcome.learner, outcome.fresh, outcome.ranked[0]
        best, default = search.everywhere(fresh, trial), search.everywhere(fresh, 0)
        pairs = zip(search.best_apart(outcome.searched), experiment.scenarios, strict=True)
        apart = [fresh[pair] for pair in pairs]
        settings = _settings(experiment, learner, trial)
        yield _names(learner) | {
            "trial": trial,
            "settings": _text(settings),
            "edges": ", ".join(key.split(".")[-1] for key in at_edges(learner.declared.search, settings)),
            "default": mean_over_scenarios(default),
            "chosen": mean_over_scenarios(best),
            "gain": gain(best, default),
            "per_scenario": mean_over_scenarios(apart),
            "sensitivity": gain(apart, best),
            "found": float(max(measures.mean() for measures in outcome.searched)),
        }


@_item(
    "picks", "how often the best of b trials beats that of a reference, and what it reaches", where=no_rows
)
def picks(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates what is `picked` of the trials, with the digits that trials.csv has."""
    tried = pd.DataFrame(_tried(runs, experiment))
    tried = tried.map(lambda value: float(f"{value:.6g}") if isinstance(value, float) else value)
    families = {learner.variant: learner.family for learner in experiment.learners.values()}
    yield from search.picked(tried, search.references(tried, families))


@picks.figure(
    "How often the best of b trials beats the best of b of the reference: by means over all scenarios, and, "
    "if they are few, in each."
)
def _(table: pd.DataFrame, experiment: Experiment) -> Figure | None:
    compared = [each for each in experiment.learners.values() if _of(table, each)["beats"].notna().any()]
    learners = [learner for learner in compared if learner.family == "deep"] or compared
    if not learners:
        return None
    panels = [search.ALL, *(experiment.scenarios if len(experiment.scenarios) <= _FEW else ())]
    n_rows, n = math.ceil(len(panels) / _IN_A_ROW), table["trials"].max()
    ticks = [b for b in table["trials"].unique() if 1.4 * b <= n or b == n]  # apart from each other
    height = 2.1 * n_rows + 0.45 * math.ceil(len(learners) / 2) + 0.5
    with figure_of(n_rows, min(len(panels), _IN_A_ROW), (WIDTH, height)) as (figure, axes):
        for axis in axes.flat[len(panels) :]:
            axis.set_axis_off()
        for axis, scenario in zip(axes.flat, panels, strict=False):
            axis.axhline(0.5, color="0.35", lw=0.8, ls=":")
            for learner in learners:
                rows = _of(table[table["scenario"] == scenario], learner)
                axis.plot(rows["trials"], rows["beats"], ms=5, lw=1.4, **style_of(learner.name, experiment))
            axis.set(xscale="log", ylim=(-0.03, 1.03), title=_PANELS.get(scenario, scenario))
            axis.set_xticks(ticks, ticks)
            axis.xaxis.set_minor_locator(NullLocator())
        figure.supxlabel("trials of either learner, b", fontsize="medium")
        figure.supylabel("probability of a better pick", fontsize="medium")
        names = [(learner, _of(table, learner)["reference"].iloc[0]) for learner in learners]
        titles = [f"{learner.title}\nagainst {experiment.learners[name].title}" for learner, name in names]
        figure.legend(axes[0, 0].lines[1:], titles, loc="outside upper center", ncols=2, frameon=False)
    return figure


@_item(
    "cost",
    "cost of the search: of all trials, and of fresh runs of those that were ranked",
    _columns("learner trials runs steps cpu_time_s cpu_ms"),
    is_measured=True,
    best="-cpu_time_s",
)
def cost(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the effort of each search; `cpu_ms` is the mean time that a run of the search trains."""
    for name, result in search.chosen_by(experiment, runs).items():
        effort = result.model_dump(include={"trials", "runs", "steps", "cpu_time_s"})
        cpu_ms = 1000 * result.cpu_time_s / result.runs
        yield _names(experiment.learners[name]) | effort | {"cpu_ms": cpu_ms}


@item(
    "trials",
    "every trial of every learner: settings, and means by scenario",
    where=no_rows,
    meanings={**COLUMNS["search"], "*": "mean area, or earliness, in this scenario, on the first runs"},
)
def trials(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the means over the first runs of each trial, and over fresh runs where there are any."""
    yield from _tried(runs, experiment)


def _tried(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    names, measure = [*experiment.scenarios], search.measure_of(experiment)
    for outcome in search.outcomes(experiment, runs):
        for trial, measures in enumerate(outcome.searched):
            cells = [outcome.fresh.get((trial, name), np.array([math.nan])) for name in names]
            yield _names(outcome.learner) | {
                "trial": trial,
                "settings": _text(_settings(experiment, outcome.learner, trial)),
                measure: float(measures.mean()),
                f"fresh_{measure}": float(np.mean([cell.mean() for cell in cells])),
                **dict(zip(names, measures.mean(axis=1).tolist(), strict=True)),
            }


@trials.figure("What each trial of the search reached, and what the chosen settings reach in fresh runs.")
def _(tables: Frames, experiment: Experiment) -> Figure:
    learners, measure = [*experiment.learners.values()], search.measure_of(experiment)
    with figure_of(1, 1, (WIDTH, 0.3 * len(learners) + 1.2)) as (figure, axes):
        axis = axes[0, 0]
        for y, learner in enumerate(learners):
            reached, style = _of(tables["trials"], learner)[measure], style_of(learner.name, experiment)
            row = _of(tables["chosen"], learner).iloc[0]
            axis.plot(reached[1:], [y] * (len(reached) - 1), "|", ms=9, mew=0.9, color="0.55")
            axis.plot(row["default"], y, "x", ms=7, mew=2, color="black")
            ends = [row["chosen_low"], row["chosen_high"]]
            axis.plot(ends, [y, y], lw=3, alpha=0.5, color=style["color"])
            axis.plot(row["chosen"], y, style["marker"], ms=7, color=style["color"], mec="white", mew=0.4)
        axis.set_yticks(range(len(learners)), [learner.title for learner in learners])
        axis.set(ylim=(len(learners) - 0.5, -0.5), xlim=(-0.02, 1.0), xlabel=_AXES[measure])
        axis.grid(axis="y", lw=0.4, color="0.85")
        axis.tick_params(axis="y", length=0)
        handles = [
            Line2D([], [], ls="", marker="|", ms=9, color="0.55", label="a trial"),
            Line2D([], [], ls="", marker="x", mew=2, color="black", label="trial 0, as declared"),
            Line2D([], [], lw=3, marker="o", color="0.4", label="chosen settings, 95 % interval"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False)
    return figure


@_item(
    "around",
    "one setting at a time around the chosen ones",
    _columns("learner setting value n area earliness difference"),
)
def around(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the chosen settings, and the same with one setting at another value, on runs of their own."""
    of_stage, measure = runs[runs["stage"] == search.AROUND], search.measure_of(experiment)
    if of_stage.empty:
        return
    for learner in experiment.learners.values():
        groups = of_stage[of_stage["learner"] == learner.name].groupby(["setting", "value"], sort=False)
        found = {key: np.split(rows[measure].to_numpy(), len(experiment.scenarios)) for key, rows in groups}
        for (setting, value), parts in found.items():
            yield _names(learner) | {
                "setting": setting or "none",
                "value": value or "as chosen",
                "n": sum(map(len, parts)),
                measure: mean_over_scenarios(parts),
                "difference": gain(parts, found["", ""]),
            }


@item(
    "spaces",
    "the declared range of every setting, and why",
    _columns("variant setting default range why") | {"default": "trial 0"},
    meanings={**COLUMNS["search"], "default": "value in trial 0, as declared"},
)
def spaces(experiment: Experiment) -> Iterator[Row]:
    """Tabulates what was declared before the search."""
    populations = reversed(experiment.populations)
    defaults = {population.learner.variant: population.first.settings for population in populations}
    for name, declared in experiment.declared.algorithms.items():
        for key, axis in declared.search.items():
            if isinstance(axis, Choice):
                texts = " or ".join(map(json.dumps, axis.values))
            else:
                texts = f"{axis.low:g} to {axis.high:g}"
                texts += ", logarithmic" * (axis.scale == "log") + ", whole" * axis.whole
            default = json.dumps(_at(defaults[name], key))
            yield {"variant": name, "setting": key, "default": default, "range": texts, "why": axis.why}


@drawing("scenes", "the scenarios of the search", "The scenarios of the search.")
def scenes(experiment: Experiment) -> Figure:
    """Draws where settings are searched for."""
    return gallery([compile_scenario(scenario) for scenario in experiment.scenarios.values()])


def _names(learner: Learner) -> Row:
    return {"variant": learner.variant, "observation": learner.observation}


def _of(frame: pd.DataFrame, learner: Learner) -> pd.DataFrame:
    is_own = frame["variant"] == learner.variant
    return frame[is_own & (frame["observation"] == learner.observation)]


def _at(settings: object, key: str) -> object:
    """Returns the value of a dotted key; None if it is not set."""
    for name in key.split("."):
        settings = settings.get(name) if isinstance(settings, dict) else getattr(settings, name, None)
    return settings


def _settings(experiment: Experiment, learner: Learner, trial: int) -> Row:
    """Returns the searched settings of a trial, by dotted key."""
    condition, scenario = [*experiment.conditions][trial], next(iter(experiment.scenarios))
    settings = experiment.population(condition, scenario, learner.name).first.settings
    return {key: _at(settings, key) for key in learner.declared.search}


def _text(settings: Row) -> str:
    """Returns the searched settings of a trial as readers see them, without those that are not set."""
    texts = {key.split(".")[-1]: json.dumps(value) for key, value in settings.items() if value is not None}
    return ", ".join(f"{key} {text}" for key, text in texts.items()) or "default"


def at_edges(space: Space, settings: Row) -> list[str]:
    """Lists the settings with a number at an edge of what was searched."""
    numbers = {key: value for key, value in settings.items() if isinstance(value, int | float)}
    return [key for key, value in numbers.items() if not space[key].edges[0] < value < space[key].edges[1]]


def gain(x: Sequence[Floats], y: Sequence[Floats]) -> Estimate:
    """Returns the difference of two means over scenarios, x minus y, as of independent runs."""
    # Scenarios in which both sides are the same runs change neither the difference nor its interval.
    apart = [pair for pair in zip(x, y, strict=True) if pair[0] is not pair[1]]
    sides, weights = [side for pair in apart for side in pair], [1 / len(x), -1 / len(x)] * len(apart)
    means = [float(side.mean()) for side in sides]
    if not apart:
        return Estimate(0.0, 0.0, 0.0)
    return Estimate(float(np.dot(weights, means)), *combined(weights, means, [*map(len, sides)]))
