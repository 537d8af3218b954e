"""Items of a comparison: what each learner reached, how learners differ, and what is possible."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, VERDICTS, WORSE
from benchmark.analysis.frames import ENDPOINTS as RESULTS
from benchmark.analysis.intervals import mean_over_scenarios, proportion
from benchmark.drawing.style import WIDTH, colour_map, figure_of, ink_on
from benchmark.drawing.tables import inert, link, show, write_csv
from benchmark.experiments import Experiment
from benchmark.folder import SCORES, Folder, with_titles
from benchmark.studies.comparison import figures
from benchmark.studies.comparison.cells import Row, effort, names_of, own_rows, populations, wrong_pings
from benchmark.studies.comparison.columns import CELL, DIFFERENCES, ENDPOINTS, MEANINGS, WORDS, columns
from benchmark.studies.comparison.declared import drawn_learners, reporting_of
from benchmark.studies.comparison.verdicts import contrast_rows, effect_rows, outcome_rows, same_input_rows
from benchmark.studies.item import Frames, Item, item, no_rows, writing
from envs.scene import COLOUR_MAP

_MOST_DRAWN: Final = 24  # contrasts
_MOST_NAMED: Final = 3  # contrasts in a sentence
_CHARACTERS, _MOST_COLUMNS = 66, 8  # of the names of a figure's columns in a line; columns with level names
# What outcomes mean, in the order of scenarios in a figure
_OUTCOMES: Final = {
    "earns": "a net beats every baseline in success",
    "another policy": "a net beats every baseline in success, with another kind of policy",
    "another input": "a net beats every baseline in success, with another input",
    "no baseline learned": "only nets are shown to beat the random policy",
    "mixed": "mixed",
    "undecided": "undecided",
    "unequal budgets": "unequal budgets",
    "does not earn": "no net beats every baseline in success",
    "cannot be beaten": "cannot be beaten here: a baseline leaves no room",
    "nothing to learn": "the random policy succeeds, too",
    "neither learned": "no learner is shown to beat the random policy",
    "no verdict": "no verdict",
}


def _measured(frame: pd.DataFrame) -> pd.DataFrame:
    """Marks equivalences whose difference is significant."""
    is_shown = (frame["success_verdict"] == EQUIVALENT) & (frame["success_p_different"] <= 0.05)
    texts = frame["success_margin"].map("within {:g}, but measurably ".format)
    texts += np.where(frame["success_difference"] > 0, BETTER, WORSE)
    success, score = (frame[f"{endpoint}_verdict"].map(WORDS) for endpoint in ENDPOINTS)
    return frame.assign(success_verdict=np.where(is_shown, texts, success), score_verdict=score)


contrasts: Item[Any] = item(
    "contrasts",
    "the declared contrasts, x against y: differences, p-values and verdicts",
    columns(
        "scenario condition x y success_verdict score_verdict success_except n success_difference "
        "success_p_different success_p_equivalent score_difference wrong_pings_difference"
    ),
    meanings=MEANINGS
    | {"n": "runs per scenario, the smallest number", "wrong_pings": MEANINGS["training_wrong_pings"]},
    where=_measured,
)(contrast_rows)


text = "exploratory: nets against tables and linear learners of the same input"
same_input = replace(contrasts, name="same_input", description=text, compute=same_input_rows)


@contrasts.figure(
    "The contrasts: differences with their 90 % (thick) and 95 % intervals, the margin (grey), and verdicts."
)
def _(table: pd.DataFrame, experiment: Experiment) -> Figure | None:
    if len(table) > _MOST_DRAWN:
        return None
    titles = {name: learner.title for name, learner in experiment.learners.items()}
    rows = with_titles(figures.labelled(table), titles).iterrows()
    names = [", ".join(filter(None, [f"{row['x']}\nagainst {row['y']}", row["scenario"]])) for _, row in rows]
    return figures.differences(table, names)


outcomes: Item[Any] = item(
    "outcomes",
    "whether deep RL earns its keep over the baselines",
    meanings=MEANINGS,
    where=lambda frame: frame.assign(outcome=frame["outcome"].map(_OUTCOMES)),
)(outcome_rows)


@item(
    "verdicts",
    "how many verdicts on success each contrast has, over scenarios",
    {"x": "", "y": "", "n": "contrasts", **WORDS},
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


effects: Item[Any] = item(
    "effects",
    "exploratory: differences between scenarios, conditions or learners, x minus y",
    columns(f"effect {CELL} x y n {DIFFERENCES}"),
    meanings=MEANINGS | {"wrong_pings": MEANINGS["training_wrong_pings"]},
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
    frame, drawn = figures.labelled(tables["summary"]), drawn_learners(experiment)
    learners = [name for name in frame["learner"].unique() if name in drawn]
    if not learners:  # of a partial report
        return None
    values = frame.pivot(index="scenario", columns="learner", values="success")[learners]
    rows, groups = dict[str, Any](), dict[int, str]()
    scenarios = [*frame["scenario"].unique()]
    if len(scenarios) > figures.FEW:  # the highest first
        scenarios.sort(key=lambda name: -values.loc[name].sum())
    for title, names in _grouped(tables, scenarios).items():
        groups[len(rows)] = title
        rows |= {name: values.loc[name] for name in names}
    if "aggregate" in tables and len(rows) > 1 and "condition" not in tables["aggregate"]:
        rows["mean"] = figures.labelled(tables["aggregate"]).set_index("learner")["success"].reindex(learners)
    frame = pd.DataFrame(rows).T
    is_crowded = len(learners) > _MOST_COLUMNS  # then their names are turned
    characters = 24 if is_crowded else max(_CHARACTERS // len(learners), 11)
    titles = [fill(experiment.learners[name].title, characters, break_on_hyphens=False) for name in learners]
    cells = {"vmin": 0.0, "vmax": 1.0, "cmap": colour_map(COLOUR_MAP), "cbar": False, "linewidths": 2}
    texts = {"annot": frame.map(lambda value: show(value, 2)), "fmt": "", "annot_kws": {"size": "small"}}
    with figure_of(1, 1, (WIDTH, 0.32 * len(rows) + 1.3 + is_crowded)) as (figure, axes):
        axis = sns.heatmap(frame, ax=axes[0, 0], xticklabels=False, yticklabels=False, **cells, **texts)
        axis.set_xticks(np.arange(len(titles)) + 0.5, titles)
        axis.set_yticks(np.arange(len(rows)) + 0.5, [*rows])
        shown = frame.to_numpy().ravel()
        for text, value in zip(axis.texts, shown[~np.isnan(shown)], strict=True):
            text.set_color(ink_on(colour_map(COLOUR_MAP)(value)))
        axis.set(xlabel="", ylabel="")
        axis.xaxis.tick_top()
        axis.tick_params(length=0, labelsize="small", labelrotation=0)
        axis.tick_params(axis="x", labelrotation=90 * is_crowded)
        for at, title in groups.items():
            style = {"va": "top", "fontsize": "small", "transform": axis.get_yaxis_transform()}
            axis.text(1.01, at + 0.1, fill(title, 20), **style)
            axis.axhline(at, color="black", lw=1.2 * bool(at))
        figure.supxlabel("success after training, mean over runs", fontsize="small")
    return figure


def _grouped(tables: Frames, scenarios: list[str]) -> Mapping[str, list[str]]:
    """Returns scenarios by outcome, if there are outcomes of each."""
    if "scenario" not in tables.get("outcomes", ()):
        return {"": scenarios}
    outcome_of = figures.labelled(tables["outcomes"]).set_index("scenario")["outcome"]
    groups = dict[str, list[str]]()
    for outcome, title in _OUTCOMES.items():
        if names := [name for name in scenarios if outcome_of.get(name) == outcome]:
            groups[title] = names
    return groups


@item(
    "aggregate",
    "every learner over all scenarios, after training",
    columns(f"{CELL} policy runs success score every_cell_success"),
    meanings=MEANINGS,
    best="success",
)
def aggregate(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Computes means over scenarios, if these are pooled."""
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
        yield row


