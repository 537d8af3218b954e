"""What must one know for a table or tile coding to do?

A map asks, at every point of its grids, what a run takes until it has learned, and how it does
where training never was: in new places, and among onlookers who stand in new ways. Two learners are
compared over pairs of runs of the same seed, which have the same draw of the scenario: by the
probability that the first takes less; ties count as a half. Pairs are independent, so the mean of
these numbers, each 0, 1/2 or 1, has the interval of a proportion.

A *ladder* has rungs: what learners are told. On each, tile coding is compared with nets that are
told the same.

For each of steps, new places and new ways, the probability of any wrong verdict is at most 5 %:
which learner takes less is decided by Holm's method (1979), in thirds of the error, since a verdict
can be wrong at either end of an interval, or at that of a share of runs that learn. That no winner
is wrong assumes that contrasts are independent (Shaffer 1980, Annals of Statistics 8:1342-1347);
otherwise, it is known from simulation.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain, product
from math import prod
from typing import Annotated, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, NullLocator
from numpy.typing import NDArray
from pydantic import Field

from benchmark import specification
from benchmark.experiment import Experiment, Population
from benchmark.records import random_success
from benchmark.statistics import (
    ALPHA,
    Estimate,
    Floats,
    differences,
    holm,
    median,
    p_half,
    proportion,
    proportion_interval,
    wins,
    with_ends,
)
from benchmark.study import Data, Pairs, Report, described, giving_up, learning, solved_of
from benchmark.style import WIDTH, Look, figure_of
from envs import InputError, compile_scenario
from envs.inputs import Label, Names, Table, unknown_name

Pair = Mapping[str, pd.DataFrame]  # runs of x and of y, by seed
_WRONG = "training_wrong_pings"
KEYS = ["grid", "point", "learner"]  # the columns that name a population
NEW = ("unseen", "new_way")  # where training never was
_SUCCESSES = [f"{unit}_success" for unit in NEW]

# What an experiment declares


class Rung(Table):
    """What learners are told, and who is compared there."""

    title: Annotated[Label, Field(min_length=1)]
    """What they are told."""
    tiles: str
    """The learner by tile coding."""
    nets: dict[Label, str] = Field(default_factory=dict)
    """Nets that are told the same, by what readers call them; figures show the first."""


class Ladder(Table):
    """Rungs, each with more knowledge than the one before."""

    grids: Annotated[Names, Field(min_length=1)]
    """The grids where they are compared. Figures show all points; a learner that runs at one point
    only is shown at each as it is there."""
    rungs: Annotated[tuple[Rung, ...], Field(min_length=1)]
    """The rungs."""


class Panel(Table):
    """Learners that a figure shows under a heading, along the only axis of a grid."""

    title: Annotated[Label, Field(min_length=1)]
    """Their heading."""
    grid: str
    """The grid."""
    learners: Annotated[Names, Field(min_length=1)]
    """Their names."""


class Margins(Table):
    """The smallest effects that count; with a smaller one, there is no verdict."""

    probability: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    """Distance of the probability of taking less from 1/2."""
    ratio: Annotated[float, Field(gt=1)] = 1.1
    """Ratio of the medians of steps, if most runs of both learn."""
    success: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """Difference in mean success in new places, or in new ways."""


class Declared(Report):
    """The contrasts that a map decides, and what its figures show."""

    contrasts: Pairs = ()
    """Pairs of learners x, y that are compared, with verdicts, wherever there are both. On a
    ladder, nets are compared with tile coding as well."""
    margins: Margins = Margins()
    """The smallest effects that count."""
    ladder: Ladder | None = None
    """The rungs of the table and the figure of this name; by default there are none."""
    panels: tuple[Panel, ...] = ()
    """What the other figure shows; without any, there is none."""

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """All pairs that are compared, those of the ladder first."""
        rungs = self.ladder.rungs if self.ladder else ()
        of_rungs = [(net, rung.tiles) for rung in rungs for net in rung.nets.values()]
        return [*dict.fromkeys([*of_rungs, *self.contrasts])]


def check(experiment: Experiment, declared: Declared) -> None:
    """Raises an InputError if grids, contrasts, budgets, seeds or figures do not fit a map."""
    where, grids, ladder = experiment.argument, experiment.declared.grids, declared.ladder
    if not grids:
        raise InputError(f"{where}: [grids] is missing; this report needs it.")
    solved_of(experiment)
    if len(experiment.scenarios) > 1:
        raise InputError(f"{where}: scenarios: {len(experiment.scenarios)}: accepted: exactly one.")
    on_ladder, rungs = (ladder.grids, ladder.rungs) if ladder else ((), ())
    shown = chain.from_iterable(panel.learners for panel in declared.panels)
    flat = [name for name, grid in grids.items() if len(grid.axes) == 1]
    drawn = chain(on_ladder, (panel.grid for panel in declared.panels))
    named = chain(*declared.pairs, shown, (rung.tiles for rung in rungs))
    for kind, names, accepted in (
        ("grid with one axis", drawn, flat),
        ("learner", named, experiment.learners),
    ):
        for name in names:
            if name not in accepted:
                unknown_name(f"{where}: report", kind, name, accepted)
    if not declared.pairs:
        raise InputError(f"{where}: report.contrasts is missing; this report needs it.")
    for contrast in declared.pairs:
        pairs = compared(experiment, [contrast])
        efforts = [{(side.seeds[0], side.first.settings.budget) for side in pair} for pair in pairs]
        if not pairs or any(len(both) > 1 for both in efforts):
            found = f"report.contrasts: {' and '.join(contrast)}"
            rule = "two learners in one grid, with the same first seed and budget"
            raise InputError(f"{where}: {found}: accepted: {rule}.")


# Populations


def key_of(population: Population) -> tuple[object, ...]:
    """Returns the columns that name a population: its grid, its point there, and its learner."""
    return tuple(population.keys[name] for name in KEYS)


def compared(
    experiment: Experiment, contrasts: Sequence[tuple[str, str]]
) -> list[tuple[Population, Population]]:
    """Lists both populations of each contrast at each point that has both."""
    known = {key_of(each): each for each in experiment.populations}
    points = dict.fromkeys(key[:2] for key in known)
    pairs = [((*point, x), (*point, y)) for point in points for x, y in contrasts]
    return [(known[x], known[y]) for x, y in pairs if {x, y} <= known.keys()]


def _by_key(data: Data) -> dict[Any, pd.DataFrame]:
    """Returns the runs of each population by seed, with what they took."""
    runs = data.runs.merge(data.tables["took"], on=[*KEYS, "seed"])
    failures = {unit: 1 - runs[f"{unit}_success"] for unit in NEW}
    groups = runs.assign(**failures).groupby(KEYS, sort=False)
    return {key: own.set_index("seed") for key, own in groups}


# What runs took


def took(data: Data) -> pd.DataFrame:
    """What every run took."""
    level = solved_of(data.experiment).success
    groups = data.curves.groupby(KEYS, sort=False)[["seed", "step", "success", _WRONG]]
    tables = groups.apply(lambda curves: pd.DataFrame(until_learned(curves, level)))
    return tables.reset_index(KEYS).reset_index(drop=True)


def until_learned(curves: pd.DataFrame, level: float) -> dict[str, NDArray[Any]]:
    """Returns what the runs of a population took until they had learned, by seed.

    `steps` and `wrong_pings` are infinite if a run never learned; `steps_before` is the evaluation
    before. A run has `lost` the level if success is below it in half or more of the later
    evaluations, or of the later steps, or at the end. Runs that reach it `at_last` do so in the
    last evaluation only.
    """
    steps, seeds = curves["step"].unique(), curves["seed"].unique()
    success, wrong_pings = (
        curves[name].to_numpy().reshape(len(seeds), -1) for name in ("success", _WRONG)
    )
    last, is_there = len(steps) - 1, success >= level
    first = np.array([specification.solved(row, [*steps], level)[0] for row in success.tolist()])
    at, is_after = first.clip(max=last), np.arange(last + 1) > first[:, None]
    is_lost = (first < last) & ~is_there[:, last]
    for weight in (np.ones(last + 1), np.diff(steps, prepend=0)):  # of evaluations, and of steps
        below = (is_after & ~is_there) @ weight
        is_lost |= (below > 0) & (below >= is_after @ weight / 2)
    return {
        "seed": seeds,
        "steps": np.where(first > last, np.inf, steps[at]),
        "steps_before": steps[(first - 1).clip(0)],
        "wrong_pings": np.where(first > last, np.inf, wrong_pings[range(len(at)), at]),
        "lost": is_lost,
        "at_last": first == last,
        "untrained": first == 0,
    }


def cells(data: Data) -> pd.DataFrame:
    """How many runs learn, and medians."""
    runs, rows = _by_key(data), []
    for population in data.experiment.populations:
        own = runs[key_of(population)]
        is_learned = np.isfinite(own["steps"].to_numpy())
        row: dict[str, Any] = dict(zip(KEYS, key_of(population), strict=True))
        row |= {"n": len(own), "budget": own["budget"].iloc[0], "n_solved": is_learned.sum()}
        row |= {"n_at_last": own["at_last"].sum()} | with_ends("solved", proportion(is_learned))
        for name in ("steps", "wrong_pings"):
            row |= with_ends(name, median(own[name].to_numpy()))
        for name in _SUCCESSES:
            row |= with_ends(name, proportion(own[name].to_numpy()))
        rows.append(row)
    return pd.DataFrame(rows)


def needed(cell: "pd.Series[Any]") -> str:
    """Returns how many steps a cell's learner needs (median), for a text."""
    if np.isfinite(cell["steps"]):
        return f"{cell['steps']:,.0f}"
    n_learned = f"{cell['n_solved']:.0f} of {cell['n']:.0f} runs learn"
    return f"more than {cell['budget']:,.0f} ({n_learned})"


