"""Growth: time and memory of this project against the numbers of agents, cells and stored runs.

All points take turns, in several rounds, and the fastest round of each counts. An exponent is the slope of a
straight line through the logarithms, by least squares.
"""

import math
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from benchmark.execution.provenance import check_packages
from benchmark.reports.folder import Folder
from benchmark.reports.growth import points
from benchmark.reports.growth.points import Values, command, fresh
from benchmark.reports.item import Estimate, Frames, entry, item
from benchmark.reports.measured import Measured, Measuring
from envs.inputs import missing_package

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# What the points of a curve took, by curve and size: a round each.
Turns = dict[tuple[str, int], list[Values]]

# What is counted to the curves against it, and what these are called.
PANELS: Final[Mapping[str, Mapping[str, str]]] = {
    "agents": {"agents_tables": "tables", "agents_nets": "nets"},
    "cells": {
        "cells_compile": "compile",
        "cells_solve": "solve",
        "cells_evaluate": "evaluate",
        "cells_train": "train one table",
    },
    "stored runs": {"runs_list": "list", "runs_resume": "resume", "runs_report": "report"},
}
_FEWEST: Final = 3  # points, so that a line leaves something for an interval
_BUDGET: Final = 1000  # steps of a table
_NET_BUDGET: Final = 400  # steps of a net, but for the overhead
FACTS: Final = {
    "budget": _BUDGET,
    "net_budget": _NET_BUDGET,
    "grid_horizon": points.HORIZON,
    "grid_steps": points.STEPS,
}
# The replication in S1 alone, with fewer steps. Its report shows 100 agents, and counts successes of all.
_TABLES: Final = """
extends = "reproduce"
description = "The paper's Q-learning in S1, with fewer steps."
[changes]
scenarios = ["S1"]
evaluation_every = {budget}
map_every = {budget}
"algorithms.q_learning.settings.budget" = {budget}
readings = {{ default = {{ question = "How is the paper read?", answer = "as by default", seeds = {size} }} }}
"""
# How much is measured; to try the code, the first of each. Commands are run on the stores of tables.
_N_TABLES: Final = [100, 300, 1000, 3000, 10_000, 30_000, 100_000]
_N_NETS: Final = [1, 3, 10, 30, 100, 300, 1000]
_GRIDS: Final = [(10, 12), (15, 20), (25, 40), (50, 60), (100, 100), (150, 200), (250, 400)]  # rows, columns


# What is published


@item(
    "growth",
    "time and peak memory of every point (shown: the largest of each curve)",
    {
        "curve": "",
        "size": "",
        "unit": "of",
        "seconds": "",
        "slowest_seconds": "seconds of the slowest round",
        "peak_memory_mb": "peak memory in MB",
    },
    where=lambda frame: frame.drop_duplicates("curve", keep="last"),  # sizes ascend
    is_measured=True,
)
def growth(data: Measured) -> Iterator[dict[str, Any]]:
    """Tabulates the points of the curves: the fastest and the slowest round, and the lowest peak.

    What else a system or a first round has to do, such as compiling, only adds to either.
    """
    turns: Turns = data.taken
    for unit, curves in PANELS.items():
        for curve in curves:
            for size in sorted(size for name, size in turns if name == curve):
                taken = turns[curve, size]
                seconds = [values["seconds"] for values in taken]
                yield {
                    "curve": curve,
                    "size": size,
                    "unit": unit,
                    "seconds": min(seconds),
                    "slowest_seconds": max(seconds),
                    "peak_memory_mb": min(values["peak_memory_mb"] for values in taken),
                    "rounds": len(taken),
                }


@growth.sentence
def _(table: pd.DataFrame, _: Folder) -> str:
    last = table.drop_duplicates("curve", keep="last")
    stored = last[last["unit"] == "stored runs"]
    seconds = (
        f"`{row['curve'].removeprefix('runs_')}` takes {entry(row, 'seconds', 'growth')} s"
        for _, row in stored.iterrows()
    )
    return f"With {stored['size'].max():,} stored runs, {', '.join(seconds)} (target: `list` below 2 s)."


