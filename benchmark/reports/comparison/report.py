"""The comparison as a report: its items and what they are called."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import pandas as pd

from benchmark.analysis.population import GOOD_SCORE, Population
from benchmark.analysis.snapshots import Shown, typical_agent
from benchmark.drawing import tables
from benchmark.experiments import DEFAULT_CONDITION, Experiment
from benchmark.reports.comparison import findings
from benchmark.reports.comparison import tables as comparison
from benchmark.reports.comparison.data import Context, Data, load
from benchmark.reports.comparison.protocol import Learner, protocol_of
from benchmark.reports.explorer import explorer_items
from benchmark.reports.item import Frames, Item, Report, Section, whole
from benchmark.reports.published import Published
from benchmark.reports.view import Columns
from envs import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

_LEARNER: Final = ("algorithm", "observation")
_POPULATION: Final = ("scenario", *_LEARNER)
_ENDS: Final = ("low", "high")


def check(experiment: Experiment) -> None:
    """Checks that an experiment has the default condition alone, its protocol, and no effects.

    Raises:
      InputError: It has other conditions, the protocol names what is not there, or there are effects.
    """
    check_conditions(experiment)
    if experiment.effects:
        raise InputError(
            f'{experiment.argument}: effects: accepted only if report = "scenarios"; here it is "comparison".'
        )


def check_conditions(experiment: Experiment) -> None:
    """Checks that an experiment has the default condition alone, and its protocol.

    Raises:
      InputError: It has other conditions, or the protocol names what is not there.
    """
    protocol_of(experiment)
    if list(experiment.conditions) != [DEFAULT_CONDITION]:
        raise InputError(
            f"{experiment.argument}: readings, sweep: a comparison takes the {DEFAULT_CONDITION} condition "
            "alone."
        )


# Tables


def _scores(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.scores(data)


def _summary(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.summary(data)


def _aggregate(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.aggregate(data)


def _contrasts(data: Data, _: Frames) -> pd.DataFrame | None:
    return comparison.contrasts(data)


def _improvement(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.improvement(data)


def _profile(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.profile(data)


def _curves(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.curves(data)


def _curves_cpu(data: Data, frames: Frames) -> pd.DataFrame:
    return comparison.curves_cpu(data, frames["curves"])


def _threshold(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.threshold(data)


def _region(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.region(data)


def _cost(data: Data, _: Frames) -> pd.DataFrame:
    return comparison.cost(data)


def _maps(data: Data, _: Frames) -> pd.DataFrame | None:
    return comparison.maps(data) if any(data.mapped) else None


def _shown(data: Data) -> list[Shown]:
    return [Shown(*learner, population) for learner, _, population in data.mapped]


def _write_film(data: Data, _: Frames, directory: "Path") -> None:
    """Writes an animation of learning: typical agents of the first table and net, in every scenario."""
    from benchmark.drawing import film

    def typical(learner: Learner, scenario: str, population: Population) -> film.Film:
        agent = typical_agent(population)
        title = f"{scenario}: {learner}, seed {population.seeds[agent]} (median)"
        return film.film_of(title, population, agent)

    families: dict[str, list[Learner]] = {"tabular": [], "deep": [], "planner": []}
    for learner, populations in data.without_checks.learners.items():
        families[next(iter(populations.values())).algorithm.family].append(learner)
    films = [
        [typical(learner, *shown) for shown in data.learners[learner].items()]
        for learners in families.values()
        for learner in learners[:1]
    ]
    film.write(film.learning(films), directory / "learning.webp")


# As .md and .tex show them


def _display_summary(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["success", "score"]
    columns += [c for c in ("every_cell_success",) if c in frame]
    shown = [*_POPULATION, "policy", "n", *columns, "unbounded_score", "steps"]
    return tables.with_intervals(frame, columns)[shown]


def _display_aggregate(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["success", "score"]
    columns += [c for c in ("every_cell_success", "every_cell_score") if c in frame]
    shown = [*_LEARNER, "policy", "runs", *columns, "unbounded_score", "iqm"]
    return tables.with_intervals(frame, columns)[shown]


def _display_contrasts(frame: pd.DataFrame) -> pd.DataFrame:
    columns = [f"{endpoint}_difference" for endpoint in comparison.ENDPOINTS]
    verdicts = [f"{endpoint}_verdict" for endpoint in comparison.ENDPOINTS]
    return tables.with_intervals(frame, columns)[["x", "y", *verdicts, "n", *columns]]


def _display_improvement(frame: pd.DataFrame) -> pd.DataFrame:
    names = {"probability": "p", "low": "p_low", "high": "p_high"}
    return tables.with_intervals(_once(frame).rename(columns=names), ["p"])[["x", "y", "p"]]


def _once(frame: pd.DataFrame) -> pd.DataFrame:
    """Returns every pair of `improvement` once."""
    return frame.iloc[::2]


def _display_profile(frame: pd.DataFrame) -> pd.DataFrame:
    shown = frame[(frame["score"] * 10 % 1).abs() < 1e-9]
    wide = shown.pivot(index=list(_LEARNER), columns="score", values="share")
    wide = wide.loc[list(dict.fromkeys(map(tuple, shown[list(_LEARNER)].to_numpy())))]
    return wide.rename(columns=lambda score: f"≥ {score:g}").reset_index()


def _display_threshold(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["reached_share", "stays_share"]
    steps = ["reached_step_median", "stays_step_median"]
    return tables.with_intervals(frame, columns)[[*_POPULATION, "n", *columns, *steps]]


def _display_region(frame: pd.DataFrame) -> pd.DataFrame:
    columns = ["precision", "recall", "overlap"]
    return tables.with_intervals(frame, columns)[[*_POPULATION, "n", "cells_marked", *columns]]


def _display_maps(frame: pd.DataFrame) -> pd.DataFrame:
    pings = frame[frame["action"] == "PING"]
    largest: pd.DataFrame = pings.groupby(list(_POPULATION), sort=False)[["value", "marked"]].max()
    return largest.reset_index()


# Figures


def _draw_summary(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.summary(frames["summary"], frames.get("contrasts"), frames["aggregate"], context)


def _draw_contrasts(frames: Frames, _: Context) -> "Figure | None":
    from benchmark.reports.comparison import figures

    return figures.contrasts(frames["contrasts"]) if "contrasts" in frames else None


def _draw_curves(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.curves(frames["curves"], context, "step", "environment step")


def _draw_curves_cpu(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.curves(frames["curves_cpu"], context, "cpu_time_s", "CPU time (s)")


def _draw_disagreements(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.disagreements(frames["curves"], context)


def _draw_aggregate(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.aggregate(frames["aggregate"], context)


def _draw_profile(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.profile(frames["profile"], replace(context, checks={}, check_note=""))


def _draw_improvement(frames: Frames, context: Context) -> "Figure | None":
    from benchmark.reports.comparison import figures

    return figures.improvement(frames["improvement"], context)


def _draw_threshold(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.threshold(frames["threshold"], context)


def _draw_region(frames: Frames, context: Context) -> "Figure":
    from benchmark.reports.comparison import figures

    return figures.region(frames["region"], context)


def _of_kind(frames: Frames, kind: str) -> list[Learner]:
    """Lists the learners whose maps hold action values, or probabilities."""
    if "maps" not in frames:
        return []
    frame = frames["maps"].drop_duplicates(list(_LEARNER))
    shown = frame[frame["kind"] == kind]
    return [Learner(*pair) for pair in zip(shown["algorithm"], shown["observation"], strict=True)]


def _valued(frames: Frames) -> list[Learner]:
    """Lists the learners whose action values are drawn: all but those with SB3's own settings."""
    return [learner for learner in _of_kind(frames, "q") if not learner.is_default]


