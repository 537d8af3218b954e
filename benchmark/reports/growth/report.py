"""Measures growth, and writes what was measured: tables, exponents, a figure and a README.

All points take turns, in several rounds, and the fastest round of each counts. An exponent is the slope of a
straight line through the logarithms, by least squares.
"""

import math
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from benchmark.drawing import tables
from benchmark.drawing.style import write_figure
from benchmark.execution.provenance import check_packages
from benchmark.experiments import Experiment, all_specifications, load_experiment
from benchmark.reports import files
from benchmark.reports.growth import figures, points
from benchmark.reports.growth.points import Values, command, fresh
from envs.inputs import missing_package

# What the points of a curve took, by curve and size: a round each.
Turns = dict[tuple[str, int], list[Values]]

_DECADE: Final = 10.0
_FEWEST: Final = 3  # points, so that a line leaves something for an interval
_BUDGET: Final = 1000  # steps of a table
_NET_BUDGET: Final = 400  # steps of a net, but for the overhead
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


class Sizes(NamedTuple):
    """How much is measured."""

    agents: Sequence[int]  # tables, on whose stores the commands are run
    nets: Sequence[int]
    grids: Sequence[tuple[int, int]]  # rows and columns
    workers: Sequence[int]
    populations: int  # of `compare_deep_smoke`, for the workers; each is one job
    seeds: int  # of each population
    overhead: int  # agents of which the overhead is measured
    overhead_budget: int  # their steps
    rounds: int


_FULL: Final = Sizes(
    agents=(100, 300, 1000, 3000, 10_000, 30_000, 100_000),
    nets=(1, 3, 10, 30, 100, 300, 1000),
    grids=((10, 12), (15, 20), (25, 40), (50, 60), (100, 100), (150, 200), (250, 400)),
    workers=(1, 2),
    populations=18,
    seeds=25,
    overhead=25,
    overhead_budget=10_000,
    rounds=2,
)
_SMOKE: Final = Sizes(
    agents=(100,),
    nets=(1,),
    grids=((10, 12),),
    workers=(1,),
    populations=1,
    seeds=1,
    overhead=2,
    overhead_budget=200,
    rounds=1,
)


class _Point(NamedTuple):
    """What is measured in a turn."""

    curve: str
    size: int
    expected_s: float  # about how long it takes on two slow cores, for the time that is left
    measure: Callable[[], Values]


def measure(directory: Path, *, smoke: bool) -> None:
    """Measures every point, and writes tables, a figure and a README.

    Args:
      directory: Where to write.
      smoke: Whether to do very little, to try the code; the numbers then mean nothing.

    Raises:
      InputError: A package is missing, the folder cannot be written, or something that is measured fails.
    """
    check_packages(["q_learning", "compiled_dqn", "compiled_ppo"])
    if find_spec("distributed") is None:
        raise missing_package("benchmark growth", "distributed")
    sizes = _SMOKE if smoke else _FULL
    # Other reports wait meanwhile: they would disturb what is measured.
    with files.alone(directory.parent), files.scratch(directory.parent) as scratch:
        turns = _take_turns(list(_points(sizes, scratch)), sizes.rounds)
        with files.replaced(directory, lambda _: False) as aside:
            write(turns, aside)
    print(f"written to {directory}")