@growth.figure("Time and peak memory against the numbers of agents, cells and stored runs.")
def _(frames: Frames, _: object) -> "Figure":
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    from benchmark.drawing.style import figure_of, variant_style

    frame = frames["growth"]
    with figure_of(2, len(PANELS), (10.5, 6.0)) as (figure, axes):
        for column, (unit, curves) in zip(axes.T, PANELS.items(), strict=True):
            for place, (name, label) in enumerate(curves.items()):
                # Where points coincide, the first is the largest.
                points = frame[frame["curve"] == name]
                style = variant_style(place) | {"markersize": 7 - place}
                sizes, seconds = points["size"], points["seconds"]
                column[0].plot(sizes, seconds, **style, lw=1.3, label=label)
                column[0].vlines(sizes, seconds, points["slowest_seconds"], color=style["color"], lw=1)
                column[1].plot(sizes, points["peak_memory_mb"], **style, lw=1.3)
            for axis in column:
                axis.set(xscale="log", yscale="log")
                axis.yaxis.set_major_formatter(StrMethodFormatter("{x:,g}"))
                axis.yaxis.set_minor_formatter(NullFormatter())
            column[1].set_xlabel(unit)
        axes[0, 0].set_ylabel("time in s")
        axes[1, 0].set_ylabel("peak memory in MB")
        for row in axes:  # whose axes share a scale
            lowest, highest = zip(*(axis.get_ylim() for axis in row), strict=True)
            for axis in row:
                axis.set_ylim(min(lowest), max(highest))
                _lines(axis, "linear growth" if axis is axes[0, 0] else None)
        for axis in axes[0]:
            axis.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=2, frameon=False)
        for axis in axes[1]:  # one power of ten needs more numbers
            axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    return figure