def _draw_maps(frames: Frames, context: Context) -> "Figure | None":
    from benchmark.reports.comparison import figures

    learners = _valued(frames)
    if not learners:
        return None
    return figures.maps(frames["maps"], context.models, learners, "mean final Q of PING")


def _draw_maps_probability(frames: Frames, context: Context) -> "Figure | None":
    from benchmark.reports.comparison import figures

    learners = _of_kind(frames, "probability")
    if not learners:
        return None
    label = "mean final probability of PING"
    return figures.maps(frames["maps"], context.models, learners, label, (0.0, 1.0))


_COST: Final = Columns(
    file="cost.csv",
    caption="Cost of a run, measured: medians over all runs",
    keys=_LEARNER,
    numbers={
        "cpu_time_s": "CPU time (s)",
        "steps_per_cpu_s": "steps per CPU second",
        "updates": "updates",
        "parameters": "parameters",
        "peak_memory_mb": "peak memory (MB)",
    },
)


ITEMS: Final = (
    Item(
        name="aggregate",
        description="every learner over all scenarios: success, score, and the search behind its settings",
        compute=_aggregate,
        display=_display_aggregate,
        draw=_draw_aggregate,
        caption="Success and score over all scenarios, with 95 % intervals; beside each, the best enlarged.",
        view=Columns(
            file="aggregate.csv",
            caption="Every learner over all scenarios, after training",
            keys=_LEARNER,
            numbers={
                "success": "success probability",
                "score": "score, clipped",
                "settings_tried": "settings tried",
                "every_cell_success": "success from any cell",
                "unbounded_score": "score without bounds",
                "iqm": "its interquartile mean",
            },
        ),
    ),
    Item(
        name="contrasts",
        description="the contrasts of the protocol: differences, p-values adjusted by Holm, verdicts",
        section="protocol",
        compute=_contrasts,
        display=_display_contrasts,
        draw=_draw_contrasts,
        caption="The contrasts of the protocol, with intervals, margins and verdicts.",
        view=Columns(
            file="contrasts.csv",
            caption="The contrasts of the protocol: x against y",
            keys=("x", "y", "success_verdict", "score_verdict"),
            labels={"success_verdict": "verdict on success", "score_verdict": "verdict on score"},
            numbers={
                "n": "runs per scenario",
                "success_difference": "difference in success",
                "success_p_different": "p, no difference",
                "success_p_equivalent": "p, not equivalent",
                "success_deciding_runs": "runs to decide",
                "score_difference": "difference in score",
                "score_p_different": "p, no difference",
                "score_p_equivalent": "p, not equivalent",
            },
        ),
    ),
    Item(
        name="summary",
        description="each scenario and learner: runs, success, score, steps, wrong PINGs",
        compute=_summary,
        display=_display_summary,
        draw=_draw_summary,
        caption="How often each learner succeeds after training, and the verdicts.",
        view=Columns(
            file="summary.csv",
            caption="Each scenario and learner, after training",
            keys=_POPULATION,
            numbers={
                "n": "runs",
                "success": "success probability",
                "score": "score, clipped",
                "unbounded_score": "score without bounds",
                "steps": "steps",
                "wrong_pings": "wrong PINGs",
                "uncomfortable_steps": "uncomfortable steps",
                "every_cell_success": "success from any cell",
                "greedy_success": "success, greedy policy",
            },
        ),
    ),
    Item(
        name="curves",
        description="success, score and disagreements over training, against environment steps",
        compute=_curves,
        draw=_draw_curves,
        caption="Success probability over training, with its 95 % interval.",
    ),
    Item(
        name="scores",
        description="every run at the end of training",
        compute=_scores,
    ),
    Item(
        name="threshold",
        description=f"when, and in how many runs, the policy scores {GOOD_SCORE:g}",
        compute=_threshold,
        display=_display_threshold,
        draw=_draw_threshold,
        caption=f"How many runs reach a score of {GOOD_SCORE:g}, and when.",
        view=Columns(
            file="threshold.csv",
            caption=f"Runs that score {GOOD_SCORE:g} at some time, and those that stay there to the last "
            "evaluation; median step of each",
            keys=_POPULATION,
            numbers={
                "n": "runs",
                "reached_share": "share that reaches it",
                "reached_step_median": "median step",
                "stays_share": "share that stays",
                "stays_step_median": "median step to stay",
            },
        ),
        is_folded=True,
    ),
    Item(
        name="improvement",
        description="exploratory: probability that a run of one learner scores higher than one of another, "
        "each pair; of a check, only the pair with the learner that it checks",
        compute=_improvement,
        display=_display_improvement,
        draw=_draw_improvement,
        caption="Exploratory: probability that a run of one learner scores higher than one of another.",
        view=Columns(
            file="improvement.csv",
            caption="Exploratory, not tested: probability that a run of x scores higher than one of y",
            keys=("x", "y"),
            numbers={"probability": "probability"},
            where=_once,
            ends=_ENDS,
        ),
        is_folded=True,
    ),
    Item(
        name="profile",
        description="performance profiles, without checks: the share of runs that score at least a number",
        compute=_profile,
        display=_display_profile,
        draw=_draw_profile,
        caption="Performance profiles: the share of runs that score at least a number.",
        is_folded=True,
    ),
    Item(
        name="disagreements",
        description="the issuer's disagreements per 1,000 steps while agents learn",
        draw=_draw_disagreements,
        caption="The issuer's disagreements per 1,000 steps while agents learn.",
        is_folded=True,
    ),
    Item(
        name="region",
        description="how well the cells where an agent values PING match the target region",
        compute=_region,
        display=_display_region,
        draw=_draw_region,
        caption="How well the cells where an agent values PING match the target region.",
        view=Columns(
            file="region.csv",
            caption="Cells where an agent values PING, compared with the target region",
            keys=_POPULATION,
            numbers={
                "cells_marked": "cells marked",
                "precision": "precision",
                "recall": "recall",
                "overlap": "overlap",
            },
        ),
        is_folded=True,
    ),
    Item(
        name="maps",
        description="final values of every cell and action, without checks; figure: Q of PING, without "
        "learners that have SB3's own settings",
        compute=_maps,
        display=_display_maps,
        draw=_draw_maps,
        caption="Mean final Q of PING, of tables and nets.",
        is_folded=True,
    ),
    Item(
        name="maps_probability",
        description="probability of PING where the policy is stochastic",
        draw=_draw_maps_probability,
        caption="Mean final probability of PING where the policy is stochastic.",
        is_folded=True,
    ),
    Item(
        name="cost",
        description="cost of a run: CPU seconds, updates, parameters, peak memory of its process",
        section="cost",
        compute=_cost,
        display=whole,
        view=_COST,
        is_measured=True,
    ),
    Item(
        name="curves_cpu",
        description="success over training against CPU time",
        section="cost",
        compute=_curves_cpu,
        draw=_draw_curves_cpu,
        caption="Success probability against the CPU time spent on training.",
        is_measured=True,
    ),
    Item(
        name="learning",
        description="animation of learning: a table and a net, each the agent of the median seed",
        write=_write_film,
        files=("learning.webp",),
    ),
    *explorer_items(_shown),
    Item(
        name="findings",
        description="the sentences above; every number in them links to the rows that it comes from",
        tell=findings.table,
        is_measured=True,
    ),
)


