"""The stages in which an experiment runs: which runs it has, given those that are stored."""

from collections.abc import Iterator, Sequence

from benchmark.analysis import looks, search
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
        if experiment.search is not None:
            yield from search.later_stages(experiment, store)
        elif experiment.has_stages:
            yield from looks.later_stages(experiment, store)


def known_runs(experiment: Experiment, store: Store, seeds: Sequence[int] | None = None) -> Runs:
    """Lists the runs of all stages that can be known yet."""
    return [run for runs in stages(experiment, store, seeds) for run in runs]
