"""The tables of a comparison, and the sentence that says what it found."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from agents.dynamic_programming import evaluate
from benchmark.analysis.frames import ENDPOINTS as RESULTS
from benchmark.analysis.frames import KEYS, Floats, by_step, learned
from benchmark.analysis.intervals import Estimate, proportion
from benchmark.analysis.records import anchors, unbounded_scores
from benchmark.drawing.maps import in_words
from benchmark.drawing.tables import write_csv
from benchmark.folder import SCORES, Folder
from benchmark.studies import explorer
from benchmark.studies.comparison.analysis import ENDPOINTS, ComparisonAnalysis, Row, effort
from benchmark.studies.comparison.contrasts import VERDICTS
from benchmark.studies.item import COLUMNS, Item, expanded, no_rows, writing
from envs import ACTIONS, Model
from envs.model import PING
from envs.observations import compile_seen

ENOUGH: Final = 0.9  # a success by which a scenario counts as learned
FEW: Final = 4  # scenarios whose learners are listed, and drawn over training
OUTCOMES: Final = COLUMNS["comparison_outcomes"]  # what they mean, in the order of scenarios in a figure
WORDS: Final = {verdict: COLUMNS["comparison_labels"].get(verdict, verdict) for verdict in VERDICTS}
AGGREGATES: Final = ("iqm", "median", "mean", "optimality_gap")
_DRAWS: Final = 1_000  # of a bootstrap


def _item(name: str, description: str, shown: str = "", **more: Any) -> Item[ComparisonAnalysis]:
    """Makes an item of the analysis's attribute of its name; `shown` has the columns for readers."""
    labels = COLUMNS["comparison_labels"] if shown else {}
    found = Item[ComparisonAnalysis](name, description, shown, labels=labels, **more)
    return found(lambda analysis: getattr(analysis, name))


def _measured(frame: pd.DataFrame) -> pd.DataFrame:
    """Marks equivalences whose difference is significant."""
    is_shown = (frame["success_verdict"] == "equivalent") & (frame["success_p_different"] <= 0.05)
    texts = frame["success_margin"].map("within {:g}, but measurably ".format)
    texts += np.where(frame["success_difference"] > 0, "better", "worse")
    success, score = (frame[f"{endpoint}_verdict"].map(WORDS) for endpoint in ENDPOINTS)
    return frame.assign(success_verdict=np.where(is_shown, texts, success), score_verdict=score)


contrasts = _item(
    "contrasts",
    "the declared contrasts, x against y: differences, p-values and verdicts",
    "scenario condition x y success_verdict score_verdict success_except n success_difference "
    "success_p_different success_p_equivalent score_difference wrong_pings_difference",
    where=_measured,
)


same_input = replace(
    contrasts,
    name="same_input",
    description="exploratory: nets against tables and linear learners of the same input",
    compute=lambda analysis: analysis.same_input,
)


outcomes = _item(
    "outcomes",
    "whether deep RL earns its keep over the baselines",
    where=lambda frame: frame.assign(outcome=frame["outcome"].map(OUTCOMES)),
)


@_item(
    "summary",
    "each scenario and learner after training",
    "scenario condition learner policy n success greedy_success score unbounded_score steps wrong_pings "
    "training_wrong_pings every_cell_success",
    where=lambda frame: frame if frame["scenario"].nunique() <= FEW else no_rows(frame),
    best="success",
)
def summary(analysis: ComparisonAnalysis) -> list[Row]:
    """Returns the cells, without columns that name the same in all tables."""
    hidden = {*KEYS}.difference(analysis.names)
    return [{key: value for key, value in cell.items() if key not in hidden} for cell in analysis.cells]


aggregate = _item(
    "aggregate",
    "every learner over all scenarios, after training",
    "condition learner policy runs success score every_cell_success",
    best="success",
)