def words(published: Published) -> Sequence[tuple[str, str]]:
    """Explains the terms of the tables."""
    manifest: Mapping[str, Any] = published.manifest
    summary = published.frame("summary")
    terms = [
        (
            "learner",
            "an algorithm with its settings and the form of observation that it learns from. Settings are in "
            "the experiment's TOML file; a name that ends in `_default` stands for Stable-Baselines3's own.",
        ),
        (
            "success",
            "the probability, evaluated exactly, that an episode from the start cell ends with a PING in the "
            "target region; a mean over runs. It is what verdicts rest on.",
        ),
        (
            "score",
            "undiscounted return by the grid's rewards, scaled between the exact random policy (0) and the "
            f"exact optimum (1), both under a limit of {manifest['horizon']} steps, and clipped to [0, 1] in "
            "every run. Without bounds a single failing run can outweigh many others, so that score is shown "
            "without an interval and decides nothing.",
        ),
        (
            "policy",
            "each algorithm is evaluated by one policy, which the experiment names: `greedy` takes the best "
            "or likeliest action, `stochastic` draws by the learned probabilities.",
        ),
        ("every_cell", "episodes start in a random cell (any but the issuer's) instead of the start cell."),
        *_words_of_checks(published),
        ("settings tried", "in the search for a learner's settings, which used other runs; 0: no search."),
        (
            "values PING",
            "Q of PING is above 0 and not what the table began with; of a stochastic policy, PING is the "
            "likeliest action.",
        ),
        (
            "probability of improvement",
            "that a run of the first learner scores higher than a run of the second in the same scenario. "
            "Scores are clipped, and a difference up to the protocol's margin is a tie, which counts half.",
        ),
        (
            "iqm",
            "interquartile mean by rliable: the mean score of the middle half of the runs, without bounds. "
            "It hides failures of fewer than a quarter of the runs.",
        ),
        (
            "intervals",
            "95 % intervals. Those of success, scores and other means of numbers in [0, 1] are exact "
            "binomial ones (Clopper and Pearson), those of their means over scenarios and differences follow "
            "from them (Zou and Donner 2008), those of the probability of improvement are Newcombe's (2006), "
            "and those of disagreements Student's. They are not corrected for their number; the verdicts "
            "are.",
        ),
        ("inf", "at least half of the runs never reached the threshold."),
        (
            "diverged",
            "a net whose values are no longer finite counts as the random policy from then on. "
            f"Diverged runs: {int(summary['diverged'].sum())}.",
        ),
    ]
    needed = {"inf": "threshold", "values PING": "region", "probability of improvement": "improvement"}
    left_out = {term for term, table in needed.items() if f"{table}.csv" not in published}
    if "every_cell_success" not in summary:
        left_out.add("every_cell")
    return [(term, text) for term, text in terms if term not in left_out]


