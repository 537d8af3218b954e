"""Stored runs as two tidy tables: `runs`, a row per run, and `curves`, a row per run and evaluation.

All published tables and figures are computed from these two, except for maps of action values.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate
from agents.policy import uniform_policy
from benchmark.analysis.records import Array, Records, load_records
from benchmark.execution.store import Store, evaluated
from benchmark.experiments import Population, RunSpecification
from benchmark.experiments.run import solved
from envs import ZONES, InputError, Model
from envs.model import kept_with_model

Floats = NDArray[np.float64]

# Columns that name a population
KEYS: Final = ("scenario", "condition", "variant", "observation", "learner")
ENDPOINTS: Final = ("success", "score", "unbounded_score", "steps", "wrong_pings", "uncomfortable_steps")


class Group(NamedTuple):
    """Runs that become rows of the tables: all of a population, or some."""

    population: Population
    runs: Sequence[RunSpecification]


def keys_of(population: Population) -> dict[str, str]:
    """Returns the columns that name a population, with one for each axis of its condition."""
    learner, condition = population.learner, population.condition
    names = population.scenario.name, condition.name, learner.variant, learner.observation, learner.name
    return dict(condition.axes) | dict(zip(KEYS, names, strict=True))


def tables(
    groups: Iterable[Group], store: Store, columns: Sequence[str] = ()
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns the tables `runs` and `curves`, in the order of the groups and their runs.

    They have all recorded results, or only the given columns. Raises an InputError if a record is missing or
    damaged, or if a learner does not learn the policy that counts.
    """
    runs, curves = [], []
    for group in groups:
        records, policy = load_records(group.runs, store), group.population.learner.declared.policy
        if records.run.solved is None and not records.arrays[evaluated("success", policy, "start")].shape[1]:
            where = f"{records.run.stream}: algorithms.{records.run.variant}.policy = {policy}"
            raise InputError(f"{where}: its training returns no such policy; accepted: greedy.")
        keys, steps = keys_of(group.population), records.evaluation_steps
        wanted = _recorded(records.run).intersection(columns or {*_RUN_COLUMNS, *_CURVE_COLUMNS})
        endpoints, progress = (
            {name: compute(records, policy) for name, compute in computed.items() if name in wanted}
            for computed in (_RUN_COLUMNS, _CURVE_COLUMNS)
        )
        identity = {"seed": records.seeds, "policy": policy, "budget": steps[-1]}
        runs.append(pd.DataFrame(keys | identity | endpoints, index=range(len(records.seeds))))
        if progress:
            at = {"seed": np.repeat(records.seeds, len(steps)), "step": np.tile(steps, len(records.seeds))}
            flat = {name: values.ravel() for name, values in progress.items()}
            curves.append(pd.DataFrame(keys | at | flat))
    return _joined(runs), _joined(curves)