def rungs(data: Data) -> pd.DataFrame | None:
    """The rungs of the ladder, then chance."""
    ladder = data.declared.ladder
    if ladder is None:
        return None
    cells, rows = data.tables["cells"].set_index(KEYS), []
    for rung, (*where, tiles) in product(ladder.rungs, cells.index):
        if tiles == rung.tiles and where[0] in ladder.grids:
            nets = [each for each in rung.nets.items() if (*where, each[1]) in cells.index]
            rows += [(rung.title, *where, *net, tiles) for net in nets or [("none", "")]]
    rows.append(("chance", *[""] * 5))
    point, at = KEYS[:2], [*KEYS[:2], "x", "y"]
    table = pd.DataFrame(rows, columns=["rung", *point, "net", "x", "y"])
    table = table.join(cells["budget"], on=[*point, "y"])
    for side, learner in (("tiles", "y"), ("net", "x")):
        shown = cells[["n", "n_solved", "steps", *_SUCCESSES]].add_prefix(f"{side}_")
        table = table.join(shown, on=[*point, learner])
        table.loc[table.index[-1], [f"{side}_{name}" for name in _SUCCESSES]] = _chance(data)
    tests = data.tables["contrasts"].set_index(at)
    wins = tests.filter(like="steps_wins").rename(columns=lambda name: f"net_{name[6:]}")
    table = table.join(wins, on=at).join(tests["steps_verdict"], on=at)
    return table.drop(columns=["grid", "x", "y"])