def protocol_terms(
    published: Published, means: str = "means over scenarios, which weigh the same"
) -> Sequence[tuple[str, str]]:
    """Explains the protocol, as declared.

    Args:
      published: The folder of results.
      means: What is compared.
    """
    found = published.manifest["facts"].get("protocol")
    if found is None:
        return []
    arms: Mapping[str, Any] = published.manifest["algorithms"]
    by_policy: dict[str, list[str]] = {}
    for name, arm in arms.items():
        if not arm.get("check_of"):
            by_policy.setdefault(arm.get("policy", "greedy"), []).append(f"`{name}`")
    policies = "; ".join(f"{policy}: {', '.join(names)}" for policy, names in by_policy.items())
    origin = (
        "declared in the experiment's TOML file" if found["is_declared"] else "by default, see CONTRIBUTING"
    )
    contrasts = "; ".join(f"`{x}` against `{y}`" for x, y in found["contrasts"])
    return [
        ("contrasts", f"{contrasts} ({origin}). All other comparisons are exploratory."),
        *([("reference", f"`{found['reference']}`")] if found["reference"] else []),
        (
            "endpoints",
            f"first success, with a margin of {found['success_margin']:g}; second the clipped score, with a "
            f"margin of {found['score_margin']:g}; the score without bounds decides nothing. Both are "
            f"{means}.",
        ),
        ("policies", f"{policies}."),
        ("fewest runs", f"{found['fewest_runs']} per scenario and learner; with fewer there is no verdict."),
    ]


