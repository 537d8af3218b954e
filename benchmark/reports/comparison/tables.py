"""Tables of a comparison: what each learner reached, how learners compare, what it cost, and what they know.

A learner is an arm of the experiment with one observation. Unless a column says otherwise, numbers are those
of the policy that the arm declares. Success and score, clipped to [0, 1], have exact binomial intervals; the
score without bounds has none, since no method knows how far below 0 a rare failure is. Means over scenarios
weigh all scenarios the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import combinations
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.analysis.contrasts import UNDECIDED, Side, contrast, decide, deciding_runs
from benchmark.analysis.intervals import better_probability, proportion_interval, student
from benchmark.analysis.population import GOOD_SCORE, Population, overlap
from benchmark.execution.store import evaluated
from benchmark.reports.comparison.data import Data
from benchmark.reports.comparison.protocol import Learner, Protocol
from envs import ACTIONS, ZONES

PROFILE: Final = np.round(np.linspace(0, 1, 51), 2)  # scores at which performance profiles are tabulated
_ROUNDING: Final = 1e-9
ENDPOINTS: Final = {
    "success": "success",
    "score": "clipped",
}  # in the order in which they count; see `Data.results`


def scores(data: Data) -> pd.DataFrame:
    """Tabulates every run at the end of training.

    `score` is clipped to [0, 1], `unbounded_score` is not. `greedy_success` is that of the greedy policy,
    whichever counts; `every_cell_` marks episodes that start in any cell. `diverged_at` is infinite if a run
    did not diverge.
    """
    frames = []
    for learner, scenario, population in data.populations:
        columns: dict[str, Any] = _named(learner, scenario)
        columns |= {"policy": data.policy(learner), "seed": population.seeds}
        for start in population.specification["evaluated_from"]:
            for name, field in (
                ("success", "success"),
                ("score", "clipped"),
                ("unbounded_score", "score"),
                ("steps", "steps"),
                ("wrong_pings", "wrong_pings"),
            ):
                columns[evaluated(name, "greedy", start)] = data.results(learner, scenario, field, start)[
                    :, -1
                ]
            zones = data.results(learner, scenario, "zone_steps", start)[:, -1]
            columns[evaluated("uncomfortable_steps", "greedy", start)] = zones[
                :, ZONES.index("uncomfortable")
            ]
        columns["greedy_success"] = population.arrays["success"][:, -1]
        right, marked = _right_and_marked(population)
        columns["target_cells_marked"] = right
        columns["cells_marked"] = marked
        columns["region_overlap"] = overlap(population.values_ping, population.in_target)
        columns["disagreements"] = population.arrays["disagreements"][:, -1]
        diverged_at = population.arrays["diverged_at"]
        columns["diverged_at"] = np.where(diverged_at < 0, np.inf, diverged_at)
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def summary(data: Data) -> pd.DataFrame:
    """Tabulates every population at the end of training."""
    rows = []
    for learner, scenario, population in data.populations:
        n = len(population.seeds)
        row: dict[str, Any] = _named(learner, scenario) | {"policy": data.policy(learner), "n": n}
        for name, field in ENDPOINTS.items():
            row |= _scalars(_proportion(name, data.results(learner, scenario, field)[:, -1:]))
        row["unbounded_score"] = data.results(learner, scenario, "score")[:, -1].mean()
        for name in ("steps", "wrong_pings"):
            row[name] = data.results(learner, scenario, name)[:, -1].mean()
        zones = data.results(learner, scenario, "zone_steps")[:, -1]
        row["uncomfortable_steps"] = zones[:, ZONES.index("uncomfortable")].mean()
        row["greedy_success"] = population.arrays["success"][:, -1].mean()
        if "every_cell" in population.specification["evaluated_from"]:
            success = data.results(learner, scenario, "success", "every_cell")[:, -1:]
            row |= _scalars(_proportion("every_cell_success", success))
        row["diverged"] = int((population.arrays["diverged_at"] >= 0).sum())
        rows.append(row)
    return pd.DataFrame(rows)


def aggregate(data: Data) -> pd.DataFrame:
    """Tabulates every learner over all scenarios at the end of training.

    `iqm` is rliable's interquartile mean of the scores without bounds: the mean of the middle half of the
    runs, which hides failures of fewer than a quarter.
    """
    from rliable import metrics

    rows = []
    for learner, populations in data.learners.items():
        row: dict[str, Any] = {"algorithm": learner.algorithm, "observation": learner.observation}
        sizes = [len(population.seeds) for population in populations.values()]
        row |= {"policy": data.policy(learner), "runs": sum(sizes)}
        row["settings_tried"] = data.tuning.get(learner.algorithm)
        for start in next(iter(populations.values())).specification["evaluated_from"]:
            for name, field in ENDPOINTS.items():
                side = _side(data, learner, field, start)
                low, high = side.interval
                name = evaluated(name, "greedy", start)
                row |= {name: side.mean, f"{name}_low": low, f"{name}_high": high}
        final = [data.results(learner, scenario, "score")[:, -1] for scenario in populations]
        row["unbounded_score"] = np.mean([values.mean() for values in final])
        row["iqm"] = metrics.aggregate_iqm(np.concatenate(final)[:, None])
        rows.append(row)
    return pd.DataFrame(rows).astype({"settings_tried": "Int64"})


def contrasts(data: Data) -> pd.DataFrame | None:
    """Tabulates the contrasts of the protocol, with a verdict on each endpoint.

    The verdict on success counts. Runs that are missing leave no verdict. `deciding_runs` is how many runs
    per scenario and learner would probably decide an undecided contrast.

    Returns:
      One row per contrast of learners that are there; None if there is none.
    """
    protocol = data.protocol
    if protocol is None:
        return None
    pairs = [pair for pair in protocol.contrasts if set(pair) <= data.learners.keys()]
    if not pairs:
        return None
    rows: list[dict[str, Any]] = [{"x": str(x), "y": str(y)} for x, y in pairs]
    for endpoint, field in ENDPOINTS.items():
        sides = [(_side(data, x, field), _side(data, y, field)) for x, y in pairs]
        judge(rows, endpoint, sides, protocol, is_incomplete=data.is_incomplete)
        for row, (x, y) in zip(rows, sides, strict=True):
            is_open = row[f"{endpoint}_verdict"] == UNDECIDED
            needed = deciding_runs(x, y, protocol.margins[endpoint], len(pairs)) if is_open else np.nan
            row[f"{endpoint}_deciding_runs"] = needed
    return pd.DataFrame(rows)


def judge(
    rows: Sequence[dict[str, Any]],
    endpoint: str,
    sides: Sequence[tuple[Side, Side]],
    protocol: Protocol,
    *,
    is_incomplete: bool,
) -> None:
    """Writes what a set of contrasts comes to into its rows, with p-values that are adjusted for all of them.

    Args:
      rows: One per contrast.
      endpoint: With which the names of the columns begin.
      sides: Of each contrast, x and y.
      protocol: With the margin of the endpoint, and the fewest runs for a verdict.
      is_incomplete: Whether runs are missing, which leaves no verdict.
    """
    margin = protocol.margins[endpoint]
    found = [contrast(x, y, margin) for x, y in sides]
    fewest = [min(*x.sizes, *y.sizes) for x, y in sides]
    decided = decide(found, is_allowed=[not is_incomplete and n >= protocol.fewest_runs for n in fewest])
    for row, n, (x, y), each, outcome in zip(rows, fewest, sides, found, decided, strict=True):
        row |= {"n": n, f"{endpoint}_x": x.mean, f"{endpoint}_y": y.mean}
        for key, value in (asdict(each) | dict(outcome)).items():
            ending = f"difference_{key}" if key.startswith(("low", "high")) else key
            row[f"{endpoint}_{ending}"] = value
        row[f"{endpoint}_margin"] = margin


def improvement(data: Data) -> pd.DataFrame:
    """Tabulates the probability that a run of x scores higher than a run of y in the same scenario.

    Scores are clipped to [0, 1], and a difference up to the protocol's margin is a tie, which counts half.
    All scenarios weigh the same. A check is compared with the learner that it checks alone.
    """
    margin = 0.0 if data.protocol is None else data.protocol.score_margin
    rows = []
    for x, y in [*combinations(data.without_checks.learners, 2), *data.checks.items()]:
        found = [
            _probability_of_improvement(
                data.results(x, scenario, "clipped")[:, -1],
                data.results(y, scenario, "clipped")[:, -1],
                margin,
            )
            for scenario in data.learners[x]
        ]
        value, low, high = np.mean(found, axis=0)
        reach = [np.linalg.norm([p - a for p, a, _ in found]), np.linalg.norm([b - p for p, _, b in found])]
        low, high = (value - reach[0] / len(found), value + reach[1] / len(found))
        rows.append({"x": str(x), "y": str(y), "probability": value, "low": low, "high": high})
        rows.append({"x": str(y), "y": str(x), "probability": 1 - value, "low": 1 - high, "high": 1 - low})
    return pd.DataFrame(rows)


def profile(data: Data) -> pd.DataFrame:
    """Tabulates performance profiles: the share of runs that score at least a number, a mean over scenarios.

    They are of learners that are no checks.
    """
    frames = []
    for learner, populations in data.without_checks.learners.items():
        final = [data.results(learner, scenario, "score")[:, -1] for scenario in populations]
        sizes = [len(values) for values in final]
        sides = [
            Side([float((values >= score - _ROUNDING).mean()) for values in final], sizes)
            for score in PROFILE
        ]
        low, high = zip(*(side.interval for side in sides), strict=True)
        columns = {"score": PROFILE, "share": [side.mean for side in sides], "low": low, "high": high}
        frames.append(pd.DataFrame({**learner._asdict(), **columns}))
    return pd.concat(frames, ignore_index=True)


def curves(data: Data) -> pd.DataFrame:
    """Tabulates learning, one row per population and evaluation step.

    `disagreements` are wrong PINGs per 1,000 steps since the previous evaluation step, with Student's
    interval.
    """
    frames = []
    for learner, scenario, population in data.populations:
        steps = np.array(population.evaluation_steps)
        columns: dict[str, Any] = _named(learner, scenario) | {"step": steps}
        for name, field in ENDPOINTS.items():
            columns |= _proportion(name, data.results(learner, scenario, field))
        rate = np.diff(population.arrays["disagreements"], axis=1) / np.diff(steps) * 1000
        rate = np.column_stack([np.full(len(rate), np.nan), rate])  # nothing before the first step
        low, high = student(rate)
        columns |= {"disagreements": rate.mean(axis=0)}
        columns |= {"disagreements_low": np.maximum(low, 0.0), "disagreements_high": high}
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def curves_cpu(data: Data, learning: pd.DataFrame) -> pd.DataFrame:
    """Tabulates learning against the median CPU time that a run has spent on training by then.

    Args:
      data: The runs.
      learning: `curves`.
    """
    frames = []
    for learner, scenario, population in data.populations:
        seconds = np.median(_cpu_time_s(population), axis=0)
        columns = _named(learner, scenario) | {"step": population.evaluation_steps, "cpu_time_s": seconds}
        frames.append(pd.DataFrame(columns))
    keys = ["scenario", "algorithm", "observation", "step"]
    wanted = [*keys, *(f"success{end}" for end in ("", "_low", "_high"))]
    return pd.concat(frames, ignore_index=True).merge(learning[wanted], on=keys, validate="one_to_one")


def threshold(data: Data) -> pd.DataFrame:
    """Tabulates when a policy first scores `GOOD_SCORE`, and from when on it stays there to the end.

    The end is the last evaluation. Medians count runs that never get there as infinite, and are infinite if
    these are half or more.
    """
    rows = []
    for learner, scenario, population in data.populations:
        good = data.results(learner, scenario, "score") >= GOOD_SCORE  # (N, T)
        steps = np.array([*population.evaluation_steps, np.inf])
        first = np.where(good.any(axis=1), good.argmax(axis=1), good.shape[1])
        bad_after = good.shape[1] - (~good)[:, ::-1].argmax(axis=1)  # the evaluation after the last bad one
        stays = np.where(good.all(axis=1), 0, bad_after)
        row: dict[str, Any] = _named(learner, scenario) | {"n": len(good)}
        for name, when in (("reached", first), ("stays", stays)):
            count = int((when < good.shape[1]).sum())
            low, high = proportion_interval(count / len(good), len(good))
            row |= {f"{name}_share": count / len(good)}
            row |= {f"{name}_share_low": float(low), f"{name}_share_high": float(high)}
            row[f"{name}_step_median"] = np.median(steps[when])
        rows.append(row)
    return pd.DataFrame(rows)


def region(data: Data) -> pd.DataFrame:
    """Tabulates how well the cells where agents value PING match the target region, as means over agents.

    Precision is the share of an agent's marked cells that lie in the region; agents that mark none have none,
    and `n_marking` counts the others. Recall is the share of the region that an agent marks, and `overlap` an
    agent's intersection over union.
    """
    rows = []
    for learner, scenario, population in data.populations:
        right, marked = _right_and_marked(population)
        marking = marked > 0
        row: dict[str, Any] = _named(learner, scenario) | {"n": len(right), "cells_marked": marked.mean()}
        row["n_marking"] = int(marking.sum())
        row |= _scalars(_proportion("precision", (right[marking] / marked[marking])[:, None]))
        row |= _scalars(_proportion("recall", (right / population.in_target.sum())[:, None]))
        overlaps = overlap(population.values_ping, population.in_target)[:, None]
        row |= _scalars(_proportion("overlap", overlaps))
        rows.append(row)
    return pd.DataFrame(rows)


def cost(data: Data) -> pd.DataFrame:
    """Tabulates what a run costs, one row per learner: medians over its runs, and the range of CPU time."""
    rows = []
    for learner, by_scenario in data.learners.items():
        every = list(by_scenario.values())
        seconds = np.concatenate([_cpu_time_s(p)[:, -1] for p in every])
        memory = [run["peak_memory_mb"] for p in every for run in p.provenance]
        known = [mb for mb in memory if mb is not None]
        budget = every[0].settings.budget
        rows.append(
            {
                "algorithm": learner.algorithm,
                "observation": learner.observation,
                "runs": len(seconds),
                "cpu_time_s": np.median(seconds),
                "cpu_time_s_min": seconds.min(),
                "cpu_time_s_max": seconds.max(),
                "steps_per_cpu_s": budget / np.median(seconds),
                "updates": np.median(np.concatenate([p.arrays["updates"] for p in every])),
                "parameters": int(every[0].arrays["parameters"][0]),
                "peak_memory_mb": np.median(known) if known else np.nan,
            }
        )
    return pd.DataFrame(rows)


def maps(data: Data) -> pd.DataFrame:
    """Tabulates final values over agents, one row per scenario, learner, cell and action.

    `value` is the mean Q, or the mean probability of a stochastic policy; `marked` is the share of agents
    that value PING in the cell. The learners are those that are no checks, the scenarios those whose
    observations are cells.
    """
    frames = []
    for learner, scenario, population in data.mapped:
        row, column = population.model.position.repeat(len(ACTIONS), axis=0).T
        stochastic = population.arrays["stochastic"]
        final = stochastic[:, -1] if stochastic.shape[1] else population.arrays["q"]
        alive = population.arrays["diverged_at"] < 0
        value = final[alive].mean(axis=0) if alive.any() else np.full(final.shape[1:], np.nan)
        columns = _named(learner, scenario) | {
            "row": row,
            "column": column,
            "action": np.tile(ACTIONS, population.model.n_observations),
            "kind": "probability" if stochastic.shape[1] else "q",
            "value": value.ravel(),
            "marked": population.values_ping.mean(axis=0).repeat(len(ACTIONS)),
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def _named(learner: Learner, scenario: str) -> dict[str, Any]:
    """Returns the columns that name a population."""
    return {"scenario": scenario, "algorithm": learner.algorithm, "observation": learner.observation}


def _proportion(name: str, values: NDArray[Any]) -> dict[str, NDArray[np.float64]]:
    """Returns columns of the mean over agents of (N, T) numbers in [0, 1]; without agents, of NaN."""
    if not len(values):
        none = np.full(values.shape[1], np.nan)
        return {name: none, f"{name}_low": none, f"{name}_high": none}
    mean = values.mean(axis=0)
    low, high = proportion_interval(mean, len(values))
    return {name: mean, f"{name}_low": low, f"{name}_high": high}


def _side(data: Data, learner: Learner, field: str, start: str = "start") -> Side:
    """Returns a learner's means by scenario at the end of training."""
    final = [data.results(learner, scenario, field, start)[:, -1] for scenario in data.learners[learner]]
    return Side([float(values.mean()) for values in final], [len(values) for values in final])


def _scalars(columns: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Returns columns of one row as numbers."""
    return {name: float(values.item()) for name, values in columns.items()}


def _right_and_marked(population: Population) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Returns how many cells of the target region each agent marks, and how many of all, (N,) each."""
    marked = population.values_ping
    return (marked & population.in_target).sum(axis=1), marked.sum(axis=1)


def _cpu_time_s(population: Population) -> NDArray[np.float64]:
    """Returns the CPU seconds that each run spent on training until each evaluation step, (N, T)."""
    return np.array([run["cpu_time_s"] for run in population.provenance])


def _probability_of_improvement(
    x: NDArray[np.float64], y: NDArray[np.float64], margin: float
) -> tuple[float, float, float]:
    """Returns the probability that a run of x is ahead by more than a margin, with its interval."""
    ordered = np.sort(y)
    n_below = np.searchsorted(
        ordered, x - margin - _ROUNDING, "left"
    ).sum()  # runs of y that a run of x beats
    n_above = (len(y) - np.searchsorted(ordered, x + margin + _ROUNDING, "right")).sum()
    pairs = len(x) * len(y)
    p = float((pairs + n_below - n_above) / (2 * pairs))
    return p, *better_probability(p, len(x), len(y))
