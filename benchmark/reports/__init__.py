"""Reports: what is computed, drawn and said of an experiment. `REPORTS` maps a name to a report.

A report is imported when it is asked for. Reports, and further items of a report, can live in any module that
Python can import.
"""

from typing import TYPE_CHECKING, Final, TypeVar

from benchmark.reports.item import Item, Report
from envs.inputs import InputError, imported, unknown_name

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["REPORTS", "Item", "Report", "load_items", "load_report"]

REPORTS: Final = {
    "ablation": "benchmark.reports.ablation:REPORT",
    "comparison": "benchmark.reports.comparison:REPORT",
    "equivalence": "benchmark.reports.equivalence:REPORT",
    "replication": "benchmark.reports.replication:REPORT",
    "scenarios": "benchmark.reports.scenarios:REPORT",
}

_T = TypeVar("_T")


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
    return _of_class(REPORTS.get(name, name), source, "report", Report)


def load_items(report: Report, names: "Sequence[str]", source: str = "benchmark.reports") -> tuple[Item, ...]:
    """Returns a report's items and, after them, others that an experiment names.

    Args:
      report: As loaded.
      names: `module:attribute` of each further item.
      source: The file that named them, for the message.

    Raises:
      InputError: A module that cannot be imported, an object that is not an item, an item whose name is
        taken, or one in a section that the report does not have.
    """
    items = list(report.items)
    sections = [section.key for section in report.sections]
    for name in names:
        item = _of_class(name, source, "item", Item)
        if item.name in [other.name for other in items]:
            raise InputError(f"{source}: items: {name}: the report has an item {item.name} already.")
        if item.section and item.section not in sections:
            unknown_name(f"{source}: items: {name}", f"section of a {report.name}", item.section, sections)
        items.append(item)
    return tuple(items)


def _of_class(name: str, source: str, kind: str, cls: type[_T]) -> _T:
    """Returns what `module:attribute` names."""
    found = imported(name, source, kind)
    if not isinstance(found, cls):
        article = "an" if kind.startswith(tuple("aeiou")) else "a"
        raise InputError(
            f"{source}: {name} is not {article} {kind}; accepted: a {cls.__module__}.{cls.__name__}."
        )
    return found
