"""Which learner needs fewer steps, and where?

A map asks, at every point of its grids, what a run takes until it has learned. Two learners are
compared by the probability that the first takes less, over pairs of runs of the same seed, which
have the same draw of the scenario; ties count as a half. Pairs are independent, so the mean of
these numbers, each 0, 1/2 or 1, has the interval of a proportion.

In each unit, the probability of any wrong verdict is at most 5 %: which learner takes less is
decided by Holm's method (1979), in thirds of the error, since a verdict can be wrong at either end
of an interval, or at that of a share of runs that learn. That no winner is wrong assumes that
contrasts are independent (Shaffer 1980, Annals of Statistics 8:1342-1347); otherwise, it is known
from simulation.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, compress
from math import prod
from textwrap import fill
from typing import Annotated, Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, LogLocator, NullLocator
from numpy.typing import NDArray
from pydantic import Field

from benchmark import specification
from benchmark.experiment import Experiment, Population
from benchmark.statistics import (
    ALPHA,
    BOOTSTRAP_SEED,
    RESAMPLES,
    Estimate,
    differences,
    holm,
    median,
    p_half,
    proportion,
    proportion_interval,
    wins,
    with_ends,
)
from benchmark.study import (
    Data,
    FigureFunction,
    Pairs,
    Report,
    TableFunction,
    giving_up,
    learning,
    solved_of,
)
from benchmark.style import WIDTH, Row, draw_rows, figure_of
from envs import InputError
from envs.inputs import Label, Names, Table, unknown_name

Numbers = NDArray[np.float64]
Key = tuple[str, str, str]
Pair = Mapping[str, pd.DataFrame]  # runs of x and of y, by seed
_WRONG: Final = "training_wrong_pings"
KEYS: Final = ["grid", "point", "learner"]  # the columns that name a population

# What an experiment declares


class Panel(Table):
    """Learners that figures show under a heading."""

    title: Annotated[Label, Field(min_length=1)]
    """Their heading."""
    grid: str
    """The grid, with one axis, along which the map shows them."""
    learners: Annotated[Names, Field(min_length=1)]
    """Their names; some may run at the answer only."""


class Answer(Table):
    """A point at which another figure shows all learners of the panels that run there."""

    grid: str
    """Its grid."""
    point: str
    """Its name in tables: "places 64". It has unseen places."""
    unseen: str = ""
    """A grid with one axis, along which another figure shows success in unseen places."""


class Margins(Table):
    """The smallest effects that count; with a smaller one, there is no verdict."""

    probability: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    """Distance of the probability of taking less from 1/2."""
    ratio: Annotated[float, Field(gt=1)] = 1.1
    """Ratio of the medians of steps, or of wrong PINGs, if most runs of both learn."""
    unseen: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """Difference in mean success in unseen places."""


class Declared(Report):
    """The contrasts that a map decides, and what its figures show."""

    contrasts: Annotated[Pairs, Field(min_length=1)]
    """Pairs of learners x, y that are compared, with verdicts, wherever there are both."""
    margins: Margins = Margins()
    """The smallest effects that count."""
    panels: Annotated[tuple[Panel, ...], Field(min_length=1)]
    """What the figure of the map shows."""
    answer: Answer | None = None
    """What the figure of the answer shows; without it, there is no figure."""


def check(experiment: Experiment, declared: Declared) -> None:
    """Raises an InputError if grids, contrasts, budgets, seeds or figures do not fit a map."""
    where, given = experiment.argument, experiment.declared
    for key, value in {"[grids]": given.grids, "[solved]": given.solved}.items():
        if not value:
            raise InputError(f"{where}: {key} is missing; this report needs it.")
    if len(experiment.scenarios) > 1:
        raise InputError(f"{where}: scenarios: {len(experiment.scenarios)}: accepted: exactly one.")
    _check_names(experiment, declared)
    for contrast in declared.contrasts:
        pairs = compared(experiment, [contrast])
        efforts = [{(side.seeds, side.first.settings.budget) for side in pair} for pair in pairs]
        if not pairs or any(len(both) > 1 for both in efforts):
            found = f"report.contrasts: {' and '.join(contrast)}"
            rule = "two learners in one compared grid, with the same seeds and budget"
            raise InputError(f"{where}: {found}: accepted: {rule}.")


def _check_names(experiment: Experiment, declared: Declared) -> None:
    """Raises an InputError if there is no such learner, grid or point."""
    panels, answers = declared.panels, [declared.answer] if declared.answer else []
    learners = chain(*declared.contrasts, *(panel.learners for panel in panels))
    grids = [panel.grid for panel in panels] + [answer.unseen for answer in answers]
    flat = [name for name, grid in experiment.declared.grids.items() if len(grid.axes) == 1]
    points = [each for each in experiment.populations if each.scenario.issuer.unseen]
    used = {
        "learner": (learners, experiment.learners),
        "grid with one axis": (filter(None, grids), flat),
        "point with unseen places": (
            [f"{answer.grid}, {answer.point}" for answer in answers],
            {", ".join(key_of(point)[:2]) for point in points},
        ),
    }
    for kind, (names, accepted) in used.items():
        for name in names:
            if name not in accepted:
                unknown_name(f"{experiment.argument}: report", kind, name, accepted)


# Populations


def key_of(population: Population) -> Key:
    """Returns the columns that name a population: its grid, its point there, and its learner."""
    grid, point, learner = (str(population.keys[name]) for name in KEYS)
    return grid, point, learner


def compared(
    experiment: Experiment, contrasts: Iterable[tuple[str, str]]
) -> list[tuple[Population, Population]]:
    """Lists both populations of each contrast at each compared point that has both."""
    known = {key_of(each): each for each in experiment.populations}
    grids = experiment.declared.grids
    points = dict.fromkeys(key[:2] for key in known if grids[key[0]].is_compared)
    pairs = [((*point, x), (*point, y)) for point in points for x, y in contrasts]
    return [(known[x], known[y]) for x, y in pairs if {x, y} <= known.keys()]


def _by_key(data: Data) -> dict[Any, pd.DataFrame]:
    """Returns the runs of each population by seed, with what they took."""
    runs = data.runs.merge(data.tables["took"], on=[*KEYS, "seed"])
    groups = runs.assign(failures=1 - runs["unseen_success"]).groupby(KEYS, sort=False)
    return {key: own.set_index("seed") for key, own in groups}


# What runs took


def took(data: Data) -> pd.DataFrame:
    """Every run: what it took until it had learned, and whether it has lost that later."""
    level = solved_of(data.experiment).success
    groups = data.curves.groupby(KEYS, sort=False)[["seed", "step", "success", _WRONG]]
    tables = groups.apply(lambda curves: pd.DataFrame(until_learned(curves, level)))
    return tables.reset_index(KEYS).reset_index(drop=True)


def until_learned(curves: pd.DataFrame, level: float) -> dict[str, NDArray[Any]]:
    """Returns what the runs of a population took until they had learned, by seed.

    `steps` and `wrong_pings` are infinite if a run never learned; `_before` is the evaluation
    before. A run has `lost` the level if success is below it in half or more of the later
    evaluations, or of the later steps, or at the end. Runs that reach it `at_last` do so in the
    last evaluation only.
    """
    steps = curves["step"].unique()
    success, wrong_pings = (
        curves[name].to_numpy().reshape(-1, len(steps)) for name in ("success", _WRONG)
    )
    last, is_there = len(steps) - 1, success >= level
    first = np.array([specification.solved(row, [*steps], level)[0] for row in success.tolist()])
    table: dict[str, NDArray[Any]] = {"seed": curves["seed"].unique()}
    for name, spent in {"steps": steps + 0 * wrong_pings, "wrong_pings": wrong_pings}.items():
        own, before = (spent[range(len(spent)), at.clip(0, last)] for at in (first, first - 1))
        table |= {name: np.where(first > last, np.inf, own), f"{name}_before": before}
    is_after, is_lost = np.arange(last + 1) > first[:, None], (first < last) & ~is_there[:, last]
    for weight in (np.ones(last + 1), np.diff(steps, prepend=0)):  # of evaluations, and of steps
        below = (is_after & ~is_there) @ weight
        is_lost |= (below > 0) & (below >= is_after @ weight / 2)
    return table | {"lost": is_lost, "at_last": first == last, "untrained": first == 0}


def cells(data: Data) -> pd.DataFrame:
    """Every point and learner: the share of runs that learn, and medians of what they take."""
    runs, rows = _by_key(data), list[dict[str, Any]]()
    for population in data.experiment.populations:
        own = runs[key_of(population)]
        is_learned = np.isfinite(own["steps"].to_numpy())
        row: dict[str, Any] = dict(zip(KEYS, key_of(population), strict=True))
        row |= {"n": len(own), "budget": own["budget"].iloc[0], "n_solved": is_learned.sum()}
        row |= with_ends("solved", proportion(is_learned))
        for name in ("steps", "wrong_pings"):
            row |= with_ends(name, median(own[name].to_numpy()))
        rows.append(row | with_ends("unseen_budget", proportion(own["unseen_success"].to_numpy())))
    return pd.DataFrame(rows)


def needed(cell: "pd.Series[Any]") -> str:
    """Returns how many steps a cell's learner needs (median), for a text."""
    if np.isfinite(cell["steps"]):
        return f"{cell['steps']:,.0f}"
    n_learned = f"{cell['n_solved']:.0f} of {cell['n']:.0f} runs learn"
    return f"more than {cell['budget']:,.0f} ({n_learned})"


