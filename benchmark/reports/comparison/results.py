"""Items of a comparison: what each learner reached, how learners differ, and what is possible."""

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, MIXED, VERDICTS, WORSE
from benchmark.analysis.frames import ENDPOINTS as RESULTS
from benchmark.analysis.intervals import mean_over_scenarios, proportion
from benchmark.drawing.style import INK, figure_of
from benchmark.drawing.tables import inert, link, show, write_csv
from benchmark.experiments import Experiment
from benchmark.reports.comparison import figures
from benchmark.reports.comparison.cells import Row, effort, names_of, own_rows, populations, wrong_pings
from benchmark.reports.comparison.columns import CELL, DIFFERENCES, EFFORT, MEANINGS, RATE, columns
from benchmark.reports.comparison.declared import compared_learners, decisive_learners, reporting_of
from benchmark.reports.comparison.verdicts import (
    ENDPOINTS,
    contrast_rows,
    effect_rows,
    outcome_rows,
    standings,
)
from benchmark.reports.folder import SCORES, Folder, titled
from benchmark.reports.item import Frames, item, no_rows, writing
from envs.scenario import RELATIVE
from envs.scene import COLOUR_MAP
from envs.words import listed

_MOST_DRAWN: Final = 15  # contrasts
_SIGNS: Final = {BETTER: "▲", WORSE: "▼", EQUIVALENT: "=", MIXED: "±"}  # of verdicts
# What they mean, see `standings`
_THAN: Final = {
    BETTER: " than all",
    WORSE: " than at least one",
    EQUIVALENT: " to at least one, worse than none",
}
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


@contrasts.figure("The contrasts: differences with their intervals, and verdicts.")
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
    where=no_rows,
)(effect_rows)


@effects.figure("What changes between two scenarios, by learner.")
def _(table: pd.DataFrame, experiment: Experiment) -> Figure | None:
    if "algorithm" not in table:
        return None
    frame = figures.labelled(table[table["algorithm"].notna()])
    learners = compared_learners(experiment) or list(frame["learner"].unique())
    names = list(frame["effect"].unique())
    labels = {"success": "success", "wrong_pings": "wrong PINGs per 1,000 steps"}
    frame = frame.rename(columns=lambda name: str(name).replace("_difference", ""))
    distance = 0.8 / len(learners)
    size = (11.0, (0.11 * len(learners) + 0.2) * len(names) + 1.4)
    with figure_of(1, len(labels), size) as (figure, axes):
        for axis, (key, label) in zip(axes[0], labels.items(), strict=True):
            axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
            for (y, name), (i, learner) in product(enumerate(names), enumerate(learners)):
                rows = frame[(frame["effect"] == name) & (frame["learner"] == learner)]
                at = y + distance * (i - (len(learners) - 1) / 2)
                figures.dot(axis, rows, key, at, figures.style_of(learner, experiment))
            pairs = frame.groupby("effect", sort=False)[["x", "y"]].first()
            texts = [f"{name}:\n{pairs['x'][name]} − {pairs['y'][name]}" for name in names]
            figures.label_rows(axis, texts, first=axis is axes[0, 0])
            axis.grid(visible=False, axis="y")
            for y in range(len(names) - 1):
                axis.axhline(y + 0.5, color="0.85", lw=0.6)
            reach = 1.05 * float(frame[[f"{key}_low", f"{key}_high"]].abs().to_numpy().max()) or 1.0
            axis.set(xlim=(-reach, reach), xlabel=f"difference in {label}")
        figures.legend(figure, learners, experiment, "bar: 95 % interval, not adjusted; exploratory", ls="")
    return figure


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
def _(tables: Frames, experiment: Experiment) -> Figure:
    is_few = figures.labelled(tables["summary"])["scenario"].nunique() <= figures.FEW
    return _dots(tables, experiment) if is_few else _heat(tables, experiment)


