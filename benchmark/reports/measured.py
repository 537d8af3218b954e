"""Reports of measurements: what is measured of this project itself, and so belongs to no experiment."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NoReturn

from benchmark.execution.provenance import commit, machine, processor, versions
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Reporting
from benchmark.reports import draw, files, load_report
from benchmark.reports.item import Report
from envs import InputError

REPORTS: Final = {
    "speed": "benchmark.reports.speed:REPORT",
    "growth": "benchmark.reports.growth.report:REPORT",
}


@dataclass(frozen=True)
class Measured:
    """What the items of such a report are computed from, see `benchmark.reports.item.Data`."""

    taken: Any  # in a form of the report's own
    facts: Mapping[str, object] = field(default_factory=dict)
    note: str = ""
    is_incomplete: bool = False


def _refuse(experiment: Experiment, *_: object) -> NoReturn:
    raise InputError(f"{experiment.argument}: report: accepted: a report that can be drawn of an experiment.")


@dataclass(frozen=True, eq=False, kw_only=True)
class Measuring(Report):
    """A report of measurements."""

    description: str  # what is measured, in a sentence
    measure: Callable[[Path, bool], Measured]  # of an empty folder to work in, and whether just to try
    check: Callable[[Experiment], None] = _refuse
    load: Callable[[Experiment, Store, Sequence[int] | None, bool], Any] = _refuse


def measure(name: str, results: Path, *, smoke: bool) -> None:
    """Measures, and writes a folder of results. Other reports wait meanwhile: they would disturb.

    Args:
      name: A key of `REPORTS`.
      results: The folder of all results.
      smoke: Whether to measure very little, to try the code; it has a folder of its own.

    Raises:
      InputError: The folder cannot be written, or a package is missing; then nothing is measured. Or what is
        measured failed.
    """
    report: Any = load_report(REPORTS[name])
    directory = results / (f"{name}_smoke" if smoke else name)
    is_stale = draw.was_made(directory, report.items)
    with files.alone(results), files.replaced(directory, is_stale) as aside:
        with files.scratch(results) as scratch:
            data = report.measure(scratch, smoke)
        made = {
            "note": "Measured with `--smoke`: the numbers mean nothing." if smoke else "",
            "facts": data.facts,
            "commits": [commit(Path(__file__))],
            "machines": [machine()],
            "processors": [processor()],
            "versions": [versions("q_learning")],
        }
        draw.publish(report.items, data, aside, manifest(report) | made)
    print(f"written to {directory}")


def manifest(report: Measuring) -> dict[str, Any]:
    """Returns the manifest of such a report, without what ran it."""
    return {
        "experiment": report.name,
        "description": report.description,
        "command": f"make {report.name}",
        "argument": "",  # none: the command `report` does not draw it
        "report": Reporting(kind=REPORTS[report.name]).model_dump(mode="json"),
        "partial": "",
        "note": "",
        "scenarios": {},
        "algorithms": {},
    }
