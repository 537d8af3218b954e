"""The report of a search for settings: what was chosen, what that bought, and what it cost."""

from pathlib import Path
from typing import Final

from benchmark.reports.item import Report
from benchmark.reports.search import results
from benchmark.reports.search.runs import check, load

REPORT: Final = Report(
    name="search",
    question="What does tuning buy, and what does it cost?",
    check=check,
    load=load,
    items=(
        results.chosen,
        results.best_of,
        results.cost,
        results.trials,
        results.importance,
        results.around,
        results.spaces,
        results.scenes,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=results.headline,
    lead="best_of",
    packages=("optuna", "sklearn"),
)
