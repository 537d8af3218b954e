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

from benchmark.analysis.frames import Floats
from benchmark.analysis.intervals import Estimate, combined, interval, mean_over_scenarios, resample
from benchmark.analysis.search import AROUND, best_apart, chosen_by, everywhere, measure_of, outcomes
from benchmark.drawing.maps import gallery
from benchmark.drawing.style import WIDTH, figure_of, name_lines
from benchmark.drawing.tables import decimals_of
from benchmark.experiments import Experiment, Learner
from benchmark.experiments.search import Choice, Space
from benchmark.reports.comparison.figures import style_of
from benchmark.reports.item import Frames, drawing, entry, item, labelled_columns, no_rows
from envs import compile_scenario

Row = dict[str, object]

_MEANINGS: Final = {
    "area": "mean area under the curve of success, over scenarios and runs",
    "chosen": "mean area, or earliness, of the chosen settings, on fresh runs",
    "cpu_ms": "CPU milliseconds of training per run of the search",
    "cpu_time_s": "CPU seconds of training, sum over the runs of the search",
    "default": "mean area, or earliness, of trial 0, the settings as declared, on fresh runs",
    "difference": "area, or earliness, minus that of the chosen settings",
    "earliness": "mean share of the logarithm of the budget that is saved, over scenarios and runs: of a run "
    "that has learned, 1 - log(steps / evaluation_every) / log(budget / evaluation_every), else 0",
    "edges": "settings whose chosen value lies outside the inner eight tenths of its range, on its scale, or "
    "is the smallest or largest of three or more numbers",
    "expected": "expected area, or earliness, of the best of b trials",
    "found": "mean area, or earliness, of the best trial on its first runs",
    "fresh_area": "`area` on fresh runs; empty if the trial was not run again",
    "fresh_earliness": "`earliness` on fresh runs; empty if the trial was not run again",
    "gain": "`chosen` minus `default`",
    "per_scenario": "mean area, or earliness, if the best trial could be chosen in each scenario",
    "range": "declared range",
    "runs": "runs of the search: of all trials, and fresh ones of finalists",
    "sensitivity": "`per_scenario` minus `chosen`",
    "setting": "setting, by dotted key",
    "settings": "values of the searched settings, as JSON",
    "steps": "environment steps of all these runs; with [solved] their budgets, before which they may end",
    "trial": "number of the trial; 0 has the settings as declared",
    "trials": "number of trials, b, without trial 0",
    "value": "value of that setting",
    "why": "the reason for the range",
}
_LABELS: Final = {
    "cpu_ms": "CPU ms per run",
    "cpu_time_s": "CPU seconds",
    "difference": "difference from the chosen",
    "edges": "at the edge of the range",
    "found": "mean on the first runs",
    "n": "runs",
    "per_scenario": "the best per scenario",
    "sensitivity": "gain per scenario",
    "steps": "environment steps",
}
_item: Final = partial(item, meanings=_MEANINGS)
_columns: Final = partial(labelled_columns, _LABELS)
_AXES: Final = {"area": "mean area under the curve of success", "earliness": "mean earliness"}
_TICKS: Final = (1, 2, 4, 8, 16, 32)  # of trials
_SOME: Final = (1, 4, 16)  # numbers of trials that readers see
_CLOSE: Final = 0.05  # measures that differ by less are close to each other


