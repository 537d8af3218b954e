"""What a report is computed from: the tables of runs and curves, and the records behind them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import pandas as pd

from benchmark.analysis.frames import Group, tables
from benchmark.analysis.records import Provenance, Records, load_records
from benchmark.analysis.stages import runs_of, stages
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Population, RunSpecification
from envs import InputError

_LISTED: Final = 4  # populations that a sentence on missing runs names


@dataclass(frozen=True, eq=False)
class Data:
    """What the tables and figures of a report are computed from; read when it is asked for."""

    experiment: Experiment
    store: Store
    groups: Sequence[Group]  # all of whose runs are stored
    columns: Sequence[str]  # results of runs that are needed; all if it is empty
    note: str = ""  # what readers must know of missing runs or other seeds; empty if nothing
    is_partial: bool = False  # whether runs are missing: figures are then marked

    @cached_property
    def specifications(self) -> list[RunSpecification]:
        """All runs, each once."""
        return runs_of(self.groups)

    @cached_property
    def provenance(self) -> list[Provenance]:
        """Where and when each of them ran."""
        digests = [run.digest for run in self.specifications]
        return [record.provenance for record in self.store.get(digests, arrays=False)]

    @cached_property
    def _tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        return tables(self.groups, self.store, self.columns)

    @property
    def runs(self) -> pd.DataFrame:
        """A row a run, see `benchmark.analysis.frames`."""
        return self._tables[0]

    @property
    def curves(self) -> pd.DataFrame:
        """A row a run and evaluation."""
        return self._tables[1]

    def records(self, population: Population) -> Records:
        """Returns the records of a population."""
        (runs,) = (group.runs for group in self.groups if group.population is population)
        return load_records(runs, self.store)


def load(
    experiment: Experiment,
    store: Store,
    seeds: Sequence[int] | None = None,
    *,
    partial: bool = False,
    columns: Sequence[str] = (),
) -> Data:
    """Finds what is stored of an experiment.

    If runs may be missing, learners with fewer than two runs somewhere are left out. `columns` are the
    results of runs that are needed; by default all. An InputError says which runs are missing, or too few.
    """
    name, statuses = experiment.name, store.statuses()
    if seeds is not None and experiment.has_stages:
        raise InputError(f"{name}: --seeds: an experiment with stages uses only its declared seeds.")
    missing, stored = "", list[Group]()
    for stage, groups in enumerate(stages(experiment, store, seeds), start=1):
        of_stage = f" of stage {stage}" if experiment.has_stages else ""
        missing = missing or _missing(groups, statuses, of_stage)
        stored += [Group(group.population, _ended(group, statuses), group.more) for group in groups]
    if missing and not partial:
        raise InputError(f"{name}: {missing}: run the experiment first.")
    few = set[str]()
    if not experiment.has_stages:
        few = {group.population.learner.name for group in stored if len(group.runs) < 2}
        few |= {learner.name for learner in experiment.learners.values() if learner.reference_for in few}
    shown = [group for group in stored if group.runs and group.population.learner.name not in few]
    if not shown or (few and not partial):
        reason = missing or "a single run has no interval"
        raise InputError(f"{name}: too few runs ({reason}); accepted: at least two of every learner.")
    notes = [f"Partial: {missing}."] if missing else []
    notes += [f"Left out, since there are fewer than two runs: {', '.join(sorted(few))}."] if few else []
    if seeds is not None:
        fewer = " at most" * any(each.taken(seeds) != seeds for each in experiment.populations)
        which = f"the seeds {min(seeds)} to {max(seeds)} instead of those declared"
        notes.append(f"Every learner has{fewer} {which}.")
    return Data(experiment, store, shown, columns, " ".join(notes), bool(missing))


def _ended(group: Group, statuses: Mapping[str, str]) -> list[RunSpecification]:
    return [run for run in group.runs if statuses.get(run.digest, "failed") != "failed"]


def _missing(groups: Sequence[Group], statuses: Mapping[str, str], of_stage: str) -> str:
    """Says which runs are missing; empty if none is."""
    runs = {run.digest for group in groups for run in group.runs}
    pending = runs - {run.digest for group in groups for run in _ended(group, statuses)}
    if not pending:
        return ""
    lacking = [
        f"{group.population.learner.name} in {group.population.scenario.name} has {n} of {len(group.runs)}"
        for group in groups
        if (n := len(_ended(group, statuses))) < len(group.runs)
    ]
    if len(lacking) > _LISTED:
        lacking[_LISTED:] = [f"and {len(lacking) - _LISTED} more populations"]
    n_failed = sum(digest in statuses for digest in pending)
    failed = f", {n_failed} of them failed" if n_failed else ""
    return f"{len(pending)} of {len(runs)} runs{of_stage} are missing{failed} ({'; '.join(lacking)})"