def _lines(axis: "Axes", label: str | None) -> None:
    """Draws the slope of linear growth behind the curves, a line for each power of ten."""
    (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
    powers = np.arange(np.floor(np.log10(bottom / right)), np.ceil(np.log10(top / left)) + 1)
    ends = np.array([left, right])
    for power in powers:
        (line,) = axis.plot(ends, ends * 10**power, color="0.85", lw=0.8, zorder=0)
    line.set_label(label)
    axis.set(xlim=(left, right), ylim=(bottom, top))


@item(
    "exponents",
    "power laws fitted to the curves",
    dict.fromkeys(("curve", "sizes", "n", "smallest", "largest", "time_exponent", "memory_exponent"), ""),
    is_measured=True,
)
def exponents(data: Measured) -> Iterator[dict[str, Any]]:
    """Tabulates the fits to each curve: to all its sizes, and to those of the largest decade."""
    frame = growth.table(data)
    assert frame is not None
    for curve, found in frame.groupby("curve", sort=False):
        largest = found["size"].max()
        decade = found[found["size"] * 10 >= largest]
        for sizes, part in (("all", found), ("largest decade", decade)):
            n = part["size"].to_numpy(float)
            yield {
                "curve": curve,
                "unit": part["unit"].iloc[0],
                "sizes": sizes,
                "n": len(part),
                "smallest": part["size"].min(),
                "largest": largest,
                "time_exponent": exponent(n, part["seconds"].to_numpy(float)),
                "memory_exponent": exponent(n, part["peak_memory_mb"].to_numpy(float)),
            }


def exponent(sizes: NDArray[np.float64], values: NDArray[np.float64]) -> Estimate:
    """Fits `values = factor * sizes ** exponent` by least squares on the logarithms.

    Args:
      sizes: (n,) different, above 0.
      values: (n,) above 0.

    Returns:
      The exponent and its 95 % interval, from the residuals by Student's t with n - 2 degrees of freedom;
      what takes more points than there are is NaN.
    """
    n = len(sizes)
    if n < _FEWEST - 1:
        return Estimate(math.nan, math.nan, math.nan)
    fit = stats.linregress(np.log(sizes), np.log(values))
    half = stats.t.ppf(0.975, n - 2) * fit.stderr if n >= _FEWEST else math.nan
    return Estimate(float(fit.slope), float(fit.slope - half), float(fit.slope + half))


@item("workers", "several workers against one", is_measured=True)
def workers(data: Measured) -> Iterator[dict[str, Any]]:
    """Tabulates how much faster several workers are than one of them."""
    turns: Turns = data.taken
    for kind in ("processes", "dask"):
        best = {
            n: min(taken, key=lambda values: values["seconds"])
            for (curve, n), taken in turns.items()
            if curve == f"workers_{kind}"
        }
        for n, values in best.items():
            yield {
                "workers": f"{n} {kind}",
                "jobs": round(values["jobs"]),
                "seconds": values["seconds"],
                "ratio_to_one": best[1]["seconds"] / values["seconds"],
            }


@item(
    "overhead",
    "what a job costs on top of training and evaluation, a row per round",
    dict.fromkeys(("jobs", "agents", "seconds_per_job", "own_seconds_per_job", "share"), ""),
    is_measured=True,
)
def overhead(data: Measured) -> Iterator[dict[str, Any]]:
    """Tabulates the time of a job, and of it that which the job itself measures."""
    for (curve, n_agents), taken in data.taken.items():
        for values in taken if curve == "overhead" else ():
            yield {
                "jobs": round(values["jobs"]),
                "agents": n_agents,
                "seconds_per_job": values["seconds"] / values["jobs"],
                "own_seconds_per_job": values["own_seconds"] / values["jobs"],
                "share": 1 - values["own_seconds"] / values["seconds"],
            }


# What is measured


def _measure(scratch: Path, smoke: bool) -> Measured:
    """Measures all points in turns; says what each took."""
    check_packages(["q_learning", "compiled_dqn", "compiled_ppo"])
    if find_spec("distributed") is None:
        raise missing_package("benchmark growth", "distributed")
    taken: Turns = defaultdict(list)
    rounds, turns = 1 if smoke else 2, list(_points(smoke, scratch))
    for i in range(rounds):
        for place, (curve, size, call) in enumerate(turns):
            values = call()
            taken[curve, size].append(values)
            print(
                f"growth: round {i + 1} of {rounds}, point {place + 1} of {len(turns)}: {curve}, {size:,}: "
                f"{values['seconds']:.3g} s",
                file=sys.stderr,
            )
    return Measured(taken, FACTS)


def _points(smoke: bool, scratch: Path) -> Iterator[tuple[str, int, Callable[[], Values]]]:
    """Yields curve, size and measurement of all points; each round trains and stores tables first."""
    some, store = slice(1 if smoke else None), scratch / "store"
    tables = {n: scratch / f"tables_{n}.toml" for n in _N_TABLES[some]}
    for n, path in tables.items():
        path.write_text(_TABLES.format(budget=_BUDGET, size=n), encoding="utf-8")
        yield "agents_tables", n, partial(fresh, points.tables, path, path.with_suffix(""))
    for n, path in tables.items():
        at = "--results", path.with_suffix("")
        yield "runs_list", n, partial(command, "list", *at)
        yield "runs_resume", n, partial(command, "run", path, *at)
        yield "runs_report", n, partial(command, "report", path, *at)
    for n in _N_NETS[some]:
        yield "agents_nets", n, partial(fresh, points.nets, n, _NET_BUDGET, store)
    for rows, columns in _GRIDS[some]:
        for work in ("compile", "solve", "evaluate", "train"):
            yield f"cells_{work}", rows * columns, partial(fresh, points.grid, work, rows, columns)
    amount = (1, 1) if smoke else (18, 25)  # populations and their seeds
    for n in range(1, 2 if smoke else 3):
        for kind in ("processes", "dask"):
            yield f"workers_{kind}", n, partial(fresh, points.workers, kind, n, *amount, store)
    size, budget = (2, 200) if smoke else (25, 10_000)
    yield "overhead", size, partial(fresh, points.nets, size, budget, store)


REPORT: Final = Measuring(
    name="growth",
    question="How do time and memory grow?",
    description="Time and peak memory against the numbers of agents, cells and stored runs, several workers "
    "against one, and the overhead of running and storing.",
    items=(growth, exponents, workers, overhead),
    document=Path(__file__).with_name("document.md.jinja"),
    measure=_measure,
)
