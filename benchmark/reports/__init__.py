"""Reports: the tables and figures of an experiment. `REPORTS` maps a name to a report."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Final

from envs.inputs import InputError, unknown_name

if TYPE_CHECKING:
    from benchmark.experiments import Experiment

REPORTS: Final = {
    "comparison": "benchmark.reports.comparison:REPORT",
    "replication": "benchmark.reports.replication:REPORT",
}


@dataclass(frozen=True)
class Report:
    """A kind of report."""

    check: Callable[["Experiment"], None]  # raises InputError if it cannot report on the experiment


def load_report(name: str, source: str = "benchmark.reports") -> Report:
    """Returns a report.

    Args:
      name: A key of `REPORTS`, or `module:attribute` of a report that lives elsewhere.
      source: The file that named it, for the message.

    Raises:
      InputError: Unknown name, a module that cannot be imported, or an object that is not a report.
    """
    if name not in REPORTS and ":" not in name:
        unknown_name(source, "report", name, [*REPORTS, "module:attribute"])
    module, _, attribute = REPORTS.get(name, name).partition(":")
    try:
        report: object = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"{source}: report {name} cannot be imported: {error}.") from error
    if not isinstance(report, Report):
        raise InputError(f"{source}: {name} is not a report; accepted: a benchmark.reports.Report.")
    return report