def cpu(data: Data) -> pd.DataFrame:
    """Measured: median CPU seconds of training until a run has learned."""
    times = data.runs.groupby(KEYS, sort=False)["cpu_learned_s"]
    rows = [{"n": len(own)} | with_ends(times.obj.name, median(own.to_numpy())) for _, own in times]
    return times.first().index.to_frame(index=False).join(pd.DataFrame(rows))


# Which of two learners took less


def contrasts(data: Data) -> pd.DataFrame:
    """The declared contrasts: which learner takes less until it has learned."""
    runs, rows = _by_key(data), list[dict[str, Any]]()
    pairs = dict[str, Pair]()  # by their runs: a contrast in two grids is decided once
    for x, y in compared(data.experiment, data.declared.contrasts):
        pair = {"x": runs[key_of(x)], "y": runs[key_of(y)]}
        pairs[key := " ".join(chain(*(own["run"] for own in pair.values())))] = pair
        of_x, of_y = (own["steps"].to_numpy() for own in pair.values())
        diverged = [(own["diverged_at"] <= own["budget"]).sum() for own in pair.values()]
        row: dict[str, Any] = dict(zip(("grid", "point", "x"), key_of(x), strict=True))
        row |= {"y": y.learner.name, "key": key, "n": len(of_x)}
        row |= {"differs": differences(x, y, diverged)}
        row |= {"learned_x": np.isfinite(of_x).sum(), "learned_y": np.isfinite(of_y).sum()}
        rows.append(row | with_ends("ratio", ratio(of_x, of_y, x.first.settings.budget)))
    table = pd.DataFrame(rows)
    for unit in UNITS:
        having = {key: pair for key, pair in pairs.items() if pair["x"][unit].notna().all()}
        if having:
            table = table.join(decide_all(having, unit, data.declared.margins), on="key")
    return table.drop(columns="key")


