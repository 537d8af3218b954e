"""Growth: time and memory of this project against the numbers of agents, cells and stored runs.

All points take turns, in several rounds, and the fastest round of each counts. An exponent is the slope of a
straight line through the logarithms, by least squares.
"""

import math
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray
from scipy import stats

from benchmark.drawing.style import figure_of, variant_style
from benchmark.reports.folder import Folder
from benchmark.reports.growth import points
from benchmark.reports.growth.points import Values, command, fresh
from benchmark.reports.item import Estimate, Frames, entry, item
from benchmark.reports.measured import Measured, Measuring

Turns = Mapping[str, Mapping[int, list[Values]]]  # what points took, by curve and size: a round each

# What is counted to the curves against it.
PANELS: Final[Mapping[str, tuple[str, ...]]] = {
    "agents": ("agents_tables", "agents_nets"),
    "cells": ("cells_compile", "cells_solve", "cells_evaluate", "cells_train"),
    "stored runs": ("runs_list", "runs_resume", "runs_report"),
}
FACTS: Final = {
    "budget": 1000,  # steps of a table
    "net_budget": 400,  # steps of a net, but for the overhead
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
    for unit, curves in PANELS.items():
        for curve in curves:
            for size, taken in data.taken[curve].items():
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


@growth.figure("How time and peak memory grow with agents, cells and stored runs.")
def _(frames: Frames, _: object) -> Figure:
    frame = frames["growth"]
    with figure_of(2, len(PANELS), (10.5, 6.0)) as (figure, axes):
        for axis, first in zip(axes.flat, np.repeat(axes[:, 0], len(PANELS)), strict=True):
            axis.sharey(first)
            axis.set(xscale="log", yscale="log")
            axis.yaxis.set_major_formatter("{x:,g}")
            axis.yaxis.set_minor_formatter(NullFormatter())
        for column, (unit, curves) in zip(axes.T, PANELS.items(), strict=True):
            for place, curve in enumerate(curves):
                points = frame[frame["curve"] == curve]
                # Where points coincide, the first is the largest.
                style = variant_style(curve, curves) | {
                    "markersize": 7 - place,
                    "label": curve.partition("_")[2],
                }
                column[0].plot(points["size"], points["seconds"], **style)
                column[1].plot(points["size"], points["peak_memory_mb"], **style)
            column[0].legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=2, frameon=False)
            column[1].set_xlabel(unit)
        axes[0, 0].set_ylabel("time in s")
        axes[1, 0].set_ylabel("peak memory in MB")
        axes[1, 0].yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))  # shared; it spans few powers of ten
    return figure


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
        decade = found[found["size"] * 10 >= found["size"].max()]
        for sizes, part in (("all", found), ("largest decade", decade)):
            n = part["size"].to_numpy(float)
            yield {
                "curve": curve,
                "unit": part["unit"].iloc[0],
                "sizes": sizes,
                "n": len(part),
                "smallest": part["size"].min(),
                "largest": part["size"].max(),
                "time_exponent": exponent(n, part["seconds"].to_numpy(float)),
                "memory_exponent": exponent(n, part["peak_memory_mb"].to_numpy(float)),
            }


def exponent(sizes: NDArray[np.float64], values: NDArray[np.float64]) -> Estimate:
    """Fits `values = factor * sizes ** exponent` by least squares on the logarithms; returns the exponent.

    Its 95 % interval is from the residuals by Student's t with n - 2 degrees of freedom. What takes more
    points than there are is NaN.
    """
    n = len(sizes)
    if n == 1:
        return Estimate(math.nan, math.nan, math.nan)
    fit = stats.linregress(np.log(sizes), np.log(values))
    half = stats.t.ppf(0.975, n - 2) * fit.stderr  # NaN without a degree of freedom
    return Estimate(float(fit.slope), float(fit.slope - half), float(fit.slope + half))


@item("workers", "several workers against one", is_measured=True)
def workers(data: Measured) -> Iterator[dict[str, Any]]:
    """Tabulates how much faster several workers are than one of them."""
    for kind in ("processes", "dask"):
        turns = data.taken[f"workers_{kind}"]
        seconds = {n: min(values["seconds"] for values in taken) for n, taken in turns.items()}
        for n, taken in turns.items():
            yield {
                "workers": f"{n} {kind}",
                "jobs": round(taken[0]["jobs"]),
                "seconds": seconds[n],
                "ratio_to_one": seconds[1] / seconds[n],
            }


@item(
    "overhead",
    "what a job costs on top of training and evaluation, a row per round",
    dict.fromkeys(("jobs", "agents", "seconds_per_job", "own_seconds_per_job", "share"), ""),
    is_measured=True,
)
def overhead(data: Measured) -> Iterator[dict[str, Any]]:
    """Tabulates the time of a job, and of it that which the job itself measures."""
    for n_agents, taken in data.taken["overhead"].items():
        for values in taken:
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
    import_module("distributed")  # or it would be missing after half of the work
    taken: dict[str, dict[int, list[Values]]] = defaultdict(lambda: defaultdict(list))
    rounds, turns = 1 if smoke else 2, list(_points(smoke, scratch))
    for i in range(rounds * len(turns)):
        curve, size, call = turns[i % len(turns)]
        values = call()
        taken[curve][size].append(values)
        point = f"point {i + 1} of {rounds * len(turns)}: {curve}, {size:,}"
        print(f"growth: {point}: {values['seconds']:.3g} s", file=sys.stderr)
    return Measured(taken, FACTS)


def _points(smoke: bool, scratch: Path) -> Iterator[tuple[str, int, Callable[[], Values]]]:
    """Yields curve, size and measurement of all points; each round trains and stores tables first."""
    some, store = slice(1 if smoke else None), scratch / "store"
    tables = {n: scratch / f"tables_{n}.toml" for n in _N_TABLES[some]}
    for n, path in tables.items():
        path.write_text(_TABLES.format(budget=FACTS["budget"], size=n), encoding="utf-8")
        yield "agents_tables", n, partial(fresh, points.tables, path, n, path.with_suffix(""))
    for n, path in tables.items():
        at = "--results", path.with_suffix("")
        yield "runs_list", n, partial(command, "list", *at)
        yield "runs_resume", n, partial(command, "run", path, *at)
        yield "runs_report", n, partial(command, "report", path, *at)
    for n in _N_NETS[some]:
        yield "agents_nets", n, partial(fresh, points.nets, n, FACTS["net_budget"], store)
    for rows, columns in _GRIDS[some]:
        for work in ("compile", "solve", "evaluate", "train"):
            yield f"cells_{work}", rows * columns, partial(fresh, points.grid, work, rows, columns)
    for n in [1, 2][some]:
        for kind in ("processes", "dask"):
            yield f"workers_{kind}", n, partial(fresh, points.workers, kind, n, 1 if smoke else 25, store)
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
