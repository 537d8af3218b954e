"""Which learners learn which scenes, and in how many steps?

Of an experiment that extends the shipped one, as `bench` writes it, the published learners are
shown, too, from their published runs.
"""

import re
from functools import cache
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, to_hex
from matplotlib.figure import Figure

from benchmark import tables
from benchmark.comparison import bootstrap, check_packages
from benchmark.experiment import Experiment, load_experiment
from benchmark.folder import REPOSITORY
from benchmark.records import random_success
from benchmark.specification import solved
from benchmark.statistics import median, proportion, with_ends
from benchmark.study import Data, Report, described, learning, solved_of
from benchmark.style import WIDTH, colour_map, draw_cells, figure_of
from envs import compile_scenario

SUITE = "suite"  # the experiment whose runs are published
PUBLISHED_SUITE = REPOSITORY / "results" / SUITE  # an installed copy of the project has none
RELATIVE_TO = "tile_coding, coordinates"
_NEVER = "#ffffff"  # the colour of a cell in which most runs never learn
_FASTEST_AND_SLOWEST = (100, 20_000)  # ends of the scale of colours, in steps
_CHARACTERS = 24  # of a line of a learner's title


def check(experiment: Experiment, _: Report) -> None:
    """Raises an InputError if a table is missing, or a package of the report."""
    solved_of(experiment)
    check_packages(experiment)


# The tables


@cache
def published() -> Data | None:
    """Returns the published runs of the suite; None if there are none."""
    if not (PUBLISHED_SUITE / tables.RUNS).is_file():
        return None
    found = tables.published(SUITE, PUBLISHED_SUITE.parent)
    return Data(load_experiment(SUITE), None, *found)


def is_suite(data: Data) -> bool:
    """Returns whether an experiment is the suite itself, or its miniature."""
    return data.experiment.name.removesuffix("_smoke") == SUITE


def sides(data: Data) -> list[Data]:
    """Returns an experiment and, unless it is the suite itself, the published learners."""
    other = None if is_suite(data) else published()
    return [data, other] if other else [data]


def summary(data: Data) -> pd.DataFrame:
    """Each learner in each scene: steps until its runs have learned, and success at the end."""
    rows = list[dict[str, Any]]()
    for side in sides(data):
        known = {row["learner"] for row in rows}
        for population in side.experiment.populations:
            learner, run = population.learner, population.first
            if learner.name in known:  # a user's learner of the same name is shown instead
                continue
            steps, success = outcomes(side, learner.name, run.scenario.name)
            model = compile_scenario(run.scenario.drawn(run.seed))
            row = {
                "learner": learner.name,
                "title": learner.title,
                "scenario": run.scenario.name,
                "n": len(steps),
                "n_learned": np.isfinite(steps).sum(),
                **with_ends("steps", median(steps)),
                **with_ends("success", proportion(success)),
                "random_success": random_success(model, run.horizon),
            }
            rows.append(row)
    return pd.DataFrame(rows)


def outcomes(data: Data, learner: str, scenario: str) -> tuple[Any, Any]:
    """Returns the steps after which runs have learned, inf if never, and their success, (N,)."""
    curves, level = data.curves, solved_of(data.experiment).success
    own = curves[(curves["learner"] == learner) & (curves["scenario"] == scenario)]
    success = own.pivot(index="seed", columns="step", values="success")
    steps = [*success.columns, np.inf]
    learned = [steps[solved(curve, steps, level)[0]] for curve in success.to_numpy().tolist()]
    return np.array(learned, dtype=float), success.to_numpy()[:, -1]


def learners(data: Data) -> pd.DataFrame:
    """Each learner over all scenes: how many it learns, and aggregates of success (rliable)."""
    cells, rows = data.tables["summary"], []
    medians = cells.pivot(index="learner", columns="scenario", values="steps").clip(lower=1)
    logs = medians.where(np.isfinite(medians)).apply(np.log)
    for learner, own in cells.groupby("learner", sort=False):
        common = (logs.loc[learner] - logs.reindex([RELATIVE_TO]).iloc[0]).dropna()
        side = next(side for side in sides(data) if learner in side.experiment.learners)
        success = [outcomes(side, str(learner), scene)[1] for scene in own["scenario"]]
        row = {
            "learner": learner,
            "title": own["title"].iloc[0],
            "n": own["n"].min(),
            "scenes": len(own),
            "scenes_learned": np.isfinite(own["steps"]).sum(),
            "relative_steps": np.exp(common.mean()),
            "common_scenes": len(common),
        }
        rows.append(row | bootstrap(np.stack(success, axis=1)))
    return pd.DataFrame(rows)


# The figure


