"""Items of a comparison: what each learner reached, how learners differ, and what is possible."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, VERDICTS, WORSE
from benchmark.analysis.frames import ENDPOINTS as RESULTS
from benchmark.analysis.intervals import mean_over_scenarios, proportion
from benchmark.drawing.style import WIDTH, draw_cells, figure_of
from benchmark.drawing.tables import inert, link, show, write_csv
from benchmark.experiments import Experiment
from benchmark.reports.comparison import figures
from benchmark.reports.comparison.cells import Row, effort, names_of, own_rows, populations, wrong_pings
from benchmark.reports.comparison.columns import CELL, DIFFERENCES, MEANINGS, RATE, columns
from benchmark.reports.comparison.declared import decisive_learners, reporting_of
from benchmark.reports.comparison.verdicts import ENDPOINTS, contrast_rows, effect_rows, outcome_rows
from benchmark.reports.folder import SCORES, Folder, titled
from benchmark.reports.item import Frames, item, no_rows, writing
from envs.scenario import RELATIVE
from envs.scene import COLOUR_MAP

_MOST_DRAWN: Final = 15  # contrasts
_GOOD: Final = 0.95  # a success of which a figure does not show the number
_CHARACTERS: Final = 72  # of the names of a figure's columns in a line
_KINDS: Final = {"tabular": "table", "linear": "tile coding", "deep": "net"}  # of learners, by family
# What outcomes mean, in the order of scenarios in a figure
_OUTCOMES: Final = {
    "earns": "a net is better than the baselines",
    "another policy": "a net is better, with another kind of policy",
    "no baseline learned": "only nets learned",
    "mixed": "mixed",
    "undecided": "undecided",
    "unequal budgets": "unequal budgets",
    "does not earn": "no net is better than the baselines",
    "neither learned": "neither learned",
    "no verdict": "no verdict",
}


def _measured(frame: pd.DataFrame) -> pd.DataFrame:
    """Says of which equivalent learners a difference is shown, too."""
    is_shown = (frame["success_verdict"] == EQUIVALENT) & (frame["success_p_different"] <= 0.05)
    than = np.where(frame["success_difference"] > 0, BETTER, WORSE)
    pairs = zip(frame["success_margin"], than, strict=True)
    texts = [f"within {margin:g}, but measurably {word}" for margin, word in pairs]
    return frame.assign(success_verdict=np.where(is_shown, texts, frame["success_verdict"]))


contrasts = item(
    "contrasts",
    "the declared contrasts, x against y: differences, p-values and verdicts",
    columns(
        "scenario condition x y success_verdict score_verdict success_except n success_difference "
        "success_p_different success_p_equivalent score_difference wrong_pings_difference"
    ),
    meanings=MEANINGS | {"n": "runs per scenario, the smallest number", "wrong_pings": RATE},
    where=_measured,
)(contrast_rows)


@contrasts.figure(
    "The contrasts: differences with their 90 % (thick) and 95 % intervals, the margin (grey), and verdicts."
)
def _(table: pd.DataFrame, experiment: Experiment) -> Figure | None:
    if len(table) > _MOST_DRAWN:
        return None
    titles = {name: learner.title for name, learner in experiment.learners.items()}
    names = []
    for _, row in figures.labelled(table).iterrows():
        x, y = (titled(row[side], titles) for side in "xy")
        names.append(", ".join(filter(None, [f"{x}\nagainst {y}", row["scenario"]])))
    return figures.differences(table, names)


outcomes = item("outcomes", "whether deep RL earns its keep over the baselines", meanings=MEANINGS)(
    outcome_rows
)


@item(
    "verdicts",
    "how many verdicts on success each contrast has, over scenarios",
    {"x": "", "y": "", "n": "contrasts", **dict.fromkeys(VERDICTS, "")},
    meanings={"n": "contrasts", **dict.fromkeys(VERDICTS, "contrasts with this verdict")},
)
def verdicts(runs: pd.DataFrame, experiment: Experiment, is_partial: bool) -> Iterator[Row]:
    """Counts contrasts of the same two sides, if there are many scenarios."""
    rows = pd.DataFrame(contrast_rows(runs, experiment, is_partial))
    if "scenario" not in rows or rows["scenario"].nunique() <= figures.FEW:
        return
    counted = [verdict for verdict in VERDICTS if verdict in {*rows["success_verdict"]}]
    for (x, y), verdicts in rows.groupby(["x", "y"], sort=False)["success_verdict"]:
        yield {"x": x, "y": y, "n": len(verdicts)} | {name: sum(verdicts == name) for name in counted}


effects = item(
    "effects",
    "exploratory: differences between scenarios, conditions or learners, x minus y",
    columns(f"effect {CELL} x y n {DIFFERENCES}"),
    meanings=MEANINGS | {"wrong_pings": RATE},
)(effect_rows)


@item(
    "summary",
    "each scenario and learner after training",
    columns(
        f"{CELL} policy n success greedy_success score unbounded_score steps wrong_pings "
        "training_wrong_pings every_cell_success"
    ),
    meanings=MEANINGS,
    where=lambda frame: frame if frame["scenario"].nunique() <= figures.FEW else no_rows(frame),
    best="success",
)
def summary(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Of the wrong PINGs of training, the interval is Student's."""
    means = ("unbounded_score", "steps", "wrong_pings", "uncomfortable_steps", "greedy_success")
    for names, learner, rows in populations(runs, experiment):
        first = rows.iloc[0]
        row: Row = {**names, "policy": first["policy"], "n": len(rows), "budget": first["budget"]}
        row |= {name: proportion(rows[name].to_numpy()) for name in ENDPOINTS}
        row |= {name: rows[name].to_numpy().mean() for name in means}
        row["random_success"] = first["random_success"]
        if "every_cell_success" in rows:
            row["every_cell_success"] = proportion(rows["every_cell_success"].to_numpy())
        row["diverged"] = int(np.isfinite(rows["diverged_at"]).sum())
        row["training_wrong_pings"] = wrong_pings(rows)
        yield row | effort(learner)


