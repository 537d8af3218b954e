"""Reports: what is computed, drawn and said of an experiment. `REPORTS` maps a name to a report.

A report is imported when it is asked for. Reports, and further items of a report, can live in any module that
Python can import.
"""

from collections.abc import Mapping
from typing import Any, Final, TypeVar

from benchmark.studies.item import Item, Report
from envs.inputs import InputError, unknown_name
from envs.packages import imported

__all__ = ["REPORTS", "Item", "Report", "load_items", "load_report"]

REPORTS: Final = {
    "comparison": "benchmark.studies.comparison:REPORT",
    "map": "benchmark.studies.map:REPORT",
    "replication": "benchmark.studies.replication:REPORT",
    "search": "benchmark.studies.search:REPORT",
}

_T = TypeVar("_T")


def load_report(name: str, source: str = "benchmark.studies") -> Report:
    """Returns a report, by a key of `REPORTS`, or `module:attribute` of one that lives elsewhere.

    Anything but a report raises an InputError, whose message begins with the source, the file that named it.
    """
    if name not in REPORTS and ":" not in name:
        unknown_name(source, "report", name, REPORTS, "module:attribute")
    return _of_class(REPORTS.get(name, name), source, "report", Report)


def load_items(report: Report, declared: Mapping[str, Any], source: str) -> tuple[Item, ...]:
    """Returns a report's items, with those that an experiment's table `report` adds, without those it omits.

    An unknown or taken name, or anything but an item, raises an InputError that begins with the source.
    """
    names = [item.name for item in report.items]
    for name in declared["omit"]:
        if name not in names:
            unknown_name(f"{source}: report.omit", "item", name, names)
    items = {item.name: item for item in report.items if item.name not in declared["omit"]}
    for name in declared["items"]:
        item = _of_class(name, f"{source}: report.items", "item", Item)
        if item.name in items:
            raise InputError(f"{source}: report.items: {name}: the report has an item {item.name} already.")
        items[item.name] = item
    return tuple(items.values())


def _of_class(name: str, source: str, kind: str, cls: type[_T]) -> _T:
    named = imported(name, source, kind)
    if not isinstance(named, cls):
        raise InputError(f"{source}: {name}: accepted: the name of a {cls.__module__}.{cls.__name__}.")
    return named
