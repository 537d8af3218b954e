"""Estimates what missing runs cost, from stored runs of the same populations on such a machine."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Final, NamedTuple

from agents import load_algorithm
from benchmark.execution.plan import plan
from benchmark.execution.provenance import machine
from benchmark.execution.store import Provenance, Store
from benchmark.experiments import RunSpecification
from envs import InputError

DOUBT: Final = 1.3  # by what factor a time may be wrong: a rule of thumb


class Estimate(NamedTuple):
    """What it costs to execute missing runs; time and memory are of populations with stored runs."""

    jobs: int
    seconds: tuple[float, float]  # at least, and at most
    peak_memory: float  # bytes, of all processes together; 0 if the system does not say
    size: int  # bytes of records, before compression
    known: int  # how many populations have stored runs
    unknown: Sequence[str]  # the variant of every other population


def estimate(
    runs: Sequence[RunSpecification],
    missing: Sequence[RunSpecification],
    store: Store | None,
    jobs: int,
    cores: int,
) -> Estimate:
    """Returns what it costs to execute those of these runs that are missing, so many jobs at a time."""
    planned, todo = plan(missing), {run.digest for run in missing}
    variants = {job[0].population: job[0].variant for job in planned}
    stored = {} if store is None else _stored([run for run in runs if run.digest not in todo], store)
    known = [job for job in planned if job[0].population in stored]
    times, peaks = [0.0], [0.0]
    for job in known:
        measured = stored[job[0].population]
        times.append(len(job) * sum(run["wall_time_s"] for run in measured) / len(measured))
        peaks += [run["peak_memory_mb"] or 0.0 for run in measured]
    seconds = max(sum(times) / min(jobs, cores), *times)
    n_processes = sum(load_algorithm(job[0].algorithm).placement == "process" for job in known)
    unknown = [variant for population, variant in variants.items() if population not in stored]
    return Estimate(
        jobs=len(planned),
        seconds=(seconds / DOUBT, seconds * DOUBT),
        peak_memory=2**20 * max(peaks) * max(1, min(jobs, n_processes)),  # threads share that of one process
        size=sum(run.record_size for run in missing),
        known=len(variants) - len(unknown),
        unknown=unknown,
    )


def _stored(done: Sequence[RunSpecification], store: Store) -> dict[str, list[Provenance]]:
    stored: dict[str, list[Provenance]] = {}
    for run in done:
        with suppress(InputError):  # a damaged record
            (record,) = store.get([run.digest], arrays=False)
            if record.provenance["machine"] == machine():
                stored.setdefault(run.population, []).append(record.provenance)
    return stored
