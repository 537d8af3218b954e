"""The replication of the paper: its figure, its claims, and how far learning got."""

from pathlib import Path
from typing import Final

from benchmark.reports.explorer import Shown, explorer_item
from benchmark.reports.item import Report
from benchmark.reports.replication import learned, verdicts
from benchmark.reports.replication.agents import check, few_agents

__all__ = ["REPORT"]

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
        explorer_item(
            lambda experiment, records: [
                Shown(agents.run.variant, agents.run.observation, agents)
                for agents in few_agents(experiment, records).values()
            ]
        ),
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=verdicts.headline,
    lead="figure",
)
