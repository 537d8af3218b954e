"""Studies: kinds of questions. A study says what an experiment declares, computes, shows and says.

What is computed of an experiment is its *analysis*, made once. Each table and figure is a function of it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Self, TypeVar

from benchmark.analysis.frames import Group
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, RunSpecification, interleaved
from benchmark.folder import Folder
from benchmark.studies.data import Data
from benchmark.studies.item import Item
from envs import InputError
from envs.inputs import Label, Names, Table, parse, unknown_name
from envs.packages import imported, missing_package

STUDIES: Final = {
    "comparison": "benchmark.studies.comparison:STUDY",
    "map": "benchmark.studies.map:STUDY",
    "replication": "benchmark.studies.replication:STUDY",
    "search": "benchmark.studies.search:STUDY",
}
_T = TypeVar("_T")


class Declared(Table):
    """What any experiment declares of its report."""

    kind: str
    """The study: one of those below, or `module:attribute` of any other."""
    question: Label = ""
    """The heading; by default that of the study."""
    items: Names = ()
    """Further tables and figures, each as `module:attribute`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Study:
    """A kind of question: what it demands of an experiment, and what it shows."""

    name: str
    question: str  # the page's heading
    declared: type[Declared]  # the table `report` of its experiments
    check: Callable[[Experiment, Any], None]  # refuses, by an InputError, an experiment that it does not fit
    analyse: Callable[[Data[Any]], Any]
    items: tuple[Item, ...]
    document: Path  # a template of Markdown with places for the items, see `benchmark.publish.document`
    # Yields the runs of one stage after the other, given those that are stored; by default there is one stage
    stages: Callable[[Experiment, Any, Store], Iterator[list[Group]]] | None = None
    headline: Callable[[Folder], str | None] = lambda _: None  # one sentence in Markdown, from tables alone
    finding: Path | None = None  # the template of a text by hand, see `benchmark.publish.prose`
    lead: str = ""  # the item whose figure stands below or beside the headline
    packages: Sequence[str] = ()  # that it needs beyond the basic ones
    reads_curves: bool = False  # whether curves alone are enough, see `Solved` in the experiments' schema
    columns: Sequence[str] = ()  # results that it needs of runs; by default all


@dataclass(frozen=True, eq=False)
class Report:
    """The study of an experiment, as this declares it."""

    experiment: Experiment
    study: Study  # with the items that the experiment adds
    declared: Any  # the table `report`, of the study's class

    def check(self, *, is_drawn: bool = True) -> Self:
        """Returns the report if it fits the experiment and, unless `is_drawn` is false, can be drawn.

        Otherwise, it raises an InputError, for example if a package is missing.
        """
        experiment, study, where = self.experiment, self.study, self.experiment.argument
        if is_drawn and self.declared.kind == _NONE.name:
            raise InputError(f"{where}: report is missing; add a [report] table.")
        missing = [package for package in study.packages if find_spec(package) is None]
        if is_drawn and missing:
            raise missing_package(f"{experiment.name}: its report", missing[0])
        found = f"with report.kind = {self.declared.kind}"
        if experiment.declared.solved is not None and not study.reads_curves:
            raise InputError(f"{where}: solved {found}: accepted: map or search.")
        if experiment.declared.search is not None and study.stages is None:
            raise InputError(f"{where}: search {found}: accepted: kind = search.")
        study.check(experiment, self.declared)
        return self

    def stages(self, store: Store, seeds: Sequence[int] | None = None) -> Iterator[list[Group]]:
        """Yields the runs of each stage in turn, as long as those of earlier stages are stored."""
        if self.study.stages is None:
            yield [Group(each, each.runs(each.taken(seeds))) for each in self.experiment.populations]
            return
        if seeds is not None:
            what = "--seeds: an experiment with stages uses only its declared seeds"
            raise InputError(f"{self.experiment.name}: {what}.")
        for groups in self.study.stages(self.experiment, self.declared, store):
            yield groups
            if driver.pending(runs_of(groups), store):
                return

    def data(self, store: Store, seeds: Sequence[int] | None = None) -> Data[Any]:
        """Finds what is stored of the experiment; an InputError says which runs are missing, or too few."""
        experiment, has_stages = self.experiment, self.study.stages is not None
        name, statuses = experiment.name, store.statuses()
        shown = list[Group]()
        for stage, groups in enumerate(self.stages(store, seeds), start=1):
            if missing := _missing(groups, statuses, f" of stage {stage}" if has_stages else ""):
                raise InputError(f"{name}: {missing}: run the experiment first.")
            shown += [group for group in groups if group.runs]
        if not has_stages and min(len(group.runs) for group in shown) < 2:
            what = "too few runs (a single run has no interval); accepted: at least two of every learner"
            raise InputError(f"{name}: {what}.")
        note = ""
        if seeds is not None:
            shares = "; reference implementations have a share of them" * any(
                learner.reference_for for learner in experiment.learners.values()
            )
            which = f"the seeds {min(seeds)} to {max(seeds)} instead of those declared{shares}"
            note = f"Every learner has {which}."
        columns = () if self.declared.items else self.study.columns
        return Data(experiment, self.declared, store, shown, columns, note)


