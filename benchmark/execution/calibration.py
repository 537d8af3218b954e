"""Estimates what missing runs cost, from stored runs of the same populations on such a machine."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from agents import load_algorithm
from benchmark.execution.plan import plan
from benchmark.execution.provenance import machine
from benchmark.execution.store import Provenance, Store
from benchmark.experiments import RunSpecification, population_of
from envs import InputError

DOUBT: Final = 1.3  # by what factor a time may be wrong: a rule of thumb


@dataclass(frozen=True)
class Estimate:
    """What it costs to execute missing runs; time and memory are of populations with stored runs."""

    jobs: int
    seconds: tuple[float, float]  # at least, and at most
    peak_memory: float  # bytes, of all processes together; 0 if the system does not say
    size: int  # bytes of records, before compression
    known: int  # how many populations have stored runs
    unknown: Sequence[str]  # the variant of every other population


def estimate(runs: Sequence[RunSpecification], store: Store | None, jobs: int, cores: int) -> Estimate:
    """Returns what it costs to execute runs that are missing in the store, so many jobs at a time."""
    planned = plan(runs)
    variants = {job[0].population: job[0].variant for job in planned}
    stored = {} if store is None else _stored(variants, store)
    known = [job for job in planned if job[0].population in stored]
    times, peaks = [0.0], [0.0]
    for job in known:
        measured = stored[job[0].population]
        times.append(len(job) * sum(run["wall_time_s"] for run in measured) / len(measured))
        peaks += [run["peak_memory_mb"] or 0.0 for run in measured]
    seconds = max(sum(times) / min(jobs, cores), *times)
    n_processes = sum(load_algorithm(job[0].algorithm).placement == "process" for job in known)
    return Estimate(
        jobs=len(planned),
        seconds=(seconds / DOUBT, seconds * DOUBT),
        peak_memory=2**20 * max(peaks) * max(1, min(jobs, n_processes)),  # threads share that of one process
        size=sum(run.record_size for run in runs),
        known=len(stored),
        unknown=[variant for population, variant in variants.items() if population not in stored],
    )


def _stored(populations: Collection[str], store: Store) -> dict[str, list[Provenance]]:
    """Returns the provenance of stored runs of such a machine, by population."""
    stored: dict[str, list[Provenance]] = {}
    with suppress(InputError):  # the file is damaged
        for digest, content in store.contents().items():
            with suppress(InputError, TypeError, ValueError):  # a damaged record
                if (population := population_of(content)) in populations:
                    (record,) = store.get([digest], arrays=False)
                    if record.provenance["machine"] == machine():
                        stored.setdefault(population, []).append(record.provenance)
    return stored