@summary.figure("How often each learner succeeds after training.")
def _(tables: Frames, experiment: Experiment) -> Figure | None:
    frame, drawn = figures.labelled(tables["summary"]), figures.drawn_learners(experiment)
    learners = [name for name in frame["learner"].unique() if name in drawn]
    if not learners:  # of a partial report
        return None
    decisive = [name for name in decisive_learners(experiment) if name in learners] or learners
    values = frame.pivot(index="scenario", columns="learner", values="success")[learners]
    rows, groups = dict[str, "pd.Series[float]"](), dict[int, str]()
    for title, names in _grouped(tables, [*frame["scenario"].unique()]).items():
        groups[len(rows)] = title
        rows |= _rows(values.loc[names], decisive)
    if "aggregate" in tables and len(rows) > 1 and "condition" not in tables["aggregate"]:
        mean = figures.labelled(tables["aggregate"]).set_index("learner")["success"]
        rows["mean"] = mean.reindex(learners)
    colours = mpl.colormaps[COLOUR_MAP].with_extremes(bad="white")  # without runs
    cells = [
        [("" if round(value, 2) >= _GOOD else show(value, 2), to_hex(colours(value))) for value in row]
        for row in rows.values()
    ]
    characters = max(_CHARACTERS // len(learners), 12)
    titles = [fill(experiment.learners[name].title, characters, break_on_hyphens=False) for name in learners]
    with figure_of(1, 1, (WIDTH, 0.32 * len(rows) + 1.3)) as (figure, axes):
        draw_cells(axes[0, 0], cells, [*rows], titles)
        for at, title in groups.items():
            style = {"va": "top", "fontsize": "small", "transform": axes[0, 0].get_yaxis_transform()}
            axes[0, 0].text(1.01, at - 0.4, fill(title, 20), **style)
            axes[0, 0].axhline(at - 0.5, color="black", lw=1.2 * bool(at))
        text = f"success after training, mean over runs; no number: {_GOOD} or more"
        figure.supxlabel(text, fontsize="small")
    return figure


def _rows(values: pd.DataFrame, decisive: Sequence[str]) -> dict[str, "pd.Series[float]"]:
    """Returns the rows of scenarios; of many, those where all learners are good share the first one."""
    is_good = values.ge(_GOOD).all(axis=1) & (len(values) > figures.FEW)
    rest = values[~is_good]
    order = rest[decisive].sum(axis=1).sort_values(ascending=False, kind="stable").index
    names = order if is_good.any() else rest.index
    shared = {fill(", ".join(values.index[is_good]), 34): values[is_good].min()} if is_good.any() else {}
    return shared | {str(name): rest.loc[name] for name in names}


def _grouped(tables: Frames, scenarios: list[str]) -> Mapping[str, list[str]]:
    """Returns scenarios by outcome, if there are outcomes of each."""
    if "scenario" not in tables.get("outcomes", ()):
        return {"": scenarios}
    outcome_of = figures.labelled(tables["outcomes"]).set_index("scenario")["outcome"]
    groups = {
        title: [name for name in scenarios if outcome_of.get(name) == outcome]
        for outcome, title in _OUTCOMES.items()
    }
    return {title: names for title, names in groups.items() if names}


@item("classes", "the best learner of each class, after training", meanings=MEANINGS)
def classes(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Finds it by mean success, in each scenario and condition; reference implementations are left out."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for names, learner, rows in populations(runs, experiment):
        if not learner.reference_for:
            row: Row = {name: names[name] for name in ("scenario", "condition") if name in names}
            row |= {"kind": _KINDS[learner.family], "policy": learner.declared.policy}
            row["knowledge"] = "offsets" if learner.observation.startswith(RELATIVE) else "cells"
            members = found.setdefault(tuple(row.values()), [])
            success = proportion(rows["success"].to_numpy())
            members.append({**row, **names, "n": len(rows), "success": success})
    for members in found.values():
        yield max(members, key=lambda row: row["success"].value) | {"learners": len(members)}


@classes.shown
def _(frame: pd.DataFrame) -> pd.DataFrame:
    """Returns a row for each scenario and condition, and a column for each class."""
    rows: dict[str, dict[str, str]] = {}
    for (_, row), place in zip(frame.iterrows(), figures.labelled(frame)["scenario"], strict=True):
        label = f"{row['policy']} {row['kind']}, {row['knowledge']}"
        success = link(show(float(row["success"]), 2), "classes", row)
        rows.setdefault(place, {"scenario": inert(place)})[label] = success
    return pd.DataFrame(rows.values()).fillna("-")


@item(
    "aggregate",
    "every learner over all scenarios, after training",
    columns(f"{CELL} policy runs success score every_cell_success"),
    meanings=MEANINGS,
    best="success",
)
def aggregate(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Computes means over scenarios, if these are pooled."""
    from rliable import metrics

    if reporting_of(experiment).pool != "scenarios":
        return
    for names, learner, rows in populations(runs, experiment, "scenario"):
        scenarios = [here for _, here in rows.groupby("scenario", sort=False)]
        row: Row = {**names, "policy": rows["policy"].iloc[0], "runs": len(rows), **effort(learner)}
        for name in (*ENDPOINTS, *(f"every_cell_{endpoint}" for endpoint in ENDPOINTS)):
            if name in runs:
                row[name] = mean_over_scenarios([here[name].to_numpy() for here in scenarios])
        final = [here["unbounded_score"].to_numpy() for here in scenarios]
        row["unbounded_score"] = np.mean([values.mean() for values in final])
        row["iqm"] = metrics.aggregate_iqm(np.concatenate(final)[:, None])
        yield row


@writing("scores", "every run at the end of training, compressed", SCORES)
def scores(runs: pd.DataFrame, experiment: Experiment, path: Path) -> None:
    """Writes `runs`; `every_cell_` marks episodes that start in any cell, `diverged_at` may be infinite."""
    names = [*names_of(experiment), "policy", "seed", *RESULTS, *(f"every_cell_{name}" for name in RESULTS)]
    names += ["greedy_success", *runs.loc[:, "target_cells_marked":"diverged_at"]]
    write_csv(own_rows(runs, experiment)[[name for name in names if name in runs]], path)


scores.meanings = MEANINGS | {"training_wrong_pings": "wrong PINGs of the whole training"}


def headline(folder: Folder) -> str | None:
    """Returns in one sentence how often each outcome came up, or else each verdict on success."""
    if "contrasts.csv" not in folder:
        return None
    has_outcomes = "outcomes.csv" in folder
    name, column = ("outcomes", "outcome") if has_outcomes else ("contrasts", "success_verdict")
    start = "Whether deep RL earns its keep" if has_outcomes else "Verdicts on success"
    table, parts = folder.frame(name), []
    for ending, text in (_OUTCOMES | dict(zip(VERDICTS, VERDICTS, strict=True))).items():
        if len(rows := table[table[column] == ending]):
            parts.append(f"{text} ({link(str(len(rows)), name, rows)} of {len(table)})")
    return f"{start}: {'; '.join(parts)}."