# The study of an experiment without a report, whose runs are only stored
_NONE: Final = Study(
    name="none",
    question="",
    declared=Declared,
    check=lambda _, __: None,
    analyse=lambda _: None,
    items=(),
    document=Path(),
    reads_curves=True,
)


def runs_of(groups: Iterable[Group]) -> list[RunSpecification]:
    """Lists the runs of groups once, see `interleaved`."""
    return interleaved([(group.population, group.runs) for group in groups])


def load_study(name: str, source: str = "benchmark.studies") -> Study:
    """Returns a study, by a key of `STUDIES`, or `module:attribute` of one that lives elsewhere.

    Anything but a study raises an InputError, whose message begins with the source, the file that named it.
    """
    if name not in STUDIES and ":" not in name:
        unknown_name(source, "report", name, STUDIES, "module:attribute")
    return _of_class(STUDIES.get(name, name), source, "report", Study)


def with_items(study: Study, names: Iterable[str], source: str) -> Study:
    """Returns a study with further items, each named as `module:attribute`.

    A taken name, or anything but an item, raises an InputError that begins with the source.
    """
    items = {item.name: item for item in study.items}
    for name in names:
        item = _of_class(name, f"{source}: report.items", "item", Item)
        if item.name in items:
            raise InputError(f"{source}: report.items: {name}: the report has an item {item.name} already.")
        items[item.name] = item
    return replace(study, items=tuple(items.values()))


def report_of(experiment: Experiment) -> Report:
    """Returns the report of an experiment; only its table is parsed, `Report.check` checks the rest."""
    given, where = experiment.declared.report, experiment.argument
    study = _NONE if given is None else load_study(str(given.get("kind", "")), where)
    declared = parse(study.declared, given or {"kind": study.name}, f"{where}: report")
    study = with_items(study, declared.items, where)
    return Report(experiment, replace(study, finding=experiment.path.with_suffix(".md.jinja")), declared)


def _of_class(name: str, source: str, kind: str, cls: type[_T]) -> _T:
    named = imported(name, source, kind)
    if not isinstance(named, cls):
        raise InputError(f"{source}: {name}: accepted: the name of a {cls.__module__}.{cls.__name__}.")
    return named


def _ended(group: Group, statuses: Mapping[str, str]) -> list[RunSpecification]:
    return [run for run in group.runs if statuses.get(run.digest, "failed") != "failed"]


def _missing(groups: Sequence[Group], statuses: Mapping[str, str], of_stage: str) -> str:
    """Says which runs are missing; empty if none is."""
    runs = {run.digest for group in groups for run in group.runs}
    pending = runs - {run.digest for group in groups for run in _ended(group, statuses)}
    if not pending:
        return ""
    n_failed = sum(digest in statuses for digest in pending)
    failed = f", {n_failed} of them failed" if n_failed else ""
    return f"{len(pending)} of {len(runs)} runs{of_stage} are missing{failed}"