def _chance(data: Data) -> float:
    """Returns the random policy's success, which is the same in old and new places on average."""
    (scenario,) = data.experiment.scenarios.values()
    return random_success(compile_scenario(scenario), data.experiment.declared.horizon)


# Which of two learners took less


def contrasts(data: Data) -> pd.DataFrame:
    """The declared contrasts, with verdicts."""
    runs, rows = _by_key(data), list[tuple[object, ...]]()
    pairs = dict[str, Pair]()  # by their runs: a contrast in two grids is decided once
    for x, y in compared(data.experiment, data.declared.pairs):
        of_x, of_y = runs[key_of(x)], runs[key_of(y)]
        both = of_x.index.intersection(of_y.index)
        pair = {"x": of_x.loc[both], "y": of_y.loc[both]}
        pairs[key := " ".join(chain(*(own["run"] for own in pair.values())))] = pair
        diverged = [(own["diverged_at"] <= own["budget"]).sum() for own in pair.values()]
        learned = [np.isfinite(own["steps"]).sum() for own in pair.values()]
        row = *key_of(x), y.learner.name, key, len(both), *learned, differences(x, y, diverged)
        rows.append(row)
    names = ["grid", "point", "x", "y", "key", "n", "learned_x", "learned_y", "differs"]
    table = pd.DataFrame(rows, columns=names)
    for unit in UNITS:
        having = {key: pair for key, pair in pairs.items() if pair["x"][unit].notna().all()}
        if having:
            table = table.join(decide_all(having, unit, data.declared.margins), on="key")
    return table.drop(columns="key")