def ratio(x: Numbers, y: Numbers, budget: int) -> Estimate:
    """Returns the median steps of y divided by those of x, over pairs of runs.

    Where at least half of the runs never learn, the budget counts, so the ratio is a bound. It is
    NaN if this holds for both learners, or if a median is 0. The interval resamples pairs.
    """
    rng, n = np.random.default_rng(BOOTSTRAP_SEED), len(x)
    drawn = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
    below, above = (np.median(steps[drawn], axis=1) for steps in (x, y))
    if not 0 < min(below[0], above[0]) < np.inf:
        return Estimate(np.nan, np.nan, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):  # some runs may have learned at step 0
        samples = np.minimum(above, budget) / np.minimum(below, budget)
    return Estimate(samples[0], *np.nanpercentile(samples[1:], [2.5, 97.5]))


# By unit: the columns of the verdict, of why there is none, and of the probability that x takes
# less, and the verdicts if x or y takes less
UNITS: Final = {
    "steps": ("verdict", "why_none", "faster", ("faster", "slower")),
    "wrong_pings": (
        "wrong_pings_verdict",
        "wrong_pings_why",
        "fewer_wrong_pings",
        ("fewer", "more"),
    ),
    "failures": ("failures_verdict", "failures_why", "fewer_failures", ("fewer", "more")),
}
UNDECIDED: Final = "undecided"
NEITHER: Final = "most runs of neither learner learn"
NO_VERDICT: Final = "no verdict"  # for one of these reasons
UNTRAINED: Final = "it depends on runs whose untrained policy reaches the level"
AT_LAST: Final = "it depends on runs that reach the level in the last evaluation only"
COARSE: Final = "it depends on runs whose evaluations are too far apart"
NOT_LEARNED: Final = "at least half of the runs of the one that takes less never learn"
LOST: Final = (
    "the one that takes less loses the level later in at least half of the runs that learn"
)
SMALL: Final = "the difference is smaller than the margin"
_ENDS: Final = 3  # if a verdict is wrong, so is one of three ends of intervals, see above
_MOST_NAMED: Final = 4  # verdicts of any kind in a text
_COARSE: Final = 1.25  # largest ratio of successive evaluations that are not too far apart


