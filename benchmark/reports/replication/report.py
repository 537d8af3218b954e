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
from envs import InputError, Model, compile_scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CURVES: Final = ("max_q", "table_max_q")  # what the claims on curves need of a training
_SHOWN_EVERY: Final = 1000  # steps between the rows of learning.md and learning.tex


@dataclass(frozen=True)
class Context:
    """What the figures need in addition to the tables."""

    models: Mapping[str, Model]  # by scenario


@dataclass(frozen=True, eq=False)
class Data:
    """The agents of a replication, under every reading: as many as the paper has, and all of the default."""

    readings: Mapping[str, Mapping[str, Population]]  # reading to scenario to as many agents as the paper has
    everyone: Mapping[str, Population]  # scenario to all agents under the default reading
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
    def sets(self) -> Sequence[Mapping[str, Population]]:
        """Disjoint sets of the agents under the default reading, each as large as the paper's.

        They are made of consecutive seeds. The first is that of the tables and figures. If there is no second
        one, there are no sets.
        """
        size, total = (len(next(iter(each.values())).seeds) for each in (self._papers, self.everyone))
        starts = range(0, total - size + 1, size)
        if len(starts) < 2:
            return []
        others = [
            {name: population.subset(start, start + size) for name, population in self.everyone.items()}
            for start in starts[1:]
        ]
        return [self._papers, *others]

    @property
    def _papers(self) -> Mapping[str, Population]:
        return self.readings[DEFAULT_CONDITION]

    @property
    def has_claims(self) -> bool:
        """Whether the paper's scenarios are there, which its claims are about."""
        return set(claims.SCENARIOS) <= set(self._papers)

    @cached_property
    def judged_readings(self) -> Mapping[str, pd.DataFrame]:
        """The claims under every reading, each with as many agents as the paper has."""
        return {
            name: claims.judge(populations, self.curves[name]) for name, populations in self.readings.items()
        }

    @cached_property
    def judged_sets(self) -> Sequence[pd.DataFrame]:
        """The claims in each of `sets`."""
        return [claims.judge(each, self.curves[DEFAULT_CONDITION]) for each in self.sets]

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
    for scenario, name, observation in experiment.populations:
        for condition in experiment.conditions:
            run = specifications(experiment, condition, scenario, name, observation, [0])[0]
            model = compile_scenario(run.scenario)
            if not model.has_cell_maps or len(model.starts) > 1 or run.scenario.regions.target_radius is None:
                raise InputError(
                    f"{experiment.argument}: scenarios: {run.scenario.name} ({condition}): a replication "
                    "takes scenarios like the paper's: the agent observes its cell alone, there is one start "
                    "and one phase, no wall, and the regions are squares by their radii."
                )
    if experiment.sweep:
        raise InputError(
            f"{experiment.argument}: sweep: accepted: none, since a replication varies its readings alone."
        )
    if experiment.protocol is not None:
        raise InputError(
            f"{experiment.argument}: protocol: a replication takes none; accepted: in an experiment whose "
            "report is comparison or ablation."
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
    everyone: dict[str, Population] = {}
    for reading in experiment.readings:
        populations = [
            load_population(specifications(experiment, reading, scenario, arm, observation, seeds), store)
            for scenario in experiment.scenarios
        ]
        if reading == DEFAULT_CONDITION:
            everyone = {population.scenario: population for population in populations}
        readings[reading] = {
            population.scenario: population.subset(0, declared.seeds) for population in populations
        }
    first = next(iter(everyone.values()))
    for name in _CURVES:
        if name not in first.arrays:
            raise InputError(f"{experiment.name}: algorithms.{arm}: its training returns no {name}.")
    n_agents, n_declared = len(first.seeds), len(experiment.declared_seeds(arm, DEFAULT_CONDITION))
    return Data(
        readings=readings,
        everyone=everyone,
        curves={name: reading.curve for name, reading in experiment.readings.items()},
        arm=arm,
        observation=observation,
        note=_note(n_agents, n_declared, seeds),
    )


def _note(n_agents: int, n_declared: int, seeds: Sequence[int] | None) -> str:
    """Returns what readers must know of the agents; empty if they are those declared."""
    if seeds is None:
        return ""
    if n_agents < n_declared:
        return f"Partial: {n_agents} of the {n_declared} agents declared per scenario."
    return f"Agents have the seeds {min(seeds)} to {max(seeds)} instead of those declared."


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


def _success(data: Data, _: Frames) -> pd.DataFrame:
    sizes = [data.default] if not data.sets else [data.default, list(data.everyone.values())]
    return replication_tables.success([population for size in sizes for population in size])


def _claims(data: Data, _: Frames) -> pd.DataFrame | None:
    if not data.has_claims:
        return None
    judged = [data.judged_readings[DEFAULT_CONDITION]]
    if data.sets:
        judged.append(claims.judge(data.everyone, data.curves[DEFAULT_CONDITION]))
    frame = pd.concat(judged, ignore_index=True)
    frame = frame.join(claims.agreement(frame, data.judged_sets))
    texts = pd.DataFrame(
        [(claim.id, claim.says, claim.measure, claim.because) for claim in claims.CLAIMS],
        columns=["claim", "says", "measure", "because"],
    )
    frame["claim"] = pd.Categorical(frame["claim"], texts["claim"])
    frame = frame.sort_values(["claim", "agents"], kind="stable").astype({"claim": str})
    return frame.merge(texts, on="claim", how="left")


def _claim_sets(data: Data, _: Frames) -> pd.DataFrame | None:
    if not data.has_claims or not data.sets:
        return None
    frames = []
    for populations, judged in zip(data.sets, data.judged_sets, strict=True):
        seeds = next(iter(populations.values())).seeds
        frames.append(judged.assign(first_seed=seeds[0], last_seed=seeds[-1]))
    columns = ["first_seed", "last_seed", "claim", "part", "value", "low", "high", "state", "verdict"]
    return pd.concat(frames, ignore_index=True)[columns]


def _sensitivity(data: Data, _: Frames) -> pd.DataFrame | None:
    if not data.has_claims:
        return None
    columns = [
        "claim", "reading", "part", "agents", "value", "low", "high", "right_side", "threshold", "state",
        "verdict",
    ]  # fmt: skip
    frames = [frame.assign(reading=name)[columns] for name, frame in data.judged_readings.items()]
    return pd.concat(frames, ignore_index=True)


def _shown(data: Data) -> list[Shown]:
    return [Shown(data.arm, data.observation, population) for population in data.default]


# As .md and .tex show them


def _display_claims(frame: pd.DataFrame) -> pd.DataFrame:
    shown = tables.with_intervals(frame.rename(columns={"low": "value_low", "high": "value_high"}), ["value"])
    shown["must be"] = frame["right_side"] + " " + frame["threshold"].map("{:g}".format)
    agreeing = frame["sets_agreeing"].astype(str) + " of " + frame["sets"].astype(str)
    shown["sets"] = agreeing.where(frame["sets"] > 0, "-")
    columns = ["claim", "agents", "verdict", "sets", "part", "value", "must be", "state", "effect"]
    return shown[columns]


def _display_sensitivity(frame: pd.DataFrame) -> pd.DataFrame:
    weakest = claims.weakest(frame, "reading")
    wide = weakest.assign(entry=weakest["value"].map(tables.show) + ", " + weakest["verdict"])
    wide = wide.pivot(index="claim", columns="reading", values="entry")
    in_order: pd.DataFrame = wide.loc[frame["claim"].unique(), list(frame["reading"].unique())]
    return in_order.reset_index()


def _display_learning(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["success", "score", "optimal_share"]
    is_shown = (frame["step"] % _SHOWN_EVERY == 0) | (frame["step"] == frame["step"].max())
    shown = tables.with_intervals(frame[is_shown], columns)
    return shown[["scenario", "step", *columns, "unbounded_score"]]


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


def _draw_claims(frames: Frames, _: Context) -> "Figure | None":
    from benchmark.reports.replication import figures

    return figures.claims(frames["claims"]) if "claims" in frames else None


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
        description="every part of every claim, with its 95 % interval, its state and the verdict, by agents",
        section="claims",
        compute=_claims,
        display=_display_claims,
        draw=_draw_claims,
        caption="Every part of every claim, with its 95 % interval and its threshold.",
        view=findings.claims_table,
    ),
    Item(
        name="claim_sets",
        description="every part of every claim in each of the disjoint sets of agents, and the verdicts",
        compute=_claim_sets,
    ),
    Item(
        name="sensitivity",
        description="every part of every claim, its state and the verdict, under every reading of the paper",
        section="claims",
        compute=_sensitivity,
        display=_display_sensitivity,
        draw=_draw_sensitivity,
        caption="Verdict on every claim under every reading.",
        view=findings.sensitivity_table,
    ),
    Item(
        name="learning",
        description="success, score of the greedy policy, and the share of optimal agents, over training",
        section="learning",
        compute=_learning,
        display=_display_learning,
        draw=_draw_learning,
        caption="Success and score of the greedy policy, and share of optimal agents, over training.",
        view=Columns(
            file="learning.csv",
            caption="After training: exact evaluation of the agents' greedy policies",
            keys=("scenario",),
            numbers={
                "success": "success probability",
                "score": "mean score",
                "optimal_share": "share of optimal agents",
                "unbounded_score": "mean of unbounded scores",
            },
            where=_last_step,
        ),
    ),
    Item(
        name="success",
        description="success and share of optimal agents after training, with all agents as well",
        section="learning",
        compute=_success,
        view=Columns(
            file="success.csv",
            caption="After training: as many agents as the paper has, and all",
            keys=("scenario", "agents"),
            numbers={"success": "success probability", "optimal_share": "share of optimal agents"},
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
            f"exact optimum (1), both under a limit of {published.manifest['horizon']} steps. Means are of "
            "the agents' scores clipped to [0, 1]. `unbounded_score` is the mean without clipping: a "
            "greedy policy may bump into a wall until the limit, and a few such agents decide the mean. "
            "It has no interval, as no method bounds such a mean if failures are rare. `agent.csv` is not "
            "clipped.",
        ),
        (
            "optimal (an agent, a policy)",
            "its score is 1: nothing does better from the start cell. `cells_differing` is the share of all "
            "cells in which an agent's greedy action is not an optimal one; `optimal.png` shows where these "
            "are.",
        ),
        (
            "scenario_return, start_value",
            "the return with the issuer's rewards; the discounted value of the start cell, of Q* and of the "
            "agents.",
        ),
        (
            "intervals",
            "95 %. Those of shares, success and scores are exact binomial ones (Clopper and Pearson), which "
            "are wide for numbers other than 0 and 1. Those of the overlap of agents' own maps are "
            "Student's, and Welch's of a difference. Those of ratios and of other means are percentile "
            f"bootstrap intervals over agents with {RESAMPLES} seeded resamples. What depends on the signs "
            "of the mean Q-values of many cells has simultaneous intervals of these means, by Student's t "
            "with Bonferroni's correction, which is approximate: each cell is above zero, is not, or is "
            "open, and the interval reaches over all ways to decide the open ones.",
        ),
        (
            "effect",
            "distance of a part's value from its threshold, in standard deviations of a single agent, "
            "positive on the right side: (value - threshold) / (standard error * sqrt(agents)), with the "
            "standard error of its interval. Parts on the signs of cells, and parts on which all agents "
            "agree, have none. `agents_needed` is the number of agents with which the part would be decided "
            "with a probability of 80 % if its effect is the true one: (2.8 / effect)^2.",
        ),
        ("std", "sample standard deviation over agents."),
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
                "A claim has one or more parts. A part passes if its whole 95 % interval lies on the right "
                "side of the threshold, fails if it lies on the wrong side, and is undecided otherwise. If "
                "all parts pass, the claim `holds`; if one fails, it `does not hold`; otherwise it is "
                "`undecided`. The table also says in how many of the disjoint sets of agents the verdict is "
                "that of all agents, with the 95 % interval of this share; `effect` and `agents needed` are "
                "of all agents. How each claim is measured, and why the threshold is where it is: "
                "`claims.csv`."
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
