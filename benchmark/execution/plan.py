"""Splits runs into jobs.

A job is a list of runs that differ by their seed alone and are trained by one call. Training together equals
training alone, so how runs fall into jobs changes no result.
"""

from collections.abc import Sequence
from typing import Final

from agents import load_algorithm
from benchmark.experiments import RunSpecification

Job = list[RunSpecification]

# Limits of a job with several runs: budget units, since an interrupt waits for jobs in threads, and bytes of
# records.
MAX_JOB_WORK: Final = 10_000_000
MAX_JOB_SIZE: Final = 250_000_000


def plan(runs: Sequence[RunSpecification]) -> list[Job]:
    """Splits runs, none of which appears twice, into jobs, in the order of the first run of each."""
    populations: dict[str, Job] = {}
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
