"""Splits runs into jobs.

A job is a list of runs that differ by their seed alone and are trained by one call. For most algorithms
training together equals training alone, so how their runs fall into jobs changes no result.
"""

from collections.abc import Sequence
from typing import Final

from agents import load_algorithm
from benchmark.experiments import RunSpecification

Job = list[RunSpecification]

# Budget units of a job with several runs, at most: an interrupt waits for the jobs that run in threads.
JOB_WORK: Final = 10_000_000
JOB_SIZE: Final = 250_000_000  # bytes of its records, at most


def plan(runs: Sequence[RunSpecification]) -> list[Job]:
    """Splits runs into jobs, in the order of the first wanted run of each.

    If the bits of a run depend on its batch, jobs are fixed blocks of consecutive seeds. A job has the whole
    block, including seeds that are not wanted, so that no result depends on which runs were missing.

    Args:
      runs: The wanted runs; none appears twice.
    """
    populations: dict[str, Job] = {}
    for run in runs:
        populations.setdefault(run.population, []).append(run)
    place = {run.digest: i for i, run in enumerate(runs)}
    jobs = []
    for population in populations.values():
        algorithm = load_algorithm(population[0].algorithm)
        if algorithm.depends_on_batch:
            jobs += _blocks(population, algorithm.batch_size)
        else:
            first = population[0]
            most = min(JOB_WORK // first.settings.budget, JOB_SIZE // first.record_size)
            size = max(1, min(algorithm.batch_size, most))
            jobs += [population[i : i + size] for i in range(0, len(population), size)]
    return sorted(jobs, key=lambda job: min(place[run.digest] for run in job if run.digest in place))


def _blocks(population: Job, size: int) -> list[Job]:
    """Returns the whole blocks of seeds that contain a population's wanted runs."""
    first_seeds = dict.fromkeys(run.seed // size * size for run in population)
    return [[population[0].with_seed(seed) for seed in range(first, first + size)] for first in first_seeds]
