"""A stand-in until the explorer's item is there; it writes nothing."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from benchmark.analysis.snapshots import Shown
from benchmark.reports.item import Item, writing


def explorer_item(_: Callable[[Any], Iterable[Shown]]) -> Item:
    """Returns an item that writes nothing."""

    def write(_: Any, __: Path) -> None:
        return

    return writing("agents", "what the explorer shows", "agents.json.gz")(write)
