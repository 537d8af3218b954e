"""Which learner succeeds more often after the same number of steps, and at what cost?

All is computed from two tables: `runs` has a row per run, `curves` one per run and evaluation. A
contrast is the difference of two learners, x minus y, in the mean over all scenarios, and its
verdict follows from a rule that is fixed before the runs, see `verdict`.
"""

from collections import Counter
from collections.abc import Mapping
from importlib.util import find_spec
from itertools import chain
from math import ceil
from typing import Annotated, Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from pydantic import Field
from scipy.stats import trim_mean

from benchmark import statistics, style
from benchmark.experiment import Experiment
from benchmark.statistics import (
    ALPHA,
    Contrast,
    Estimate,
    Floats,
    Means,
    differences,
    holm,
    wins,
    with_ends,
)
from benchmark.study import Data, Pairs, Report, described
from envs import InputError
from envs.inputs import Names, Table, unknown_name
from envs.packages import missing_package
from envs.words import listed

ENDPOINTS = ("success", "score")
FEWEST_RUNS = 10  # per scenario and learner; with fewer there is no verdict
WITHIN = "within margin"  # at its end, it may say which side is measurably better
NEITHER = "neither shown to learn"
UNEARNED = "ahead, but not shown to learn"
OPEN = ("undecided", NEITHER, UNEARNED, "no verdict")
AGGREGATES = ("iqm", "median", "mean", "optimality_gap")  # of deep RL
_DIGITS = 9  # of a difference, which may be as large as the margin
_DRAWS = 1_000  # of rliable's bootstrap
_COLUMNS = 3  # of panels
_TITLES = {"iqm": "interquartile\nmean", "optimality_gap": "optimality\ngap"}
_MOST_NAMED = 4  # contrasts without a decided difference in a text

Margin = Annotated[float, Field(gt=0, le=0.2)]
Row = Mapping[Any, Any]


# What an experiment declares


class Margins(Table):
    """Differences that are too small to matter."""

    success: Margin = 0.1
    """Of success."""
    score: Margin = 0.08
    """Of the score."""


class Declared(Report):
    """What a comparison decides and how; a learner is named as "dqn, one_hot"."""

    margins: Margins = Margins()
    """Differences that are too small to matter."""
    contrasts: Pairs = ()
    """Pairs x, y that are compared over all scenarios; figures show these learners, or else all."""
    curves: Names = ()
    """The learners in the figure of success over training, if not all that are compared."""


def check(experiment: Experiment, declared: Declared) -> None:
    """Raises an InputError if budgets differ, or an unknown learner is named."""
    check_packages(experiment)
    source, settings = experiment.argument, [each.first.settings for each in experiment.populations]
    budgets = {(each.budget, getattr(each, "budget_unit", "steps")) for each in settings}
    if len(budgets) > 1 or budgets.pop()[1] != "steps":
        accepted = "the same number of steps for all learners"
        raise InputError(f"{source}: settings.budget: accepted in a comparison: {accepted}.")
    for key in ("contrasts", "curves"):
        for name in np.ravel(getattr(declared, key)):
            if name not in experiment.learners:
                where = f"{source}: report.{key}"
                unknown_name(where, "learner", str(name), experiment.learners)


def check_packages(experiment: Experiment) -> None:
    """Raises an InputError, before any run, if `bootstrap` lacks a package."""
    if find_spec("rliable") is None:
        raise missing_package(f"{experiment.name}: its report", "rliable")


# Verdicts


def verdict(test: Contrast, margin: float, row: Row) -> str:
    """Returns the verdict on x against y, before scenarios are looked at one by one.

    The row of the contrast has the number of runs, and whether x and y are shown to have learned. A
    difference below the margin makes a learner at most *slightly* better, and one that is not
    shown to have learned is never better.
    """
    is_within, is_apart = test.p_equivalent <= ALPHA, test.p_different <= ALPHA
    if row["n"] < FEWEST_RUNS:
        return "no verdict"
    if not (is_within or is_apart):
        return "undecided"
    if not (row["learned_x"] or row["learned_y"]):
        return NEITHER
    word, ahead = ("better", "x") if test.difference > 0 else ("worse", "y")
    is_earned = row[f"learned_{ahead}"]
    if is_within:
        return f"{WITHIN}, but {word}" if is_apart and is_earned else WITHIN
    if not is_earned:
        return UNEARNED
    return word if abs(test.difference) >= margin else f"slightly {word}"


