"""The replication of the paper: its figure, its claims, and how far learning got."""

from pathlib import Path
from typing import Final

from benchmark.experiments import Experiment
from benchmark.folder import Folder
from benchmark.studies import explorer
from benchmark.studies.replication import figures, tables
from benchmark.studies.replication.analysis import ReplicationAnalysis, analyse
from benchmark.studies.replication.claims import SCENARIOS
from benchmark.studies.study import Declared, Study
from envs import InputError, compile_scenario
from envs.words import listed

__all__ = ["STUDY"]


@explorer.explorer_item
def agents(analysis: ReplicationAnalysis, path: Path) -> None:
    """Writes what the shown agents learned."""
    explorer.write([*analysis.few.values()], path)


def check(experiment: Experiment, _: Declared) -> None:
    """Raises an InputError unless one table, which records the maximum Q, is in scenes like the paper's."""
    source, accepted = experiment.argument, "accepted in a replication"
    first, *others = experiment.learners.values()
    if others or "record_every" not in first.algorithm.settings.model_fields:
        raise InputError(f"{source}: algorithms: {accepted}: one, a table that records the maximum Q.")
    if not experiment.declared.readings:
        raise InputError(f"{source}: readings: {accepted}: at least one.")
    if {*experiment.scenarios} != {*SCENARIOS}:
        raise InputError(f"{source}: scenarios: {accepted}: the paper's, {listed(SCENARIOS)}.")
    for population in experiment.populations:
        model, name = compile_scenario(population.scenario), population.scenario.name
        is_square = model.scenario.regions.target_radius is not None
        if not (model.has_cell_maps and len(model.starts) == 1 and is_square):
            where = f"{source}: scenarios: {name} ({population.condition.name}): {accepted}"
            raise InputError(
                f"{where}: one start, one phase, no walls, squares as regions, the cell observed."
            )


def headline(folder: Folder) -> str | None:
    """Counts the verdicts on the claims, with all agents."""
    if "claims.csv" not in folder:
        return None
    frame = folder.frame("claims")
    n_agents = frame["agents"].max()
    verdicts = frame[frame["agents"] == n_agents].drop_duplicates("claim")["verdict"].value_counts()
    counts = [f"{n} × {name}" for name, n in verdicts.items()]
    return f"Verdicts on {verdicts.sum()} claims, with {n_agents:,} agents per scenario: {', '.join(counts)}."


STUDY: Final = Study(
    name="replication",
    question="Which of the paper's claims hold?",
    declared=Declared,
    check=check,
    analyse=analyse,
    items=(
        figures.figure,
        tables.claims,
        tables.claim_sets,
        tables.max_q,
        tables.sensitivity,
        tables.learning,
        tables.optimal,
        tables.q_values,
        agents,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="figure",
)
