"""The replication of the paper: its figure, its claims, and how far learning got."""

from pathlib import Path
from typing import Final

from benchmark.analysis.frames import RecordsOf
from benchmark.experiments import Experiment
from benchmark.studies import explorer
from benchmark.studies.interim import Interim
from benchmark.studies.replication import learned, verdicts
from benchmark.studies.replication.agents import check, few_agents
from benchmark.studies.study import Study

__all__ = ["STUDY"]


@explorer.explorer_item
def agents(experiment: Experiment, records: RecordsOf, path: Path) -> None:
    """Writes what some of the agents know."""
    explorer.write([*few_agents(experiment, records).values()], path)


STUDY: Final = Study(
    name="replication",
    question="Learning from disagreement how close is too close",
    declared=Interim,
    check=lambda experiment, _: check(experiment),
    analyse=lambda data: data,
    items=(
        learned.figure,
        verdicts.claims,
        verdicts.claim_sets,
        learned.max_q,
        verdicts.sensitivity,
        learned.learning,
        learned.optimal,
        learned.q_values,
        agents,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=verdicts.headline,
    lead="figure",
)
