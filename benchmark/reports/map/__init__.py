"""The report of a map: at which points one learner needs fewer steps than another."""

from pathlib import Path
from typing import Final

from benchmark.reports.item import Report
from benchmark.reports.map import figures, results, why
from benchmark.reports.map.data import check, load
from benchmark.reports.map.headline import headline

REPORT: Final = Report(
    name="map",
    question="When does a net earn its keep over a table?",
    check=check,
    load=load,
    items=(
        figures.picture,
        results.cells,
        figures.others,
        results.contrasts,
        results.verdicts,
        results.looks,
        why.measures,
        results.reference,
        results.pairs,
        results.runs,
        results.unseen,
        results.cpu,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="map",
    reads_curves=True,
)