def _points(sizes: Sizes, scratch: Path) -> Iterator[_Point]:
    """Yields all points; those of stored runs come after those that store them."""
    for n in sizes.agents:
        yield _Point("agents_tables", n, 3 + 9e-4 * n, partial(_tables, scratch, n))
    for n in sizes.agents:
        path, results = _experiment(scratch, n), _folder(scratch, n)
        at = ("--results", str(results))
        yield _Point("runs_list", n, 2 + 2e-6 * n, partial(command, "list", *at))
        yield _Point("runs_resume", n, 2.5 + 6e-5 * n, partial(command, "run", str(path), *at))
        yield _Point("runs_report", n, 11 + 5e-4 * n, partial(_report, path, results))
    for n in sizes.nets:
        changed = _nets(n, _NET_BUDGET)
        yield _Point("agents_nets", n, 7 + 0.045 * n, partial(_in_new_store, scratch, points.agents, changed))
    for rows, columns in sizes.grids:
        for name, function in (
            ("compile", points.compiling),
            ("solve", points.solving),
            ("evaluate", points.evaluating),
            ("train", points.training),
        ):
            n = rows * columns
            yield _Point(f"cells_{name}", n, 2 + 1e-5 * n, partial(fresh, function, rows, columns))
    small = load_experiment("compare_deep_smoke")
    runs = all_specifications(small, range(sizes.seeds))
    runs = [run for run in runs if run.algorithm.startswith("compiled_")]
    populations = list(dict.fromkeys(run.population for run in runs))[: sizes.populations]
    nets = [run for run in runs if run.population in populations]
    for n in sizes.workers:
        for kind in (points.processes, points.dask):
            once = partial(_in_new_store, scratch, kind, n, nets)
            yield _Point(f"workers_{kind.__name__}", n, 7 + 0.6 * sizes.seeds / n, once)
    changed = _nets(sizes.overhead, sizes.overhead_budget)
    once = partial(_in_new_store, scratch, points.overhead, changed)
    yield _Point("overhead", sizes.overhead, 8 + 4e-5 * sizes.overhead * sizes.overhead_budget, once)


def _folder(scratch: Path, size: int) -> Path:
    """Returns where so many runs of tables are stored."""
    return scratch / f"tables_{size}"


def _experiment(scratch: Path, size: int) -> Path:
    """Writes the experiment of so many tables; returns its file."""
    path = scratch / f"tables_{size}.toml"
    path.write_text(_TABLES.format(budget=_BUDGET, size=size), encoding="utf-8")
    return path


def _tables(scratch: Path, size: int) -> Values:
    """Measures how tables are trained and stored; their store stays until the next round."""
    results = _folder(scratch, size)
    shutil.rmtree(results, ignore_errors=True)
    return fresh(points.agents, load_experiment(_experiment(scratch, size)), results)


def _report(experiment: Path, results: Path) -> Values:
    """Measures how a report is drawn, from the first file to the last."""
    shutil.rmtree(results / experiment.stem, ignore_errors=True)
    return command("report", str(experiment), "--results", str(results))


def _nets(size: int, budget: int) -> Experiment:
    """Returns so many nets of `compare_deep`: DQN from one-hot observations in S1."""
    declared = load_experiment("compare_deep")
    arm = declared.algorithms["dqn"].model_copy(update={"observations": ("one_hot",), "seeds": size})
    changes = {"settings": declared.settings | {"budget": budget}, "scenarios": ("S1",)}
    return declared.model_copy(update=changes | {"algorithms": {"dqn": arm}})


def _in_new_store(scratch: Path, function: Callable[..., Values], *arguments: object) -> Values:
    """Calls a function in a fresh process, with the folder of an empty store as its last argument."""
    results = scratch / "store"
    shutil.rmtree(results, ignore_errors=True)
    return fresh(function, *arguments, results)


def _take_turns(turns: Sequence[_Point], rounds: int) -> Turns:
    """Measures all points in turns; says what each took, and how long the others will take."""
    taken: Turns = {(point.curve, point.size): [] for point in turns}
    started, expected = time.monotonic(), rounds * sum(point.expected_s for point in turns)
    done = 0.0
    print(f"growth: about {expected / 60:.0f} minutes on two slow cores", file=sys.stderr)
    for i in range(rounds):
        for point in turns:
            values = point.measure()
            taken[point.curve, point.size].append(values)
            done += point.expected_s
            left = (time.monotonic() - started) * (expected - done) / done
            peak = values.get("peak_memory_mb", math.nan)
            print(
                f"growth: round {i + 1} of {rounds}: {point.curve}, {point.size:,}: "
                f"{values['seconds']:.3g} s{'' if math.isnan(peak) else f', {peak:.0f} MB'}; "
                f"about {left:,.0f} s left",
                file=sys.stderr,
            )
    return taken


