"""Estimates what runs cost on this machine, before they are executed.

Of a population with stored runs from this kind of machine, their times, memory and sizes are taken. Of the
others, small jobs are executed for a few seconds: with few agents and a small budget first, and then with
more. The cost of a job is a fixed part and a part in proportion to agents and budget; the last two small jobs
give both. Populations that are left over when the time is up cost what a similar one does.

All this is measured on the machine as it is: if other programs use it, estimates are higher.
"""

import heapq
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

from agents import load_algorithm
from benchmark.execution.executors import ExecutorFactory
from benchmark.execution.executors.processes import Processes
from benchmark.execution.plan import Job, plan
from benchmark.execution.provenance import machine
from benchmark.execution.store import Record, Store, packed_size
from benchmark.experiments import RunSpecification, population_of
from envs import InputError, compile_scenario
from envs.inputs import parse

LIMIT_S: Final = 20.0  # of calibration, with imports and compilation
# By what factor an estimate may be wrong, by where it is from: a rule of thumb. On two slow cores that others
# used, too, an estimate from small jobs was once 2.4 times too low, as the load had changed in between.
DOUBT: Final = {"stored": 1.3, "calibrated": 2.5, "similar": 3.0}
_FIRST_PART: Final = 100  # of the budget, in the first small job
_FIRST_AGENTS: Final = 2
_SIMILAR_SIZE: Final = 1.5  # scenarios whose states differ by less than this factor cost the same


@dataclass(frozen=True)
class Cost:
    """What a job of a population costs: a fixed part, and a part of each run."""

    job_s: float
    run_s: float
    peak_memory_mb: float | None  # of the process
    run_size: float  # bytes in the store
    source: str  # a key of `DOUBT`

    def seconds(self, job: Job) -> float:
        """Returns the time that a job takes."""
        return self.job_s + self.run_s * len(job)


@dataclass(frozen=True)
class Estimate:
    """What it costs to execute the missing runs."""

    jobs: int
    seconds: tuple[float, float]  # at least, and at most; of the populations whose cost is known
    peak_memory: float | None  # bytes, of all processes together
    size: float  # bytes of records
    sources: Mapping[str, int]  # how many populations, by the source of their cost
    unknown: Sequence[RunSpecification]  # one of each population without an estimate
    failures: Sequence[str]  # of small jobs


@dataclass(frozen=True)
class _Point:
    """A small job that was measured."""

    work: float  # agents times budget in which they learn
    seconds: float
    job: Job
    record: Record


class Climb:
    """The small jobs of one population, from the first to larger ones."""

    def __init__(self, job: Job) -> None:
        """Starts without any.

        Args:
          job: The largest of the population.
        """
        self.job = job
        self.points: list[_Point] = []
        self.error = ""
        self._is_warm = False

    def add(self, small: Job, future: Future[list[Record]]) -> None:
        """Adds what was measured of a small job; the first one compiles, and says nothing."""
        try:
            record = future.result()[0]
            error = record.error
        except Exception as exception:  # its process died
            error = str(exception)
        if error is not None:
            self.error = f"{_name(small[0])}: {error}"
        elif self._is_warm:
            seconds = record.provenance["wall_time_s"] * len(small)
            self.points.append(_Point(_work(small), seconds, small, record))
        self._is_warm = True

    def predicted(self, small: Job) -> float:
        """Returns about how long a small job takes: 0 if nothing is known yet."""
        if not self.points:
            return 0.0
        if len(self.points) == 1:  # how much of it is fixed is not known
            return self.points[0].seconds * math.sqrt(_work(small) / self.points[0].work)
        job_s, rate = _line(self.points)
        return job_s + rate * _work(small)

    @cached_property
    def cost(self) -> Cost:
        """What jobs of the population cost."""
        run, last = self.job[0], self.points[-1]
        job_s, rate = _line(self.points)
        peak = last.record.provenance["peak_memory_mb"]
        if peak is not None:
            peak += (_bytes(self.job) - _bytes(last.job)) / 1e6
        # What is recorded along the way grows with the budget, the rest does not.
        arrays = last.record.arrays
        growing = packed_size({name: arrays[name] for name in ("greedy", "values")})
        scale = run.record_size / last.job[0].record_size
        run_size = packed_size(arrays) + growing * (scale - 1) + len(run.content)
        return Cost(job_s, rate * _work([run]), peak, run_size, "calibrated")


