"""Comparisons of learners: what each reached, how they differ, what they cost, and what they have learned."""

from pathlib import Path
from typing import Final

from benchmark.studies.comparison import figures as figures
from benchmark.studies.comparison import tables
from benchmark.studies.comparison.analysis import analyse
from benchmark.studies.comparison.declared import ComparisonDeclared, check
from benchmark.studies.study import Study

STUDY: Final = Study(
    name="comparison",
    question="When does deep RL earn its keep over a table?",
    declared=ComparisonDeclared,
    check=check,
    analyse=analyse,
    items=(
        tables.contrasts,
        tables.summary,
        tables.aggregate,
        tables.rliable,
        tables.curves,
        tables.cost,
        tables.scores,
        tables.agents,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=tables.headline,
    lead="curves",
    packages=("rliable",),
)
