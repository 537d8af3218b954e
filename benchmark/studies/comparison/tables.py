"""The tables of a comparison, and the sentence that says what it found."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from agents.dynamic_programming import evaluate
from benchmark.analysis.frames import ENDPOINTS as RESULTS
from benchmark.analysis.frames import Floats, by_step
from benchmark.analysis.intervals import Estimate, proportion
from benchmark.analysis.records import unbounded_scores
from benchmark.drawing.tables import write_csv
from benchmark.experiments import DEFAULT_CONDITION
from benchmark.folder import SCORES, Folder
from benchmark.studies import explorer
from benchmark.studies.comparison.analysis import ENDPOINTS, NAMES, ComparisonAnalysis, Row, by_learner
from benchmark.studies.comparison.contrasts import VERDICTS
from benchmark.studies.item import COLUMNS, Item, expanded, no_rows, writing
from envs import ACTIONS, compile_scenario
from envs.model import PING

WORDS: Final = {verdict: COLUMNS["comparison_labels"].get(verdict, verdict) for verdict in VERDICTS}
AGGREGATES: Final = ("iqm", "median", "mean", "optimality_gap")
_DRAWS: Final = 1_000  # of a bootstrap


def _item(name: str, description: str, shown: str = "", **more: Any) -> Item:
    """Makes an item of the analysis's attribute of its name; `shown` has the columns for readers."""
    labels = COLUMNS["comparison_labels"] if shown else {}
    found = Item(name, description, shown, labels=labels, **more)
    return found(lambda analysis: getattr(analysis, name))


contrasts = _item(
    "contrasts",
    "the declared contrasts, x against y: differences, p-values and verdicts",
    "scenario x y success_verdict score_verdict success_except n success_difference "
    "success_p_different success_p_equivalent score_difference",
)


@_item(
    "summary",
    "each scenario and learner after training",
    "scenario learner policy n success greedy_success score unbounded_score steps wrong_pings "
    "training_wrong_pings every_cell_success",
    best="success",
)
def summary(analysis: ComparisonAnalysis) -> list[Row]:
    """Returns the cells."""
    return [*analysis.cells.values()]


aggregate = _item(
    "aggregate",
    "every learner over all scenarios, after training",
    "learner policy runs success score every_cell_success",
    best="success",
)


@_item(
    "rliable",
    "the usual measures of deep RL: aggregates of success and of the clipped score over runs and scenarios",
    f"endpoint learner n {' '.join(AGGREGATES)} p_improvement",
    best="iqm",
)
def rliable(analysis: ComparisonAnalysis) -> Iterator[Row]:
    """Computes aggregates, and drawn learners' probability of improvement over the first baseline."""
    from rliable import metrics

    baseline, measures = (
        analysis.data.declared.baseline,
        [getattr(metrics, f"aggregate_{key}") for key in AGGREGATES],
    )
    for endpoint in ENDPOINTS:
        matrices = {  # (runs, scenarios)
            name: np.stack([own[endpoint].to_numpy() for own in scenarios], axis=1)
            for _, name, scenarios in analysis.pooled
        }
        for names, name, _ in analysis.pooled:
            values = matrices[name]
            row: Row = {"endpoint": endpoint, **names, "n": len(values)}
            points, (low, high) = _estimated(values, lambda x: np.array([measure(x) for measure in measures]))
            row |= {key: Estimate(points[i], low[i], high[i]) for i, key in enumerate(AGGREGATES)}
            row["giving_up"] = giving_up(analysis) if endpoint == "score" else math.nan
            if name in analysis.drawn and baseline and name != baseline[0]:
                (point,), ((low,), (high,)) = _estimated((values, matrices[baseline[0]]), _improvement)
                row["p_improvement"] = Estimate(point, low, high)
            yield row