# What is taken, steps or failures, and the verdicts if x or y takes less
UNITS = {"steps": ("faster", "slower")} | dict.fromkeys(NEW, ("better", "worse"))
UNDECIDED = "undecided"
NEITHER = "most runs of neither learner learn"
NO_VERDICT = "no verdict"  # for one of these reasons
UNTRAINED = "it depends on runs whose untrained policy reaches the level"
AT_LAST = "it depends on runs that reach the level in the last evaluation only"
COARSE = "it depends on runs whose evaluations are too far apart"
NOT_LEARNED = "at least half of the runs of the one that takes less never learn"
LOST = "the one that takes less loses the level later in at least half of the runs that learn"
SMALL = "the difference is smaller than the margin"
_ENDS = 3  # if a verdict is wrong, so is one of three ends of intervals, see above
_COARSE = 1.25  # largest ratio of successive evaluations that are not too far apart


def decide_all(pairs: Mapping[str, Pair], unit: str, margins: Margins) -> pd.DataFrame:
    """Decides contrasts in a unit: the verdict, why there is none, and how often x takes less."""
    parts = [evidence(pair, unit, margins) for pair in pairs.values()]
    found: Any = pd.DataFrame(parts, index=[*pairs])
    adjusted = np.array(holm((_ENDS * found["p_known"]).clip(upper=1)))
    n_open, tail = (adjusted > ALPHA).sum(), ALPHA / _ENDS / len(found)
    cases = {
        UNITS[unit][0]: (adjusted <= ALPHA) & (found["less"] > 0.5),
        UNITS[unit][1]: adjusted <= ALPHA,
        NO_VERDICT: _ENDS * n_open * found["p"] <= ALPHA,
        NEITHER: proportion_interval(found["never"], found["n"], tail)[0] > 0.5,
    }
    decided = np.select([*cases.values()], [*cases], UNDECIDED)
    why = found["why"].where(decided == NO_VERDICT, "")
    ends = proportion_interval(found["less"], found["n"], tail)
    wins = with_ends("wins", Estimate(found["less"], *ends))
    return pd.DataFrame({"verdict": decided, "why": why, **wins}).add_prefix(f"{unit}_")


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
    """Returns why it is not known which run of each pair took fewer steps; empty if it is.

    What a run took lies between two evaluations. One that reaches the level in the last evaluation
    only may have learned then, or never.
    """
    x, y = pair["x"], pair["y"]
    if unit != "steps":
        return np.full(len(x), "")
    is_learned = np.isfinite(x["steps"]) & np.isfinite(y["steps"])
    overlaps = is_learned & (x["steps"] > y["steps_before"]) & (y["steps"] > x["steps_before"])
    is_coarse = x["steps"] > _COARSE * x["steps_before"]
    is_coarse |= y["steps"] > _COARSE * y["steps_before"]
    is_at_last = x["at_last"] & (x["steps"] <= y["steps"])
    is_at_last |= y["at_last"] & (y["steps"] <= x["steps"])
    cases = [x["untrained"] | y["untrained"], is_at_last, overlaps & is_coarse]
    return np.select(cases, [UNTRAINED, AT_LAST, COARSE], "")


def _flaw(winner: pd.DataFrame, loser: pd.DataFrame, unit: str, margins: Margins) -> str:
    """Returns why the one that takes less wins nothing; empty if it does."""
    has_learned = np.isfinite(winner["steps"])
    if has_learned.mean() <= 0.5:
        return NOT_LEARNED
    if (has_learned & ~winner["untrained"]).mean() <= 0.5:
        return UNTRAINED
    if unit != "steps":
        gain = loser[unit].mean() - winner[unit].mean()
        return SMALL if round(gain, 9) < margins.success else ""
    if winner["lost"][has_learned].mean() >= 0.5:
        return LOST
    less, more = winner["steps"].median(), loser["steps"].median()
    return "" if more > less and more >= round(margins.ratio * less, 9) else SMALL


TABLES = {"took": took, "cells": cells, "contrasts": contrasts, "rungs": rungs}

# Figures

_SIDES: tuple[Look, Look] = (  # of a rung: tile coding, and the net
    {"color": "#b3003c", "marker": "s", "ls": ""},
    {"color": "#0173b2", "marker": "o", "ls": ""},
)
_CHANCE: Look = {"color": "0.5", "ls": "--", "lw": 1}
_HOLLOW = {"hollow: most runs never learn": Line2D([], [], marker="o", c="0.3", mfc="w", ls="")}
_NEVER = 1.6  # where runs that never learn are drawn, in budgets
_ROWS = {
    "steps": "steps until it has learned\n(lower is better)",
    "unseen_success": "success in new places\n(higher is better)",
}


