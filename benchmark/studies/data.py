"""What a report is computed from: tables, the records behind them, and learners' looks."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import pandas as pd

from benchmark.analysis.frames import Group, tables
from benchmark.analysis.records import Records, load_records
from benchmark.drawing.style import learner_style
from benchmark.execution.store import Provenance, Store
from benchmark.experiments import Experiment, Population, RunSpecification, interleaved

D = TypeVar("D")  # what the experiment declares of its report
Style = dict[str, Any]  # arguments of matplotlib


@dataclass(frozen=True, eq=False)
class Data(Generic[D]):
    """What the tables and figures of a report are computed from; read on first use."""

    experiment: Experiment
    declared: D
    store: Store
    groups: Sequence[Group]  # all of whose runs are stored
    columns: Sequence[str]  # results of runs that are needed; all if it is empty
    note: str = ""  # what readers must know of other seeds; empty if nothing

    @cached_property
    def specifications(self) -> list[RunSpecification]:
        """All runs, each once."""
        return interleaved([(group.population, group.runs) for group in self.groups])

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


def style_of(learner: str, experiment: Experiment, observation: str | None = None) -> Style:
    """Returns a learner's colour, marker and dash, perhaps as if it had another observation.

    Colour and marker show its algorithm, and tint and dash its observation, so that figures can be read in
    grey. A reference implementation looks like its learner, but hollow and on a dotted line.
    """
    declared = {other.variant: other.declared for other in experiment.learners.values()}
    colours = {name: variant.colour for name, variant in declared.items() if not variant.reference_for}
    drawn = experiment.learners[learner]
    seen = drawn.observation if observation is None else observation
    of = drawn.declared.reference_for
    style = learner_style(of or drawn.variant, seen, colours, drawn.family)
    return style | {"mfc": "white", "ls": (0, (1, 1))} if of else style