def _checks(published: Published) -> dict[str, Mapping[str, Any]]:
    """Returns the arms that are checks, by name."""
    return {name: arm for name, arm in published.manifest["algorithms"].items() if arm.get("check_of")}


def _words_of_checks(published: Published) -> Iterator[tuple[str, str]]:
    """Explains checks, if there are any."""
    if checks := _checks(published):
        pairs = ", ".join(f"`{name}` checks `{arm['check_of']}`" for name, arm in checks.items())
        deep = [arm for arm in checks.values() if arm.get("family") == "deep"]
        is_sb3 = bool(deep) and all("stable_baselines3" in arm["packages"] for arm in deep)
        sb3 = (
            "Nets are those of Stable-Baselines3 itself; denormal numbers count as zero, and Adam's step is "
            "fused. "
        )
        yield (
            "check",
            "a learner with the settings of another one, trained by another implementation: "
            f"{pairs}. {sb3 if is_sb3 else ''}Figures show it hollow, beside the learner that it checks. "
            "No verdict rests on it.",
        )


VERDICTS_TEXT: Final = (
    "A contrast compares two learners, x and y, by the mean over scenarios of x minus that of y. It is "
    "`equivalent` if two one-sided tests show that the difference is smaller than the margin to either side; "
    "otherwise `better` or `worse` if a two-sided test shows a difference, and `undecided` otherwise. All "
    "tests are at the 5 % level, with p-values adjusted for the number of contrasts by Holm's method, "
    "separately for differences and for equivalence, and for each endpoint. A difference can be significant "
    "and yet smaller than the margin; such learners are `equivalent`. Intervals are not adjusted, so an "
    "interval that excludes 0 can belong to an undecided contrast. `runs to decide` is how many runs per "
    "scenario and learner a new study would need to show a difference or equivalence with a power of about "
    "80 %, if the means stay as they are."
)

REPORT: Final = Report(
    name="comparison",
    question="When does deep RL earn its keep over a table?",
    check=check,
    load=load,
    items=ITEMS,
    sections=(
        Section(
            key="comparison",
            heading="Comparison",
            text=(
                "Success is the probability that an episode ends with a right PING. A score of 0 is the "
                "random policy and 1 the optimal one, and is clipped to [0, 1] in every run. Brackets hold "
                "95 % intervals over runs. A learner is an algorithm with its settings and the form of "
                "observation that it learns from; a name that ends in `_default` stands for "
                "Stable-Baselines3's own settings. A check has the settings of another learner and is "
                "trained by another implementation; no verdict rests on it. Numbers are for the policy that "
                "the protocol names, after training."
            ),
        ),
        Section(
            key="protocol",
            heading="Protocol and verdicts",
            text=VERDICTS_TEXT,
            terms=protocol_terms,
            terms_title="The protocol",
        ),
        Section(key="cost", heading="Cost"),
    ),
    headline=findings.headline,
    sentences=findings.sentences,
    words=words,
    lead="summary",
    packages=("rliable",),
)