def ladder(data: Data) -> Figure | None:
    """Tile coding and a net that are told as much; without a mark, a learner was not tried."""
    declared = data.declared.ladder
    if declared is None:
        return None
    cells, rungs = data.tables["cells"].set_index(KEYS), declared.rungs
    on_ladder = [key for key in cells.index if key[0] in declared.grids]
    known = {key[1:]: key for key in on_ladder}  # by point and learner
    n_points = Counter(learner for _, learner in known)
    points = dict.fromkeys(at for at, _ in known)
    known |= {(at, key[2]): key for key in on_ladder if n_points[key[2]] == 1 for at in points}
    with figure_of(2, len(points), (WIDTH, 5.6)) as (figure, axes):
        for column, point in zip(axes.T, points, strict=True):
            for axis, name in zip(column, _ROWS, strict=True):
                for i, rung in enumerate(rungs):
                    learners = [rung.tiles, *[*rung.nets.values()][:1]]
                    sides = zip((i - 0.13, i + 0.13), learners, _SIDES, strict=False)
                    there = [side for side in sides if (point, side[1]) in known]
                    own = cells.loc[[known[point, learner] for _, learner, _ in there]]
                    at = np.array([at for at, _, _ in there])
                    axis.plot(at, _shown(data, own, name)[0], color="0.5", lw=1, zorder=1)
                    for k, (_, _, look) in enumerate(there):
                        _draw(data, axis, at[[k]], own.iloc[[k]], name, look)
                axis.set_xticks(range(len(rungs)), [""] * len(rungs))
                axis.set_xlim(-0.5, len(rungs) - 0.5)
            column[0].set_title(" ".join(reversed(point.split())), loc="left")
            titles = [rung.title for rung in rungs]
            column[1].set_xticklabels(titles, rotation=40, ha="right", rotation_mode="anchor")
        net = next(chain(*(rung.nets for rung in rungs)), "net")
        lines = (Line2D([], [], **look) for look in _SIDES)
        figure.supxlabel("what learners are told (more →)", fontsize="medium")
        _finish(data, figure, axes, dict(zip(["tile coding", net], lines, strict=True)))
    return figure


def along(data: Data) -> Figure | None:
    """Steps until learners have learned, and success in new places, along the axis of a grid."""
    panels = data.declared.panels
    if not panels:
        return None
    cells, lines = data.tables["cells"].set_index(KEYS), dict[str, Line2D]()
    with figure_of(2, len(panels), (WIDTH, 6.2)) as (figure, axes):
        for column, panel in zip(axes.T, panels, strict=True):
            ((name, values),) = data.experiment.declared.grids[panel.grid].axes.items()
            numbers = sorted(values, key=lambda value: prod(map(float, value.split("x"))))
            for i, learner in enumerate(panel.learners):
                own = cells.loc[[(panel.grid, f"{name} {value}", learner) for value in numbers]]
                at: Any = np.arange(len(own)) + 0.4 * ((i + 0.5) / len(panel.learners) - 0.5)
                title = data.experiment.learners[learner].declared.title
                look = data.look(learner) | {"ls": "-"}
                for axis, shown in zip(column, _ROWS, strict=True):
                    lines[title] = _draw(data, axis, at, own, shown, look)
            for axis in column:
                axis.set_xticks(range(len(numbers)), numbers)
            column[0].set_title(panel.title, loc="left")
            column[1].set_xlabel(name)
        _finish(data, figure, axes, lines)
    return figure


def _draw(
    data: Data, axis: Axes, at: NDArray[Any], cells: pd.DataFrame, name: str, look: Look
) -> Line2D:
    """Draws a column of cells with its intervals; hollow if it is infinite."""
    value, low, high = _shown(data, cells, name)
    axis.vlines(at, low, high, color=look["color"], lw=4, alpha=0.35)
    (line,) = axis.plot(at, value, **look)
    is_never = np.isinf(cells[name].to_numpy())
    axis.plot(at[is_never], value[is_never], **look | {"mfc": "white", "ls": ""})
    return line


def _shown(data: Data, cells: pd.DataFrame, name: str) -> Floats:
    """Returns a column of cells with its ends, (3, cells), as far as figures show them."""
    shown = cells[[name, f"{name}_low", f"{name}_high"]].to_numpy().T
    if name != "steps":
        return shown
    shown = shown.clip(data.experiment.declared.evaluation_every)
    return np.where(np.isinf(shown), _NEVER * data.tables["cells"]["budget"].max(), shown)


