"""Tables of a comparison: what each learner scored, what it cost, and what it knows.

A learner is an arm of the experiment with one observation. Score matrices are (runs x tasks), where tasks are
scenarios, as in rliable (Agarwal et al. 2021), which estimates what is reported over all scenarios. Intervals
are 95 % percentile bootstrap intervals over runs, and seeded.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import combinations
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, interquartile_mean, mean_with_interval
from benchmark.analysis.population import GOOD_SCORE, Population, overlap
from benchmark.execution.store import evaluated
from benchmark.reports.comparison.data import Data, Learner, Scores
from envs import ACTIONS, ZONES

PROFILE: Final = np.round(np.linspace(0, 1, 51), 2)  # scores at which performance profiles are tabulated
METRICS: Final = ("iqm", "median", "mean", "optimality_gap")


def scores(data: Data) -> pd.DataFrame:
    """Tabulates every run at the end of training.

    `uncomfortable_steps` and `steps` are expectations under the greedy policy from the start; `every_cell_`
    marks those of episodes that start in any cell. `diverged_at` is infinite if a run did not diverge.
    """
    frames = []
    for learner, scenario, population in data.populations:
        columns = _final(learner, scenario, population, "greedy")
        right, marked = _right_and_marked(population)
        columns["target_cells_marked"] = right
        columns["cells_marked"] = marked
        columns["region_overlap"] = overlap(population.values_ping, population.in_target)
        columns["disagreements"] = population.arrays["disagreements"][:, -1]
        diverged_at = population.arrays["diverged_at"]
        columns["diverged_at"] = np.where(diverged_at < 0, np.inf, diverged_at)
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def scores_stochastic(data: Data) -> pd.DataFrame | None:
    """Tabulates every run that learned a stochastic policy at the end of training, by that policy."""
    frames = [
        pd.DataFrame(_final(learner, scenario, population, "stochastic"))
        for learner, scenario, population in data.populations
        if _has_stochastic(population)
    ]
    return pd.concat(frames, ignore_index=True) if frames else None


def _has_stochastic(population: Population) -> bool:
    """Returns whether the learner learns a stochastic policy."""
    return bool(population.scores_of("stochastic", "start").shape[1])


def _final(learner: Learner, scenario: str, population: Population, policy: str) -> dict[str, Any]:
    """Returns how good a policy is at the end of training, with the same names for every policy."""
    columns: dict[str, Any] = _named(learner, scenario) | {"seed": population.seeds}
    for start in population.specification["evaluated_from"]:
        values = {"score": population.scores_of(policy, start)}
        for name in ("success", "steps", "wrong_pings"):
            values[name] = population.arrays[evaluated(name, policy, start)]
        zones = population.arrays[evaluated("zone_steps", policy, start)]
        values["uncomfortable_steps"] = zones[..., ZONES.index("uncomfortable")]
        for name, over_training in values.items():
            columns[evaluated(name, "greedy", start)] = over_training[:, -1]
    return columns


def summary(data: Data) -> pd.DataFrame:
    """Tabulates every population at the end of training; unless a column says otherwise, greedy policies."""
    rows = []
    for learner, scenario, population in data.populations:
        last = population.scores[:, -1:]
        row: dict[str, Any] = _named(learner, scenario) | {
            "n": len(last),
            "diverged": int((population.arrays["diverged_at"] >= 0).sum()),
        }
        row |= _scalars(_mean("score_mean", population, last))
        row |= _scalars(interquartile_mean("score_iqm", last))
        for name in ("success", "steps", "wrong_pings"):
            row |= _scalars(_mean(name, population, population.arrays[name][:, -1:]))
        zones = population.arrays["zone_steps"][:, -1:, ZONES.index("uncomfortable")]
        row |= _scalars(_mean("uncomfortable_steps", population, zones))
        for policy in ("greedy", "stochastic"):
            for start in population.specification["evaluated_from"]:
                if (policy, start) == ("greedy", "start"):
                    continue
                last_scores = population.scores_of(policy, start)[:, -1:]
                if not last_scores.shape[1]:
                    continue
                success = population.arrays[evaluated("success", policy, start)][:, -1:]
                row |= _scalars(interquartile_mean(evaluated("score_iqm", policy, start), last_scores))
                row |= _scalars(_mean(evaluated("success", policy, start), population, success))
        rows.append(row)
    return pd.DataFrame(rows)


def aggregate(data: Data) -> pd.DataFrame:
    """Tabulates rliable's aggregates over all scenarios, one row per learner, policy and metric.

    The optimality gap is how far runs fall short of the score 1 on average. Scores have no lower bound, so
    neither the mean nor the gap is bounded.
    """
    from rliable import metrics

    functions = (
        _interquartile_mean,
        metrics.aggregate_median,
        metrics.aggregate_mean,
        metrics.aggregate_optimality_gap,
    )
    starts = next(data.populations)[2].specification["evaluated_from"]
    frames = []
    for policy in ("greedy", "stochastic"):
        for start in starts:
            matrices = {learner: data.scores(learner, policy, start) for learner in data.learners}
            matrices = {learner: matrix for learner, matrix in matrices.items() if len(matrix)}
            values, bounds = _estimate(matrices, lambda matrix: np.array([f(matrix) for f in functions]))
            for learner, estimates in values.items():
                low, high = bounds[learner]
                columns = {"policy": policy, "evaluated_from": start, "metric": METRICS}
                frames.append(_frame(learner, columns | {"value": estimates, "low": low, "high": high}))
    return pd.concat(frames, ignore_index=True)


def improvement(data: Data) -> pd.DataFrame:
    """Tabulates the probability that a run of x outscores a run of y in the same scenario.

    All scenarios weigh the same. A tie counts half, as in the Mann-Whitney statistic. A check is compared
    with the learner that it checks alone.
    """
    pairs = [*combinations(data.without_checks.learners, 2), *data.checks.items()]
    matrices = {pair: tuple(data.scores(learner) for learner in pair) for pair in pairs}
    values, bounds = _estimate(matrices, _probability_of_improvement)
    rows = []
    for (x, y), value in values.items():
        low, high = bounds[x, y].ravel()
        p = float(value.item())
        rows.append({"x": str(x), "y": str(y), "probability": p, "low": low, "high": high})
        rows.append({"x": str(y), "y": str(x), "probability": 1 - p, "low": 1 - high, "high": 1 - low})
    return pd.DataFrame(rows)


def profile(data: Data) -> pd.DataFrame:
    """Tabulates performance profiles: the share of runs in all scenarios that score above a number.

    They are of learners that are no checks.
    """
    from rliable import library

    matrices = {learner: data.scores(learner) for learner in data.without_checks.learners}
    with _numpy_seeded():
        shares, bounds = library.create_performance_profile(matrices, PROFILE, reps=RESAMPLES // 2)
    return pd.concat(
        [
            _frame(
                learner,
                {"score": PROFILE, "share": share, "low": bounds[learner][0], "high": bounds[learner][1]},
            )
            for learner, share in shares.items()
        ],
        ignore_index=True,
    )


def curves(data: Data) -> pd.DataFrame:
    """Tabulates learning, one row per population and evaluation step.

    `disagreements` are wrong PINGs per 1,000 steps since the previous evaluation step.
    """
    frames = []
    for learner, scenario, population in data.populations:
        steps = np.array(population.evaluation_steps)
        columns: dict[str, Any] = _named(learner, scenario) | {"step": steps}
        columns |= interquartile_mean("score_iqm", population.scores)
        columns |= _mean("score_mean", population, population.scores)
        columns |= _mean("success", population, population.arrays["success"])
        for start in population.specification["evaluated_from"]:
            if start != "start":
                name = evaluated("score_iqm", "greedy", start)
                columns |= interquartile_mean(name, population.scores_of("greedy", start))
        rate = np.diff(population.arrays["disagreements"], axis=1) / np.diff(steps) * 1000
        rate = np.column_stack([np.full(len(rate), np.nan), rate])  # nothing before the first step
        columns |= _mean("disagreements", population, rate)
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def curves_stochastic(data: Data) -> pd.DataFrame | None:
    """Tabulates learning by the stochastic policy, of learners that have one: a row per evaluation step."""
    frames = []
    for learner, scenario, population in data.populations:
        if not _has_stochastic(population):
            continue
        columns: dict[str, Any] = _named(learner, scenario) | {"step": population.evaluation_steps}
        for start in population.specification["evaluated_from"]:
            name = evaluated("score_iqm", "greedy", start)  # as in `curves`
            columns |= interquartile_mean(name, population.scores_of("stochastic", start))
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True) if frames else None


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
    wanted = [
        *keys,
        *(f"{name}{end}" for name in ("score_iqm", "score_mean") for end in ("", "_low", "_high")),
    ]
    return pd.concat(frames, ignore_index=True).merge(learning[wanted], on=keys, validate="one_to_one")


def threshold(data: Data) -> pd.DataFrame:
    """Tabulates when a greedy policy first scores `GOOD_SCORE`, and from when on it stays there to the end.

    The end is the last evaluation. Medians count runs that never get there as infinite, and are infinite if
    these are half or more.
    """
    rows = []
    for learner, scenario, population in data.populations:
        good = population.scores >= GOOD_SCORE  # (N, T)
        steps = np.array([*population.evaluation_steps, np.inf])
        first = np.where(good.any(axis=1), good.argmax(axis=1), good.shape[1])
        bad_after = good.shape[1] - (~good)[:, ::-1].argmax(axis=1)  # the evaluation after the last bad one
        stays = np.where(good.all(axis=1), 0, bad_after)
        row: dict[str, Any] = _named(learner, scenario) | {"n": len(good)}
        for name, when in (("reached", first), ("stays", stays)):
            count = int((when < good.shape[1]).sum())
            # Where all runs agree, resampling shows no uncertainty; the exact binomial interval does.
            bounds = stats.binomtest(count, len(good)).proportion_ci()
            row |= {f"{name}_share": count / len(good)}
            row |= {f"{name}_share_low": bounds.low, f"{name}_share_high": bounds.high}
            row[f"{name}_step_median"] = np.median(steps[when])
        rows.append(row)
    return pd.DataFrame(rows)


def region(data: Data) -> pd.DataFrame:
    """Tabulates how well the cells where agents value PING match the target region.

    Precision is the share of marked cells that lie in the region, NaN where no agent marks any. Recall is the
    share of the region that an agent marks, and `overlap` an agent's intersection over union.
    """
    rows = []
    for learner, scenario, population in data.populations:
        right, marked = _right_and_marked(population)
        weights, n = population.weights, len(right)
        row: dict[str, Any] = _named(learner, scenario) | {"n": n, "cells_marked": marked.mean()}
        with np.errstate(invalid="ignore"):
            precision = (weights @ right) / (weights @ marked)
        # Resamples without any mark have no precision.
        low, high = np.nanpercentile(precision, [2.5, 97.5]) if marked.any() else (np.nan, np.nan)
        row |= {"precision": precision[0], "precision_low": low, "precision_high": high}
        row |= _scalars(_mean("recall", population, (right / population.in_target.sum())[:, None]))
        overlaps = overlap(population.values_ping, population.in_target)[:, None]
        row |= _scalars(_mean("overlap", population, overlaps))
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
    that value PING in the cell. The learners are those that are no checks.
    """
    frames = []
    for learner, scenario, population in data.without_checks.populations:
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