def _dots(tables: Frames, experiment: Experiment) -> Figure:
    frame = figures.labelled(tables["summary"])
    panels = {str(scenario): rows for scenario, rows in frame.groupby("scenario", sort=False)}
    if "aggregate" in tables and tables["summary"]["scenario"].nunique() > 1:
        means = figures.labelled(tables["aggregate"].assign(scenario="mean over scenarios"))
        panels |= {str(scenario): rows for scenario, rows in means.groupby("scenario", sort=False)}
    drawn, baselines = figures.drawn_in(frame, experiment), reporting_of(experiment).baseline
    learners = [*drawn]
    height = (0.34 if any(drawn.values()) else 0.26) * len(learners) + 1.3
    with figure_of(1, len(panels), (11.0, height)) as (figure, axes):
        for axis, (title, panel) in zip(axes[0], panels.items(), strict=True):
            for y, (learner, references) in enumerate(drawn.items()):
                style = figures.style_of(learner, experiment)
                for i, name in enumerate([learner, *references]):
                    at = y + 0.4 * (i - len(references) / 2)
                    figures.dot(axis, panel[panel["learner"] == name], "success", at, style, is_hollow=i > 0)
            titles = [experiment.learners[name].title for name in learners]
            figures.label_rows(axis, titles, first=axis is axes[0, 0])
            axis.set(title=figures.in_lines(title), xlim=(-0.03, 1.03), xticks=(0, 0.5, 1))
            for y in [learners.index(name) for name in baselines if name in learners]:
                axis.axhspan(y - 0.5, y + 0.5, color="0.93", lw=0, zorder=0)
        text = "success probability after training; bar: 95 % interval over runs"
        text += "; grey: the baselines" if baselines else ""
        figure.supxlabel(text + figures.reference_note(drawn, tables, experiment), fontsize="small")
    return figure


def _heat(tables: Frames, experiment: Experiment) -> Figure:
    """Draws a row per scenario, sorted by outcome and success, and a column per learner, with verdicts."""
    frame, baselines = figures.labelled(tables["summary"]), reporting_of(experiment).baseline
    learners = [*figures.drawn_in(frame, experiment)]
    values = frame.pivot(index="scenario", columns="learner", values="success")
    groups, signs = _grouped(tables, [*frame["scenario"].unique()]), _signs(tables, baselines)
    own = [name for name in learners if name in decisive_learners(experiment)] or learners
    scenarios: list[str] = []
    for names in groups.values():
        scenarios += sorted(names, key=lambda name: -float(values.loc[name, own].to_numpy().sum()))
    size = (min(0.62 * len(learners) + 2.4, 11.0), 0.27 * len(scenarios) + 3.0)
    with figure_of(1, 1, size) as (figure, axes):
        axis = axes[0, 0]
        shares = values.loc[scenarios, learners].to_numpy()
        edges = np.arange(len(learners) + 1) - 0.5, np.arange(len(scenarios) + 1) - 0.5
        axis.pcolormesh(*edges, shares, cmap=COLOUR_MAP, vmin=0, vmax=1, edgecolors="white", linewidth=0.8)
        for (row, column), share in np.ndenumerate(shares):
            text = f"{share:.2f} {signs.get((scenarios[row], learners[column]), '')}".strip()
            axis.text(column, row, text, ha="center", va="center", color=INK[int(share < 0.55)])
        axis.set(ylim=(len(scenarios) - 0.5, -0.5))
        budgets = frame.groupby("learner", sort=False)["budget"].first()
        usual = budgets.mode()[0]
        labels = [
            experiment.learners[name].title + ("" if budgets[name] == usual else f" ({budgets[name]:,})")
            for name in learners
        ]
        axis.set_xticks(range(len(learners)), labels, rotation=40, ha="left", rotation_mode="anchor")
        axis.set_yticks(range(len(scenarios)), scenarios)
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        at = 0
        for title, names in groups.items():
            axis.text(1.01, at - 0.3, fill(title, 22), va="top", transform=axis.get_yaxis_transform())
            axis.axhline(at - 0.5, color="black", lw=1.2) if at else None
            at += len(names)
        lines = [f"success probability after {usual:,} steps of training, mean over runs"]
        if signs:
            meanings = [f"{sign} {verdict}{_THAN.get(verdict, '')}" for verdict, sign in _SIGNS.items()]
            lines.append(f"against {listed(experiment.learners[name].title for name in baselines)}:")
            lines.append(f"{', '.join(meanings)}; no sign: undecided or not compared")
        figure.supxlabel("\n".join(lines), fontsize="small")
    return figure


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


def _signs(tables: Frames, baselines: tuple[str, ...]) -> dict[tuple[str, str], str]:
    signs: dict[tuple[str, str], str] = {}
    if "scenario" in tables.get("contrasts", ()):
        for scenario, rows in figures.labelled(tables["contrasts"]).groupby("scenario", sort=False):
            of_learners = standings(rows, baselines).map(_SIGNS).fillna("")
            signs |= {(str(scenario), str(x)): sign for x, sign in of_learners.items()}
    return signs


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
    columns(f"{CELL} policy runs success score {EFFORT} every_cell_success unbounded_score iqm"),
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
