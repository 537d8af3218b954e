"""What does tuning buy, and what does it cost?

First, every trial of a learner runs in each of its scenarios. Then trial 0, which has the declared
settings, and the finalists, which are the best trials, run again with fresh seeds. The best of
these is chosen, so mere luck is not enough.

Trials are compared by their area: success averaged over the logarithm of steps, from the first
evaluation after training has begun to the end of the budget, and then over scenarios.
"""

import json
from collections.abc import Iterator, Mapping
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark.experiment import Experiment, Learner, digest_of_search
from benchmark.folder import Folder
from benchmark.specification import solved
from benchmark.statistics import ALPHA, BOOTSTRAP_SEED, Floats, student, with_ends
from benchmark.store import Store
from benchmark.study import Data, Report, described, learning, solved_of
from benchmark.style import WIDTH, figure_of, name_rows, note_beside
from benchmark.tables import Group, tables
from benchmark.trials import Choices, Chosen, Search, write_choices
from envs import InputError
from envs.inputs import override
from envs.words import listed

_MEASURE = "success averaged over the logarithm of steps"
_PERMUTATIONS = 10_000
_KINDS = ["default", "drawn", "candidate"]  # of trials
_DIGITS = 2  # means that differ less are equal, and the earlier trial counts
_MARGIN = 0.05  # smaller gains do not matter


def check(experiment: Experiment, _: Report) -> None:
    """Raises an InputError if there is no search, or if its runs are not measured as it needs."""
    where, given = experiment.argument, experiment.declared
    if given.search is None or given.solved is None:
        raise InputError(f"{where}: [search] or [solved] is missing; this report needs both.")
    for each in experiment.populations:
        budget, every = each.first.settings.budget, each.first.evaluation_every
        if budget <= every:
            found = f"{where}: {each.learner.name}: budget = {budget}"
            raise InputError(f"{found}: accepted: more than evaluation_every = {every}.")


def search_of(experiment: Experiment) -> Search:
    """Returns the declared search."""
    assert experiment.declared.search is not None  # see `check`
    return experiment.declared.search


# What is found for each learner


class Outcome(NamedTuple):
    """What a search has found for a learner."""

    learner: Learner
    runs: pd.DataFrame  # what `measured` returns, of its first runs
    first: pd.DataFrame  # mean areas of these, (trials, scenarios)
    fresh: pd.DataFrame  # areas of runs with fresh seeds, (trials that have some, scenarios, seeds)
    finalists: list[int]  # the best trials by the first runs
    picked: int  # the best trial by fresh runs; trial 0 before there are any


def ranked(means: "pd.Series[float]") -> list[int]:
    """Returns trials by their rounded means, the largest first; of equal ones, the first trial.

    >>> ranked(pd.Series({2: 0.304, 0: 0.3, 1: 0.5}))
    [1, 0, 2]
    """
    ordered = means.round(_DIGITS).sort_index().sort_values(ascending=False, kind="stable")
    return ordered.index.tolist()


def measured(experiment: Experiment, curves: pd.DataFrame) -> pd.DataFrame:
    """Returns a row per run: its `area`, its `budget`, and by how much success has risen.

    `steps` are those until it has learned, inf if it never has. What is reached only by the end of
    the budget counts as not learned.
    """
    level, parts = solved_of(experiment).success, []
    for _, own in curves.groupby("learner", sort=False):  # whose runs have the same evaluations
        steps = np.array(own["step"].unique())
        success = own["success"].to_numpy().reshape(-1, len(steps))
        log = np.log(steps[1:])
        area = np.trapezoid(success[:, 1:], log) / (log[-1] - log[0])
        learned = [solved(curve, [*steps], level)[0] for curve in success.tolist()]
        runs = own[["trial", "scenario", "learner", "seed"]][:: len(steps)]
        runs = runs.assign(area=area, budget=steps[-1], rise=success[:, -1] - success[:, 0])
        parts.append(runs.assign(steps=np.array([*steps[:-1], inf, inf])[learned]))
    return pd.concat(parts)


