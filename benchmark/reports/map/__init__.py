"""The report of a map: where a net needs fewer steps than a table, in which currency, and why."""

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
        results.crossings,
        results.exponents,
        why.measures,
        why.predictors,
        results.reference,
        results.runs,
        results.cpu,
        results.crossings_cpu,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="map",
    reads_curves=True,
)