@writing("scores", "every run at the end of training, compressed", SCORES)
def scores(runs: pd.DataFrame, experiment: Experiment, path: Path) -> None:
    """Writes `runs`; `every_cell_` marks episodes that start in any cell, `diverged_at` may be infinite."""
    names = [*names_of(experiment), "policy", "seed", *RESULTS, *(f"every_cell_{name}" for name in RESULTS)]
    names += ["greedy_success", *runs.loc[:, "target_cells_marked":"diverged_at"]]
    write_csv(own_rows(runs, experiment)[[name for name in names if name in runs]], path)


scores.meanings = MEANINGS | {"training_wrong_pings": "wrong PINGs of the whole training"}


def headline(folder: Folder) -> str | None:
    """Returns how often each outcome came up, or else each verdict on success, and where score differs."""
    if "contrasts.csv" not in folder:
        return None
    has_outcomes = "outcomes.csv" in folder
    name, column = ("outcomes", "outcome") if has_outcomes else ("contrasts", "success_verdict")
    start = "Whether deep RL earns its keep" if has_outcomes else "Verdicts on success"
    table, parts = folder.frame(name), []
    for ending, text in (_OUTCOMES if has_outcomes else WORDS).items():
        if len(rows := table[table[column] == ending]):
            parts.append(f"{text} ({link(str(len(rows)), name, rows)} of {len(table)})")
    return f"{start}: {'; '.join(parts)}.{_by_score(folder)}"


def _by_score(folder: Folder) -> str:
    """Returns a sentence on contrasts that are better or worse in score, and not in success."""
    table = figures.labelled(folder.frame("contrasts"))
    rows = table.query("score_verdict in ('better', 'worse') and score_verdict != success_verdict")
    parts, more = [], rows[_MOST_NAMED:]
    for _, row in rows[:_MOST_NAMED].iterrows():
        x, y = (inert(folder.phrase(row[side])) for side in "xy")
        where = f" in {inert(row['scenario'])}" if row["scenario"] else ""
        parts.append(f"{x} is {link(row['score_verdict'], 'contrasts', row)} than {y}{where}")
    if len(more):
        parts.append(f"{link(str(len(more)), 'contrasts', more)} other contrasts are better or worse, too")
    return f" By score, {'; '.join(parts)}." if parts else ""
