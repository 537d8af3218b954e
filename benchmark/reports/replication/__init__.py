"""The replication of the paper: its figure, its claims, and how far learning got."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from benchmark.analysis.snapshots import Shown
from benchmark.reports.explorer import explorer_item
from benchmark.reports.item import Report
from benchmark.reports.replication import learned, verdicts
from benchmark.reports.replication.data import Data, check, load

__all__ = ["REPORT"]


def _shown(data: Data) -> Iterator[Shown]:
    """Yields what the explorer shows."""
    for population in data.default:
        yield Shown(data.arm, data.observation, population)


REPORT: Final = Report(
    name="replication",
    question="Learning from disagreement how close is too close",
    check=check,
    load=load,
    items=(
        learned.figure,
        verdicts.claims,
        verdicts.claim_sets,
        learned.max_q,
        verdicts.sensitivity,
        learned.learning,
        learned.success,
        learned.optimal,
        learned.optimal_cells,
        learned.q_values,
        explorer_item(_shown),
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=verdicts.headline,
    lead="figure",
)