@_item(
    "rliable",
    "the usual measures of deep RL: aggregates of success and of the clipped score over runs and scenarios",
    f"endpoint condition learner n {' '.join(AGGREGATES)} p_improvement",
    best="iqm",
)
def rliable(analysis: ComparisonAnalysis) -> Iterator[Row]:
    """Computes aggregates, and drawn learners' probability of improvement over the first baseline."""
    from rliable import metrics

    plan, measures = analysis.plan, [getattr(metrics, f"aggregate_{key}") for key in AGGREGATES]
    level = {"score": giving_up(analysis)} if analysis.is_pooled else {}
    for endpoint in ENDPOINTS:
        matrices = analysis.matrices(endpoint)
        baselines = [each for each in matrices if each[1] in plan.baseline[:1]]
        for names, name, values in matrices:
            row: Row = {"endpoint": endpoint, **names, "n": len(values)}
            points, (low, high) = estimated(values, lambda x: np.array([measure(x) for measure in measures]))
            row |= {key: Estimate(points[i], low[i], high[i]) for i, key in enumerate(AGGREGATES)}
            row["giving_up"] = level.get(endpoint, math.nan)
            for given, baseline, others in baselines if name in plan.drawn else ():
                if baseline != name and given.get("condition") == names.get("condition"):
                    (point,), ((low,), (high,)) = estimated((values, others), _improvement)
                    row |= {"p_improvement": Estimate(point, low, high), "over": baseline}
            yield row


def giving_up(analysis: ComparisonAnalysis) -> float:
    """Returns the clipped score of an agent that does nothing but PING, mean over scenarios."""
    horizon, scores = analysis.experiment.declared.horizon, []
    for model in models_of(analysis).values():
        policy = np.eye(len(ACTIONS))[np.full(model.n_observations, PING)]
        found = evaluate(model, policy, horizon).grid_return
        scores.append(np.clip(unbounded_scores(np.asarray(found), model, horizon, "start"), 0.0, 1.0))
    return float(np.mean(scores))


def _improvement(x: Floats, y: Floats) -> float:
    """Returns what `rliable.metrics.probability_of_improvement` does, a hundred times as fast."""
    return float(np.mean(x[:, None] > y) + np.mean(x[:, None] == y) / 2)


def estimated(scores: Any, measure: Callable[..., Any]) -> tuple[Floats, Floats]:
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
    for names, _, rows in analysis.populations(analysis.curves):
        means = {name: proportion(by_step(rows, name)) for name in ENDPOINTS}
        frames.append(pd.DataFrame(expanded({**names, "step": rows["step"].unique(), **means})))
    return pd.concat(frames, ignore_index=True)


@_item(
    "steps",
    f"after how many steps success stays at or above {ENOUGH:g} to the last evaluation",
    "scenario condition learner n budget share median_step step final_success",
    best="-step",
)
def steps(analysis: ComparisonAnalysis) -> Iterator[Row]:
    """Computes when runs, and the mean over runs, have learned."""
    for names, _, rows in analysis.populations(analysis.curves):
        success, evaluations = by_step(rows, "success"), rows["step"].unique().tolist()
        mean, indices = success.mean(axis=0), learned(success, evaluations, ENOUGH)
        first, when = int(learned(mean[None], evaluations, ENOUGH)[0]), np.array([*evaluations, np.inf])
        yield {
            **names,
            "n": len(success),
            "budget": rows["step"].max(),
            "share": proportion(indices < len(mean)),
            "median_step": float(np.median(when[indices])),
            "step": float(when[first]),
            "final_success": float(mean[-1]),
        }


@_item(
    "cost",
    "cost of a run, measured: medians over all runs of CPU seconds, updates, parameters and peak memory",
    "learner cpu_time_s steps_per_cpu_s updates parameters peak_memory_mb settings_tried search_steps "
    "search_cpu_s",
    is_measured=True,
    best="-cpu_time_s",
)
def cost(analysis: ComparisonAnalysis) -> Iterator[Row]:
    """Computes medians over all scenarios and conditions, and the range of CPU time."""
    for names, learner, rows in analysis.populations(analysis.runs, "scenario", "condition"):
        seconds = rows["cpu_time_s"].to_numpy()
        yield {
            **names,
            "runs": len(rows),
            "cpu_time_s": np.median(seconds),
            "cpu_time_s_min": seconds.min(),
            "cpu_time_s_max": seconds.max(),
            "steps_per_cpu_s": rows["budget"].iloc[0] / np.median(seconds),
            "updates": np.median(rows["updates"].to_numpy()),
            "parameters": rows["parameters"].iloc[0],
            "peak_memory_mb": rows["peak_memory_mb"].median(),
            **effort(learner),
        }


