"""What does tuning buy, and what does it cost?

First, every trial of every learner runs in all scenarios. Then trial 0, which has the declared
settings, and the finalists, which are the best trials of each part of the search, run again with
fresh seeds. The best of these is the pick of its part, so mere luck is not enough; trial 0 is a
candidate in the first part. The best pick is chosen.

Trials are compared by means over scenarios of a measure of each run: the area under its curve of
success or, with `[solved]`, how early it has learned.
"""

import json
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import chain
from math import inf
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydantic import Field

from benchmark.experiment import Experiment, Learner, digest_of_search
from benchmark.folder import Folder, digests
from benchmark.statistics import ALPHA, Estimate, Means, contrast, with_ends
from benchmark.store import Store
from benchmark.study import Data, Report, giving_up, learning
from benchmark.style import WIDTH, figure_of, name_rows
from benchmark.tables import Group, tables
from benchmark.trials import Choices, Chosen, Search, write_choices
from envs import InputError
from envs.inputs import override
from envs.words import listed

_DIGITS: Final = 2  # means that differ less are equal: the order of sums must not decide
_MEASURES: Final = {"area": "mean success over training", "earliness": "mean earliness of learning"}
_ALL: Final = "all"  # stands for all scenarios


class Declared(Report):
    """The table `[report]` of a search."""

    margin: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Smaller gains do not matter."""


def check(experiment: Experiment, _: Declared) -> None:
    """Refuses an experiment without a search."""
    if experiment.declared.search is None:
        raise InputError(
            f"{experiment.argument}: it has no table [search], which this report needs."
        )


def search_of(experiment: Experiment) -> Search:
    """Returns the declared search."""
    assert experiment.declared.search is not None  # see `check`
    return experiment.declared.search


# What is found for each learner


class Outcome(NamedTuple):
    """What a search has found for a learner."""

    learner: Learner
    first: pd.DataFrame  # means of the first runs, (trials, scenarios)
    fresh: pd.DataFrame  # means of the runs with fresh seeds, (trials that have some, scenarios)
    finalists: list[list[int]]  # the best trials of every part by the first runs
    picks: list[int]  # the best of these by fresh runs; none before the second stage


def ranked(means: "pd.Series[float]") -> list[int]:
    """Returns trials by their means, the largest first; of equal ones, the first trial.

    >>> ranked(pd.Series({2: 0.3, 0: 0.1 + 0.2, 1: 0.5}))
    [1, 0, 2]
    """
    ordered = means.round(_DIGITS).sort_index().sort_values(ascending=False, kind="stable")
    return [int(trial) for trial in ordered.index]


def measured(curves: pd.DataFrame) -> pd.DataFrame:
    """Returns a row per run: its `measure`, and by how much success has risen in training.

    With `[solved]`, it has the `steps` until a run has learned, inf if it never has. What is
    reached only by the end of the budget counts as not learned.
    """
    parts = []
    for _, own in curves.groupby("learner", sort=False):
        steps = own["step"].unique()
        success = own["success"].to_numpy().reshape(-1, len(steps))
        runs = own[["trial", "scenario", "learner", "seed"]][:: len(steps)]
        log = np.log(steps[1:])
        area = np.trapezoid(success[:, 1:], log) / (log[-1] - log[0])
        parts.append(runs.assign(rise=success[:, -1] - success[:, 0], measure=area))
    return pd.concat(parts)


def outcomes(experiment: Experiment, curves: pd.DataFrame) -> Iterator[Outcome]:
    """Yields what the search has found for every learner, by the curves of its runs."""
    search, runs = search_of(experiment), measured(curves)
    keys = ["trial", "scenario"]
    for name, learner in experiment.learners.items():
        own = runs[runs["learner"] == name]
        is_fresh = own["seed"].isin(search.fresh)
        first, fresh = (
            stage.groupby(keys)["measure"].mean().unstack().reindex(columns=[*experiment.scenarios])
            for stage in (own[~is_fresh], own[is_fresh])
        )
        first, fresh = first.dropna(axis=1, how="all"), fresh.dropna(axis=1, how="all")
        means, again = first.mean(axis=1), fresh.mean(axis=1, skipna=False)
        finalists = [ranked(means)[: search.finalists]]
        candidates = [[*{0, *finalists[0]}]]
        picks = [ranked(again[part])[0] for part in candidates] if len(again) else []
        yield Outcome(learner, first, fresh, finalists, picks)


def stages(experiment: Experiment, store: Store) -> Iterator[list[Group]]:
    """Yields the runs of both stages; the first must be stored before the second is asked for."""
    first = [Group(each, each.runs()) for each in experiment.populations]
    yield first
    curves = tables(first, store)[1]
    # As published, so that the report finds the same
    curves["success"] = curves["success"].map("{:.6g}".format).astype(float)
    found = outcomes(experiment, curves)
    again = {each.learner.name: {0, *chain(*each.finalists)} for each in found}
    yield [
        Group(each, each.runs(search_of(experiment).fresh))
        for each in experiment.populations
        if each.keys["trial"] in again[each.learner.name]
    ]


@lru_cache(maxsize=1)
def found(data: Data) -> list[Outcome]:
    """Returns what the search has found for every learner."""
    return [*outcomes(data.experiment, data.curves)]


def measure_of(data: Data) -> str:
    """Returns the name of what runs are compared by."""
    return "area" if data.experiment.declared.solved is None else "earliness"


def drawn_for(experiment: Experiment, learner: Learner) -> list[dict[str, object]]:
    """Returns what each trial of a learner draws, by dotted key."""
    return experiment.declared.trials_of(learner.variant)


def write_chosen(experiment: Experiment, folder: Path) -> None:
    """Writes what was chosen, by published results, for experiments that name the search."""
    tables = Folder(folder).tables()
    costs = tables["cost"].drop(columns="cpu_ms").set_index("learner").to_dict("index")
    chosen = dict[str, Chosen]()
    for name, learner in experiment.learners.items():
        rows = tables["chosen"][tables["chosen"]["learner"] == name]
        drawn = drawn_for(experiment, learner)
        own = experiment.declared.settings | learner.declared.settings
        kept = {key: value for key, value in own.items() if key not in ("budget", "time_limit")}
        picks = [
            Chosen(
                trial=trial, settings=override(kept, drawn[trial], name), score=score, **costs[name]
            )
            for trial, score in zip(rows["trial"], rows["chosen"], strict=True)
        ]
        (chosen[name],) = picks
    digest = digests(folder)["trials.csv"]
    search = digest_of_search(experiment.declared)
    write_choices(experiment.path, Choices(search=search, trials=digest, learners=chosen))


# Tables


def trials_table(data: Data) -> pd.DataFrame:
    """Every trial of every learner: settings, and means by scenario."""
    frames, measure = [], measure_of(data)
    for outcome in found(data):
        columns = {
            "learner": outcome.learner.name,
            "trial": outcome.first.index,
            "settings": [text_of(each) for each in drawn_for(data.experiment, outcome.learner)],
            measure: outcome.first.mean(axis=1),
            f"fresh_{measure}": outcome.fresh.mean(axis=1, skipna=False),
        }
        frames.append(pd.DataFrame(columns).join(outcome.first))
    return pd.concat(frames, ignore_index=True)


def text_of(settings: Mapping[str, object]) -> str:
    """Returns what a trial draws as JSON."""
    texts = [f"{key.split('.')[-1]} {json.dumps(value)}" for key, value in settings.items()]
    return ", ".join(texts) or "as declared"


def chosen(data: Data) -> pd.DataFrame:
    """The chosen settings of each learner, and what it reaches with them on fresh seeds."""
    texts = data.tables["trials"].set_index(["learner", "trial"])["settings"]
    margin, search = data.declared.margin, search_of(data.experiment)
    n_finalists = search.finalists * len(found(data))
    runs, rows = measured(data.curves), []
    rises = runs[runs["seed"].isin(search.fresh)].groupby(["learner", "trial"])["rise"].mean()
    for outcome in found(data):
        name, picks = outcome.learner.name, outcome.picks
        for part, trial in enumerate(picks, 1):
            means = (outcome.fresh.loc[each] for each in (trial, 0))
            x, y = (Means([*own], [search.seeds] * len(own)) for own in means)
            *gain, _, _, p, _ = contrast(x, y, margin) if trial else [0.0] * 5 + [1.0, 1.0]
            row: dict[str, object] = {"learner": name} | ({"part": part} if len(picks) > 1 else {})
            row |= {"trial": trial, "settings": texts[name, trial]}
            row |= with_ends("default", y.estimate) | with_ends("chosen", x.estimate)
            row |= with_ends("gain", Estimate(*gain)) | {"p": min(1.0, p * n_finalists)}
            row |= {"rise": rises[name, trial]}
            rows.append(row)
    table = pd.DataFrame(rows)
    is_large = table[["gain", "rise"]].min(axis=1).round(_DIGITS) >= margin
    is_gain = is_large & (table["chosen_low"] > random_of(data)) & (table["p"] <= ALPHA)
    return table.assign(verdict=np.where(is_gain, "gain", "no gain shown"))


def random_of(data: Data) -> float:
    """Returns the measure of the random policy, below which nothing has been learned."""
    if "random_success" not in data.runs:
        return 0.0  # with [solved], it never learns
    return float(data.runs.groupby("scenario")["random_success"].first().mean())


def effort(data: Data) -> pd.DataFrame | None:
    """Steps of search and training together, from nothing, until a run has learned.

    Once the cost of tuning counts, simple algorithms can outperform their successors: "Benchmarking
    RL should account for tuning", openreview.net/forum?id=816gaVGHgP.
    """
    if data.experiment.declared.solved is None:
        return None
    runs, budget = measured(data.curves), int(data.curves["step"].max())
    first = runs[~runs["seed"].isin(search_of(data.experiment).fresh)]
    keys = ["scenario", "learner"]
    groups = first.groupby(keys, sort=False)
    rows = [dict(zip(keys, key, strict=True)) | _expected(own, budget) for key, own in groups]
    table = pd.DataFrame(rows)
    sums = dict.fromkeys(("learned", "trials"), "sum")
    means = dict.fromkeys(("default", "total", "drawn"), "mean")
    over_all = table.groupby("learner", sort=False, as_index=False).agg(sums | means)
    return pd.concat([over_all.assign(scenario=_ALL), table], ignore_index=True)[[*table]]


def _expected(runs: pd.DataFrame, budget: int) -> dict[str, float]:
    """Returns what it takes in a scenario, if trial 0 runs first, and if other runs are drawn."""
    is_default = runs["trial"] == 0
    default, others = (runs["steps"][which].to_numpy() for which in (is_default, ~is_default))
    drawn = expected_drawn(others, budget)
    total = np.where(np.isfinite(default), default, budget + drawn).mean()
    numbers = {"default": default.mean(), "learned": int(np.isfinite(others).sum())}
    return numbers | {"trials": len(others), "total": float(total), "drawn": drawn}


def expected_drawn(steps: NDArray[np.float64], budget: int) -> float:
    """Returns the expected steps of runs that are drawn without replacement, until one has learned.

    If m of n learn, (n - m) / (m + 1) fail before, on average; such a run costs the budget. The
    argument, (n,), holds the steps until each run has learned, or inf if it never does.
    """
    learned = steps[np.isfinite(steps)]
    failures = (len(steps) - len(learned)) / (len(learned) + 1)
    return failures * budget + float(learned.mean()) if len(learned) else inf


def cost(data: Data) -> pd.DataFrame:
    """Cost of the search: first runs of all trials, and fresh runs of finalists and picks."""
    search, rows = search_of(data.experiment), []
    for learner, _, _, finalists, picks in found(data):
        own = data.runs[data.runs["learner"] == learner.name]
        is_compared = own["trial"].isin({*chain(*finalists), *picks})
        tried = own[is_compared | ~own["seed"].isin(search.fresh)]
        n_runs, cpu_time_s = len(tried), round(tried["cpu_time_s"].sum(), 3)
        row = {"learner": learner.name, "trials": search.trials, "runs": n_runs}
        row |= {"steps": tried["budget"].sum(), "cpu_time_s": cpu_time_s}
        rows.append(row | {"cpu_ms": 1000 * cpu_time_s / n_runs})
    return pd.DataFrame(rows)


# The figure


def figure(data: Data) -> Figure:
    """What each trial of the search reached, and what the chosen settings reach in fresh runs."""
    measure, learners = measure_of(data), data.experiment.learners
    drawn, chosen = data.tables["trials"].query("trial > 0"), data.tables["chosen"]
    rows, y = (table["learner"].map([*learners].index) for table in (drawn, chosen))
    with figure_of(1, 1, (WIDTH, 0.3 * len(learners) + 1.2)) as (figure, axes):
        axis = axes[0, 0]
        axis.plot(drawn[measure], rows, "|", ms=9, color="0.55", label="a trial")
        axis.plot(chosen["default"], y, "kx", ms=7, mew=2, label="trial 0, as declared")
        axis.hlines(y, chosen["chosen_low"], chosen["chosen_high"], color="0.7", lw=3)
        label = "chosen settings, 95 % interval"
        axis.plot(chosen["chosen"], y, "o", color="0.25", ms=7, mec="white", label=label)
        name_rows(axis, [learner.title for learner in learners.values()])
        axis.set(xlim=(-0.02, 1.0), xlabel=_MEASURES[measure])
        figure.legend(loc="outside upper center", ncols=3, frameon=False)
    return figure


TABLES: Final = {"trials": trials_table, "chosen": chosen, "effort": effort, "cost": cost}
FIGURES: Final = {"trials": figure}


# Text

SHOWN: Final = {
    "chosen": "learner part trial default chosen gain p verdict",
    "effort": "scenario learner default learned trials total drawn",
    "cost": "learner trials runs steps cpu_time_s cpu_ms",
}
COLUMNS: Final = {
    "area": "area under the curve of success, mean over scenarios and runs",
    "fresh_*": "the same with fresh seeds; NaN if the trial was not run again",
    "earliness": "share of the logarithm of the budget that is saved, mean over scenarios and runs",
    "chosen": "mean of the chosen settings, with fresh seeds",
    "cpu_ms": "CPU milliseconds of training per run of the search",
    "cpu_time_s": "CPU seconds of training, sum over the runs of the search",
    "default": "mean of trial 0 with fresh seeds; in `effort.csv`, its steps until it has learned",
    "drawn": "`total` without trial 0",
    "gain": "`chosen` minus `default`",
    "learned": "first runs of the other trials that have learned",
    "p": "p-value of no gain, times the number of all finalists",
    "part": "part of the search",
    "rise": "success at the end of fresh runs with the chosen settings, minus that before training",
    "runs": "first runs of all trials, and fresh runs of finalists and picks",
    "settings": "values of the searched settings, as JSON",
    "steps": "budgets of all these runs",
    "total": "expected steps of search and training until a run has learned; inf if none may ever",
    "trial": "number of the trial; 0 has the settings as declared",
    "trials": "trials without trial 0; in `effort.csv`, their first runs",
    "verdict": "whether a gain is shown, see above",
}


def headline(data: Data) -> str:
    """Says for which learners a gain is shown, and what is reached."""
    experiment, table = data.experiment, data.tables["chosen"]
    search, settings = search_of(experiment), experiment.populations[0].first.settings
    best = table.loc[table.groupby("learner", sort=False)["chosen"].idxmax()]
    budget = f"{settings.budget:,} {getattr(settings, 'budget_unit', 'steps')}"
    runs = f"mean over {listed(experiment.scenarios)}, {search.seeds} fresh seeds in each"
    if best["chosen"].max() <= 0:
        return f"""\
