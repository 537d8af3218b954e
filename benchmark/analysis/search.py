"""The stages of a search for settings; see the other branch."""

from collections.abc import Iterator

from benchmark.analysis.frames import Group
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, RunSpecification


def further_stages(experiment: Experiment, store: Store) -> Iterator[list[RunSpecification]]:
    """Yields the runs of the second and third stage."""
    raise NotImplementedError


def groups(experiment: Experiment, store: Store) -> list[Group]:
    """Lists the runs of all stages."""
    raise NotImplementedError
