"""The report on scenarios: its items and what they are called."""

import json
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import pandas as pd

from agents import load_algorithm
from benchmark.drawing import tables
from benchmark.experiments import Experiment
from benchmark.reports.comparison.data import Context, Data
from benchmark.reports.comparison.data import load as load_compared
from benchmark.reports.comparison.report import check_conditions, protocol_terms
from benchmark.reports.item import Frames, Item, Report, Section, whole
from benchmark.reports.published import Published
from benchmark.reports.scenarios import findings
from benchmark.reports.scenarios import tables as scenarios
from benchmark.reports.view import Columns
from envs import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from benchmark.execution.store import Store

_LEARNER: Final = ("algorithm", "observation")
_POPULATION: Final = ("scenario", *_LEARNER)


def check(experiment: Experiment) -> None:
    """Checks the conditions and the protocol of an experiment, and its budgets, which must be steps.

    Raises:
      InputError: One of them is not accepted, or all arms are planners.
    """
    check_conditions(experiment)
    algorithms = {name: load_algorithm(arm.algorithm) for name, arm in experiment.algorithms.items()}
    if all(algorithm.family == "planner" for algorithm in algorithms.values()):
        raise InputError(f"{experiment.argument}: algorithms: accepted: at least one that is not a planner.")
    for name, arm in experiment.algorithms.items():
        if (experiment.settings | arm.settings).get("budget_unit", "steps") != "steps":
            own = f"algorithms.{name}." if "budget_unit" in arm.settings else ""
            unit = (experiment.settings | arm.settings)["budget_unit"]
            raise InputError(
                f"{experiment.argument}: {own}settings.budget_unit = {json.dumps(unit)}: accepted: "
                '"steps", in which this report counts.'
            )


def load(experiment: Experiment, store: "Store", seeds: Sequence[int] | None, partial: bool) -> Data:
    """Reads all runs, see `benchmark.reports.comparison.data.load`.

    Raises:
      InputError: Runs are missing, or there is no learner that is no planner.
    """
    data = load_compared(experiment, store, seeds, partial)
    if not scenarios.learners(data).learners:
        raise InputError(
            f"{experiment.name}: only planners have stored runs; accepted: runs of another algorithm, too."
        )
    return data


# As .md and .tex show them