With settings chosen among {search.trials:,} trials, no run of any learner has learned before the
end of its {budget} ({runs}). {giving_up(data.experiment)}"""
    gaining = best[best["verdict"] == "gain"][["learner", "default", "chosen"]]
    gains = [
        f"{data.title(name)} ({before:.3g} to {after:.3g})"
        for name, before, after in gaining.itertuples(index=False)
    ]
    is_area = experiment.declared.solved is None
    random = f"The random policy has {random_of(data):.3g}. " if is_area else ""
    return f"""\
Settings chosen among {search.trials:,} trials {"are" if gains else "are not"} shown to raise
{_MEASURES[measure_of(data)]} ({budget}; {runs}) over that of the declared ones for
{listed(gains) or "any learner"}. A gain counts if it is above 0 at a level of 5 %, adjusted for all
finalists, and estimated at {data.declared.margin:g} or more, and if training with these settings
raises success by as much. {random}Learners are not compared with each other.
{giving_up(experiment)}"""


def reading(data: Data) -> str:
    """Says how trials are compared and chosen."""
    experiment, declared = data.experiment, data.experiment.declared
    search, level, first = search_of(experiment), declared.solved, experiment.populations[0].first
    learners = experiment.learners.values()
    stochastic = listed(each.title for each in learners if each.policy == "stochastic")
    if level is None:
        measure = """\
