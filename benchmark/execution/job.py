"""Executes a job where the work is done: trains its runs, evaluates them, and makes their records."""

import math
import time
from contextlib import suppress
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents import Schedule, Training, check_training, load_algorithm
from agents.dynamic_programming import Evaluation, evaluate
from agents.policy import mask_policy, uniform_policy
from benchmark.execution.plan import Job
from benchmark.execution.provenance import peak_memory_mb, provenance, reset_peak_memory
from benchmark.execution.store import VALUE_DECIMALS, Arrays, Record, evaluated
from benchmark.experiments import RunSpecification
from benchmark.experiments.run import given_up, solved
from envs import InputError, Model
from envs.observations import compile_seen
from envs.packages import contained

EXPLORED: Final = 0.05  # probability of a random action in the stochastic policy of learners that have none
# Fields of `Training` that exports need, also of runs that record only curves.
POLICY: Final = ("greedy", "q", "stochastic")


def execute_job(job: Job) -> list[Record]:
    """Trains the runs of a job, evaluates all their policies exactly, and returns their records in order.

    If training raises an exception, all of them have failed.
    """
    started = time.perf_counter()
    reset_peak_memory()
    try:
        if replace(job[0]).digest != job[0].digest:
            raise InputError("a module that the run depends on has changed; run the experiment again.")
        columns = recorded(contained()(_train_and_evaluate)(job))
    except Exception as exception:
        return failures(job, exception, started)
    measured = provenance(job[0].algorithm) | _times(job, started) | {"peak_memory_mb": peak_memory_mb()}
    # CPU time is measured, so it is no result: arrays are the same whenever a run is repeated.
    cpu_time_s = columns.pop("cpu_time_s")
    return [
        Record(
            digest=run.digest,
            specification=run.content,
            status="done" if columns["diverged_at"][i] < 0 else "diverged",
            provenance=measured | {"cpu_time_s": cpu_time_s[i].tolist()},
            arrays={name: values[i] for name, values in columns.items()},
        )
        for i, run in enumerate(job)
    ]


def recorded(columns: Arrays) -> dict[str, NDArray[np.generic]]:
    """Returns what records hold of the arrays of N runs, (N, ...), see `Record`."""
    if "values" not in columns:  # only curves
        return {**columns}
    return {
        **columns,
        "values": np.round(columns["values"].astype(np.float64), VALUE_DECIMALS).astype(np.float32),
        "stochastic": columns["stochastic"][:, -1:],
    }


def failures(job: Job, error: BaseException, started: float) -> list[Record]:
    """Returns the records of a job that has failed now, given when it started (`time.perf_counter`)."""
    measured = _times(job, started) | {"peak_memory_mb": None, "cpu_time_s": []}
    with suppress(InputError):  # an algorithm that cannot be imported here has no versions
        measured |= provenance(job[0].algorithm)
    message = f"{type(error).__name__}: {error}"
    return [Record(run.digest, run.content, "failed", measured, {}, message) for run in job]


def _times(job: Job, started: float) -> dict[str, object]:
    seconds = time.perf_counter() - started
    started_at = (datetime.now(UTC) - timedelta(seconds=seconds)).isoformat(timespec="seconds")
    return {"started_at": started_at, "wall_time_s": seconds / len(job)}


def _train(job: Job, model: Model, schedule: Schedule) -> Training:
    first, seeds = job[0], [run.seed_sequence for run in job]
    algorithm = load_algorithm(first.algorithm)
    training = algorithm.train(model, first.settings, first.observation, seeds, schedule)
    check_training(training, model, len(job), schedule)
    return training


