"""Items of a comparison: how learners learn, after how many steps, at whose expense, and at what cost."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from benchmark.analysis.frames import RecordsOf, by_step, learned
from benchmark.analysis.intervals import proportion, student
from benchmark.drawing import film
from benchmark.experiments import Experiment, Population
from benchmark.reports import explorer
from benchmark.reports.comparison import figures
from benchmark.reports.comparison.cells import Row, effort, populations
from benchmark.reports.comparison.columns import CELL, EFFORT, MEANINGS, columns
from benchmark.reports.comparison.declared import compared_learners, decisive_learners, reporting_of
from benchmark.reports.explorer import explorer_item, typical_agent
from benchmark.reports.item import Frames, drawing, expanded, item, no_rows, writing

ENOUGH: Final = 0.9  # a success by which a scenario counts as learned


@item(
    "curves",
    "success, score and wrong PINGs over training, against environment steps",
    meanings={"wrong_pings": "wrong PINGs per 1,000 steps of training since the evaluation before"},
    where=no_rows,
)
def curves(curves: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Of the wrong PINGs, the interval is Student's."""
    frames = []
    for names, _, rows in populations(curves, experiment):
        steps = rows["step"].unique()
        row: Row = {**names, "step": steps}
        row |= {name: proportion(by_step(rows, name)) for name in ("success", "score")}
        rate = np.diff(by_step(rows, "training_wrong_pings"), axis=1) / np.diff(steps) * 1000
        wrong = student(np.column_stack([np.full(len(rate), np.nan), rate]))  # nothing before the first step
        row["wrong_pings"] = wrong._replace(low=np.maximum(wrong.low, 0.0))
        frames.append(pd.DataFrame(expanded(row)))
    return pd.concat(frames, ignore_index=True)


@curves.figure("How often each learner succeeds while it learns.")
def _(table: pd.DataFrame, tables: Frames, experiment: Experiment) -> Figure:
    frame = figures.labelled(table)
    drawn = figures.drawn_in(frame, experiment)
    if frame["scenario"].nunique() <= figures.FEW:
        panels = _panels(drawn, experiment)
    else:
        panels = {"": {name: drawn[name] for name in _compared(drawn, experiment)}}
    note = f"; dotted: {ENOUGH:g}{figures.reference_note(drawn, tables, experiment)}"
    with figures.curve_panels(frame, panels, experiment, "success", "success", note) as (figure, axes):
        for axis in axes:
            axis.axhline(ENOUGH, color="0.35", lw=0.8, ls=":")
            axis.set(ylim=(-0.03, 1.03), yticks=(0, 0.5, 1))
    return figure


def _panels(drawn: figures.Drawn, experiment: Experiment) -> dict[str, figures.Drawn]:
    """Returns the learners of each declared group, by its title; those of no group are in every panel."""
    groups: dict[str, dict[str, Sequence[str]]] = {"": {}}
    for name, references in drawn.items():
        groups.setdefault(experiment.learners[name].declared.group, {})[name] = references
    everywhere = groups.pop("")
    return {title: everywhere | own for title, own in groups.items()} or {"": everywhere}


def _compared(drawn: figures.Drawn, experiment: Experiment) -> list[str]:
    return [name for name in compared_learners(experiment) if name in drawn] or [*drawn]


@drawing(
    "wrong_pings",
    "wrong PINGs per 1,000 steps while agents learn",
    "How often a person is disturbed while agents learn: wrong PINGs per 1,000 steps.",
)
def wrong_pings(tables: Frames, experiment: Experiment) -> Figure | None:
    """Draws how often the issuer disagreed while agents learned, without reference implementations."""
    if "curves" not in tables:
        return None
    frame = figures.labelled(tables["curves"])
    drawn = dict.fromkeys(_compared(figures.drawn_in(frame, experiment), experiment), ())
    most = float(figures.rows_of(frame, drawn)["wrong_pings"].max())
    label = "wrong PINGs\nper 1,000 steps"
    with figures.curve_panels(frame, {"": drawn}, experiment, "wrong_pings", label) as (figure, axes):
        for axis in axes:
            axis.set(ylim=(0, most * 1.05))
    return figure