def outcomes(experiment: Experiment, curves: pd.DataFrame) -> Iterator[Outcome]:
    """Yields what the search has found for every learner, by the curves of its runs."""
    search, runs = search_of(experiment), measured(experiment, curves)
    for name, learner in experiment.learners.items():
        own = runs[runs["learner"] == name]
        is_fresh = own["seed"].isin(search.fresh)
        of_first, of_fresh = own[~is_fresh], own[is_fresh]
        names = [*own["scenario"].unique()]
        first = of_first.pivot_table("area", "trial", "scenario")[names]
        fresh = of_fresh.pivot(index="trial", columns=["scenario", "seed"], values="area")
        finalists = ranked(first.mean(axis=1))[: search.finalists]
        picked = 0
        if len(fresh):
            again = [*{0, *finalists}]
            n_runs = of_fresh["trial"].isin(again).sum()
            if n_runs != len(again) * len(names) * search.seeds:
                run = f"python -m benchmark run {experiment.argument}"
                lack = f"the tables lack fresh runs of finalists of {name}"
                raise InputError(f"{experiment.name}: {lack}; '{run}' publishes all.")
            picked = ranked(fresh.mean(axis=1)[again])[0]
        yield Outcome(learner, of_first, first, fresh, finalists, picked)


def stages(experiment: Experiment, store: Store) -> Iterator[list[Group]]:
    """Yields the runs of both stages; the first must be stored before the second is asked for."""
    first = [Group(each, each.runs()) for each in experiment.populations]
    yield first
    curves = tables(first, store)[1]
    # As published, so that the report finds the same
    curves["success"] = curves["success"].map("{:.6g}".format).astype(float)
    again = {each.learner.name: {0, *each.finalists} for each in outcomes(experiment, curves)}
    yield [
        Group(each, each.runs(search_of(experiment).fresh))
        for each in experiment.populations
        if each.keys["trial"] in again[each.learner.name]
    ]


@lru_cache(maxsize=1)
def found(data: Data) -> list[Outcome]:
    """Returns what the search has found for every learner."""
    return [*outcomes(data.experiment, data.curves)]


def write_chosen(experiment: Experiment, folder: Path) -> None:
    """Writes what was chosen, by published results, for experiments that name the search."""
    chosen = dict[str, Chosen]()
    published = Folder(folder)
    rows = published.tables()["chosen"].set_index("learner").to_dict("index")
    for name, learner in experiment.learners.items():
        row, tried = rows[name], experiment.declared.trials_of(learner.variant)
        own = experiment.declared.settings | learner.declared.settings
        kept = {key: value for key, value in own.items() if key not in ("budget", "time_limit")}
        settings = override(kept, tried[row["trial"]], name)
        effort = {key: row[key] for key in ("trial", "trials", "runs", "steps", "cpu_time_s")}
        chosen[name] = Chosen(settings=settings, score=row["chosen"], **effort)
    search, trials = digest_of_search(experiment.declared), published.files["trials.csv"]
    write_choices(experiment.path, Choices(search=search, trials=trials, learners=chosen))


# Tables