def _finish(data: Data, figure: Figure, axes: NDArray[Any], lines: Mapping[str, Line2D]) -> None:
    """Gives both rows their scales and labels, draws chance, and gives the figure its legend."""
    for axis in axes[1]:
        axis.axhline(_chance(data), **_CHANCE)
    for row, label in zip(axes, _ROWS.values(), strict=True):
        row[0].set_ylabel(label)
        for axis in row:
            axis.sharey(row[0])
            axis.tick_params(labelleft=axis is row[0])
    top, bottom = axes[:, 0]
    budget, low = data.tables["cells"]["budget"].max(), min(each.dataLim.y0 for each in axes[0])
    ticks = [n for n in (100, 300, 1000, 3000, 10_000, 30_000, 100_000) if 0.8 * low < n < budget]
    top.set_yscale("log")
    top.set_yticks([*ticks, _NEVER * budget], [*map(EngFormatter(sep=""), ticks), "never"])
    top.yaxis.set_minor_locator(NullLocator())
    top.set_ylim(0.8 * low, 1.3 * _NEVER * budget)
    bottom.set(ylim=(-0.03, 1.03), yticks=(0, 0.5, 1))
    marks = {**lines, "chance": Line2D([], [], **_CHANCE)} | _HOLLOW
    n_columns = 4 if len(marks) < 5 else 3
    figure.legend(marks.values(), marks, loc="outside upper center", ncols=n_columns, frameon=False)


FIGURES = {"ladder": ladder, "along": along}

# Text

SHOWN = {
    "rungs": (
        "rung point net tiles_n_solved net_n_solved tiles_steps net_steps net_wins"
        " tiles_unseen_success net_unseen_success"
    ),
    "contrasts": "grid point x y n learned_x learned_y steps_verdict steps_why unseen_verdict",
}
COLUMNS = described("""\
at_last: whether the run reaches the level in the last evaluation only
grid: grid of the experiment
learned_x: runs of x that learn
learned_y: runs of y that learn
lost: whether success is below the level later: at the end, or for half of the time
n: runs; of contrasts, pairs of runs
n_at_last: runs that reach the level in the last evaluation only
n_solved: runs that learn
net: net that is told the same as tile coding
net_*: * of the net
net_wins: probability that the net takes fewer steps than tile coding
point: point of the grid
rung: what learners are told
solved: share of runs that learn
steps: steps until a run has learned, or their median; inf if it never does
steps_before: steps of the evaluation before
tiles_*: * of tile coding
untrained: whether the untrained policy reaches the level
wrong_pings: wrong PINGs until a run has learned, or their median; inf if it never does
*_verdict: the verdict on x by *
*_why: why there is no verdict by *
*_wins: probability that x takes less than y, or succeeds more often, by *
""")


def headline(data: Data) -> str:
    """Lists what is decided by steps."""
    table = data.tables["contrasts"]
    groups = table.groupby(["grid", "x", "y", "steps_verdict"], sort=False)["point"]
    lines = [
        f"- {data.title(x)} compared with {data.title(y)}: {verdict} ({grid}: {', '.join(points)})"
        for (grid, x, y, verdict), points in groups
        if verdict in UNITS["steps"]
    ]
    return f"""\
One learner is faster in {table["steps_verdict"].isin(UNITS["steps"]).sum()} of {len(table)}
contrasts: it needs fewer steps until it has learned. {giving_up(data.experiment)}

{chr(10).join(lines)}"""


def reading(data: Data) -> str:
    """Explains learning, contrasts and new places."""
    margins = data.declared.margins
    return f"""\
{learning(data.experiment)} In *new places*, the person never stood in training; in *new ways*,
onlookers stand as they never did. Success there is that after the whole budget. Bars are 95 %
intervals.

Contrasts pair runs of the same seed, which have the same draw of the scenario. *Faster* (*better*):
x takes fewer steps (fails less often) with a probability that differs from 1/2 significantly, and
by {margins.probability:g} or more; medians of steps differ by a factor of {margins.ratio:g} (mean
success by {margins.success:g}) or more; and most runs of x have learned, and kept it. *Slower* and
*worse* mean the same of y. *No verdict*: a significant difference fails another condition, or
depends on runs whose evaluations are too far apart, or that reach the level in the last evaluation
only or untrained.

The probability of any wrong verdict is at most 5 % in each of steps, new places and new ways (by
Holm's method), and intervals of contrasts hold at once."""
