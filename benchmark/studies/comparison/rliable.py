"""Items of a comparison in the measures that are usual in deep RL (Agarwal et al. 2021), computed by rliable.

All are of the clipped score, with percentiles of a bootstrap that draws runs anew within each scenario. Like
all that is not declared as a contrast, they are exploratory.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from benchmark.analysis.intervals import Estimate
from benchmark.drawing.style import WIDTH, figure_of
from benchmark.experiments import Experiment
from benchmark.studies.comparison import figures
from benchmark.studies.comparison.cells import Row, populations
from benchmark.studies.comparison.columns import CELL, MEANINGS, columns
from benchmark.studies.comparison.declared import drawn_learners, reporting_of
from benchmark.studies.item import COLUMNS, drawing, item

Scores = NDArray[np.float64]  # (runs, scenarios)
_DRAWS: Final = 1_000  # of a bootstrap
_SEED: Final = 0
_THRESHOLDS: Final = np.linspace(0.0, 1.0, 51)
_AGGREGATES: Final = ("iqm", "median", "mean", "optimality_gap")
_MEASURES: Final = {
    "iqm": "interquartile\nmean",
    "median": "median",
    "mean": "mean",
    "optimality_gap": "optimality\ngap",
    "p_improvement": "probability of\nimprovement",
}


@contextmanager
def _seeded() -> Iterator[None]:
    """Seeds NumPy's global generator, from which rliable draws, and restores it."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(_SEED)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002


def _estimated(scores: Any, measure: Callable[..., Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Returns what a measure is of scores, (K,), and its 95 % interval, (2, K)."""
    from rliable.library import get_interval_estimates

    with _seeded():
        points, intervals = get_interval_estimates({"": scores}, measure, reps=_DRAWS)
    return np.atleast_1d(points[""]), intervals[""]


def _improvement(x: Scores, y: Scores) -> float:
    """Returns what `rliable.metrics.probability_of_improvement` does, a hundred times as fast."""
    return float(np.mean(x[:, None] > y) + np.mean(x[:, None] == y) / 2)


def _scores_of(runs: pd.DataFrame, experiment: Experiment) -> Iterator[tuple[Row, str, Scores]]:
    """Yields each learner's scores, if scenarios are pooled and it has as many runs in each."""
    if reporting_of(experiment).pool != "scenarios":
        return
    for names, learner, rows in populations(runs, experiment, "scenario"):
        scores = [here["score"].to_numpy() for _, here in rows.groupby("scenario", sort=False)]
        if len({*map(len, scores)}) == 1:
            yield names, learner.name, np.stack(scores, axis=1)


@item(
    "rliable",
    "the usual measures of deep RL: aggregates of the clipped score over runs and scenarios",
    columns(f"{CELL} n {' '.join(_MEASURES)}"),
    meanings={**MEANINGS, **COLUMNS["rliable"]},
    best="iqm",
)
def rliable(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Computes aggregates, and of drawn learners the probability of improvement over the first baseline."""
    from rliable import metrics

    found = [*_scores_of(runs, experiment)]
    measures = [getattr(metrics, f"aggregate_{key}") for key in _AGGREGATES]
    baseline, drawn = next(iter(reporting_of(experiment).baseline), ""), drawn_learners(experiment)
    of_baseline = {name: scores for _, name, scores in found if name == baseline}
    for names, name, scores in found:
        row: Row = {**names, "n": len(scores)}
        points, (low, high) = _estimated(scores, lambda x: np.array([measure(x) for measure in measures]))
        row |= {key: Estimate(points[i], low[i], high[i]) for i, key in enumerate(_AGGREGATES)}
        if name in drawn and name != baseline and of_baseline:
            pair = (scores, of_baseline[baseline])
            (point,), ((low,), (high,)) = _estimated(pair, _improvement)
            row |= {"p_improvement": Estimate(point, low, high), "over": baseline}
        yield row


@rliable.figure(
    "Aggregates of the clipped score and, if there is a baseline, the probability that a run scores higher "
    "than one of the first baseline; bars: 95 % intervals of a bootstrap within scenarios."
)
def _(table: pd.DataFrame, experiment: Experiment) -> Figure | None:
    rows = figures.labelled(table).sort_values("iqm", kind="stable")
    rows = rows[rows["learner"].isin(drawn_learners(experiment))]
    measures = [key for key in _MEASURES if key in rows]
    if "condition" in rows or rows.empty:
        return None
    with figure_of(1, len(measures), (WIDTH, 0.3 * len(rows) + 1.2)) as (figure, axes):
        for axis, key in zip(axes.flat, measures, strict=True):
            for y, (_, row) in enumerate(rows.iterrows()):
                style = figures.style_of(row["learner"], experiment)
                axis.plot([row[f"{key}_low"], row[f"{key}_high"]], [y, y], lw=3, color=style["color"])
                axis.plot(row[key], y, ms=5, **{**style, "ls": ""})
            axis.set(title=_MEASURES[key], ylim=(-0.6, len(rows) - 0.4))
            axis.set_yticks(range(len(rows)), [])
            axis.xaxis.set_major_locator(MaxNLocator(2))
            axis.margins(x=0.15)
            axis.grid(lw=0.4, color="0.85")
        axes[0, 0].set_yticklabels([fill(experiment.learners[name].title, 30) for name in rows["learner"]])
    return figure


@drawing(
    "profiles",
    "performance profiles: the share of runs with a higher clipped score",
    "Performance profiles: the share of runs whose clipped score is above a threshold; shade: 95 % interval.",
)
def profiles(runs: pd.DataFrame, experiment: Experiment) -> Figure | None:
    """Draws the profiles of the learners that the outcome is about."""
    from rliable.library import create_performance_profile

    drawn = drawn_learners(experiment)
    every = _scores_of(runs, experiment)
    scores = {name: own for names, name, own in every if name in drawn and "condition" not in names}
    if not scores:
        return None
    with figure_of(1, 1, (WIDTH, 3.6)) as (figure, axes):
        axis = axes[0, 0]
        for name, found in scores.items():
            style = figures.style_of(name, experiment)
            with _seeded():
                points, intervals = create_performance_profile({"": found}, _THRESHOLDS, reps=_DRAWS)
            title = fill(experiment.learners[name].title, 30, break_on_hyphens=False)
            axis.plot(_THRESHOLDS, points[""], lw=1.3, ms=4, markevery=10, label=title, **style)
            axis.fill_between(_THRESHOLDS, *intervals[""], color=style["color"], alpha=0.12, lw=0)
        axis.set(xlim=(0, 1), ylim=(-0.03, 1.03), xlabel="clipped score τ", ylabel="share of runs above τ")
        figure.legend(loc="outside lower center", ncols=3, fontsize="small")
    return figure
