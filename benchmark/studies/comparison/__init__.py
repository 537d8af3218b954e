"""Comparisons of learners: what each reached, how cells of the table differ, what it cost, and what it knows.

The axes of the table are scenarios, conditions and learners. Everything that is compared is the difference
between two of its cells, or between means of cells over scenarios.
"""

from pathlib import Path
from typing import Final

from benchmark.studies.comparison import results, rliable, scenarios, training
from benchmark.studies.comparison.declared import check
from benchmark.studies.interim import Interim
from benchmark.studies.study import Study

STUDY: Final = Study(
    name="comparison",
    question="When does deep RL earn its keep over a table?",
    declared=Interim,
    check=lambda experiment, _: check(experiment),
    analyse=lambda data: data,
    items=(
        results.contrasts,
        results.outcomes,
        results.summary,
        results.aggregate,
        rliable.rliable,
        rliable.profiles,
        training.curves,
        training.steps,
        results.verdicts,
        results.effects,
        results.same_input,
        scenarios.scenarios,
        training.cost,
        results.scores,
        training.agents,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=results.headline,
    lead="summary",
    packages=("rliable",),
    can_be_partial=True,
)
