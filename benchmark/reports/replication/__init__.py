"""The replication of the paper: its figure, its claims, and how far learning got."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from benchmark.analysis.frames import RecordsOf
from benchmark.experiments import Experiment
from benchmark.reports.explorer import Shown, explorer_item
from benchmark.reports.item import Report
from benchmark.reports.replication import learned, verdicts
from benchmark.reports.replication.agents import check, few_agents

__all__ = ["REPORT"]


def _explored(experiment: Experiment, records: RecordsOf) -> Iterator[Shown]:
    (learner,) = experiment.learners.values()
    for agents in few_agents(experiment, records).values():
        yield Shown(learner.variant, learner.observation, agents)


REPORT: Final = Report(
    name="replication",
    question="Learning from disagreement how close is too close",
    check=check,
    items=(
        learned.figure,
        verdicts.claims,
        verdicts.claim_sets,
        learned.max_q,
        verdicts.sensitivity,
        learned.learning,
        learned.optimal,
        learned.q_values,
        explorer_item(_explored),
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=verdicts.headline,
    lead="figure",
    columns=("success",),
)