@_item(
    "scenarios",
    "what each scenario is, and what is possible in it",
    "scenario description observed cells states observations random_return random_success optimal_return",
)
def scenarios(analysis: ComparisonAnalysis) -> Iterator[Row]:
    """Describes scenarios, unless they are pooled, by the first learner's view of them."""
    experiment, runs = analysis.experiment, analysis.data.runs
    if len(experiment.scenarios) <= 1 or analysis.is_pooled:
        return
    models = models_of(analysis)
    for name in experiment.scenarios:
        model = models[name]
        random, optimal = anchors(model, experiment.declared.horizon, "start")
        own = runs[runs["scenario"] == name]
        yield {
            "scenario": name,
            "description": model.scenario.description,
            "cells": len(model.position),
            "states": len(model.observation),
            "observations": model.n_observations,
            "observed": in_words(model.scenario.observe),
            "random_return": random,
            "random_success": own["random_success"].iloc[0],
            "optimal_return": optimal,
        }


def models_of(analysis: ComparisonAnalysis) -> dict[str, Model]:
    """Returns each scenario, compiled as its first learner sees it."""
    models = dict[str, Model]()
    for population in analysis.experiment.populations:
        scenario, learner = population.scenario, population.learner
        if scenario.name not in models:
            models[scenario.name] = compile_seen(scenario, learner.observation)
    return models


@writing("scores", "every run at the end of training, compressed", SCORES)
def scores(analysis: ComparisonAnalysis, path: Path) -> None:
    """Writes `runs`; `every_cell_` marks episodes that start in any cell, `diverged_at` may be infinite."""
    runs = analysis.runs
    names = [*analysis.names, "policy", "seed", *RESULTS, *(f"every_cell_{name}" for name in RESULTS)]
    names += ["greedy_success", *runs.loc[:, "target_cells_marked":"diverged_at"]]
    write_csv(runs[[name for name in names if name in runs]], path)


@explorer.explorer_item
def agents(analysis: ComparisonAnalysis, path: Path) -> None:
    """Writes what all learners but reference implementations have learned."""
    drawn = [
        analysis.experiment.population(rows["condition"].iloc[0], names["scenario"], learner.name)
        for names, learner, rows in analysis.populations(analysis.runs)
        if not learner.reference_for
    ]
    explorer.write([analysis.data.records(population) for population in drawn], path)


def labelled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table with "SCENARIO under CONDITION" for its scenarios, and a column of learners."""
    table = table.copy()
    names = [table[key].fillna("") for key in ("scenario", "condition") if key in table]
    table["scenario"] = [" under ".join(filter(None, parts)) for parts in zip(*names, strict=True)] or ""
    if "variant" in table:
        table["learner"] = table["variant"] + ", " + table["observation"]
    return table


def headline(folder: Folder) -> str | None:
    """Returns how often each outcome came up, or else each verdict on success."""
    if "contrasts.csv" not in folder:
        return None
    has_outcomes = "outcomes.csv" in folder
    name, column = ("outcomes", "outcome") if has_outcomes else ("contrasts", "success_verdict")
    start = "Whether deep RL earns its keep" if has_outcomes else "Verdicts on success"
    table, parts = folder.frame(name), []
    for ending, text in (OUTCOMES if has_outcomes else WORDS).items():
        if len(rows := table[table[column] == ending]):
            parts.append(f"{text} ({len(rows)} of {len(table)})")
    return f"{start}: {'; '.join(parts)}."