def giving_up(analysis: ComparisonAnalysis) -> float:
    """Returns the clipped score of an agent that does nothing but PING, mean over scenarios."""
    horizon, scores = analysis.experiment.declared.horizon, []
    for model in map(compile_scenario, analysis.experiment.scenarios.values()):
        policy = np.eye(len(ACTIONS))[np.full(model.n_observations, PING)]
        found = evaluate(model, policy, horizon).grid_return
        scores.append(np.clip(unbounded_scores(np.asarray(found), model, horizon, "start"), 0.0, 1.0))
    return float(np.mean(scores))


def _improvement(x: Floats, y: Floats) -> float:
    """Returns what `rliable.metrics.probability_of_improvement` does, a hundred times as fast."""
    return float(np.mean(x[:, None] > y) + np.mean(x[:, None] == y) / 2)


def _estimated(scores: Any, measure: Callable[..., Any]) -> tuple[Floats, Floats]:
    """Returns what a measure is of scores, (K,), and its 95 % interval, (2, K).

    The interval has percentiles of a bootstrap that draws runs anew within each scenario (Agarwal et al.
    2021). Since rliable draws from NumPy's global generator, this is seeded and restored.
    """
    from rliable.library import get_interval_estimates

    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    try:
        points, intervals = get_interval_estimates({"": scores}, measure, reps=_DRAWS)
    finally:
        np.random.set_state(state)  # noqa: NPY002
    return np.atleast_1d(points[""]), intervals[""]


@_item("curves", "success and score over training, against environment steps", where=no_rows)
def curves(analysis: ComparisonAnalysis) -> pd.DataFrame:
    """Computes means over runs at every evaluation."""
    frames = []
    for names, _, rows in by_learner(analysis.curves):
        means = {name: proportion(by_step(rows, name)) for name in ENDPOINTS}
        frames.append(pd.DataFrame(expanded({**names, "step": rows["step"].unique(), **means})))
    return pd.concat(frames, ignore_index=True)


@_item(
    "cost",
    "cost of a run, measured: medians over all runs of CPU seconds, updates, parameters and peak memory",
    "learner cpu_time_s updates parameters peak_memory_mb",
    is_measured=True,
    best="-cpu_time_s",
)
def cost(analysis: ComparisonAnalysis) -> Iterator[Row]:
    """Computes medians over all scenarios."""
    for names, _, rows in by_learner(analysis.runs, NAMES[1:]):
        yield {
            **names,
            "runs": len(rows),
            "cpu_time_s": rows["cpu_time_s"].median(),
            "updates": rows["updates"].median(),
            "parameters": rows["parameters"].iloc[0],
            "peak_memory_mb": rows["peak_memory_mb"].median(),
        }


@writing("scores", "every run at the end of training, compressed", SCORES)
def scores(analysis: ComparisonAnalysis, path: Path) -> None:
    """Writes `runs`; `every_cell_` marks episodes that start in any cell, `diverged_at` may be infinite."""
    runs = analysis.runs
    names = [*NAMES, "policy", "seed", *RESULTS, *(f"every_cell_{name}" for name in RESULTS)]
    names += ["greedy_success", "training_wrong_pings", "diverged_at"]
    write_csv(runs[[name for name in names if name in runs]], path)


@explorer.explorer_item
def agents(analysis: ComparisonAnalysis, path: Path) -> None:
    """Writes what all learners but reference implementations have learned."""
    drawn = [
        analysis.experiment.population(DEFAULT_CONDITION, scenario, name)
        for name, scenario in analysis.cells
        if name in analysis.learners
    ]
    explorer.write([analysis.data.records(population) for population in drawn], path)


def headline(folder: Folder) -> str | None:
    """Returns how often each verdict on success came up."""
    if "contrasts.csv" not in folder:
        return None
    verdicts = folder.frame("contrasts")["success_verdict"]
    counts = verdicts.map(WORDS).value_counts()
    parts = [f"{text} ({n} of {len(verdicts)})" for text, n in counts.items()]
    return f"Verdicts on success: {'; '.join(parts)}."
