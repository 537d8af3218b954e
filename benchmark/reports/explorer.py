"""Stand-in."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from benchmark.analysis.snapshots import Shown
from benchmark.reports.item import Item, writing


def explorer_item(lister: Callable[[Any], Iterable[Shown]]) -> Item:
    @writing("agents", "what agents know", "agents.json.gz")
    def agents(data: Any, directory: Path) -> None:
        list(lister(data))

    return agents