def decide(test: Contrast, margin: float, row: Row, x: Means, y: Means) -> tuple[str, list[int]]:
    """Returns the verdict, and the indices of scenarios that contradict it or may do so.

    If the difference in one of them contradicts it by the margin or more, it is *mixed*, since
    opposite differences must not cancel.
    """
    decided = verdict(test, margin, row)
    if decided in OPEN or len(x.means) == 1:
        return decided, []
    direction = decided.removeprefix("slightly ")
    found, unsure = statistics.standing_apart(x, y, margin, direction)
    return ("mixed", found) if found else (decided, unsure)


# The tables


def contrasts(data: Data) -> pd.DataFrame | None:
    """The declared contrasts, x against y: differences, p-values and verdicts."""
    named, scenarios = data.declared.contrasts, [*data.experiment.scenarios]
    if not named:
        return None
    cells = summary(data).set_index(["learner", "scenario"])
    of = {population.learner.name: population for population in data.experiment.populations}
    updates = data.runs.groupby("learner")["updates"].max()
    sides = [[cells.loc[name].loc[scenarios] for name in pair] for pair in named]
    p_random = [holm([*map(_p_random, own)]) for own in zip(*sides, strict=True)]
    rows = []
    for (x, y), both, *p_values in zip(named, sides, *p_random, strict=True):
        row = {"x": x, "y": y, "n": min(own["n"].min() for own in both)}
        row |= {"differs": differences(of[x], of[y], [own["diverged"].sum() for own in both])}
        for side, name, own, p in zip("xy", (x, y), both, p_values, strict=True):
            after, before = own["success"].mean(), own["untrained_success"].mean()
            least = min(data.declared.margins.success, after / 2)
            has_gained = updates[name] == 0 or round(after - before - least, _DIGITS) >= 0
            has_learned = p <= ALPHA and has_gained  # a planner, without updates, need not gain
            row |= {f"p_random_{side}": p, f"learned_{side}": has_learned}
        rows.append(row)
    for endpoint in ENDPOINTS:
        margin = getattr(data.declared.margins, endpoint)
        pairs = [(means_of(x, endpoint), means_of(y, endpoint)) for x, y in sides]
        tests, matrices = statistics.contrasts(pairs, margin), _matrices(data, endpoint)
        for row, (x, y), test in zip(rows, pairs, tests, strict=True):
            decided, apart = decide(test, margin, row, x, y)
            found = {
                "x": x.mean,
                "y": y.mean,
                **test._asdict(),
                "verdict": decided,
                "margin": margin,
                "except": ", ".join(scenarios[i] for i in apart),
                "p_improvement": wins(matrices[row["y"]], matrices[row["x"]][:, None]).mean(),
            }
            row |= {f"{endpoint}_{key}": value for key, value in found.items()}
    return pd.DataFrame(rows)


def means_of(cells: Any, column: str) -> Means:
    """Returns the means of a learner from its rows of the summary, one per scenario."""
    return Means(cells[column].tolist(), cells["n"].tolist())


def _p_random(cells: pd.DataFrame) -> float:
    """Returns the p-value of succeeding no more often than the random policy."""
    means = means_of(cells, "success")
    return statistics.p_above(means.weights, *means, cells["random_success"].mean())