@item(
    "steps",
    f"after how many steps success stays at or above {ENOUGH:g} to the last evaluation",
    columns(f"{CELL} n budget share median_step step final_success"),
    meanings=MEANINGS
    | {
        "share": f"share of runs whose success stays at or above {ENOUGH:g}",
        "median_step": f"median over runs of the evaluation step from which success stays at or above "
        f"{ENOUGH:g}; inf if most never reach it",
        "step": f"evaluation step from which the mean success over runs stays at or above {ENOUGH:g}; inf if "
        "there is none",
        "below_at": "last evaluation before `step`; empty if there is none",
    },
    best="-step",
)
def steps(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Computes when runs, and the mean over runs, have learned."""
    for names, _, rows in populations(curves, experiment):
        success, evaluations = by_step(rows, "success"), rows["step"].unique().tolist()
        mean, indices = success.mean(axis=0), learned(success, evaluations, ENOUGH)
        first, when = int(learned(mean[None], evaluations, ENOUGH)[0]), np.array([*evaluations, np.inf])
        yield {
            **names,
            "n": len(success),
            "budget": rows["step"].max(),
            "share": proportion(indices < len(mean)),
            "median_step": float(np.median(when[indices])),
            "step": float(when[first]),
            "below_at": float(when[first - 1]) if first > 0 else np.nan,
            "final_success": float(mean[-1]),
        }


@item(
    "cost",
    "cost of a run, measured: medians over all runs of CPU seconds, updates, parameters and peak memory",
    columns(f"{CELL} cpu_time_s steps_per_cpu_s updates parameters peak_memory_mb {EFFORT}"),
    meanings=MEANINGS,
    is_measured=True,
    best="-cpu_time_s",
)
def cost(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Computes medians over all scenarios and conditions, and the range of CPU time."""
    for names, learner, rows in populations(runs, experiment, "scenario", "condition"):
        seconds = rows["cpu_time_s"].to_numpy()
        yield {
            **names,
            "runs": len(rows),
            "cpu_time_s": np.median(seconds),
            "cpu_time_s_min": seconds.min(),
            "cpu_time_s_max": seconds.max(),
            "steps_per_cpu_s": rows["budget"].iloc[0] / np.median(seconds),
            "updates": np.median(rows["updates"].to_numpy()),
            "parameters": rows["parameters"].iloc[0],
            "peak_memory_mb": rows["peak_memory_mb"].median(),
            **effort(learner),
        }


@writing(
    "learning",
    "animation of learning: of a table, a net or both, the agent of the median seed",
    "learning.webp",
)
def learning(runs: pd.DataFrame, experiment: Experiment, records: RecordsOf, path: Path) -> None:
    """Writes an animation: typical agents of a table and of a net, in every scenario."""
    drawn, rows = _drawn(runs, experiment), []
    learners = [*reporting_of(experiment).baseline, *decisive_learners(experiment)]
    learners += [population.learner.name for population in drawn]  # if nothing is declared
    for family in ("tabular", "deep"):
        chosen = next((name for name in learners if experiment.learners[name].family == family), None)
        rows.append([_film(population, records) for population in drawn if population.learner.name == chosen])
    film.write(film.learning([row for row in rows if row]), path)


def _film(population: Population, records: RecordsOf) -> film.Film:
    own = records(population)
    agent = typical_agent(own)
    title = f"{population.scenario.name}: {population.learner.title}, seed {own.seeds[agent]} (median)"
    return film.film_of(title, own, agent)


@explorer_item
def agents(runs: pd.DataFrame, experiment: Experiment, records: RecordsOf, path: Path) -> None:
    """Writes what all learners know, but for reference implementations."""
    explorer.write([records(population) for population in _drawn(runs, experiment)], path)


def _drawn(runs: pd.DataFrame, experiment: Experiment) -> list[Population]:
    return [
        experiment.population(rows["condition"].iloc[0], names["scenario"], learner.name)
        for names, learner, rows in populations(runs, experiment)
        if not learner.reference_for
    ]