def decide_all(pairs: Mapping[str, Pair], unit: str, margins: Margins) -> pd.DataFrame:
    """Decides contrasts in a unit: columns of `UNITS`, by the keys of pairs of runs."""
    parts = [evidence(pair, unit, margins) for pair in pairs.values()]
    found: Any = pd.DataFrame(parts, index=[*pairs])
    verdict, why, less, words = UNITS[unit]
    adjusted = np.array(holm((_ENDS * found["p_known"]).clip(upper=1)))
    n_open, tail = (adjusted > ALPHA).sum(), ALPHA / _ENDS / len(found)
    cases = {
        words[0]: (adjusted <= ALPHA) & (found["less"] > 0.5),
        words[1]: adjusted <= ALPHA,
        NO_VERDICT: _ENDS * n_open * found["p"] <= ALPHA,
        NEITHER: proportion_interval(found["never"], found["n"], tail)[0] > 0.5,
    }
    decided = np.select([*cases.values()], [*cases], UNDECIDED)
    table = {verdict: decided, why: found["why"].where(decided == NO_VERDICT, "")}
    ends = proportion_interval(found["less"], found["n"], tail)
    return pd.DataFrame(table | with_ends(less, Estimate(found["less"], *ends)), index=[*pairs])


def evidence(pair: Pair, unit: str, margins: Margins) -> dict[str, object]:
    """Returns what pairs of runs say in a unit, not adjusted for the number of contrasts.

    `less` is the share of pairs in which x takes less, and `p` its one-sided p-value; `p_known` is
    the same, whatever open pairs may be, or 1 if a winner would have no verdict. `never` is the
    share of runs that never learn, of the learner with fewer of them.
    """
    x, y, n = pair["x"][unit].to_numpy(), pair["y"][unit].to_numpy(), len(pair["x"])
    won, reasons = wins(x, y), _open(pair, unit)
    less = won.mean()
    worst = np.where(reasons != "", less < 0.5, won).mean()
    winner, loser = ("x", "y") if less > 0.5 else ("y", "x")
    why = _flaw(pair[winner], pair[loser], unit, margins)
    if abs(less - 0.5) < margins.probability:
        why = SMALL
    is_known = not why and (worst - 0.5) * (less - 0.5) > 0
    return {
        "n": n,
        "less": less,
        "p": p_half(less, n),
        "p_known": p_half(worst, n) if is_known else 1.0,
        "why": why or next((each for each in (UNTRAINED, AT_LAST, COARSE) if each in reasons), ""),
        "never": min(np.isinf(x).mean(), np.isinf(y).mean()),
    }


def _open(pair: Pair, unit: str) -> NDArray[np.str_]:
    """Returns why it is not known which run of each pair took less; empty if it is.

    What a run took lies between two evaluations. One that reaches the level in the last evaluation
    only may have learned then, or never.
    """
    if unit == "failures":
        return np.full(len(pair["x"]), "")
    x, y = pair["x"], pair["y"]
    before, is_learned = f"{unit}_before", np.isfinite(x[unit]) & np.isfinite(y[unit])
    overlaps = is_learned & (x[unit] > y[before]) & (y[unit] > x[before])
    is_coarse = (x[unit] > _COARSE * x[before]) | (y[unit] > _COARSE * y[before])
    is_at_last = (x["at_last"] & (x[unit] <= y[unit])) | (y["at_last"] & (y[unit] <= x[unit]))
    cases = [x["untrained"] | y["untrained"], is_at_last, overlaps & is_coarse]
    return np.select(cases, [UNTRAINED, AT_LAST, COARSE], "")