def _train_and_evaluate(job: Job) -> Arrays:
    first = job[0]
    if first.solved is not None:
        curves = [_train_until_solved(run) for run in job]
        return {name: np.concatenate([columns[name] for columns in curves]) for name in curves[0]}
    model = compile_seen(first.scenario, first.observation)
    training = _train(job, model, first.schedule)
    columns = {field.name: getattr(training, field.name) for field in fields(training)}
    # Equal policies, as all are before the first step, are evaluated once.
    masks, where = np.unique(training.greedy.reshape(-1, model.n_observations), axis=0, return_inverse=True)
    shape = training.greedy.shape[:2]  # (N, T)
    for start in first.evaluated_from:
        greedy = evaluate(model, mask_policy(masks), first.horizon, start)
        stochastic = evaluate(model, training.stochastic, first.horizon, start)
        for name in (field.name for field in fields(Evaluation)):
            values = getattr(greedy, name)[where.ravel()]
            columns[evaluated(name, "greedy", start)] = values.reshape(*shape, *values.shape[1:])
            columns[evaluated(name, "stochastic", start)] = getattr(stochastic, name)
    return columns


def _train_until_solved(run: RunSpecification) -> Arrays:
    """Trains a run until it has solved its scenario or is given up, see `Solved`.

    Returns its curves, (1, ...). After the point at which that is certain, a curve repeats its value. If the
    run is trained to its budget, because its algorithm cannot end early or there are unseen places, the last
    point is that of the last policy, unless the run is given up. `unseen_success` (1, 2, 2) is success in
    unseen places: when learned or given up and at the budget, by the greedy and the stochastic policy.
    """
    assert run.solved is not None
    enough, is_greedy = float(run.solved["success"]), run.solved["policy"] == "greedy"
    model = compile_seen(run.drawn_scenario, run.observation)
    schedule, has_unseen = run.schedule, len(model.unseen_starts) > 0
    n_steps = len(schedule.evaluation_steps)
    success: list[float] = []
    after = float(run.solved.get("given_up_after") or math.inf)
    is_given_up = partial(given_up, success, schedule.evaluation_steps, enough, after)

    def is_over(policy: NDArray[np.float64]) -> bool:
        success.append(float(evaluate(model, policy, run.horizon).success))
        return solved(success, schedule.evaluation_steps, enough)[1] or is_given_up()

    def may_end(_: int, table: NDArray[np.float64]) -> bool:
        return is_over(mask_policy((1 << table.argmax(axis=1)).astype(np.uint8)) if is_greedy else table)

    training = _train([run], model, replace(schedule, may_end=None if has_unseen else may_end))
    has_stochastic = training.stochastic.shape[1] > 0
    if not is_greedy and not has_stochastic:
        raise ValueError(f"{run.algorithm} learns no stochastic policy; accepted: policy = greedy.")

    def policies(i: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        greedy = mask_policy(training.greedy[0, i])
        explored = (1 - EXPLORED) * greedy + EXPLORED * uniform_policy(model)
        return greedy, training.stochastic[0, i] if has_stochastic else explored

    has_ended = 0 < len(success) < n_steps and training.diverged_at[0] < 0
    is_early = has_ended
    while not has_ended and (i := len(success)) < n_steps:
        has_ended = is_over(policies(i)[not is_greedy])
    i_learned = len(success) - 1
    success += [success[-1]] * (n_steps - len(success))
    if is_given_up():
        training.disagreements[:, i_learned:] = training.disagreements[:, [i_learned]]
    elif not is_early:
        success[-1] = float(evaluate(model, policies(n_steps - 1)[not is_greedy], run.horizon).success)
    unseen = np.empty((1, 0, 2))
    if has_unseen:
        scored = np.stack([policy for i in (i_learned, n_steps - 1) for policy in policies(i)])
        unseen = evaluate(model, scored, run.horizon, "unseen").success.reshape(1, 2, 2)
    columns = {"success": np.array([success]), "unseen_success": unseen}
    names = ("disagreements", "cpu_time_s", "updates", "parameters", "diverged_at")
    return columns | {name: getattr(training, name) for name in (*names, *(POLICY if run.keep else ()))}