def estimate(
    runs: Sequence[RunSpecification],
    store: Store | None,
    jobs: int,
    cores: int,
    limit_s: float = LIMIT_S,
    executor: ExecutorFactory = Processes,
) -> Estimate:
    """Returns what it costs to execute runs that are missing in the store.

    Args:
      runs: The missing runs.
      store: Where others are stored; None if nowhere.
      jobs: How many jobs are under way at a time.
      cores: How many of them are faster than one.
      limit_s: How long to execute small jobs, at most.
      executor: Makes the worker that executes them.
    """
    started = time.monotonic()
    planned = plan(runs)
    largest: dict[str, Job] = {}  # of every population
    for job in planned:
        known = largest.setdefault(job[0].population, job)
        if len(job) > len(known):
            largest[job[0].population] = job
    costs: dict[str, Cost] = {}
    if store is not None:
        with suppress(InputError):  # it is damaged where it is asked
            costs = stored_costs(largest, store)
    todo = [job for population, job in largest.items() if population not in costs]
    sizes = {job[0].population: len(compile_scenario(job[0].scenario).next_state) for job in todo}
    chosen = _representatives(todo, planned, sizes)
    climbs, start_s = (
        calibrate(chosen, limit_s - (time.monotonic() - started), executor) if todo else ([], 0.0)
    )
    costs |= {climb.job[0].population: climb.cost for climb in climbs if climb.points}
    for job in todo:
        if job[0].population not in costs and (cost := _similar(job[0], climbs, sizes)):
            costs[job[0].population] = cost
    failures = [climb.error for climb in climbs if climb.error]
    return _total(planned, costs, jobs, min(jobs, cores), start_s, failures)


def stored_costs(populations: Mapping[str, Job], store: Store) -> dict[str, Cost]:
    """Returns the cost of the populations of which there are stored runs from this kind of machine.

    Args:
      populations: A job of each, by the population.
      store: Where stored runs are.
    """
    found: dict[str, list[tuple[Record, int]]] = {}
    for digest, (content, size) in store.contents().items():
        with suppress(InputError, TypeError, ValueError):  # a damaged record
            if (population := population_of(content)) in populations:
                (record,) = store.get([digest], arrays=False)
                if record.provenance["machine"] == machine():
                    found.setdefault(population, []).append((record, size + len(content)))
    costs = {}
    for population, records in found.items():
        measured = [record.provenance for record, _ in records]
        peaks = [each["peak_memory_mb"] for each in measured if each["peak_memory_mb"] is not None]
        costs[population] = Cost(
            job_s=0.0,
            run_s=sum(each["wall_time_s"] for each in measured) / len(records),
            peak_memory_mb=max(peaks, default=None),
            run_size=sum(size for _, size in records) / len(records),
            source="stored",
        )
    return costs


def calibrate(
    jobs: Sequence[Job], limit_s: float, executor: ExecutorFactory = Processes
) -> tuple[list[Climb], float]:
    """Executes small jobs of populations until the time is up.

    Args:
      jobs: The largest job of each population, the most important ones first.
      limit_s: When to stop, whatever is running then.
      executor: Makes the worker that executes them.

    Returns:
      The populations that were begun, and how long the worker took for its first job, with all imports.
    """
    end = time.monotonic() + limit_s
    climbs: list[Climb] = []
    start_s = 0.0
    with ExitStack() as stack:
        worker = executor(1)
        stack.callback(worker.cancel)  # kills it if it is busy
        for i, job in enumerate(jobs):
            climb = Climb(job)
            climbs.append(climb)
            for agents, budget in _ladder(job):
                small = _small(job, agents, budget)
                left_s = end - time.monotonic()
                if left_s <= 0:
                    return climbs, start_s
                if climb.predicted(small) > left_s / (len(jobs) - i):  # its share of what is left
                    break
                future = worker.submit(small)
                if not wait([future], timeout=left_s).done:
                    return climbs, start_s
                climb.add(small, future)
                start_s = start_s or limit_s - (end - time.monotonic())
                if climb.error:
                    break
    return climbs, start_s