def write(turns: Turns, directory: Path) -> None:
    """Writes what was measured: tables, a figure and a README.

    Args:
      turns: What every point took.
      directory: Where to write; it exists.
    """
    growth = _growth(turns)
    tables.write_csv(growth, directory / "growth.csv")
    fitted = exponents(growth)
    names = ["time_exponent", "memory_exponent"]
    shown = tables.with_intervals(fitted, names)
    bounds = [f"{name}_{end}" for name in names for end in ("low", "high")]
    tables.write_table(fitted, directory / "exponents", shown.drop(columns=bounds))
    workers, overhead = _workers(turns), _overhead(turns)
    tables.write_table(workers, directory / "workers")
    tables.write_table(overhead, directory / "overhead")
    write_figure(figures.growth(growth), directory / "growth")
    rounds = len(next(iter(turns.values())))
    text = _readme(growth, shown.drop(columns=bounds), workers, overhead, rounds)
    (directory / "README.md").write_text(text, encoding="utf-8")


def _growth(turns: Turns) -> pd.DataFrame:
    """Returns a row per point of the curves: its fastest and its slowest round, and its lowest peak.

    What else a system or a first round has to do, such as compiling, only adds to either.
    """
    rows = [
        {
            "curve": curve,
            "size": size,
            "unit": unit,
            "seconds": min(values["seconds"] for values in taken),
            "slowest_seconds": max(values["seconds"] for values in taken),
            "peak_memory_mb": min(values["peak_memory_mb"] for values in taken),
            "rounds": len(taken),
        }
        for unit, curves in figures.PANELS.items()
        for curve in curves
        for (name, size), taken in sorted(turns.items())
        if name == curve
    ]
    return pd.DataFrame(rows)


def exponents(growth: pd.DataFrame) -> pd.DataFrame:
    """Fits power laws to curves: to all their sizes, and to those of the largest decade.

    Args:
      growth: A row per point: curve, size, unit, seconds, peak_memory_mb.

    Returns:
      A row per fit, with the exponents of time and of memory and their 95 % intervals, see `exponent`.
    """
    rows = []
    for curve, found in growth.groupby("curve", sort=False):
        largest = found["size"].max()
        for sizes, part in (
            ("all", found),
            ("largest decade", found[found["size"] * _DECADE >= largest]),
        ):
            row: dict[str, object] = {
                "curve": curve,
                "unit": part["unit"].iloc[0],
                "sizes": sizes,
                "n": len(part),
                "smallest": part["size"].min(),
                "largest": largest,
            }
            for name, column in (("time", "seconds"), ("memory", "peak_memory_mb")):
                ends = exponent(part["size"].to_numpy(float), part[column].to_numpy(float))
                keys = ("exponent", "exponent_low", "exponent_high")
                row |= {f"{name}_{key}": value for key, value in zip(keys, ends, strict=True)}
            rows.append(row)
    return pd.DataFrame(rows)


def exponent(sizes: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float, float]:
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
        return math.nan, math.nan, math.nan
    fit = stats.linregress(np.log(sizes), np.log(values))
    half = stats.t.ppf(0.975, n - 2) * fit.stderr if n >= _FEWEST else math.nan
    return float(fit.slope), float(fit.slope - half), float(fit.slope + half)


def _workers(turns: Turns) -> pd.DataFrame:
    """Returns a row per number of workers, with how much faster they are than one of them."""
    rows = []
    for name in ("processes", "dask"):
        best = {
            n: min(taken, key=lambda values: values["seconds"])
            for (curve, n), taken in turns.items()
            if curve == f"workers_{name}"
        }
        rows += [
            {
                "workers": f"{n} {name}",
                "jobs": round(values["jobs"]),
                "seconds": values["seconds"],
                "ratio_to_one": best[1]["seconds"] / values["seconds"],
            }
            for n, values in best.items()
        ]
    return pd.DataFrame(rows)