def draw(data: Data) -> Figure:
    """Median steps until learned; darker: fewer. White: how many runs learn, where most do not."""
    over_all, scale = data.tables["learners"], LogNorm(*_FASTEST_AND_SLOWEST, clip=True)
    blues = colour_map("Blues")

    def colour(steps: float) -> str:  # dark text can be read on all
        return _NEVER if steps == np.inf else to_hex(blues(0.6 - 0.5 * scale(steps)))

    drawn = [
        [(text, colour(steps)) for text, steps in _cells(data, row)]
        for row in over_all.to_dict("records")
    ]
    titles = [fill(title, _CHARACTERS, break_on_hyphens=False) for title in over_all["title"]]
    columns = [re.sub("(?<=[a-z])(?=[A-Z])", "\n", scene) for scene in _scenes(data)]
    columns += ["scenes\nlearned", "steps /\ntiles'"]
    with figure_of(1, 1, (WIDTH, 0.4 * len(drawn) + 0.6)) as (figure, axes):
        draw_cells(axes[0, 0], drawn, titles, columns)
    return figure


def _scenes(data: Data) -> list[str]:
    return [*dict.fromkeys(data.tables["summary"]["scenario"])]


def _cells(data: Data, row: Any) -> list[tuple[str, float]]:
    """Returns what cells of a learner say, with its median steps, by scene; then those of all."""
    cells = data.tables["summary"]
    own = cells[cells["learner"] == row["learner"]].set_index("scenario").to_dict("index")
    found = list[tuple[str, float]]()
    for scene in _scenes(data):
        cell = own.get(scene, {"steps": np.inf, "n_learned": 0, "n": 0})
        share = f"{cell['n_learned']} of {cell['n']}"
        found.append((share if cell["steps"] == np.inf else f"{cell['steps']:,.0f}", cell["steps"]))
    ratio, n_common = f"{row['relative_steps']:.2g} ({row['common_scenes']})", row["common_scenes"]
    found.append((f"{row['scenes_learned']} of {row['scenes']}", np.inf))
    return [*found, (ratio if n_common else "-", np.inf)]


# The text


def headline(data: Data) -> str:
    """Says how many scenes each learner learns; of a user's learners, with rows to paste."""
    table, budget = data.tables["learners"], data.runs["budget"].max()
    found = "; ".join(
        f"{row['title']}: {row['scenes_learned']}" for row in table.to_dict("records")
    )
    sizes = " or ".join(map(str, sorted({*table["n"]})))
    text = f"""\
Scenes of {table["scenes"].max()} in which most runs of a learner ({sizes} in each) learn within
{budget:,} steps: {found}.
"""
    return text if is_suite(data) else f"{text}\nTo paste:\n\n```\n{rows_to_paste(data)}\n```\n"


def rows_to_paste(data: Data) -> str:
    """Returns a Markdown table with a row for each of the experiment's own learners."""
    table, head = data.tables["learners"], ["learner", "runs", "scenes learned"]
    head += ["steps / tiles' (scenes)", "IQM of success", *_scenes(data)]
    lines = [head, ["---"] * len(head)]
    for row in table[table["learner"].isin(data.experiment.learners)].to_dict("records"):
        *texts, share, ratio = (text for text, _ in _cells(data, row))
        lines.append([row["title"], str(row["n"]), share, ratio, f"{row['iqm']:.2f}", *texts])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def reading(data: Data) -> str:
    """Says how the tables are made."""
    return f"""\
{learning(data.experiment)} *Success* is that at the end of training, which ends once it is certain
that a run has learned. A learner learns a scene if more than half of its runs do; the figure then
has their median number of steps, and otherwise how many learn. Steps relative to tile coding's are
the geometric mean of ratios of medians, over the scenes that both learn, whose number is in
brackets.

These are numbers, not verdicts: with few runs, a difference may be chance. Aggregates of success
are those of rliable, with 95 % intervals of a bootstrap within scenes."""


TABLES = {"summary": summary, "learners": learners}
FIGURES = {"suite": draw}
SHOWN = {"learners": "title n scenes_learned relative_steps common_scenes iqm mean"}
COLUMNS = described("""\
title: what readers call the learner
n: runs in each scene
n_learned: runs that have learned
steps: median steps until learned; inf if half of the runs or more never learn
random_success: success of the random policy; of drawn cells, with those of the first seed
scenes: scenes in which it ran
scenes_learned: scenes in which most of its runs learn
relative_steps: steps relative to tile coding's, geometric mean over common scenes
common_scenes: scenes that both it and tile coding learn
iqm: interquartile mean of success, over runs and scenes
median: median over scenes of the mean success over runs
mean: mean success over runs and scenes
optimality_gap: mean distance of success from 1
""")