def _frame(learner: Learner, columns: Mapping[str, Any]) -> pd.DataFrame:
    """Returns columns after those that name a learner."""
    return pd.DataFrame({"algorithm": learner.algorithm, "observation": learner.observation, **columns})


def _mean(name: str, population: Population, values: NDArray[Any]) -> dict[str, NDArray[np.float64]]:
    """Names the mean over agents of (N, T) values, and its interval."""
    return mean_with_interval(name, population.weights @ values / len(values))


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


def _interquartile_mean(scores: Scores) -> float:
    """Returns rliable's statistic, by sorting, which is much faster than its trimmed mean."""
    ordered = np.sort(scores, axis=None)
    n_cut = len(ordered) // 4
    return float(ordered[n_cut : len(ordered) - n_cut].mean())


def _probability_of_improvement(x: Scores, y: Scores) -> NDArray[np.float64]:
    """Returns rliable's statistic, (1,), by binary search, which is much faster than ranks or all pairs."""
    n_below = 0  # twice the runs of y below each run of x; a tie adds one
    for x_scores, y_scores in zip(x.T, np.sort(y, axis=0).T, strict=True):  # of a scenario
        n_below += int(np.searchsorted(y_scores, x_scores, "left").sum())
        n_below += int(np.searchsorted(y_scores, x_scores, "right").sum())
    return np.array([n_below / (2 * x.size * len(y))])


def _estimate(
    matrices: Mapping[Any, Any], function: Callable[..., NDArray[np.float64]]
) -> tuple[dict[Any, NDArray[np.float64]], dict[Any, NDArray[np.float64]]]:
    """Returns rliable's point estimates and intervals, (2, ...), by stratified bootstrap."""
    if not matrices:
        return {}, {}
    from rliable import library

    with _numpy_seeded():
        values, bounds = library.get_interval_estimates(dict(matrices), function, reps=RESAMPLES)
    return values, bounds


@contextmanager
def _numpy_seeded() -> Iterator[None]:
    """Seeds NumPy's global generator, which rliable draws from despite its arguments, and restores it."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(BOOTSTRAP_SEED)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