def _display_contrasts(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["success_difference", "score_difference"]
    shown = ["scenario", "x", "y", "success_verdict", "score_verdict", "n", *columns]
    return tables.with_intervals(frame, columns)[shown]


def _display_effects(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["success", "score", "disagreements"]
    shown = ["effect", "scenario", "against", *_LEARNER, "n", *columns]
    return tables.with_intervals(frame, columns)[shown]


# Figures


def _draw_scenarios(_: Frames, context: Context) -> "Figure":
    from benchmark.drawing.maps import gallery

    return gallery(list(context.models.values()))


def _draw_summary(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.scenarios import figures

    return figures.summary(frames["summary"], frames.get("contrasts"), context)


def _draw_curves(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.scenarios import figures

    return figures.curves(frames["curves"], context)


def _draw_effects(frames: Frames, context: Context) -> "Figure | None":
    from benchmark.reports.scenarios import figures

    return figures.effects(frames["effects"], context) if "effects" in frames else None


ITEMS: Final = (
    Item(
        name="summary",
        description=(
            "each scenario and learner: success, score, steps, wrong PINGs, disagreements in training"
        ),
        compute=scenarios.summary,
        draw=_draw_summary,
        caption="How often each learner succeeds in each scenario; verdicts, if there is a protocol.",
    ),
    Item(
        name="contrasts",
        description=(
            "the contrasts of the protocol in every scenario: differences, adjusted p-values, verdicts"
        ),
        compute=scenarios.contrasts,
        display=_display_contrasts,
        view=Columns(
            file="contrasts.csv",
            caption="The contrasts of the protocol in every scenario: x against y",
            keys=("scenario", "x", "y", "success_verdict", "score_verdict"),
            labels={"success_verdict": "verdict on success", "score_verdict": "verdict on score"},
            numbers={
                "success_difference": "difference in success",
                "success_p_different": "p, no difference",
                "score_difference": "difference in score",
            },
        ),
        is_folded=True,
    ),
    Item(
        name="steps",
        description=f"after how many steps the mean success stays at or above {scenarios.ENOUGH:g}",
        compute=scenarios.steps,
    ),
    Item(
        name="curves",
        description="success and disagreements over training, against environment steps",
        compute=scenarios.curves,
        draw=_draw_curves,
        caption="Success over training, with its 95 % interval.",
    ),
    Item(
        name="ahead",
        description=(
            "exploratory: at which steps one learner of a contrast succeeds more often than the other"
        ),
        compute=scenarios.ahead,
    ),
    Item(
        name="effects",
        description="exploratory: what a difference between two scenarios does to each learner",
        section="effects",
        compute=scenarios.effects,
        display=_display_effects,
        draw=_draw_effects,
        caption="Differences between two scenarios, by learner.",
    ),
    Item(
        name="scenarios",
        description="each scenario: cells, states, observations, what is hidden, and what is possible",
        section="scenarios",
        compute=scenarios.scenarios,
        display=whole,
        draw=_draw_scenarios,
        caption="The scenarios.",
        view=Columns(
            file="scenarios.csv",
            caption="What each scenario is, and what is possible in it",
            keys=("scenario", "description", "observed", "hidden"),
            numbers={
                "cells": "cells",
                "states": "states",
                "observations": "observations",
                "random_return": "random return",
                "optimal_return": "optimal return",
                "memoryless_return": "best memoryless return found",
                "memoryless_success": "its success",
            },
        ),
    ),
    Item(name="scores", description="every run at the end of training", compute=scenarios.scores),
    Item(
        name="region",
        description="how well the cells where an agent values PING match the target region",
        compute=scenarios.region,
    ),
    Item(
        name="cost",
        description="cost of a run: CPU seconds, updates, parameters, peak memory of its process",
        section="cost",
        compute=scenarios.cost,
        view=Columns(
            file="cost.csv",
            caption="Cost of a run, measured: medians over all scenarios",
            keys=_LEARNER,
            numbers={
                "cpu_time_s": "CPU time (s)",
                "steps_per_cpu_s": "steps per CPU second",
                "peak_memory_mb": "peak memory (MB)",
            },
        ),
        is_measured=True,
    ),
    Item(
        name="findings",
        description="the sentences above; every number in them links to the rows that it comes from",
        tell=findings.table,
    ),
)


def words(published: Published) -> Sequence[tuple[str, str]]:
    """Explains the terms of the tables."""
    horizon = published.manifest["horizon"]
    return [
        ("scenario", "who stands where, how personal space is shaped, and what changes."),
        (
            "success",
            "the probability, evaluated exactly, that an episode ends with a PING in the target region; the "
            "mean over runs. Episodes start in the scenario's starts, all equally likely.",
        ),
        (
            "score",
            "undiscounted return by the grid's rewards, scaled between the exact random policy (0) and the "
            "exact "
            f"optimum of an agent that knows the state (1), both under a limit of {horizon} steps, and "
            "clipped "
            "to [0, 1] in every run. Where part of the state is hidden, 1 may be out of reach.",
        ),
        (
            "memoryless",
            "of a policy: it depends on the present observation alone. The best one found comes from the "
            "algorithm `memoryless`, which knows the model and searches by gradient ascent on the exact "
            "expected return.",
        ),
        (
            "hidden",
            "what varies in the state and does not follow from the observation. `clock`: how long the phase "
            "has lasted; `feedback to come`: whether delayed feedback is pending.",
        ),
        ("disagreements", "wrong PINGs per 1,000 steps of the whole training."),
        (
            "intervals",
            "95 % intervals over runs, not adjusted: exact binomial intervals for success and score (Clopper "
            "and Pearson), intervals derived from them for differences (Zou and Donner 2008), and Student's "
            "t for disagreements. Verdicts use adjusted p-values.",
        ),
        ("inf", "never within the budget."),
    ]


_VERDICTS_TEXT: Final = (
    "A contrast compares two learners in one scenario. Verdicts are those of a comparison, see "
    "`benchmark/analysis/contrasts.py`: p-values are adjusted by Holm's method for all contrasts in all "
    "scenarios "
    "together, separately for differences and for equivalence. With few runs, learners that succeed equally "
    "often are usually undecided: showing equivalence takes more runs than showing a large difference."
)

REPORT: Final = Report(
    name="scenarios",
    question="In which scenarios does deep RL earn its keep?",
    check=check,
    load=load,
    items=ITEMS,
    sections=(
        Section(
            key="verdicts",
            heading="Scenario by scenario",
            text=_VERDICTS_TEXT,
            terms=partial(protocol_terms, means="means over the runs in one scenario"),
            terms_title="The protocol",
        ),
        Section(
            key="effects",
            heading="Effects",
            text=(
                "Each effect is the difference between two scenarios, in means over runs, with 95 % "
                "intervals and without a test. Where something is added and observed, the observation grows, "
                "too."
            ),
        ),
        Section(key="scenarios", heading="The scenarios"),
        Section(key="cost", heading="Cost"),
    ),
    headline=findings.headline,
    sentences=findings.sentences,
    words=words,
    lead="summary",
)