def _flaw(winner: pd.DataFrame, loser: pd.DataFrame, unit: str, margins: Margins) -> str:
    """Returns why the one that takes less wins nothing; empty if it does."""
    has_learned = np.isfinite(winner["steps"])
    if has_learned.mean() <= 0.5:
        return NOT_LEARNED
    if (has_learned & ~winner["untrained"]).mean() <= 0.5:
        return UNTRAINED
    if unit == "failures":
        gain = loser[unit].mean() - winner[unit].mean()
        return SMALL if round(gain, 9) < margins.unseen else ""
    if winner["lost"][has_learned].mean() >= 0.5:
        return LOST
    less, more = winner[unit].median(), loser[unit].median()
    return "" if more > less and more >= round(margins.ratio * less, 9) else SMALL


TABLES: Final[dict[str, TableFunction]] = {
    "took": took,
    "cells": cells,
    "contrasts": contrasts,
    "cpu": cpu,
}

# Figures


def answer(data: Data) -> Figure | None:
    """Steps until learners have learned, and success in unseen places, at one point."""
    declared = data.declared.answer
    if declared is None:
        return None
    panels = _panels_in(data, declared.grid)
    n_rows = sum(1 + len(panel.learners) for panel in panels)
    with figure_of(1, 2, (WIDTH, 1 + 0.3 * n_rows)) as (figure, axes):
        left, right = axes[0]
        for axis, column in ((left, "steps"), (right, "unseen_budget")):
            cells = _shown(data, declared.grid, column)
            cells = cells[cells["point"] == declared.point].set_index("learner")
            rows = list[Row]()
            for panel in panels:
                rows.append(Row(panel.title, {}))
                rows += [_row(data, cells.loc[name]) for name in panel.learners]
            draw_rows(axis, rows, is_named=axis is left)
        left.set_title(f"{declared.point} ({declared.grid})", loc="left")
        left.set(xscale="log", xlabel="steps until it\nhas learned (← better)")
        _format_steps(left.xaxis)
        right.set(xlim=(0, 1.02), xticks=(0, 0.5, 1), xlabel="success in unseen\nplaces (better →)")
    return figure


def _row(data: Data, cell: "pd.Series[Any]") -> Row:
    """Returns a cell as a row of the figure; its marker is hollow if it is infinite."""
    hollow = {"mfc": "white"} if cell["is_never"] else {}
    title, ends = fill(data.title(cell.name), 34), (cell["value"], cell["low"], cell["high"])
    return Row(title, data.look(cell.name) | hollow, ends, cell["text"])


def _panels_in(data: Data, grid: str) -> list[Panel]:
    """Returns the panels as they are in another grid: learners that run there, each once."""
    ran = {*_shown(data, grid, "steps")["learner"]}
    panels = list[Panel]()
    for panel in data.declared.panels:
        learners = tuple(name for name in panel.learners if name in ran)
        ran -= {*learners}
        if learners:
            panels.append(panel.model_copy(update={"grid": grid, "learners": learners}))
    return panels


def _shown(data: Data, grid: str, column: str) -> pd.DataFrame:
    """Returns a column of the cells of a grid as it is drawn, with its interval and its text."""
    cells = data.tables["cells"]
    cells = cells[cells["grid"] == grid]
    shown = cells[[column, f"{column}_low", f"{column}_high"]]
    texts = shown[column].map("{:.2f}".format)
    if column == "steps":
        learned = cells["n_solved"].astype(str) + " of " + cells["n"].astype(str) + " learn"
        texts = shown[column].map("{:,.0f}".format).where(np.isfinite(shown[column]), learned)
        shown = shown.clip(data.experiment.declared.evaluation_every, cells["budget"], axis=0)
    shown = shown.set_axis(["value", "low", "high"], axis=1)
    names, is_never = cells[["point", "learner"]], np.isinf(cells[column])
    return shown.join(names).assign(text=texts, is_never=is_never)


def _format_steps(axis: Axis) -> None:
    axis.set_major_locator(LogLocator(subs=(1, 3)))
    axis.set_major_formatter(EngFormatter(sep=""))
    axis.set_minor_locator(NullLocator())


