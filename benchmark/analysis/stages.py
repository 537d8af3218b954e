"""The stages in which an experiment runs: which runs it has, given those that are stored."""

from collections.abc import Iterator, Sequence

from benchmark.analysis import looks, search
from benchmark.analysis.frames import Group
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, RunSpecification, all_specifications

Runs = list[RunSpecification]


def stages(experiment: Experiment, store: Store, seeds: Sequence[int] | None = None) -> Iterator[Runs]:
    """Yields the runs of one stage after the other, as long as those before are stored.

    An experiment has a single stage, but for a search and for one that declares looks.
    """
    runs = all_specifications(experiment, seeds)
    yield runs
    if not driver.pending(runs, store):
        if experiment.declared.search is not None:
            yield from search.further_stages(experiment, store)
        elif experiment.has_stages:
            yield from looks.further_stages(experiment, store)


def known_runs(experiment: Experiment, store: Store, seeds: Sequence[int] | None = None) -> Runs:
    """Lists the runs of all stages that can be known yet."""
    return [run for runs in stages(experiment, store, seeds) for run in runs]


def groups(experiment: Experiment, store: Store, seeds: Sequence[int] | None = None) -> list[Group]:
    """Lists what a report is made of: the runs of all populations, in all stages, stored or not."""
    if experiment.declared.search is not None:
        return search.groups(experiment, store)
    if experiment.has_stages:
        return looks.groups(experiment, store)
    return [Group(population, population.runs(seeds)) for population in experiment.populations]
