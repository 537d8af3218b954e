"""The report of a map: at which points one learner needs fewer steps than another."""

from pathlib import Path
from typing import Final

from benchmark.analysis.looks import VERDICTS
from benchmark.drawing.tables import link
from benchmark.reports.folder import Folder
from benchmark.reports.item import Report
from benchmark.reports.map import figures, results
from benchmark.reports.map.check import check
from benchmark.reports.map.crossings import crossings


def headline(folder: Folder) -> str:
    """Says how the contrasts of the first grid ended."""
    table = folder.frame("verdicts")
    grid, parts = table["grid"].iloc[0], []
    for _, row in table[table["grid"] == grid].iterrows():
        ended = [verdict for verdict in VERDICTS if row[verdict]]
        counts = [f"{verdict} at {link(str(row[verdict]), 'verdicts', row)}" for verdict in ended]
        x, y = (folder.phrase(row[side]) for side in "xy")
        parts.append(f"{x} compared with {y}: {', '.join(counts)}")
    return f"Over the points of the grid `{grid}`, {'; '.join(parts)}."


REPORT: Final = Report(
    name="map",
    question="When does a net earn its keep over a table?",
    check=check,
    items=(
        figures.answer,
        figures.picture,
        results.cells,
        results.contrasts,
        results.verdicts,
        results.looks,
        results.levels,
        crossings,
        results.success,
        results.reference,
        results.pairs,
        results.runs,
        results.unseen,
        results.cpu,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="answer",
    reads_curves=True,
    can_be_partial=True,
)