def makespan(durations: Sequence[float], places: int) -> float:
    """Returns how long jobs take if each starts, in their order, as soon as a place is free.

    >>> makespan([3.0, 1.0, 1.0, 2.0], 2)
    4.0
    """
    free = [0.0] * places
    for duration in durations:
        heapq.heappush(free, heapq.heappop(free) + duration)
    return max(free)


def _ladder(job: Job) -> Iterator[tuple[int, int]]:
    """Yields agents and budgets of small jobs, the first one twice, up to the whole job.

    Evaluation time depends on how much a table has learned, so the whole budget comes first.
    """
    settings = job[0].settings
    rollout, budget = getattr(settings, "rollout", 1), settings.budget
    first = _idle(job[0]) + max(1, budget // _FIRST_PART)
    budgets = [min(math.ceil(first / rollout) * rollout, budget)]
    while budgets[-1] < budget:
        budgets.append(min(math.ceil(4 * budgets[-1] / rollout) * rollout, budget))
    agents = [min(_FIRST_AGENTS, len(job))]
    while agents[-1] < len(job):
        agents.append(min(agents[-1] * 2, len(job)))
    yield agents[0], budgets[0]
    yield from ((agents[0], n_units) for n_units in budgets)
    yield from ((n, budget) for n in agents[1:])


def _small(job: Job, agents: int, budget: int) -> Job:
    """Returns a job like this one, with other agents and another budget."""
    run = job[0]
    data = json.loads(run.settings.model_dump_json(exclude_unset=True)) | {"budget": budget}
    evaluation_every = min(run.evaluation_every, budget)
    small = replace(
        run,
        settings=parse(type(run.settings), data, run.arm),
        evaluation_every=evaluation_every,
        map_every=min(run.map_every, math.ceil(budget / evaluation_every) * evaluation_every),
    )
    return [small.with_seed(seed) for seed in range(agents)]


def _idle(run: RunSpecification) -> int:
    """Returns after how many steps an agent begins to learn."""
    starts: int = getattr(run.settings, "learning_starts", 0)
    return starts if starts < run.settings.budget else 0


def _work(job: Job) -> float:
    """Returns what the time of a job is in proportion to, but for a fixed part."""
    return len(job) * max(1, job[0].settings.budget - _idle(job[0]))


def _line(points: Sequence[_Point]) -> tuple[float, float]:
    """Returns the fixed part of a job's time and the time per unit of work, from the last two points.

    One point alone, or a noisy second one, means that all time is in proportion to work.
    """
    last = points[-1]
    rate = last.seconds / last.work
    if len(points) > 1:
        before = points[-2]
        slope = (last.seconds - before.seconds) / (last.work - before.work)
        rate = slope if 0 < slope < rate else rate
    return last.seconds - rate * last.work, rate


def _bytes(job: Job) -> int:
    """Returns about how many bytes are recorded in a job."""
    return len(job) * job[0].record_size


def _kind(run: RunSpecification) -> tuple[str, str, str]:
    """Returns what populations of a kind share: the algorithm, its settings, and the observation."""
    return run.algorithm, run.settings.model_dump_json(), run.observation


def _representatives(jobs: Sequence[Job], planned: Sequence[Job], sizes: Mapping[str, int]) -> list[Job]:
    """Chooses populations to calibrate: of every kind one with the fewest states, then one with the most.

    Some of every algorithm come before more of one, and what is most work before the rest.
    """
    n_runs: dict[str, int] = {}
    for job in planned:
        n_runs[job[0].population] = n_runs.get(job[0].population, 0) + len(job)
    kinds: dict[tuple[str, str, str], list[Job]] = {}
    for job in sorted(jobs, key=lambda job: sizes[job[0].population]):
        kinds.setdefault(_kind(job[0]), []).append(job)

    def work(kind: list[Job]) -> tuple[bool, float]:
        is_table = load_algorithm(kind[0][0].algorithm).family == "tabular"
        return is_table, -sum(n_runs[job[0].population] * _work(job[:1]) for job in kind)

    smallest, largest = [], []
    turns: dict[str, int] = {}  # how many kinds of each algorithm there are so far
    for kind in sorted(kinds.values(), key=work):
        algorithm = kind[0][0].algorithm
        turns[algorithm] = turns.get(algorithm, 0) + 1
        smallest.append((turns[algorithm], kind[0]))
        if sizes[kind[-1][0].population] / sizes[kind[0][0].population] > _SIMILAR_SIZE:
            largest.append((turns[algorithm], kind[-1]))
    return [job for group in (smallest, largest) for _, job in sorted(group, key=lambda each: each[0])]


def _similar(run: RunSpecification, climbs: Sequence[Climb], sizes: Mapping[str, int]) -> Cost | None:
    """Returns the cost of the most similar population that was calibrated; None if none has the algorithm."""

    def distance(climb: Climb) -> tuple[bool, bool, float]:
        other = climb.job[0]
        ratio = sizes[other.population] / sizes[run.population]
        return (
            _kind(other) != _kind(run),
            other.observation != run.observation,
            abs(math.log(ratio)),
        )

    candidates = [climb for climb in climbs if climb.points and climb.job[0].algorithm == run.algorithm]
    if not candidates:
        return None
    nearest = min(candidates, key=distance)
    other, cost = nearest.job[0], nearest.cost
    ratio = sizes[run.population] / sizes[other.population]
    run_s = cost.run_s * _work([run]) / _work([other])
    if load_algorithm(run.algorithm).family != "deep":  # most of the time goes into evaluations of all states
        run_s *= ratio
    is_same = _kind(other) == _kind(run) and 1 / _SIMILAR_SIZE < ratio < _SIMILAR_SIZE
    scale = run.record_size / other.record_size
    return replace(
        cost, run_s=run_s, run_size=cost.run_size * scale, source="calibrated" if is_same else "similar"
    )


def _total(
    planned: Sequence[Job],
    costs: Mapping[str, Cost],
    jobs: int,
    places: int,
    start_s: float,
    failures: Sequence[str],
) -> Estimate:
    """Adds up what jobs cost, if so many are under way, which take as long as with so many places."""
    known = [(job, costs[job[0].population]) for job in planned if job[0].population in costs]
    populations = {job[0].population: job[0] for job in planned}

    def seconds(doubt: Callable[[Cost], float], start_doubt: float) -> float:
        # First the command starts and imports, then its workers do.
        return makespan([cost.seconds(job) * doubt(cost) for job, cost in known], places) + (
            2 * start_s * start_doubt
        )

    peaks: dict[str, float] = {"thread": 0.0, "process": 0.0}
    n_processes = 0
    for job, cost in known:
        placement = load_algorithm(job[0].algorithm).placement
        peaks[placement] = max(peaks[placement], cost.peak_memory_mb or 0.0)
        n_processes += placement == "process"
    sources: dict[str, int] = {}
    for population in populations.keys() & costs.keys():
        sources[costs[population].source] = sources.get(costs[population].source, 0) + 1
    return Estimate(
        jobs=len(planned),
        seconds=(
            seconds(lambda cost: 1 / DOUBT[cost.source], 1 / DOUBT["calibrated"]),
            seconds(lambda cost: DOUBT[cost.source], DOUBT["calibrated"]),
        ),
        # Threads share the memory of this process, and every worker process has its own.
        peak_memory=2**20 * (peaks["thread"] + min(jobs, n_processes) * peaks["process"]) or None,
        size=sum(cost.run_size * len(job) for job, cost in known),
        sources=sources,
        unknown=[run for population, run in populations.items() if population not in costs],
        failures=failures,
    )


def _name(run: RunSpecification) -> str:
    """Returns how a population is called in a message."""
    return f"{run.scenario.name}, {run.arm}, {run.observation}"
