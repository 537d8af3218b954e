"""The stages in which an experiment runs: which runs it has, given those that are stored."""

from collections.abc import Iterable, Iterator, Sequence

from benchmark.analysis import looks, search
from benchmark.analysis.frames import Group
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, RunSpecification, interleaved


def stages(experiment: Experiment, store: Store, seeds: Sequence[int] | None = None) -> Iterator[list[Group]]:
    """Yields the runs of one stage after the other, as long as those before are stored."""
    if not experiment.has_stages:
        yield [Group(each, each.runs(each.taken(seeds))) for each in experiment.populations]
        return
    kind = looks if experiment.declared.search is None else search
    for groups in kind.stages(experiment, store):
        yield groups
        if driver.pending(runs_of(groups), store):
            return


def runs_of(groups: Iterable[Group]) -> list[RunSpecification]:
    """Lists the runs of groups once, see `interleaved`."""
    return interleaved([(group.population, group.runs) for group in groups])