def _overhead(turns: Turns) -> pd.DataFrame:
    """Returns what a job costs on top of training and evaluation: a row per round."""
    rows = []
    for (curve, n_agents), taken in turns.items():
        for values in taken if curve == "overhead" else ():
            jobs = values["jobs"]
            rows.append(
                {
                    "jobs": round(jobs),
                    "agents": n_agents,
                    "seconds_per_job": values["seconds"] / jobs,
                    "own_seconds_per_job": values["own_seconds"] / jobs,
                    "share": 1 - values["own_seconds"] / values["seconds"],
                }
            )
    return pd.DataFrame(rows)


def _readme(
    growth: pd.DataFrame, fitted: pd.DataFrame, workers: pd.DataFrame, overhead: pd.DataFrame, rounds: int
) -> str:
    """Returns the README of the folder."""
    last = growth.drop_duplicates("curve", keep="last").set_index("curve")  # sizes ascend
    stored = ", ".join(
        f"`{name.removeprefix('runs_')}` with {last['size'][name]:,} runs takes "
        f"{tables.show(last['seconds'][name])} s"
        for name in figures.PANELS["stored runs"]
    )
    return f"""# growth

Made by `make growth`, on a machine with {os.cpu_count()} cores ({platform.machine()}): time and peak memory
against the numbers of agents, cells and stored runs; several workers against one; and the overhead of
running and storing on top of training.

![Time and peak memory against the numbers of agents, cells and stored runs](growth.png)

Every point is measured in a process of its own, in turns with all others; rounds: {rounds}. Its time
is that of the fastest round (in the figure a thin line leads to the slowest), its memory the lowest peak.
[growth.csv](growth.csv) has all numbers.

- **Agents.** The real runner trains, evaluates and stores runs in S1 in an empty store, one job at a time.
  *Tables*: the paper's Q-learning, but with {_BUDGET:,} steps. *Nets*: `dqn` of `compare_deep` from
  one-hot observations, but with {_NET_BUDGET} steps. Compiling and importing come before and are not
  counted.
- **Cells.** S1 on larger grids, in which the first wrong PING ends the episode, so that there are as many
  states as cells: read, check and *compile* the scenario; *solve* it with the paper's discount (larger grids
  take more sweeps of value iteration, until the discount bounds their number); *evaluate* the random policy
  exactly over {points.HORIZON} steps; *train one table* for {points.STEPS:,} steps. The fastest of three
  calls counts. Memory includes compiling.
- **Stored runs.** The stores are those of the tables, made by the real runner, of one experiment each. The
  commands are real ones, from the start of their processes to the end: `list`; *resume*, a `run` that finds
  everything done and verifies every checksum; `report`, that of a replication in S1. It draws figures in
  further processes, whose memory is not counted. {stored} (target: `list` below 2 s).

## Exponents

A straight line is fitted to the logarithms of size and of time (or memory) by least squares: an exponent of 1
is linear growth, one of 0 is none. Brackets are 95 % intervals from the residuals, by Student's t with n − 2
degrees of freedom. They say how well the points lie on a line, not what another machine would do. Fixed
costs, such as starting Python, make small sizes look flatter, so fits to the largest decade are shown, too.

{tables.to_markdown(fitted)}
## Workers

The nets of `compare_deep_smoke`, in workers that have trained some of each before; *dask* is a cluster on
this machine, with its scheduler in the driver. `ratio_to_one` is the speed-up over one worker of the same
kind (target for two of Dask: 1.8).

{tables.to_markdown(workers)}
## Overhead

DQN in S1 with the settings of `compare_deep`, in one thread of a process that has trained before; a row
per round. `own_seconds_per_job` is the time that jobs measure themselves: training, evaluating, and rounding
what is recorded. `share` is the rest of the time (target: below 0.03): planning, compressing and
storing, as far as it delays the next job.

{tables.to_markdown(overhead)}"""