def summary(data: Data) -> pd.DataFrame:
    """Each learner in each scenario, after training."""
    keys, per = ["scenario", "learner"], data.runs["budget"] / 1000
    runs = data.runs.assign(training_wrong_pings=data.runs["training_wrong_pings"] / per)
    runs["diverged"] = runs["diverged_at"] <= runs["budget"]
    groups, curves = runs.groupby(keys, sort=False), data.curves
    means = ["unbounded_score", "steps", "wrong_pings", "uncomfortable_steps", "greedy_success"]
    table = groups[["policy", "budget", "random_success"]].first()
    table.insert(1, "n", groups.size())
    table = table.join([over_runs(runs, keys), groups[means].mean(), groups["diverged"].sum()])
    untrained = curves[curves["step"] == 0].groupby(keys)["success"].mean()
    rates = groups["training_wrong_pings"]
    wrong = [with_ends(rates.obj.name, statistics.student(own.to_numpy())) for _, own in rates]
    table = table.join(pd.DataFrame(wrong, index=table.index).clip(lower=0))
    return table.join(untrained.rename("untrained_success")).reset_index()


def over_runs(frame: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    """Returns means over runs of success and score with their intervals."""
    groups = frame.groupby(keys, sort=False)[[*ENDPOINTS]]
    means, sizes = groups.mean(), np.array(groups.size())
    found: dict[str, Any] = {}
    for name in ENDPOINTS:
        ends = statistics.proportion_interval(means[name].to_numpy(), sizes)
        found |= with_ends(name, Estimate(means[name], *ends))
    return pd.DataFrame(found)


def aggregate(data: Data) -> pd.DataFrame:
    """Each learner after training, mean over scenarios; the most successful first."""
    rows = []
    for learner, cells in summary(data).groupby("learner", sort=False):
        row = {"learner": learner, "policy": cells["policy"].iloc[0], "runs": cells["n"].sum()}
        for name in ENDPOINTS:
            row |= with_ends(name, means_of(cells, name).estimate)
        rows.append(row)
    return pd.DataFrame(rows).sort_values("success", ascending=False, kind="stable")


def rliable(data: Data) -> pd.DataFrame:
    """Aggregate metrics of deep RL (Agarwal et al. 2021), over runs and scenarios."""
    rows = []
    for endpoint in ENDPOINTS:
        for learner, own in _matrices(data, endpoint).items():
            row = {"endpoint": endpoint, "learner": learner, "n": len(own)}
            rows.append(row | bootstrap(own))
    return pd.DataFrame(rows)


def _matrices(data: Data, endpoint: str) -> dict[str, Floats]:
    """Returns the results of each learner, (runs, scenarios), by its name."""
    return {
        str(learner): runs.pivot(index="seed", columns="scenario", values=endpoint).to_numpy()
        for learner, runs in data.runs.groupby("learner", sort=False)
    }


def aggregates(x: Floats) -> Floats:
    """Returns interquartile mean, median, mean and optimality gap of scores, (runs, scenarios).

    They are those of `rliable.metrics`, several times as fast.
    """
    mean = x.mean()
    return np.array([trim_mean(x, 0.25, axis=None), np.median(x.mean(axis=0)), mean, 1 - mean])


def bootstrap(scores: Any) -> dict[str, Any]:
    """Returns the columns of the aggregates of scores, (runs, scenarios), with their intervals.

    Runs are drawn anew within each scenario, by NumPy's global generator, which is seeded, and then
    set back.
    """
    from rliable.library import get_interval_estimates

    state = np.random.get_state()  # noqa: NPY002
    try:
        np.random.seed(0)  # noqa: NPY002
        points, ends = get_interval_estimates({"": scores}, aggregates, reps=_DRAWS)
    finally:
        np.random.set_state(state)  # noqa: NPY002
    columns = dict[str, Any]()
    for name, *estimate in zip(AGGREGATES, points[""], *ends[""], strict=True):
        columns |= with_ends(name, Estimate(*estimate))
    return columns


def progress(data: Data) -> pd.DataFrame:
    """Success and score over training, means over runs."""
    return over_runs(data.curves, ["scenario", "learner", "step"]).reset_index()


def cost(data: Data) -> pd.DataFrame:
    """Measured costs of a run: medians over all runs; the cheapest learner first."""
    groups = data.runs.groupby("learner", sort=False)
    names = ["cpu_time_s", "updates", "parameters", "peak_memory_mb"]
    table = groups[names].median()
    table.insert(0, "runs", groups.size())
    return table.sort_values("cpu_time_s", kind="stable").reset_index()


# The figures


def draw_contrasts(data: Data) -> Figure | None:
    """Differences in success with 95 % intervals, the margin (grey), and verdicts.

    Grey and hollow: no decided difference.
    """
    if "contrasts" not in data.tables:
        return None
    rows = list[style.Row]()
    for y, against in data.tables["contrasts"].groupby("y", sort=False):
        rows.append(style.Row(f"against {data.title(y)}", {}))
        for row in against.to_dict("records"):
            decided = row["success_verdict"]
            faded = {"color": "0.6", "mfc": "white"} if decided in OPEN else {}
            ends = statistics.ends_of("success_difference", row)
            look = data.look(row["x"]) | faded
            rows.append(style.Row(data.title(row["x"]), look, ends, decided))
    size = style.WIDTH, 0.19 * len(rows) + 0.8
    with style.figure_of(1, 1, size) as (figure, axes):
        axis, margin = axes[0, 0], data.declared.margins.success
        axis.axvspan(-margin, margin, color="0.92", lw=0)
        axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
        style.draw_rows(axis, rows)
        axis.set(xlabel="difference in success")
    return figure


def draw_curves(data: Data) -> Figure:
    """Mean success during training; shades: 95 % intervals."""
    shown = data.declared.curves or _drawn(data)
    table = data.tables["progress"]
    panels = [*table[table["learner"].isin(shown)].groupby("scenario", sort=False)]
    n_rows, n_columns = ceil(len(panels) / _COLUMNS), min(len(panels), _COLUMNS)
    with style.figure_of(n_rows, n_columns, (style.WIDTH, 2.3 * n_rows + 0.5)) as (figure, axes):
        for axis, (scenario, rows) in zip(axes.flat, panels, strict=False):
            ends = {}
            for learner, curve in rows.groupby("learner", sort=False):
                look, step = data.look(learner), curve["step"]
                axis.plot(step, curve["success"], **look, ms=4, markevery=0.2)
                shade = {"color": look["color"], "alpha": 0.1, "lw": 0}
                axis.fill_between(step, curve["success_low"], curve["success_high"], **shade)
                ends[data.title(learner)] = curve["success"].iloc[-1], look
            axis.set(title=scenario, xlim=(0, rows["step"].max()), ylim=(-0.03, 1.03))
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
        style.name_lines(axis, ends)
        figure.supxlabel("environment step")
        figure.supylabel("success")
    return figure


def draw_rliable(data: Data) -> Figure:
    """Aggregates of the score; bars are 95 % intervals of a bootstrap within scenarios."""
    table = data.tables["rliable"]
    table = table[table["learner"].isin(_drawn(data)) & (table["endpoint"] == "score")]
    size = style.WIDTH, 0.3 * len(table) + 1
    with style.figure_of(1, len(AGGREGATES), size) as (figure, axes):
        for axis, measure in zip(axes[0], AGGREGATES, strict=True):
            rows = [
                style.Row(data.title(name), data.look(name), statistics.ends_of(measure, row))
                for name, row in table.set_index("learner").to_dict("index").items()
            ]
            style.draw_rows(axis, rows, is_named=axis is axes[0, 0])
            axis.set(title=_TITLES.get(measure, measure))
            axis.locator_params(axis="x", nbins=2, min_n_ticks=1)
            axis.margins(x=0.15)
    return figure


def _drawn(data: Data) -> set[str]:
    """Returns all learners that are compared; without contrasts, all."""
    return {*chain(*data.declared.contrasts)} or {*data.experiment.learners}


# The text


def headline(data: Data) -> str:
    """Says which verdicts on success there are, and on which learners; x is named first."""
    if "contrasts" not in data.tables:
        return "No contrasts were declared, so there are no verdicts."
    table, scenarios = data.tables["contrasts"].fillna(""), data.experiment.scenarios
    counts = Counter(map(str, table["success_verdict"])).items()
    found = ", ".join(f"*{decided}* ({n})" for decided, n in counts)
    text = f"""\
After {data.runs["budget"].iloc[0]:,} steps of training in {listed(scenarios)}, the verdicts on
mean success over scenarios are {found}. The margin is {data.declared.margins.success:g}, the
level 5 %, and each of these learners has at least {table["n"].min()} runs in each scenario.
"""
    for decided, rows in table.groupby("success_verdict", sort=False):
        if decided in OPEN and len(rows) > _MOST_NAMED:
            text += f"\n- *{decided!s}*: {len(rows)} contrasts, see contrasts.csv"
        else:
            text += "".join(f"\n- {_sentence(data, row)}" for row in rows.to_dict("records"))
    return text


def _sentence(data: Data, row: Row) -> str:
    """Says what the verdict on a pair of learners is, and what else differs between them."""
    decided, apart = row["success_verdict"], row.get("success_except")
    numbers = f"{row['success_x']:.3g} against {row['success_y']:.3g}"
    where = f"{'' if decided == 'mixed' else 'perhaps '}contradicted in {apart}"
    details = "; ".join(filter(None, [numbers, row.get("differs"), apart and where]))
    return f"{data.title(row['x'])} against {data.title(row['y'])}: *{decided}* ({details})"


def reading(data: Data) -> str:
    """Says how the tables are made."""
    margins = data.declared.margins
    return f"""\
*Success* is the exact probability that an episode of at most {data.experiment.declared.horizon}
steps ends with a correct PING, by the policy after training; a learner that diverged acts at
random.

Contrasts compare x with y, averaged over scenarios. *Better* and *worse*
require a significant difference whose estimate is at least the margin, {margins.success:g} of
success and {margins.score:g} of the score; with *slightly*, it is smaller. *Within margin* means
that two one-sided tests show a difference below the margin; *but better* and *but worse*, that it
is significant nevertheless. *Mixed* means that a scenario contradicts the verdict by the margin or
more. A learner is shown to learn if it succeeds significantly more often than the random policy,
and than before training by the margin, or twice as often, unless it plans without any updates.
Otherwise it is never called better
(*{NEITHER}*, *{UNEARNED}*). With fewer than {FEWEST_RUNS} runs per learner and scenario, there
is *no verdict*.

Tests are at the 5 % level. P-values are adjusted by Holm's method, separately for each endpoint,
and for differences and margins; intervals are not. Verdicts are valid only if the runs are looked
at once."""


TABLES = {
    table.__name__: table for table in (progress, contrasts, summary, aggregate, rliable, cost)
}
FIGURES = {"curves": draw_curves, "contrasts": draw_contrasts, "rliable": draw_rliable}
SHOWN = {
    "contrasts": "x y success_x success_y success_verdict score_verdict success_except differs",
    "aggregate": "learner policy runs success score",
    "cost": "learner cpu_time_s updates parameters peak_memory_mb",
}
COLUMNS = described("""\
n: runs in each scenario, of a contrast the smaller number
runs: runs over all scenarios
p_random_x: p-value of x succeeding no more often than the random policy, adjusted
p_random_y: p-value of y succeeding no more often than the random policy, adjusted
learned_x: whether x is shown to learn, see README
learned_y: whether y is shown to learn, see README
diverged: runs that diverged, and act at random
untrained_success: success before training
*_difference: * of x minus that of y
*_low_90: lower end of the 90 % interval of *
*_high_90: upper end of the 90 % interval of *
*_p_different: p-value of no difference in *, adjusted
*_p_equivalent: p-value of a difference in * of the margin or more, adjusted
*_verdict: verdict on x by *
*_margin: difference in * that is too small to matter
*_except: scenarios that contradict the verdict by *, or where it is not shown
training_wrong_pings: wrong PINGs per 1,000 steps of training
endpoint: what is aggregated
iqm: interquartile mean over runs and scenarios
median: median over scenarios of the mean over runs
mean: mean over runs and scenarios
optimality_gap: mean distance from 1
*_p_improvement: share of pairs of runs in which x has more * than y; a tie counts half
""")