def trials_table(data: Data) -> pd.DataFrame:
    """Every trial of every learner: settings, and what runs with them reach."""
    search, frames = search_of(data.experiment), []
    for outcome in found(data):
        tried = data.experiment.declared.trials_of(outcome.learner.variant)
        trial = pd.Series(range(len(tried)))
        columns = {
            "learner": outcome.learner.name,
            "trial": trial,
            "kind": np.select([trial == 0, trial <= search.trials], _KINDS[:2], _KINDS[2]),
            "settings": [json.dumps(each) for each in tried],
            "area": outcome.first.mean(axis=1),
            "median_steps": outcome.runs.groupby("trial")["steps"].median(),
            "is_finalist": trial.isin(outcome.finalists),
            "fresh_area": outcome.fresh.mean(axis=1),
            "n_fresh": trial.isin(outcome.fresh.index) * outcome.fresh.shape[1],
            "is_chosen": trial == outcome.picked,
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def chosen(data: Data) -> pd.DataFrame:
    """The chosen settings of each learner, and what fresh runs with them reach."""
    search = search_of(data.experiment)
    n_finalists, rows = search.finalists * len(found(data)), []
    runs = measured(data.experiment, data.curves)
    rises = runs[runs["seed"].isin(search.fresh)].groupby(["learner", "trial"])["rise"].mean()
    for outcome in found(data):
        name, trial = outcome.learner.name, outcome.picked
        default, best = (
            outcome.fresh.loc[each].to_numpy().reshape(-1, search.seeds) for each in (0, trial)
        )
        p = p_of_gain(best, default) if trial else 1.0
        own = data.runs[data.runs["learner"] == name]
        before, after = (student(each.mean(axis=0)) for each in (default, best))
        row = {
            "learner": name,
            "trial": trial,
            **with_ends("default", before),
            **with_ends("chosen", after),
            "gain": after.value - before.value,
            "p": min(1.0, p * n_finalists),
            "rise": rises[name, trial],
            "trials": len(outcome.first) - 1,
            "runs": len(own),
            "steps": own["budget"].sum(),
            "cpu_time_s": round(own["cpu_time_s"].sum(), 3),
        }
        rows.append(row)
    table = pd.DataFrame(rows)
    is_gain = (table[["gain", "rise"]].min(axis=1) >= _MARGIN) & (table["p"] <= ALPHA)
    return table.assign(verdict=np.where(is_gain, "gain", "no gain shown"))


def p_of_gain(chosen: Floats, default: Floats) -> float:
    """Returns the one-sided p-value of no gain, by permutations of runs within scenarios.

    Both are (scenarios, seeds). The test is exact for any distribution; seeds that share random
    streams make it conservative.
    """
    rng, sums = np.random.default_rng(BOOTSTRAP_SEED), np.zeros(_PERMUTATIONS)
    for both in np.hstack([chosen, default]):
        drawn = rng.permuted(np.tile(both, (_PERMUTATIONS, 1)), axis=1)
        sums += drawn[:, : chosen.shape[1]].sum(axis=1)
    n_as_large = (sums >= chosen.sum() - 1e-9).sum()  # but for rounding
    return float((1 + n_as_large) / (1 + _PERMUTATIONS))


def effort(data: Data) -> pd.DataFrame:
    """Steps of search and training together, from nothing, until a run has learned.

    Once the cost of tuning counts, simple algorithms can outperform their successors: "Benchmarking
    RL should account for tuning", openreview.net/forum?id=816gaVGHgP. Candidates do not count:
    nobody knows what it took to find them.
    """
    rows, last = [], search_of(data.experiment).trials
    for outcome in found(data):
        runs = outcome.runs[outcome.runs["trial"] <= last]
        table = pd.DataFrame(_expected(own) for _, own in runs.groupby("scenario"))
        counts, means = table[["learned", "tried"]], table[["default", "total", "drawn"]]
        rows.append({"learner": outcome.learner.name, **counts.sum(), **means.mean()})
    return pd.DataFrame(rows)


def _expected(runs: pd.DataFrame) -> dict[str, float]:
    """Returns what it takes in a scenario, if trial 0 runs first, and if drawn trials alone run."""
    is_default, budget = runs["trial"] == 0, int(runs["budget"].iloc[0])
    default, others = (runs["steps"][which].to_numpy() for which in (is_default, ~is_default))
    drawn = expected_drawn(others, budget)
    return {
        "default": default.mean(),
        "learned": np.isfinite(others).sum(),
        "tried": len(others),
        "total": np.where(np.isfinite(default), default, budget + drawn).mean(),
        "drawn": drawn,
    }


def expected_drawn(steps: Floats, budget: int) -> float:
    """Returns the expected steps of runs that are drawn without replacement, until one has learned.

    If m of n learn, (n - m) / (m + 1) fail before, on average; such a run costs the budget. The
    argument, (n,), holds the steps until each run has learned, or inf if it never does.
    """
    learned = steps[np.isfinite(steps)]
    failures = (len(steps) - len(learned)) / (len(learned) + 1)
    return failures * budget + float(learned.mean()) if len(learned) else inf


# The figure


def groups_of(experiment: Experiment) -> dict[tuple[str, ...], list[Learner]]:
    """Returns the learners that were tried in the same scenarios, by their names."""
    groups = dict[tuple[str, ...], list[Learner]]()
    for learner in experiment.learners.values():
        names = learner.declared.scenarios or tuple(experiment.scenarios)
        groups.setdefault(names, []).append(learner)
    return groups


def figure(data: Data) -> Figure:
    """What trials reach; right: expected steps of search and training until a run has learned."""
    groups = groups_of(data.experiment)
    sizes = [len(learners) for learners in groups.values()]
    size = WIDTH, 0.23 * sum(sizes) + 0.5 * len(sizes) + 0.8
    with figure_of(len(groups), 1, size) as (figure, axes):
        axes[0, 0].get_gridspec().set_height_ratios(sizes)
        for axis, (scenarios, learners) in zip(axes[:, 0], groups.items(), strict=True):
            _draw_group(axis, learners, data.tables)
            axis.set_title(listed(scenarios), loc="left", fontweight="bold")
        axes[-1, 0].set_xlabel(f"{_MEASURE} (area)")
        marks = axes[0, 0].get_legend_handles_labels()
        figure.legend(*marks, loc="outside upper center", ncols=4, frameon=False)
    return figure


def _draw_group(axis: Axes, learners: list[Learner], tables: Mapping[str, pd.DataFrame]) -> None:
    """Draws the trials and the chosen settings of learners, a row for each."""
    names = [learner.name for learner in learners]
    both = tables["trials"], tables["chosen"]
    tried, best = (table[table["learner"].isin(names)] for table in both)
    rows, y = (table["learner"].map(names.index) for table in (tried, best))
    for kind, mark in {"drawn": "|", "candidate": "1"}.items():
        own = tried["kind"] == kind
        axis.plot(tried["area"][own], rows[own], mark, ms=7, color="0.55", label=f"{kind} trial")
    axis.plot(best["default"], y, "kx", ms=6, mew=1.8, label="defaults, fresh runs")
    axis.hlines(y, best["chosen_low"], best["chosen_high"], color="0.85", lw=8, zorder=0)
    axis.plot(best["chosen"], y, "o", color="0.2", ms=6, mec="white", label="chosen, 95 % interval")
    name_rows(axis, [learner.title for learner in learners])
    axis.set(xlim=(-0.02, 1.02))
    steps = tables["effort"].set_index("learner")["total"]
    for row, text in enumerate(["steps", *map(_steps, steps[names])], -1):
        note_beside(axis, row, text)


def _steps(number: float) -> str:
    """Returns a number of steps as readers see it."""
    return "never" if np.isinf(number) else f"{float(f'{number:.3g}'):,.0f}"


TABLES = {"trials": trials_table, "chosen": chosen, "effort": effort}
FIGURES = {"trials": figure}


# Text

SHOWN = {
    "chosen": "learner trial default chosen gain p verdict",
    "effort": "learner default learned tried total drawn",
}
COLUMNS = described(f"""\
area: {_MEASURE} and over scenarios, of first runs
chosen: mean area of the chosen settings, with fresh seeds
cpu_time_s: CPU seconds of training, sum over the runs of the search
default: mean area of trial 0 with fresh seeds; in `effort.csv`, its steps until it learns
drawn: `total` without trial 0
fresh_area: `area` with fresh seeds; NaN if the trial did not run again
gain: `chosen` minus `default`
is_chosen: whether its settings are chosen
is_finalist: whether it is among the best by first runs
kind: default, drawn or candidate (known to work before the search)
learned: first runs of drawn trials that have learned
median_steps: steps until a first run has learned, median; inf if half never do
n_fresh: runs with fresh seeds
p: p-value of no gain, times the number of all finalists
rise: success at the end of fresh runs with the chosen settings, minus that before training
runs: runs of the search, with fresh ones
settings: what the trial changes, as JSON
steps: budgets of all these runs
total: expected steps of search and training until a run has learned, mean over scenarios; inf if \
none may ever in one of them
trials: trials without trial 0
tried: first runs of drawn trials
verdict: whether a gain is shown, see README
""")


def headline(data: Data) -> str:
    """Says for how many learners a gain is shown, and which learners take the fewest steps."""
    table, steps = data.tables["chosen"], data.tables["effort"].set_index("learner")["total"]
    gains = table[table["verdict"] == "gain"]["gain"]
    shown = f"{len(gains) or 'none'} of {len(table)} learners"
    if len(gains):
        shown += f", by {gains.min():.2f} to {gains.max():.2f}"
    fewest = []
    for scenarios, learners in groups_of(data.experiment).items():
        nets = [learner.name for learner in learners if learner.algorithm.family == "deep"]
        sets = steps[[learner.name for learner in learners]], steps[nets]
        best = [
            f"{data.title(own.idxmin())} ({_steps(own.min())})"
            for own in sets
            if min(own, default=inf) < inf
        ]
        which = "; of nets, ".join(dict.fromkeys(best)) or "none, since none learns everywhere"
        fewest.append(f"- {listed(scenarios)}: {which}")
    lines = "\n".join(fewest)
    return f"""\
Settings chosen among {table["trials"].iloc[0]} trials besides the declared ones are shown to raise
{_MEASURE} for {shown} ({search_of(data.experiment).seeds} fresh runs in each scenario). Learners
are not compared with each other in this.

With the steps of the search included, these are expected to take the fewest steps until a run has
learned (means over scenarios):

{lines}"""


def reading(data: Data) -> str:
    """Says how trials are compared and chosen."""
    experiment, first = data.experiment, data.experiment.populations[0].first
    search, learners = search_of(experiment), experiment.learners.values()
    variant = next(iter(experiment.declared.algorithms.values()))
    budgets = {each.first.settings.budget for each in experiment.populations}
    greedy = "Success is that of the greedy policy"
    if stochastic := {each.declared.title for each in learners if each.policy == "stochastic"}:
        greedy += f", but of the stochastic one for {listed(sorted(stochastic))}"
    return f"""\
{learning(experiment)}
A run that reaches the level only in its last evaluation counts as one that never learns here.

Trials are compared by success averaged over the logarithm of steps, from {first.evaluation_every:,}
steps to the end of the budget ({" or ".join(f"{budget:,}" for budget in sorted(budgets))}), and
over the scenarios of the learner. Means are rounded to two digits, and of equal ones the earlier
trial counts. {greedy}.

Trial 0 has the declared settings, {search.trials} trials are points of a Sobol sequence, and
{len(variant.candidates)} are candidates, which were declared by hand. First runs of each in
each scenario: {variant.seeds}. The best {search.finalists} and trial 0 ran again with
{search.seeds} fresh seeds. The best of these is chosen, so its mean and gain are biased upwards.
For that, p-values are multiplied by the number of all finalists. A gain is shown if p is at most
0.05, and the gain and the rise of success in training are at least {_MARGIN:g}.
P-values are those of permutations of runs within scenarios. Intervals are Student's, of means over
scenarios by seed.

Right of the figure and in `effort.csv`, trial 0 runs first. If it does not learn, first runs of
drawn trials follow in random order until one has learned; candidates are left out. A run that
never learns costs the budget, even if it was given up."""