def picture(data: Data) -> Figure:
    """Steps until learners have learned, medians with 95 % intervals; hollow: half never learn."""
    return _panels(data, data.declared.panels, "steps", "steps until it has learned")


def unseen(data: Data) -> Figure | None:
    """Success in unseen places at the end of training, means with 95 % intervals."""
    grid = data.declared.answer and data.declared.answer.unseen
    if not grid:
        return None
    return _panels(data, _panels_in(data, grid), "unseen_budget", "success in unseen places")


def _panels(data: Data, panels: Sequence[Panel], column: str, label: str) -> Figure:
    """Draws a column of the cells along the axis of each panel's grid, two panels in a row."""
    n_rows, n_columns = -(-len(panels) // 2), min(len(panels), 2)
    n_learners = len({name for panel in panels for name in panel.learners})
    with figure_of(n_rows, n_columns, (WIDTH, 2.9 * n_rows + 0.15 * n_learners)) as (figure, axes):
        lines = dict[str, Line2D]()
        for axis, panel in zip(axes.flat, panels, strict=False):
            axis.sharey(axes[0, 0])
            lines |= _draw_panel(data, axis, panel, column)
            axis.set_title(panel.title, loc="left")
            if column == "steps":
                axis.set_yscale("log")
                _format_steps(axis.yaxis)
            else:
                axis.set_ylim(0, 1.03)
        for axis in axes[:, 0]:
            axis.set_ylabel(label)
        figure.legend(lines.values(), lines, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _draw_panel(data: Data, axis: Axes, panel: Panel, column: str) -> dict[str, Line2D]:
    """Draws learners beside each other at each value of a grid's axis; returns lines by title."""
    ((name, values),) = data.experiment.declared.grids[panel.grid].axes.items()
    numbers = sorted(values, key=lambda value: prod(map(float, value.split("x"))))
    places = {f"{name} {value}": i for i, value in enumerate(numbers)}
    cells, lines = _shown(data, panel.grid, column), dict[str, Line2D]()
    cells["at"] = cells["point"].map(places)
    shown = [learner for learner in panel.learners if learner in {*cells["learner"]}]
    for learner, shift in zip(shown, np.linspace(-0.2, 0.2, len(shown)), strict=True):
        rows, own = cells[cells["learner"] == learner].sort_values("at"), data.look(learner)
        x, y = rows["at"] + shift, rows["value"]
        axis.vlines(x, rows["low"], rows["high"], color=own["color"], lw=4, alpha=0.35)
        (lines[data.title(learner)],) = axis.plot(x, y, **own, lw=1.5)
        hollow, is_never = {"mfc": "white", "ls": ""}, rows["is_never"]
        axis.plot(x[is_never], y[is_never], **own | hollow)
    axis.set_xticks(range(len(numbers)), numbers)
    axis.set(xlim=(-0.5, len(numbers) - 0.5), xlabel=name)
    return lines


FIGURES: Final[dict[str, FigureFunction]] = {"answer": answer, "map": picture, "unseen": unseen}

# Text

SHOWN: Final = {
    "contrasts": (
        "grid point x y n learned_x learned_y verdict why_none ratio differs failures_verdict"
    ),
    "cells": "grid point learner n solved steps wrong_pings unseen_budget",
}
COLUMNS: Final = {
    "at_last": "whether the run reaches the level in the last evaluation only",
    "cpu_learned_s": "CPU seconds of training until a run has learned, median; inf if half do not",
    "failures_verdict": "the verdict on x by failures in unseen places at the end",
    "failures_why": "why there is no verdict by failures",
    "faster": "probability that x takes fewer steps",
    "fewer_failures": "probability that x fails less often in unseen places at the end",
    "fewer_wrong_pings": "probability that x takes fewer wrong PINGs",
    "grid": "grid of the experiment",
    "learned_x": "runs of x that learn",
    "learned_y": "runs of y that learn",
    "lost": "whether success is below the level later: at the end, or for half of the time",
    "n": "runs; of contrasts, pairs of runs",
    "n_solved": "runs that learn",
    "point": "point of the grid",
    "ratio": "median steps of y / of x; a bound, with the budget, if one never learns",
    "solved": "share of runs that learn",
    "steps": "steps until a run has learned, or their median; inf if it never does",
    "steps_before": "steps of the evaluation before",
    "unseen_budget": "success in unseen places at the end of training",
    "untrained": "whether the untrained policy reaches the level",
    "verdict": "the verdict on x by steps",
    "why_none": "why there is no verdict by steps",
    "wrong_pings": "wrong PINGs until a run has learned, or their median; inf if it never does",
    "wrong_pings_before": "wrong PINGs at the evaluation before",
    "wrong_pings_verdict": "the verdict on x by wrong PINGs until a run has learned",
    "wrong_pings_why": "why there is no verdict by wrong PINGs",
}


def headline(data: Data) -> str:
    """Says how the contrasts of the first grid ended, by steps."""
    table, margins = data.tables["contrasts"].fillna(""), data.declared.margins
    grid, cells = table["grid"].iloc[0], data.tables["cells"]
    table = table[table["grid"] == grid]
    n_decided = table["verdict"].isin(UNITS["steps"][-1]).sum()
    budgets = " or ".join(f"{n:,}" for n in cells[cells["grid"] == grid]["budget"].unique())
    groups = [*table.groupby(["x", "y", "verdict", "why_none", "differs"], sort=False)]
    is_named = [len(groups) <= _MOST_NAMED or names[2] != UNDECIDED for names, _ in groups]
    lines = [_sentence(data, names, rows) for names, rows in compress(groups, is_named)]
    if not all(is_named):
        lines.append(f"- All others in this grid are {UNDECIDED}, see contrasts.csv.")
    text = "\n".join(lines)
    return f"""\
In the grid `{grid}`, one learner is faster in {n_decided} of {len(table)} contrasts: it needs fewer
steps until success is at or above {solved_of(data.experiment).success:g}, at every evaluation until
the first one at or after twice as many steps, or to the end of all {budgets} steps.
{giving_up(data.experiment)}

{text}

*Faster* and *slower* require a significant difference at the 5 % level, a probability of taking
less that differs from 1/2 by {margins.probability:g} or more, and medians that differ by a factor
of {margins.ratio:g} or more."""


def _sentence(data: Data, names: Iterable[object], rows: pd.DataFrame) -> str:
    """Says what the verdict on two learners is at some points, why, and what else differs."""
    (x, y, verdict, why, differs), points = map(str, names), []
    for row in rows.to_dict("records"):
        learned = f"{row['learned_x']} and {row['learned_y']} runs learn"
        points.append(f"{row['point']} ({learned})")
    also = differs and f"also different: {differs}"
    details = "; ".join(filter(None, [f"{rows['n'].min()} pairs of runs", also, why]))
    sides = f"{data.title(x)} compared with {data.title(y)}"
    return f"- {sides}: {verdict} at {', '.join(points)}; {details}."


def reading(data: Data) -> str:
    """Explains learning, contrasts and unseen places."""
    margins, solved = data.declared.margins, solved_of(data.experiment)
    return f"""\
{learning(data.experiment)}
Successive evaluations, except the first ones, are at most about {100 * (solved.growth - 1):.0f} %
apart. What happens later is measured only in runs trained to the budget, for example where there
are unseen places. In figures, hollow markers mean that at least half of the runs never learn.

Contrasts pair runs of the same seed, which have the same draw of the scenario. A run that never
learns takes more than every run that does; two such runs are tied, and a tie counts as a half.
*Faster* and *fewer* mean that x takes less, *slower* and *more* that y does: the probability of
taking less differs from 1/2 significantly, and by {margins.probability:g} or more; the other's
median of steps or wrong PINGs is at least {margins.ratio:g} times as large, or its success in
unseen places lower by {margins.unseen:g} or more; and the learner that takes less has learned, by
training, in more than half of its runs and, except for unseen places, has not lost the level in
half of these (at the end, or in half of the later evaluations or steps). There is *no verdict* if a
significant difference fails another condition, or depends on runs whose evaluations are too far
apart, or that reach the level only in the last evaluation or untrained. *{NEITHER.capitalize()}* is
said only if no difference is significant.

The probability of any wrong verdict is at most 5 % for each of steps, wrong PINGs, and failures in
unseen places at the end of training (Holm's method; if contrasts share runs, this is known from
simulation). Intervals in `contrasts.csv`, those of its first step, hold for all contrasts at
once."""
