"""Items of a comparison: how learners learn, after how many steps, at whose expense, and at what cost."""

from collections.abc import Iterator
from pathlib import Path
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from agents.policy import mask_policy
from benchmark.analysis.frames import RecordsOf, by_step, learned
from benchmark.analysis.intervals import proportion
from benchmark.drawing.maps import draw_policy, policy_legend
from benchmark.drawing.style import WIDTH, figure_of
from benchmark.experiments import Experiment
from benchmark.studies import explorer
from benchmark.studies.comparison import figures
from benchmark.studies.comparison.cells import Row, effort, populations
from benchmark.studies.comparison.columns import CELL, EFFORT, ENDPOINTS, MEANINGS, columns
from benchmark.studies.comparison.declared import drawn_learners
from benchmark.studies.explorer import explorer_item
from benchmark.studies.item import COLUMNS, drawing, expanded, item, no_rows

_COLUMNS: Final = 3  # of maps
ENOUGH: Final = 0.9  # a success by which a scenario counts as learned


@item("curves", "success and score over training, against environment steps", where=no_rows)
def curves(curves: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """Computes means over runs at every evaluation."""
    frames = []
    for names, _, rows in populations(curves, experiment):
        means = {name: proportion(by_step(rows, name)) for name in ENDPOINTS}
        frames.append(pd.DataFrame(expanded({**names, "step": rows["step"].unique(), **means})))
    return pd.concat(frames, ignore_index=True)


@curves.figure("How often each learner succeeds while it learns; shade: 95 % interval.")
def _(table: pd.DataFrame, experiment: Experiment) -> Figure | None:
    frame, names = figures.labelled(table), drawn_learners(experiment)
    if frame["scenario"].nunique() > figures.FEW:
        return None
    return figures.curve_panels(frame, names, experiment)


@drawing(
    "policies",
    "what the first run of each learner does after training",
    "What the first run of each learner does after training in the first scenario, before any PING.",
)
def policies(runs: pd.DataFrame, experiment: Experiment, records: RecordsOf) -> Figure | None:
    """Draws the policies of compared learners that have runs in the first scenario."""
    scenario, condition = (str(runs[key].iloc[0]) for key in ("scenario", "condition"))
    here = runs[(runs["scenario"] == scenario) & (runs["condition"] == condition)].groupby("learner")
    names = [name for name in drawn_learners(experiment) if name in here.groups]
    n_columns = min(len(names), _COLUMNS)
    n_rows, norm = -(-len(names) // n_columns), Normalize(0.0, 1.0)
    with figure_of(n_rows, n_columns, (WIDTH, 2.6 * n_rows + 1.0)) as (figure, axes):
        figure.set_layout_engine("compressed")
        for axis, name in zip(axes.flat, names, strict=False):
            first, learner = here.get_group(name).iloc[0], experiment.learners[name]
            found = records(experiment.population(condition, scenario, name)).subset(0, 1)
            policy = found.arrays[learner.declared.policy][0, -1]
            if learner.declared.policy == "greedy":
                policy = mask_policy(policy)
            draw_policy(axis, found.model, policy, norm)
            title = fill(learner.title, 30, break_on_hyphens=False)
            axis.set_title(f"{title}\nsuccess {first['success']:.2f}", fontsize="small")
        for axis in axes.flat[len(names) :]:
            axis.set_axis_off()
        policy_legend(figure, [*axes.flat], found.model, norm)
    return figure


@item(
    "steps",
    f"after how many steps success stays at or above {ENOUGH:g} to the last evaluation",
    columns(f"{CELL} n budget share median_step step final_success"),
    meanings={**MEANINGS, **COLUMNS["learned"]},
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


@explorer_item
def agents(runs: pd.DataFrame, experiment: Experiment, records: RecordsOf, path: Path) -> None:
    """Writes what all learners know, but for reference implementations."""
    drawn = [
        experiment.population(rows["condition"].iloc[0], names["scenario"], learner.name)
        for names, learner, rows in populations(runs, experiment)
        if not learner.reference_for
    ]
    explorer.write([records(population) for population in drawn], path)
