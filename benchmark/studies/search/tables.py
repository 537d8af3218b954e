"""The tables of a search: what was chosen, what that bought, and what it cost."""

from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from benchmark.analysis.intervals import mean_over_scenarios
from benchmark.studies.item import COLUMNS, Item, no_rows
from benchmark.studies.search.analysis import (
    ALL,
    Row,
    SearchAnalysis,
    best_by_scenario,
    expected_drawn,
    expected_total,
    gain,
    text_of,
)

_item: Final = partial(Item, labels=COLUMNS["search_labels"])


@_item(
    "chosen",
    "the chosen settings of each learner, and what it reaches with them on fresh runs",
    "learner part trial settings default chosen gain per_scenario",
    best="chosen",
)
def chosen(analysis: SearchAnalysis) -> Iterator[Row]:
    """Tabulates means over scenarios on fresh runs."""
    scenarios = analysis.data.experiment.scenarios
    picks = [(outcome, *pick) for outcome in analysis.outcomes for pick in enumerate(outcome.picks, 1)]
    for outcome, part, trial in picks:
        learner, parts = outcome.learner, {"part": part} if len(outcome.picks) > 1 else {}
        best, default = outcome.again(trial), outcome.again(0)
        pairs = zip(best_by_scenario(outcome.searched), scenarios, strict=True)
        best_of_each = [outcome.fresh[pair] for pair in pairs]
        yield {
            "variant": learner.variant,
            "observation": learner.observation,
            **parts,
            "trial": trial,
            "settings": text_of(analysis.settings(learner, trial)),
            "default": mean_over_scenarios(default),
            "chosen": mean_over_scenarios(best),
            "gain": gain(best, default),
            "per_scenario": mean_over_scenarios(best_of_each),
        }


@_item(
    "effort",
    "steps with tuning included: search and training together, from nothing, until a run has learned",
    "learner default learned trials total drawn",
    best="-total",
    where=lambda frame: frame[frame["scenario"] == ALL],
)
def effort(analysis: SearchAnalysis) -> Iterator[Row]:
    """Tabulates `expected_total` by scenario, and its mean over all, if runs are measured until they learn.

    Once the cost of tuning counts, simple algorithms can outperform their successors: "Benchmarking RL should
    account for tuning", openreview.net/forum?id=816gaVGHgP.
    """
    experiment = analysis.data.experiment
    run = experiment.populations[0].first
    first, budget = run.evaluation_every, run.settings.budget
    for outcome in analysis.outcomes if analysis.measure == "earliness" else ():
        learner = {"variant": outcome.learner.variant, "observation": outcome.learner.observation}
        steps = np.where(outcome.searched > 0, first * (budget / first) ** (1 - outcome.searched), np.inf)
        scenes = steps.swapaxes(0, 1)
        totals = [expected_total(each[0], each[1:].ravel(), budget) for each in scenes]
        drawn = [expected_drawn(each[1:].ravel(), budget) for each in scenes]
        for i, scenario in enumerate((ALL, *experiment.scenarios)):
            some = slice(i - 1, i) if i else slice(None)
            default, others = steps[0, some], steps[1:, some]
            row = {"default": float(default.mean()), "learned": int(np.isfinite(others).sum())}
            means = {"total": float(np.mean(totals[some])), "drawn": float(np.mean(drawn[some]))}
            yield {"scenario": scenario, **learner, **row, "trials": others.size, **means}


@_item(
    "cost",
    "cost of the search: of all trials, and of fresh runs of those that were ranked",
    "learner trials runs steps cpu_time_s cpu_ms",
    is_measured=True,
    best="-cpu_time_s",
)
def cost(analysis: SearchAnalysis) -> Iterator[Row]:
    """Tabulates the effort of each search; `cpu_ms` is the mean time that a run of the search trains."""
    for name, found in analysis.chosen.items():
        variant, observation = name.split(", ")
        effort = found.model_dump(include={"trials", "runs", "steps", "cpu_time_s"})
        cpu_ms = 1000 * found.cpu_time_s / found.runs
        yield {"variant": variant, "observation": observation, **effort, "cpu_ms": cpu_ms}


trials = _item(
    "trials",
    "every trial of every learner: settings, and means by scenario",
    where=no_rows,
    compute=lambda analysis: analysis.trials,
)
