"""Estimates what runs cost on this machine, before they are executed.

Where such a machine has stored runs of a population, these give its cost. Of other kinds of learners
(algorithm, settings, observation) a short job is executed, and time is scaled in proportion to runs, budget
and, for tables, states.
"""

import math
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

from agents import load_algorithm
from benchmark.execution.executors import ExecutorFactory
from benchmark.execution.executors.processes import Processes
from benchmark.execution.job import failures
from benchmark.execution.plan import Job, plan
from benchmark.execution.provenance import machine
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, population_of
from envs import InputError, compile_scenario

LIMIT_S: Final = 20.0  # of all short jobs, with imports and compilation
# By what factor a time may be wrong, by where it is from: rules of thumb.
DOUBT: Final = {"stored runs": 1.3, "short jobs": 3.0}
_TABLES: Final = 4  # in a short job, with their whole budget
_PART: Final = 20  # of a net's budget, in a short job


@dataclass(frozen=True)
class Cost:
    """What a run costs."""

    seconds: float
    peak_memory_mb: float  # of its process; 0 if the system does not say
    source: str  # a key of `DOUBT`


@dataclass(frozen=True)
class Estimate:
    """What it costs to execute missing runs; time and memory are of those populations whose cost is known."""

    jobs: int
    seconds: tuple[float, float]  # at least, and at most
    peak_memory: float  # bytes, of all processes together; 0 if the system does not say
    size: int  # bytes of records, before compression
    sources: Mapping[str, int]  # how many populations, by the source of their cost
    unknown: Sequence[str]  # the variant of every population whose cost is not known
    errors: Sequence[str]  # of short jobs


def estimate(
    runs: Sequence[RunSpecification],
    store: Store | None,
    jobs: int,
    cores: int,
    limit_s: float = LIMIT_S,
    executor: ExecutorFactory = Processes,
) -> Estimate:
    """Returns what it costs to execute runs that are missing in the store, so many jobs at a time.

    Short jobs are executed for at most `limit_s` seconds, by a worker that `executor` makes.
    """
    planned = plan(runs)
    populations = {job[0].population: job for job in planned}
    costs: dict[str, Cost] = {}
    if store is not None:
        with suppress(InputError):  # it is damaged where it is read
            costs = _stored(populations, store)
    others = [job for population, job in populations.items() if population not in costs]
    rates, errors = _rates(others, limit_s, executor) if others else ({}, [])
    for run in (job[0] for job in others):
        if rate := rates.get(_kind(run)):
            costs[run.population] = replace(rate, seconds=rate.seconds * _work(run))
    known = [(job, costs[job[0].population]) for job in planned if job[0].population in costs]

    def seconds(exponent: int) -> float:
        times = [len(job) * cost.seconds * DOUBT[cost.source] ** exponent for job, cost in known]
        return max([sum(times) / min(jobs, cores), *times])

    n_processes = sum(load_algorithm(job[0].algorithm).placement == "process" for job, _ in known)
    peak = max((cost.peak_memory_mb for _, cost in known), default=0.0)
    return Estimate(
        jobs=len(planned),
        seconds=(seconds(-1), seconds(1)),
        peak_memory=2**20 * peak * max(1, min(jobs, n_processes)),  # threads share the memory of one process
        size=sum(run.record_size for run in runs),
        sources=Counter(cost.source for cost in costs.values()),
        unknown=[job[0].variant for population, job in populations.items() if population not in costs],
        errors=errors,
    )


def _stored(populations: Collection[str], store: Store) -> dict[str, Cost]:
    """Returns the cost of the populations of which such a machine has stored runs."""
    found: dict[str, list[Record]] = {}
    for digest, content in store.contents().items():
        with suppress(InputError, TypeError, ValueError):  # a damaged record
            if (population := population_of(content)) in populations:
                (record,) = store.get([digest], arrays=False)
                if record.provenance["machine"] == machine():
                    found.setdefault(population, []).append(record)
    return {population: _cost(records, "stored runs") for population, records in found.items()}


def _cost(records: Sequence[Record], source: str) -> Cost:
    seconds = [record.provenance["wall_time_s"] for record in records]
    peaks = [record.provenance["peak_memory_mb"] or 0.0 for record in records]
    return Cost(sum(seconds) / len(records), max(peaks), source)


def _rates(
    jobs: Sequence[Job], limit_s: float, executor: ExecutorFactory
) -> tuple[dict[tuple[str, ...], Cost], list[str]]:
    """Executes a short job of every kind of learner; returns costs per unit of work by kind, and errors."""
    rates: dict[tuple[str, ...], Cost] = {}
    errors: list[str] = []
    end = time.monotonic() + limit_s
    compiled: set[str] = set()  # algorithms
    worker = executor(1)
    try:
        for kind, job in {_kind(job[0]): _short(job) for job in jobs}.items():
            run = job[0]
            for _ in range(1 if run.algorithm in compiled else 2):  # the first time compiles
                try:
                    records = worker.submit(job).result(max(0.0, end - time.monotonic()))
                except TimeoutError:
                    return rates, errors
                except Exception as error:  # its process died
                    records = failures(job, error, time.perf_counter())
            compiled.add(run.algorithm)
            if records[0].error is None:
                cost = _cost(records, "short jobs")
                rates[kind] = replace(cost, seconds=cost.seconds / _work(run))
            else:
                where = f"{run.scenario.name}, {run.variant}, {run.observation}"
                errors.append(f"{where}: {records[0].error}")
    finally:
        worker.cancel()  # kills it if it is busy
    return rates, errors


def _short(job: Job) -> Job:
    """Returns a few tables of a job with their whole budget, or a net with a small part of it."""
    run, settings = job[0], job[0].settings
    if load_algorithm(run.algorithm).family != "deep":
        return job[:_TABLES]
    rollout, learning = getattr(settings, "rollout", 1), _learning_steps(run)
    steps = settings.budget - learning + learning / _PART
    budget = min(math.ceil(steps / rollout) * rollout, settings.budget)
    settings = settings.model_copy(update={"budget": budget})
    return [replace(run, settings=settings, evaluation_every=budget, map_every=budget)]


def _kind(run: RunSpecification) -> tuple[str, ...]:
    return run.algorithm, run.settings.model_dump_json(), run.observation


def _learning_steps(run: RunSpecification) -> int:
    """Returns in how many steps of its budget an agent learns."""
    budget, starts = run.settings.budget, getattr(run.settings, "learning_starts", 0)
    return budget - starts if starts < budget else budget


def _work(run: RunSpecification) -> int:
    """Returns what time is in proportion to; that of a table goes into evaluations of all states."""
    is_deep = load_algorithm(run.algorithm).family == "deep"
    return _learning_steps(run) * (1 if is_deep else len(compile_scenario(run.scenario).next_state))
