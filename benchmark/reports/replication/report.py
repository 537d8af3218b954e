"""The replication as a report: its data, its items and what they are called."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from agents import load_algorithm
from benchmark.analysis.intervals import RESAMPLES
from benchmark.analysis.population import Population, load_population
from benchmark.analysis.snapshots import Shown
from benchmark.drawing import tables
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, Experiment, specifications
from benchmark.reports.explorer import explorer_items
from benchmark.reports.item import Frames, Item, Report, Section
from benchmark.reports.published import Published
from benchmark.reports.replication import claims, findings
from benchmark.reports.replication import tables as replication_tables
from benchmark.reports.view import Columns
from envs import InputError, Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CURVES: Final = ("max_q", "table_max_q")  # what the claims on curves need of a training


@dataclass(frozen=True)
class Context:
    """What the figures need in addition to the tables."""

    models: Mapping[str, Model]  # by scenario


@dataclass(frozen=True, eq=False)
class Data:
    """The agents of a replication, under every reading."""

    readings: Mapping[str, Mapping[str, Population]]  # reading to scenario to its agents
    curves: Mapping[str, str]  # reading to the maximum Q that the claims on curves are about
    arm: str
    observation: str
    note: str
    is_incomplete: bool = False  # a replication is reported whole or not at all

    @property
    def default(self) -> Sequence[Population]:
        """The agents under the default reading, in the order of the scenarios."""
        return list(self.readings[DEFAULT_CONDITION].values())

    @cached_property
    def verdicts(self) -> dict[str, pd.DataFrame] | None:
        """The claims under every reading; None without the paper's scenarios, which they are about."""
        if not set(claims.SCENARIOS) <= set(self.readings[DEFAULT_CONDITION]):
            return None
        return {
            name: claims.judge(populations, self.curves[name]) for name, populations in self.readings.items()
        }

    @property
    def context(self) -> Context:
        """See `Context`."""
        return Context({population.scenario: population.model for population in self.default})

    @property
    def facts(self) -> dict[str, object]:
        """Which readings leave what the agents learn as it is by default."""
        default = self.readings[DEFAULT_CONDITION]
        equal = [
            name
            for name, populations in self.readings.items()
            if name != DEFAULT_CONDITION
            and all(
                np.array_equal(populations[scenario].arrays["q"], default[scenario].arrays["q"])
                for scenario in default
            )
        ]
        return {"learned_as_default": equal}


def check(experiment: Experiment) -> None:
    """Checks that an experiment has a single tabular arm that records the maximum Q, and no sweep.

    Raises:
      InputError: It has something else.
    """
    fits = False
    if len(experiment.algorithms) == 1:
        (arm,) = experiment.algorithms.values()
        algorithm = load_algorithm(arm.algorithm)
        fits = algorithm.family == "tabular" and "record_every" in algorithm.settings.model_fields
    if not fits:
        raise InputError(
            f"{experiment.argument}: algorithms: a replication takes exactly one, and a tabular one that "
            "records the maximum Q."
        )
    if experiment.sweep:
        raise InputError(
            f"{experiment.argument}: sweep: accepted: none, since a replication varies its readings alone."
        )


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Data:
    """Reads all agents of a replication.

    Args:
      experiment: As loaded.
      store: Where its records are.
      seeds: Other seeds than the declared ones.
      partial: Refused: claims are judged of all runs or not at all.

    Raises:
      InputError: A run is missing, or lacks what the claims need.
    """
    if partial:
        raise InputError(f"--partial: {experiment.name} is a replication; accepted: a comparison.")
    arm, declared = next(iter(experiment.algorithms.items()))
    observation = declared.observations[0]
    readings: dict[str, dict[str, Population]] = {}
    for reading in experiment.readings:
        populations = [
            load_population(specifications(experiment, reading, scenario, arm, observation, seeds), store)
            for scenario in experiment.scenarios
        ]
        readings[reading] = {population.scenario: population for population in populations}
    first = next(iter(readings[DEFAULT_CONDITION].values()))
    for name in _CURVES:
        if name not in first.arrays:
            raise InputError(f"{experiment.name}: algorithms.{arm}: its training returns no {name}.")
    n_agents = len(first.seeds)
    return Data(
        readings=readings,
        curves={name: reading.curve for name, reading in experiment.readings.items()},
        arm=arm,
        observation=observation,
        note=""
        if n_agents == declared.seeds
        else f"Partial: {n_agents} of the {declared.seeds} agents declared.",
    )


# Tables


def _q_values(data: Data, _: Frames) -> pd.DataFrame:
    return replication_tables.q_values(data.default)


def _max_q(data: Data, _: Frames) -> pd.DataFrame:
    return replication_tables.max_q(data.default)


def _learning(data: Data, _: Frames) -> pd.DataFrame:
    return replication_tables.learning(data.default)


def _optimal(data: Data, _: Frames) -> pd.DataFrame:
    return replication_tables.optimal(data.default)


def _optimal_cells(data: Data, _: Frames) -> pd.DataFrame:
    return replication_tables.optimal_cells(data.default)


def _claims(data: Data, _: Frames) -> pd.DataFrame | None:
    return None if data.verdicts is None else data.verdicts[DEFAULT_CONDITION]


def _sensitivity(data: Data, _: Frames) -> pd.DataFrame | None:
    if data.verdicts is None:
        return None
    columns = ["claim", "reading", "value", "low", "high", "threshold", "verdict", "parts"]
    return pd.concat([frame.assign(reading=name)[columns] for name, frame in data.verdicts.items()])


def _shown(data: Data) -> list[Shown]:
    return [Shown(data.arm, data.observation, population) for population in data.default]


# As .md and .tex show them


