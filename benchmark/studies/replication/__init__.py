"""The replication of the paper: its figure, its claims, and how far learning got."""

from pathlib import Path
from typing import Final

from benchmark.experiments import Experiment
from benchmark.folder import Folder
from benchmark.studies import explorer
from benchmark.studies.replication import figures, tables
from benchmark.studies.replication.analysis import ReplicationAnalysis, analyse
from benchmark.studies.replication.claims import SCENARIOS, VERDICTS, weakest
from benchmark.studies.study import Declared, Study
from envs import InputError, compile_scenario
from envs.words import listed

__all__ = ["STUDY"]


@explorer.explorer_item
def agents(analysis: ReplicationAnalysis, path: Path) -> None:
    """Writes what the shown agents learned."""
    explorer.write([*analysis.few.values()], path)


def check(experiment: Experiment, _: Declared) -> None:
    """Raises an InputError unless one table, which records the maximum Q, is in the paper's scenarios."""
    source = experiment.argument
    first, *others = experiment.learners.values()
    if others or first.family != "tabular" or "record_every" not in first.algorithm.settings.model_fields:
        accepted = "one: a table that records the maximum Q"
        raise InputError(f"{source}: algorithms: a replication takes {accepted}.")
    if experiment.declared.grids:
        raise InputError(f"{source}: grids: accepted in a replication: none, only readings.")
    if {*experiment.scenarios} != {*SCENARIOS}:
        raise InputError(f"{source}: scenarios: a replication takes the paper's: {listed(SCENARIOS)}.")
    for population in experiment.populations:
        if len(population.firsts) > 1:
            raise InputError(f"{source}: tuned_by: accepted in a replication: a search with one part.")
        settings = population.first.settings.model_dump()
        if settings["budget"] <= settings["record_every"]:
            found = f"algorithms.{first.variant}: record_every = {settings['record_every']}"
            raise InputError(f"{source}: {found}: accepted: less than budget = {settings['budget']}.")
        model, name = compile_scenario(population.scenario), population.scenario.name
        is_square = model.scenario.regions.target_radius is not None
        if not (model.has_cell_maps and len(model.starts) == 1 and is_square):
            where = f"{source}: scenarios: {name} ({population.condition.name})"
            needed = "the agent observes only its cell, there are one start, one phase and no walls"
            squares = "the regions are squares by their radii"
            raise InputError(f"{where}: in a replication {needed}, and {squares}.")


def headline(folder: Folder) -> str | None:
    """Counts the verdicts on the claims, with all agents."""
    if "claims.csv" not in folder:
        return None
    frame = folder.frame("claims")
    n_agents = frame["agents"].max()
    rows = weakest(frame[frame["agents"] == n_agents])
    parts = [(name, rows[rows["verdict"] == name]) for name in VERDICTS]
    counts = [f"{len(judged)} × {name}" for name, judged in parts if len(judged)]
    scope = f"the paper's {len(rows)} claims, with {n_agents:,} agents per scenario"
    return f"Verdicts on {scope}: {', '.join(counts)}."


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