def _joined(frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Returns one table; an axis that a population does not have is empty."""
    joined = pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()
    texts = [name for name in joined if not pd.api.types.is_numeric_dtype(joined[name])]
    return joined.assign(**{str(name): joined[name].fillna("") for name in texts})


def _recorded(run: RunSpecification) -> set[str]:
    if run.solved is not None:
        return _MAPPED
    names = {*_RUN_COLUMNS, *_CURVE_COLUMNS} - {*_UNSEEN, "earliness"}
    return {name for name in names if "every_cell" in run.evaluated_from or "every_cell_" not in name}


def _over_training(name: str, start: str, records: Records, policy: str) -> Floats:
    """Returns the evaluations of the policy that counts, (N, T)."""
    if name in ("score", "unbounded_score"):
        scores = records.unbounded_scores(policy, start)
        return scores if name == "unbounded_score" else np.clip(scores, 0.0, 1.0)
    if name == "uncomfortable_steps":
        steps = records.arrays[evaluated("zone_steps", policy, start)]
        return np.asarray(steps[..., ZONES.index("uncomfortable")])
    key = name if records.run.solved is not None else evaluated(name, policy, start)
    return np.asarray(records.arrays[key])


def _final(name: str, start: str, records: Records, policy: str) -> Floats:
    return _over_training(name, start, records, policy)[:, -1]


@kept_with_model
def _random_success(model: Model, horizon: int) -> float:
    """Returns how often the random policy succeeds, exactly."""
    return float(evaluate(model, uniform_policy(model), horizon).success)


def _unseen(when: int, named: str, records: Records, counting: str) -> Floats:
    """Returns the success in unseen places, (N,), by a policy or the one that counts; NaN without any."""
    found = records.arrays["unseen_success"]
    which = when, int((named or counting) == "stochastic")
    return found[:, *which] if found.size else np.full(len(found), math.nan)


def _area(records: Records, policy: str) -> Floats:
    """Returns the area under curves of success, (N,), as a share of the largest possible."""
    success, steps = _over_training("success", "start", records, policy), records.evaluation_steps
    return np.asarray(np.trapezoid(success, steps) / (steps[-1] - steps[0]))


def _earliness(records: Records, _: str) -> Floats:
    """Returns the share of the logarithm of the budget, (N,), that runs save by learning early."""
    run, steps = records.run, records.evaluation_steps
    assert run.solved is not None
    first = learned(records.arrays["success"], steps, float(run.solved["success"]), until=2)
    n_steps = np.maximum([*steps, steps[-1]], run.evaluation_every)[first]
    return np.asarray(1 - np.log(n_steps / run.evaluation_every) / np.log(steps[-1] / run.evaluation_every))


# Success in unseen places: when a run has learned (0) or at the budget (1), by which policy
_UNSEEN: Final = {
    "unseen_success": (0, ""),
    "unseen_greedy": (0, "greedy"),
    "unseen_stochastic": (0, "stochastic"),
    "unseen_budget": (1, ""),
    "unseen_budget_greedy": (1, "greedy"),
    "unseen_budget_stochastic": (1, "stochastic"),
}
_RUN_COLUMNS: Final[Mapping[str, Callable[[Records, str], Array]]] = {
    **{name: partial(_final, name, "start") for name in ENDPOINTS},
    **{f"every_cell_{name}": partial(_final, name, "every_cell") for name in ENDPOINTS},
    "greedy_success": lambda records, _: records.arrays["success"][:, -1],
    "random_success": lambda records, _: np.full(
        len(records.seeds), _random_success(records.model, records.run.horizon)
    ),
    **{name: partial(_unseen, *which) for name, which in _UNSEEN.items()},
    "area": _area,
    "earliness": _earliness,
    "training_wrong_pings": lambda records, _: records.arrays["disagreements"][:, -1],
    "diverged_at": lambda records, _: np.where(
        records.arrays["diverged_at"] < 0, np.inf, records.arrays["diverged_at"]
    ),
    "updates": lambda records, _: records.arrays["updates"],
    "parameters": lambda records, _: records.arrays["parameters"],
    "cpu_time_s": lambda records, _: np.array([run["cpu_time_s"][-1] for run in records.provenance]),
    "peak_memory_mb": lambda records, _: np.array(
        [run["peak_memory_mb"] or math.nan for run in records.provenance]
    ),
}
_CURVE_COLUMNS: Final[Mapping[str, Callable[[Records, str], Array]]] = {
    **{name: partial(_over_training, name, "start") for name in ("success", "score", "unbounded_score")},
    "training_wrong_pings": lambda records, _: records.arrays["disagreements"],
    "cpu_time_s": lambda records, _: np.array([run["cpu_time_s"] for run in records.provenance]),
}
# Runs that end when they have learned record nothing else.
_MAPPED: Final = {
    "success", "earliness", "training_wrong_pings", "diverged_at", "updates", "parameters", "cpu_time_s",
    "peak_memory_mb", *_UNSEEN,
}  # fmt: skip


def by_population(frame: pd.DataFrame) -> Iterator[tuple[dict[str, str], pd.DataFrame]]:
    """Yields the rows of every population with its keys."""
    for values, rows in frame.groupby([*KEYS], sort=False):
        yield dict(zip(KEYS, map(str, values), strict=True)), rows


def by_step(curves: pd.DataFrame, column: str) -> Floats:
    """Returns a column of the curves of one population by run and evaluation, (N, T)."""
    return curves[column].to_numpy().reshape(-1, curves["step"].nunique())


def learned(success: Floats, steps: Sequence[int], level: float, until: float = math.inf) -> NDArray[np.int_]:
    """Returns the index of the first evaluation, (N,), from which success stays at or above a level.

    It has to stay there until `until` times as many steps, or to the end; T if it never does.

    >>> curves = np.array([[0.0, 1.0, 0.0, 1.0, 1.0], [0.0, 1.0, 1.0, 0.0, 0.0]])
    >>> steps = [0, 100, 200, 300, 400]
    >>> learned(curves, steps, 0.9).tolist(), learned(curves, steps, 0.9, until=2).tolist()
    ([3, 5], [3, 1])
    """
    return np.array([solved(curve, steps, level, until)[0] for curve in success.tolist()], dtype=np.int_)