Trials are compared by the area under the curve of exact success: success averaged over training."""
        steps = ""
    else:
        measure = f"""\
Trials are compared by how early runs learn. {learning(experiment)}
Its earliness is 1 - log(*s*/*e*) /
log(*B*/*e*), at most 1, with *e* = {first.evaluation_every:,}; it is 0 if the run never learns, or
only at the end of the budget."""
        steps = """\
In effort.csv, trial 0 runs first. If it does not learn, first runs of the other trials are drawn,
without replacement, until one has learned. A run that never learns costs the budget, even if it was
given up. Numbers are expected steps, averaged over scenarios."""
    policy = f", but of the stochastic one for {stochastic}" if stochastic else ""
    return f"""\
{measure} Success is that of the greedy policy{policy}.

Trial 0 has the declared settings; the other {search.trials:,} trials are points of a Sobol
sequence. The best {search.finalists:,} and trial 0 ran again with {search.seeds:,} fresh
seeds in each of {len(experiment.scenarios)} scenarios. The best of these are chosen, so their
means and gains are biased upwards. For that, p-values are multiplied by the number of all
finalists. A gain is shown if p is at most 0.05, the gain and the rise of success in training are
at least {data.declared.margin:g}, and the interval of the chosen settings is above the random
policy. Intervals treat runs as independent, although trials share random streams.

{steps}"""