@_item(
    "chosen",
    "the chosen settings of each learner, and what it reaches with them on fresh runs",
    _columns("learner trial settings edges default chosen gain per_scenario sensitivity found")
    | {"default": "trial 0", "chosen": "chosen settings"},
    best="chosen",
)
def chosen(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates means over scenarios on fresh runs. `found` is the mean of the best trial's first runs."""
    for outcome in outcomes(experiment, runs):
        learner, fresh, trial = outcome.learner, outcome.fresh, outcome.ranked[0]
        best, default = everywhere(fresh, trial), everywhere(fresh, 0)
        apart = [fresh[pair] for pair in zip(best_apart(outcome.searched), experiment.scenarios, strict=True)]
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


@_item("best_of", "the expected result of the best of b trials")
def best_of(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates `expected_best` of the trials without trial 0, with intervals over trials.

    Beyond a third of the trials there are none: the bootstrap of a maximum has too narrow ones there.
    """
    budget = experiment.populations[0].first.settings.budget
    for outcome in outcomes(experiment, runs):
        tried = outcome.searched[1:]
        samples = expected_best(tried, resample(len(tried), outcome.learner.name))
        low, high = interval(samples)
        for i, value in enumerate(samples[0]):
            ends = (min(low[i], value), max(high[i], value)) if i < len(tried) // 3 else (math.nan, math.nan)
            effort = {"trials": i + 1, "steps": (i + 1) * budget * tried[0].size}
            yield _names(outcome.learner) | effort | {"expected": Estimate(value, *ends)}


@best_of.figure(
    "What tuning buys: the expected result of the best of b trials, for each algorithm with its best form of "
    "observation."
)
def _(tables: Frames, experiment: Experiment) -> Figure:
    frame, chosen, best = tables["best_of"], tables["chosen"], dict[str, Learner]()
    for _, row in chosen.sort_values("chosen", kind="stable").iterrows():
        best[row["algorithm"]] = experiment.learners[f"{row['algorithm']}, {row['observation']}"]
    with figure_of(1, 1, (WIDTH, 4.4)) as (figure, axes):
        axis, ends = axes[0, 0], {}
        for i, learner in enumerate(best.values()):
            rows, style = _of(frame, learner), style_of(learner.name, experiment)
            axis.plot(rows["trials"], rows["expected"], markevery=(i, 12), ms=5, lw=1.4, **style)
            low, high = rows["expected_low"], rows["expected_high"]
            axis.fill_between(rows["trials"], low, high, color=style["color"], alpha=0.1, lw=0)
            by_default = _of(chosen, learner)["default"].iloc[0]
            axis.plot(0.8, by_default, "x", ms=6, mew=1.8, color=style["color"])
            ends[learner.title] = float(rows["expected"].iloc[-1]), style
        ticks = [tick for tick in _TICKS if tick <= frame["trials"].max()]
        axis.set(xscale="log", xlim=(0.7, frame["trials"].max()), ylim=(-0.02, 1.0))
        axis.set(xlabel="trials (cross: settings as declared)", ylabel=_AXES[measure_of(experiment)])
        axis.set_xticks(ticks, [str(tick) for tick in ticks])
        axis.xaxis.set_minor_locator(NullLocator())
        name_lines(axis, ends)
    return figure


@best_of.shown
def _(table: pd.DataFrame) -> pd.DataFrame:
    """Shows a row per learner: some numbers of trials, and how many come close to all of them."""
    n, digits, shown = int(table["trials"].max()), decimals_of(table, "expected"), []
    learners = [rows for _, rows in table.groupby("learner", sort=False)]
    for rows in sorted(learners, key=lambda rows: -rows["expected"].iloc[-1]):
        row = {"learner": rows["learner"].iloc[0]}
        for b in (*(b for b in _SOME if b < n), n):
            row[f"best of {b}"] = entry(rows.iloc[b - 1], "expected", "best_of", digits)
        is_close = rows["expected"] >= rows["expected"].iloc[-1] - _CLOSE
        needed = f"trials needed to come within {_CLOSE} of the best of {n}"
        shown.append(row | {needed: f"{rows.loc[is_close, 'trials'].iloc[0]}"})
    return pd.DataFrame(shown)


@_item(
    "cost",
    "cost of the search: of all trials, and of fresh runs of finalists",
    _columns("learner trials runs steps cpu_time_s cpu_ms"),
    is_measured=True,
    best="-cpu_time_s",
)
def cost(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the effort of each search; `cpu_ms` is the mean time that a run of the search trains."""
    for name, result in chosen_by(experiment, runs).items():
        effort = result.model_dump(include={"trials", "runs", "steps", "cpu_time_s"})
        cpu_ms = 1000 * result.cpu_time_s / result.runs
        yield _names(experiment.learners[name]) | effort | {"cpu_ms": cpu_ms}


@item(
    "trials",
    "every trial of every learner: settings, and means by scenario",
    where=no_rows,
    meanings=_MEANINGS | {"*": "mean area, or earliness, in the scenario of this name, on the first runs"},
)
def trials(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the means over the first runs of each trial, and over fresh runs where there are any."""
    names, measure = [*experiment.scenarios], measure_of(experiment)
    for outcome in outcomes(experiment, runs):
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
    learners, measure = [*experiment.learners.values()], measure_of(experiment)
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
    of_stage, measure = runs[runs["stage"] == AROUND], measure_of(experiment)
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
    _columns("algorithm setting default range why") | {"default": "trial 0"},
    meanings=_MEANINGS | {"default": "value in trial 0, as declared"},
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
            yield {"algorithm": name, "setting": key, "default": default, "range": texts, "why": axis.why}


@drawing("scenes", "the scenarios of the search", "The scenarios of the search.")
def scenes(experiment: Experiment) -> Figure:
    """Draws where settings are searched for."""
    return gallery([compile_scenario(scenario) for scenario in experiment.scenarios.values()])


def _names(learner: Learner) -> Row:
    return {"algorithm": learner.variant, "observation": learner.observation}


def _of(frame: pd.DataFrame, learner: Learner) -> pd.DataFrame:
    is_own = frame["algorithm"] == learner.variant
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


def expected_best(measures: Floats, weights: Floats) -> Floats:
    """Returns the expected mean of the best of b of n trials, for b from 1 to n: (..., n).

    Trials are drawn without replacement. The best of them is that with the largest mean over half of the runs
    of each scenario, and what counts is its mean over the other half, which removes the optimism of the
    maximum; both ways are averaged.

    Args:
      measures: (n, I, N) of all trials, N at least 2.
      weights: (..., n) how often each trial is among those that are drawn from; they sum to n.

    >>> measures = np.array([0.2, 0.5, 0.8])[:, None, None].repeat(2, axis=2)
    >>> expected_best(measures, np.ones(3)).round(3).tolist()  # of 2: 0.5 with probability 1/3, else 0.8
    [0.5, 0.7, 0.8]
    """
    n, half = len(measures), measures.shape[2] // 2
    parts = [measures[:, :, part].mean(axis=(1, 2)) for part in (slice(half), slice(half, None))]
    # The probability that all of b trials are among the lowest c, for c from 0 and b from 1: (n + 1, n).
    drawn = np.arange(n)
    all_among = np.cumprod(np.maximum(np.arange(n + 1)[:, None] - drawn, 0) / (n - drawn), axis=1)
    halves = []
    for by, counted in (parts, parts[::-1]):
        order = np.argsort(by, kind="stable")  # the worst first
        up_to = weights[..., order].cumsum(axis=-1).astype(int)
        is_best = np.diff(all_among[up_to], axis=-2, prepend=0.0)  # (..., trials, b)
        halves.append((is_best * counted[order][:, None]).sum(axis=-2))
    return np.asarray(np.mean(halves, axis=0))