def _display_claims(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[["claim", "says", "value", "low", "high", "threshold", "verdict"]]


def _display_sensitivity(frame: pd.DataFrame) -> pd.DataFrame:
    wide = frame.assign(entry=[f"{row.value:.3g}, {row.verdict}" for row in frame.itertuples()])
    wide = wide.pivot(index="claim", columns="reading", values="entry")
    in_order: pd.DataFrame = wide.loc[frame["claim"].unique(), list(frame["reading"].unique())]
    return in_order.reset_index()


def _display_learning(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["score", "score_iqm", "success", "optimal_share"]
    return tables.with_intervals(frame, columns)[["scenario", "step", *columns]]


def _display_optimal(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.set_index("scenario").T.rename_axis("measure").reset_index()


def _last_step(frame: pd.DataFrame) -> pd.DataFrame:
    last: float = frame["step"].max()
    return frame[frame["step"] == last]


# Figures


def _draw_figure(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.replication import figures

    return figures.replication(frames["max_q"], frames["q_values"], context.models)


def _draw_learning(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.replication import figures

    return figures.learning(frames["learning"], context.models)


def _draw_optimal(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.replication import figures

    return figures.optimal(frames["optimal_cells"], context.models)


def _draw_sensitivity(frames: Frames, _: Context) -> "Figure | None":
    from benchmark.reports.replication import figures

    return figures.sensitivity(frames["sensitivity"]) if "sensitivity" in frames else None


ITEMS: Final = (
    Item(
        name="figure",
        description="the paper's figure: maximum Q per step, final Q of the moves, final Q of PING",
        section="replication",
        draw=_draw_figure,
        caption="The paper's figure: maximum Q over training, final Q of the moves and of PING.",
    ),
    Item(
        name="claims",
        description="every claim of the paper, measured, with its 95 % interval over agents and a verdict",
        section="claims",
        compute=_claims,
        display=_display_claims,
        view=findings.claims_table,
    ),
    Item(
        name="sensitivity",
        description="value and verdict of every claim under every reading of the paper",
        section="claims",
        compute=_sensitivity,
        display=_display_sensitivity,
        draw=_draw_sensitivity,
        caption="Verdict on every claim under every reading.",
    ),
    Item(
        name="learning",
        description="exact score of the greedy policy, and the share of optimal agents, over training",
        section="learning",
        compute=_learning,
        display=_display_learning,
        draw=_draw_learning,
        caption="Exact score of the greedy policy, and share of optimal agents, over training.",
        view=Columns(
            file="learning.csv",
            caption="After training: exact evaluation of the agents' greedy policies",
            keys=("scenario",),
            numbers={
                "score": "mean score",
                "score_iqm": "score, interquartile mean",
                "success": "success probability",
                "optimal_share": "share of optimal agents",
            },
            where=_last_step,
        ),
    ),
    Item(
        name="optimal",
        description="the exact optimum, what was learned, and the regret",
        section="learning",
        compute=_optimal,
        display=_display_optimal,
        draw=_draw_optimal,
        caption="The exact optimum, what learning made of it, and where agents act optimally.",
    ),
    Item(
        name="optimal_cells",
        description="Q* and the learned Q of every cell and action, and where policies differ",
        compute=_optimal_cells,
    ),
    Item(name="q_values", description="final Q over agents of every cell and action", compute=_q_values),
    Item(
        name="max_q",
        description="maximum Q over agents at every recorded step, of the visited cell and of the table",
        compute=_max_q,
    ),
    *explorer_items(_shown),
)


def _words(published: Published) -> list[tuple[str, str]]:
    """Explains the terms of the tables."""
    return [
        (
            "score",
            "undiscounted return by the grid's rewards, scaled between the exact random policy (0) and the "
            f"exact optimum (1), both under a limit of {published.manifest['horizon']} steps. It has no "
            "lower bound: a greedy policy may bump into a wall until the limit, which lowers the mean.",
        ),
        (
            "optimal (an agent, a policy)",
            "its score is 1: nothing does better from the start cell. `cells_differing` is the share of all "
            "cells in which an agent's greedy action is not an optimal one; `optimal.png` shows where these "
            "are.",
        ),
        (
            "score_iqm",
            "interquartile mean: the mean of the middle half of the agents. `scenario_return` includes the "
            "issuer's rewards. `start_value` is the discounted value of the start cell, of Q* and of the "
            "agents.",
        ),
        (
            "std",
            "sample standard deviation over agents. Intervals are 95 % percentile bootstrap intervals over "
            f"agents with {RESAMPLES} seeded resamples.",
        ),
        (
            "Q*",
            "values of an agent that knows its state, before any wrong PING. Wrong PINGs are hidden from the "
            "learner, so its values need not converge to Q*. No policy is worth more than Q*, but noise can "
            "make estimates larger.",
        ),
    ]


REPORT: Final = Report(
    name="replication",
    question="Learning from disagreement how close is too close",
    check=check,
    load=load,
    items=ITEMS,
    sections=(
        Section(key="replication", heading="Replication"),
        Section(
            key="claims",
            heading="The paper's claims",
            text=(
                "A claim's value is that of its weakest part. A part passes if its whole 95 % interval lies "
                "on the right side of the threshold, fails if it lies on the wrong side, and is undecided "
                "otherwise. If all parts pass, the claim `holds`; if none passes and one fails, it `does not "
                "hold`; otherwise it `holds in part`. How each claim is measured, all its parts, and why the "
                "threshold is where it is: `claims.csv`."
            ),
            terms=findings.readings,
            terms_title="The readings of the paper, and the control",
        ),
        Section(key="learning", heading="Learning", text=""),
    ),
    headline=findings.headline,
    sentences=findings.sentences,
    words=_words,
)
