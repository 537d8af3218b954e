"""Jobs: runs that are trained together where the work is done, evaluated, and made into records.

Runs of a job differ by their seed alone. Training together equals training alone, so how runs fall
into jobs changes no result.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache, partial

import numpy as np

from agents import Schedule, Training, check_training, load_algorithm
from agents.dynamic_programming import evaluate
from agents.policy import mask_policy, uniform_policy
from benchmark.provenance import peak_memory_mb, provenance, reset_peak_memory
from benchmark.records import Array, Floats
from benchmark.specification import RunSpecification, given_up, solved
from benchmark.store import VALUE_DECIMALS, Record, evaluated
from envs import InputError, Model
from envs.observations import compile_seen
from envs.packages import contained

Job = list[RunSpecification]

# Of a job with several runs: budget units, since an interrupt waits for jobs in threads, and bytes.
MAX_JOB_WORK = 10_000_000
MAX_JOB_SIZE = 250_000_000
EXPLORED = 0.05  # probability of a random action, for learners without a stochastic policy
# Fields of `Training` that exports need, also of runs that record only curves.
POLICY = ("greedy", "q", "stochastic")
_CURVE = ("disagreements", "cpu_time_s", "updates", "parameters", "diverged_at")


def plan(runs: Sequence[RunSpecification]) -> list[Job]:
    """Splits runs, none of which comes twice, into jobs, in the order of the first run of each."""
    populations = dict[str, Job]()
    for run in runs:
        populations.setdefault(run.population, []).append(run)
    index = {run.digest: i for i, run in enumerate(runs)}
    jobs = []
    for population in populations.values():
        first = population[0]
        limit = min(MAX_JOB_WORK // first.settings.budget, MAX_JOB_SIZE // first.record_size)
        size = max(1, min(load_algorithm(first.algorithm).batch_size, limit))
        jobs += [population[i : i + size] for i in range(0, len(population), size)]
    return sorted(jobs, key=lambda job: index[job[0].digest])


def execute_job(job: Job) -> list[Record]:
    """Trains the runs of a job, evaluates policies exactly, and returns the records in order.

    If training raises an exception, all of them have failed.
    """
    started_at, started = datetime.now(UTC), time.perf_counter()
    reset_peak_memory()
    try:
        if replace(job[0]).digest != job[0].digest:
            raise InputError("a module that the run depends on has changed; run it again.")
        train = _trained if job[0].solved is None else _trained_until_solved
        columns = contained()(train)(job)
    except Exception as exception:
        return failures(job, exception)
    made = provenance(job[0].algorithm) | {
        "started_at": started_at.isoformat(timespec="seconds"),
        "wall_time_s": (time.perf_counter() - started) / len(job),
        "peak_memory_mb": peak_memory_mb(),
    }
    # CPU time is measured, so it is no result: arrays are the same whenever a run is repeated.
    cpu_time_s = columns.pop("cpu_time_s")
    return [
        Record(
            digest=run.digest,
            specification=run.content,
            status="done" if columns["diverged_at"][i] < 0 else "diverged",
            provenance=made | {"cpu_time_s": cpu_time_s[i].tolist()},
            arrays={name: values[i] for name, values in columns.items()},
        )
        for i, run in enumerate(job)
    ]


def failures(job: Job, error: BaseException) -> list[Record]:
    """Returns the records of a job that has failed."""
    message = f"{type(error).__name__}: {error}"
    return [Record(run.digest, run.content, "failed", {}, {}, message) for run in job]


def _train(job: Job, model: Model, schedule: Schedule) -> Training:
    first, seeds = job[0], [run.seed_sequence for run in job]
    algorithm = load_algorithm(first.algorithm)
    training = algorithm.train(model, first.settings, first.observation, seeds, schedule)
    check_training(training, model, len(job), schedule)
    return training


# Runs that are trained to their budget


def _trained(job: Job) -> dict[str, Array]:
    """Trains N runs; returns what their records hold, (N, ...) each, see `Record`."""
    horizon, model = job[0].horizon, compile_seen(job[0].scenario, job[0].observation)
    training = _train(job, model, job[0].schedule)
    # Equal policies, as all are before the first step, are evaluated once.
    policies = training.greedy.reshape(-1, model.n_observations)
    masks, where = np.unique(policies, axis=0, return_inverse=True)
    where = where.reshape(training.greedy.shape[:2])  # (N, T)
    greedy = vars(evaluate(model, mask_policy(masks), horizon))
    stochastic = vars(evaluate(model, training.stochastic, horizon))
    values = np.round(training.values.astype(np.float64), VALUE_DECIMALS)
    return {
        **vars(training),
        "values": values.astype(np.float32),
        "stochastic": training.stochastic[:, -1:],
        **{evaluated(name, "greedy"): found[where] for name, found in greedy.items()},
        **{evaluated(name, "stochastic"): found for name, found in stochastic.items()},
    }


# Runs that are measured until they have solved their scenario


def _trained_until_solved(job: Job) -> dict[str, Array]:
    """Trains N runs, each in its own scenario; returns their curves, (N, ...) each."""
    curves = [_until_solved(run) for run in job]
    return {name: np.concatenate([columns[name] for columns in curves]) for name in curves[0]}


def _until_solved(run: RunSpecification) -> dict[str, Array]:
    """Trains a run until it has solved its scenario or is given up, see `Solved`.

    Returns its curves, (1, ...). After the point at which that is certain, a curve repeats its
    value. If the run is trained to its budget, because its algorithm cannot end early or there are
    unseen places, the last point is that of the last policy, unless the run is given up.
    `unseen_success`, (1, 0 to 2, 2), is success of the greedy and the stochastic one of the same
    policies in unseen places, and among onlookers who stand in new ways, where there are any.
    """
    assert run.solved is not None
    which = int(run.solved["policy"] == "stochastic")
    model = compile_seen(run.scenario.drawn(run.seed), run.observation)
    schedule, n_steps = run.schedule, len(run.schedule.evaluation_steps)
    so_far: list[float] = []

    @cache
    def success(policy: bytes) -> float:
        table = np.frombuffer(policy).reshape(model.n_observations, -1)
        return float(evaluate(model, table, run.horizon).success)

    def may_end(_: int, table: Floats) -> bool:
        greedy = mask_policy((1 << table.argmax(axis=1)).astype(np.uint8))
        so_far.append(success((table.astype(np.float64) if which else greedy).tobytes()))
        return _is_over(run, so_far)[0]

    unseen = [
        kind
        for kind, starts in (("unseen", model.unseen_starts), ("new_way", model.new_way_starts))
        if len(starts)
    ]
    training = _train([run], model, replace(schedule, may_end=None if unseen else may_end))
    policies = partial(_policies, training, model)
    if which and not training.stochastic.shape[1]:
        raise ValueError(f"{run.algorithm} learns no stochastic policy; accepted: policy = greedy.")
    curve: list[float] = []
    is_given_up = False
    for i in range(n_steps):
        curve.append(success(policies(i)[which].tobytes()))
        is_over, is_given_up = _is_over(run, curve)
        if is_over:
            break
    last = -1
    if is_given_up:
        last = len(curve) - 1
        training.disagreements[:, last:] = training.disagreements[:, [last]]
    curve += [curve[-1]] * (n_steps - len(curve))
    final = policies(last)
    curve[-1] = success(final[which].tobytes())
    scored = [evaluate(model, np.stack(final), run.horizon, kind).success for kind in unseen]
    columns = {name: getattr(training, name) for name in _CURVE + POLICY * bool(run.keep)}
    unseen_success = np.reshape(scored, (1, len(unseen), 2))
    return columns | {"success": np.array([curve]), "unseen_success": unseen_success}


def _policies(training: Training, model: Model, i: int) -> tuple[Floats, Floats]:
    """Returns the greedy and the stochastic policy of the only agent at an evaluation."""
    greedy = mask_policy(training.greedy[0, i])
    if training.stochastic.shape[1]:
        return greedy, training.stochastic[0, i]
    return greedy, (1 - EXPLORED) * greedy + EXPLORED * uniform_policy(model)


def _is_over(run: RunSpecification, curve: Sequence[float]) -> tuple[bool, bool]:
    """Returns whether a run has surely learned or is given up, and whether it is given up."""
    assert run.solved is not None
    steps, level = run.schedule.evaluation_steps, run.solved["success"]
    is_given_up = given_up(curve, steps, level, run.solved.get("given_up_after") or math.inf)
    return solved(curve, steps, level)[1] or is_given_up, is_given_up
