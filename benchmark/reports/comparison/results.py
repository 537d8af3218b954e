"""Items of a comparison: what each learner reached, how learners differ, and what they know."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from agents.memoryless import SEARCH
from benchmark.analysis.contrasts import BETTER, MIXED, VERDICTS, WORSE
from benchmark.analysis.intervals import Estimate, proportion
from benchmark.drawing.maps import gallery, in_words
from benchmark.drawing.style import figure_of
from benchmark.drawing.tables import link, write_csv
from benchmark.execution.store import evaluated
from benchmark.reports.comparison import figures, words
from benchmark.reports.comparison.declared import Declared, cannot_show
from benchmark.reports.comparison.runs import CELL, EFFORT, PAIR, Cell, Runs, means_of
from benchmark.reports.comparison.verdicts import (
    ENDPOINTS,
    Outcome,
    contrasts_of,
    counted,
    decisive_rows,
    effects_of,
    is_worse_in_some,
    outcome,
    runs_needed,
    standings,
    winners,
)
from benchmark.reports.folder import SCORES, Folder
from benchmark.reports.item import Finding, Frames, item, no_rows, writing
from envs import ZONES
from envs.scene import COLOUR_MAP
from envs.words import listed

_LABELS: Final = {"success": "success probability", "score": "score, clipped to [0, 1]"}
_MOST_TOLD: Final = 6  # contrasts that have a sentence each
_NEARLY: Final = 0.005  # short of the optimum, that is not worth a mention
_OUTCOMES: Final[Mapping[Outcome, str]] = {
    "earns": "deep RL earns its keep in",
    "another class": "a net with a policy of another class than the tables that learned is better in",
    "does not earn": "it does not in",
    "no table learned": "only deep learners are shown to beat the random policy in",
    "neither learned": "no table and no deep learner compared is shown to beat the random policy in",
    "mixed": "results are mixed in",
    "undecided": "it is undecided in",
    "unequal budgets": "it is left open, as budgets differ, in",
    "no verdict": "there is no verdict in",
}
# Groups of scenarios in a figure, from top to bottom
_GROUPS: Final[Mapping[Outcome, str]] = {
    "earns": "a net is better than the tables",
    "another class": "a net with a policy of another class is better",
    "no table learned": "only nets learned",
    "mixed": "mixed",
    "undecided": "undecided",
    "unequal budgets": "unequal budgets",
    "does not earn": "no net is better than the tables",
    "neither learned": "neither learned",
    "no verdict": "no verdict",
}


def _in_words(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(success_verdict=[words.in_words(row) for _, row in frame.iterrows()])


contrasts = item(
    "contrasts",
    "the declared contrasts, x against y: differences, p-values and verdicts",
    {
        **PAIR,
        "success_verdict": "verdict on success",
        "score_verdict": "verdict on score",
        "success_except": "not in",
        "n": "runs",
        "success_difference": "difference in success",
        "success_p_different": "p, no difference",
        "success_p_equivalent": "p, not equivalent",
        "score_difference": "difference in score",
        "wrong_pings_difference": "difference in wrong PINGs",
    },
    where=_in_words,
)(contrasts_of)


@contrasts.figure("The contrasts: differences with their intervals, and verdicts.")
def _(tables: Frames, runs: Runs) -> Figure | None:
    if "contrasts" not in tables or len(tables["contrasts"]) > 2 * _MOST_TOLD:
        return None
    frame = tables["contrasts"]
    names = []
    for _, row in frame.iterrows():
        x, y = (runs.names.of_side(str(row[key])) for key in "xy")
        names.append(", ".join(filter(None, [f"{x}\nagainst {y}", words.place(row)])))
    return figures.differences(frame, names, dict(_LABELS))


@contrasts.sentence
def _(table: pd.DataFrame, folder: Folder) -> Iterator[Finding]:
    """Tells every contrast, if they are few."""
    if len(table) <= _MOST_TOLD:
        yield from (words.verdict(row, folder.names) for _, row in table.iterrows())


@contrasts.sentence
def _(table: pd.DataFrame, folder: Folder) -> str | None:
    """Says if the runs could not have shown equivalence."""
    declared = Declared.from_manifest(folder.manifest)
    n_pooled = declared.n_pooled(len(folder.manifest["scenarios"]))
    return cannot_show(int(table["n"].min()), n_pooled, len(table), declared.reporting) or None


@contrasts.sentence
def _(table: pd.DataFrame, folder: Folder) -> str | None:
    """Says how many runs would settle the places that are undecided, if all means stayed as they are."""
    declared = Declared.from_manifest(folder.manifest)
    reporting, places = declared.reporting, words.scenario_labels(table)
    if not declared.baselines or reporting.pool != "none" or not all(places):
        return None
    n_tests, summary = len(table) if reporting.adjust == "holm" else 1, _summary(folder)
    parts: dict[int, list[str]] = {}
    for place, rows in table.groupby(places, sort=False):
        if outcome(declared, rows, summary) == "undecided" and (n := runs_needed(declared, rows, n_tests)):
            parts.setdefault(n, []).append(str(place))
    told = "; ".join(f"{n:,} in {listed(names)}" for n, names in sorted(parts.items()))
    start = "Exploratory: if all means stayed as they are, a verdict would take this many runs per learner:"
    return f"{start} {told}." if told else None


@item(
    "verdicts",
    "how many verdicts on success each contrast has, over scenarios",
    {"x": "", "y": "", "n": "contrasts", **dict.fromkeys(VERDICTS, "")},
)
def verdicts(runs: Runs) -> Iterator[dict[str, Any]]:
    """Counts contrasts of the same two sides, if they are many."""
    rows = pd.DataFrame(contrasts_of(runs))
    if len(rows) <= _MOST_TOLD or not rows.duplicated(["x", "y"]).any():
        return
    found = [verdict for verdict in VERDICTS if verdict in {*rows["success_verdict"]}]
    for (x, y), here in rows.groupby(["x", "y"], sort=False):
        counts = {verdict: int((here["success_verdict"] == verdict).sum()) for verdict in found}
        yield {"x": x, "y": y, "n": len(here), **counts}


def headline(folder: Folder) -> Finding | None:
    """Answers whether deep RL earns its keep, for which budget and in which scenarios."""
    declared = Declared.from_manifest(folder.manifest)
    start = words.setting(folder)
    if "contrasts.csv" not in folder:
        return Finding(f"{start}, there is no verdict on any contrast.")
    table = folder.frame("contrasts")
    if not declared.baselines:
        n = link(str(len(table)), "contrasts", table)
        return Finding(f"{start}, of {n} contrast{'s' * (len(table) != 1)}, {counted(table)}.")
    places = words.scenario_labels(table)
    if not any(places):
        return _pooled(declared, table, folder, start)
    by_outcome: dict[Outcome, list[str]] = {}
    summary = _summary(folder)
    for place, rows in table[places != ""].groupby(places, sort=False):
        by_outcome.setdefault(outcome(declared, rows, summary), []).append(str(place))
    parts = []
    for key, text in _OUTCOMES.items():
        if names := by_outcome.get(key):
            count = link(str(len(names)), "contrasts", table[places.isin(names)])
            which = f" ({listed(names)})" if len(names) <= figures.FEW else ""
            parts.append(f"{text} {count}{which}")
        elif key == "earns":
            parts.append("deep RL is not shown to earn its keep in any")
    told = folder.names.told
    deep = listed(told(str(learner)) for learner in declared.decisive)
    beaten = listed(
        [*(f"than {told(str(baseline))}" for baseline in declared.baselines), "than the random policy"]
    )
    is_one = len(declared.baselines) == 1
    like = "this table, which has to beat" if is_one else "one of these tables that beats"
    rule = (
        f"Deep RL earns its keep in a scenario if one of {deep} succeeds more often there {beaten}, with the "
        f"same budget, a policy of the same class as {like} the random policy, too, and a score that is not "
        "shown to be worse."
    )
    if declared.reporting.adjust == "holm":
        rule += (
            " The probability that any claim of a difference in success is wrong is at most about 5 %, and "
            "so is that of any claim of equivalence."
        )
    return Finding(
        f"{start} and {words.sizes(folder)} runs per learner compared: {'; '.join(parts)}."
        f"{_sight(declared)}\n\n{rule}"
    )


def _summary(folder: Folder) -> pd.DataFrame | None:
    """Returns the table that has the budgets; None if the experiment omits it."""
    return folder.frame("summary") if "summary.csv" in folder else None


def _sight(declared: Declared) -> str:
    """Says if the tables to beat observe offsets and no net compared with them does; else empty."""
    sides = declared.baselines, declared.decisive
    if [{each.observation.startswith("offset") for each in side} for side in sides] != [{True}, {False}]:
        return ""
    subject = "table observes" if len(declared.baselines) == 1 else "tables observe"
    return f" The {subject} offsets; no net compared does."


def _pooled(declared: Declared, table: pd.DataFrame, folder: Folder, start: str) -> Finding:
    """Answers for the mean over scenarios, or for the only one."""
    rows, called = decisive_rows(declared, table), folder.names.told
    names = [called(str(baseline)) for baseline in declared.baselines]
    found, standing = outcome(declared, table, _summary(folder)), standings(declared, rows)
    margin, is_one = declared.reporting.margins.success, len(names) == 1
    won = [called(x) for x in winners(rows)["x"].unique()]
    more = f"{listed(won)} {'succeeds' if len(won) == 1 else 'succeed'} more often than {listed(names)}"
    n_deep = rows["x"].nunique()
    subject = "the deep learner" if n_deep == 1 else f"each of the {n_deep} deep learners compared"
    counts = "; ".join(
        f"against {called(str(baseline))}, {counted(rows[rows['y'] == str(baseline)])}"
        for baseline in declared.baselines
    )
    text = {
        "earns": f"deep RL earns its keep over a table: {more}",
        "another class": f"{more}, but no table with a policy of the same class, greedy or stochastic, is "
        "shown to succeed more often than the random policy, so it is not shown that the net makes the "
        "difference",
        "does not earn": f"deep RL does not earn its keep over a table: {subject} succeeds less often than "
        f"{'' if is_one else 'at least one of '}{listed(names)}, or equally often within {margin:g}",
        "no table learned": f"{more}, but no table to beat is shown to succeed more often than the random "
        "policy, so the comparison says nothing about what tables can learn",
        "neither learned": f"neither {' nor '.join(names)} nor a deep learner compared is shown to succeed "
        "more often than the random policy",
        "mixed": f"results are mixed: {counts}",
        "undecided": f"it is undecided whether deep RL earns its keep over a table: {counts}",
        "unequal budgets": "it is left open whether deep RL earns its keep over a table, as the budgets of "
        f"the learners compared differ: {counts}",
        "no verdict": "there is no verdict on whether deep RL earns its keep over a table: runs are missing, "
        f"or there are fewer than {declared.reporting.fewest_runs} per scenario and learner",
    }[found]
    aside = ""
    for (_, row), is_worse in zip(rows.iterrows(), is_worse_in_some(rows), strict=True):
        if row["success_verdict"] != standing.get(row["x"]):
            continue  # other contrasts decide
        x, y = called(row["x"]), called(row["y"])
        against = "" if is_one else f" against {y}"
        if row["success_verdict"] == BETTER and row["score_verdict"] in (WORSE, MIXED):
            aside += f" In score{against}, {x} is {row['score_verdict']}."
        if (apart := str(row.get("success_except", "nan"))) in ("", "nan"):
            continue
        where = listed(apart.split(", "))
        if is_worse:
            aside += f" In {where}, the mean success of {x} is lower than that of {y} by {margin:g} or more."
        elif row["success_verdict"] != MIXED:
            verdict = f"The verdict on {x}{against} ({words.in_words(row)})"
            aside += f" {verdict} is for the mean; it is not shown separately in {where}."
    aside += _sight(declared)
    if found == "no verdict" or "aggregate.csv" not in folder:
        return Finding(f"{start}, {text}.{aside}", found)
    learners = {words.name_of(row): row for _, row in folder.frame("aggregate").iterrows()}
    best = max(map(str, declared.baselines), key=lambda name: float(learners[name]["success"]))
    room = 1 - learners[best]["success"]
    ceiling = ""
    if room < margin and found not in ("earns", "another class", "no table learned"):
        how = "always succeeds" if room < 1e-6 else f"fails in {room:.3f} of episodes"
        ceiling = f"\n\nAs {called(best)} {how}, no learner could have been better by {margin:g}."
    return Finding(f"{start}, {text}.{aside}{ceiling}", found)


effects = item(
    "effects",
    "exploratory: differences between scenarios, conditions or learners, x minus y",
    {
        "effect": "",
        **CELL,
        "x": "",
        "y": "",
        "n": "runs",
        "success_difference": "difference in success",
        "score_difference": "difference in score",
        "wrong_pings_difference": "difference in wrong PINGs",
    },
    where=no_rows,
)(effects_of)


@effects.figure("What changes between two scenarios, by learner.")
def _(tables: Frames, runs: Runs) -> Figure | None:
    frame = tables.get("effects", pd.DataFrame())
    if "algorithm" not in frame:
        return None
    frame = frame[frame["algorithm"].notna()]
    if "condition" in frame:
        frame = frame.assign(effect=frame["effect"] + ", " + frame["condition"].fillna("all conditions"))
    own = runs.own
    learners = runs.declared.compared or figures.learners_in(frame, own)
    names = list(frame["effect"].unique())
    labels = {"success": "success", "wrong_pings": "wrong PINGs per 1,000 steps"}
    frame = frame.rename(columns=lambda name: str(name).replace("_difference", ""))
    step = 0.8 / len(learners)
    size = (11.0, (0.11 * len(learners) + 0.2) * len(names) + 1.4)
    with figure_of(1, len(labels), size) as (figure, axes):
        for axis, (key, label) in zip(axes[0], labels.items(), strict=True):
            axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
            for y, name in enumerate(names):
                for place, learner in enumerate(learners):
                    rows = frame[(frame["effect"] == name) & figures.is_of(frame, learner)]
                    at = y + step * (place - (len(learners) - 1) / 2)
                    figures.dot(axis, rows, key, at, figures.style_of(learner, own))
            pairs = frame.groupby("effect", sort=False)[["x", "y"]].first()
            rows = [f"{name}:\n{pairs['x'][name]} − {pairs['y'][name]}" for name in names]
            figures.rows(axis, rows, first=axis is axes[0, 0])
            axis.grid(visible=False, axis="y")
            for y in range(len(names) - 1):
                axis.axhline(y + 0.5, color="0.85", lw=0.6)
            reach = 1.05 * float(frame[[f"{key}_low", f"{key}_high"]].abs().to_numpy().max()) or 1.0
            axis.set(xlim=(-reach, reach), xlabel=f"difference in {label}")
        figures.legend(figure, learners, own, "bar: 95 % interval, not adjusted; exploratory", ls="")
    return figure


@effects.sentence
def _(table: pd.DataFrame, folder: Folder) -> Iterator[str]:
    """Tells the effects that are not one per learner; the figure shows the others."""
    for _, row in table.iterrows():
        if not isinstance(row.get("algorithm"), str):
            x, y = (folder.names.of_side(row[side]) for side in "xy")
            yield (
                f"Exploratory, {row['effect']}: the success of {x} minus that of {y} is "
                f"{words.difference(row, 'success', 'effects', 2)} (95 % interval, not adjusted)."
            )


@item(
    "summary",
    "each scenario and learner after training",
    {
        **CELL,
        "policy": "",
        "n": "runs",
        "success": "success probability",
        "greedy_success": "of the greedy policy",
        "score": "score, clipped",
        "unbounded_score": "score without bounds",
        "steps": "",
        "wrong_pings": "wrong PINGs",
        "training_wrong_pings": "wrong PINGs per 1,000 steps of training",
        "every_cell_success": "success from any cell",
    },
    where=lambda frame: frame if frame["scenario"].nunique() <= figures.FEW else no_rows(frame),
    best="success",
)
def summary(runs: Runs) -> Iterator[dict[str, Any]]:
    """`training_wrong_pings` are those per 1,000 steps of the whole training, with Student's interval."""
    for cell in runs:
        row = cell.row(policy=cell.policy, n=cell.n, budget=cell.steps[-1])
        row |= {name: proportion(cell.final(name)) for name in ENDPOINTS}
        row |= {name: cell.final(name).mean() for name in ("unbounded_score", "steps", "wrong_pings")}
        row["uncomfortable_steps"] = cell.final("zone_steps")[:, ZONES.index("uncomfortable")].mean()
        row["greedy_success"] = cell.population.arrays["success"][:, -1].mean()
        row["random_success"] = cell.random_success
        if "every_cell" in cell.population.specification["evaluated_from"]:
            row["every_cell_success"] = proportion(cell.final("success", "every_cell"))
        row["diverged"] = int((cell.population.arrays["diverged_at"] >= 0).sum())
        row["training_wrong_pings"] = cell.wrong_pings
        yield row | runs.effort(cell.learner)


@summary.figure("How often each learner succeeds after training.")
def _(tables: Frames, runs: Runs) -> Figure:
    is_few = words.by_place(tables["summary"])["scenario"].nunique() <= figures.FEW
    return (_dots if is_few else _heat)(tables, runs)


def _dots(tables: Frames, runs: Runs) -> Figure:
    """Draws a panel per scenario and condition, and of the means over scenarios if these are pooled."""
    frame = words.by_place(tables["summary"])
    scenarios, learners = list(frame["scenario"].unique()), figures.learners_in(frame, runs)
    panels = {scenario: frame[frame["scenario"] == scenario] for scenario in scenarios}
    if "aggregate" in tables and len(runs.scenarios) > 1:
        means = words.by_place(tables["aggregate"].assign(scenario="mean over scenarios"))
        panels |= {str(place): rows for place, rows in means.groupby("scenario", sort=False)}
    height = (0.34 if runs.references else 0.26) * len(learners) + 1.3
    with figure_of(1, len(panels), (11.0, height)) as (figure, axes):
        for axis, (title, panel) in zip(axes[0], panels.items(), strict=True):
            figures.dots(axis, panel, "success", learners, runs)
            figures.rows(axis, [runs.names(*each) for each in learners], first=axis is axes[0, 0])
            axis.set(title=title, xlim=(-0.03, 1.03), xticks=(0, 0.5, 1))
            for at in [learners.index(each) for each in runs.declared.baselines if each in learners]:
                axis.axhspan(at - 0.5, at + 0.5, color="0.93", lw=0, zorder=0)
        text = "success probability after training; bar: 95 % interval over runs"
        if runs.declared.baselines:
            text += "; grey: the tables to beat"
        figure.supxlabel(figures.with_references(text, runs), fontsize="small")
    return figure


def _heat(tables: Frames, runs: Runs) -> Figure:
    """Draws a row per scenario, sorted by outcome and success, and a column per learner, with verdicts."""
    frame, contrasts, declared = words.by_place(tables["summary"]), tables.get("contrasts"), runs.declared
    learners = figures.learners_in(frame, runs)
    groups: dict[str, list[str]] = {"": list(frame["scenario"].unique())}
    verdicts: dict[tuple[str, str], str] = {}
    if contrasts is not None and "scenario" in contrasts:
        found: dict[str, str] = {}
        for place, rows in contrasts.groupby(words.scenario_labels(contrasts), sort=False):
            verdicts |= {(str(place), str(x)): each for x, each in standings(declared, rows).items()}
            found[str(place)] = outcome(declared, rows, tables["summary"]) if declared.baselines else ""
        titles = {each: title for each, title in _GROUPS.items() if each in found.values()}
        groups = {titles[each]: [name for name in groups[""] if found.get(name) == each] for each in titles}
    values = frame.set_index(["scenario", "algorithm", "observation"])["success"]
    own = [each for each in learners if each in declared.decisive] or learners
    scenarios: list[str] = []
    for names in groups.values():
        scenarios += sorted(names, key=lambda name: -sum(values[name, *each] for each in own))
    table = np.array([[values[scenario, *learner] for learner in learners] for scenario in scenarios])
    size = (min(0.62 * len(learners) + 2.4, 11.0), 0.27 * len(scenarios) + 3.0)
    with figure_of(1, 1, size) as (figure, axes):
        axis = axes[0, 0]
        edges = np.arange(len(learners) + 1) - 0.5, np.arange(len(scenarios) + 1) - 0.5
        axis.pcolormesh(*edges, table, cmap=COLOUR_MAP, vmin=0, vmax=1, edgecolors="white", linewidth=0.8)
        for (row, column), value in np.ndenumerate(table):
            sign = figures.SIGNS.get(verdicts.get((scenarios[row], str(learners[column])), ""), "")
            text = f"{value:.2f} {sign}".strip()
            figures.text_on(axis, column, row, text, is_dark=value < 0.55)
        axis.set(ylim=(len(scenarios) - 0.5, -0.5))
        budgets = frame.groupby(["algorithm", "observation"], sort=False)["budget"].first()
        usual = budgets.mode()[0]
        names = [
            runs.names(*each) + ("" if budgets[each] == usual else f" ({budgets[each]:,})")
            for each in learners
        ]
        axis.set_xticks(range(len(learners)), names, rotation=40, ha="left", rotation_mode="anchor")
        axis.set_yticks(range(len(scenarios)), scenarios)
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        at = 0
        for title, names in groups.items():
            if title:
                axis.text(1.01, at - 0.3, fill(title, 22), va="top", transform=axis.get_yaxis_transform())
                axis.axhline(at - 0.5, color="black", lw=1.2) if at else None
            at += len(names)
        lines = [f"success probability after {usual:,} steps of training, mean over runs"]
        if verdicts:
            than = {} if len(declared.baselines) == 1 else figures.THAN
            signs = ", ".join(f"{sign} {each}{than.get(each, '')}" for each, sign in figures.SIGNS.items())
            against = listed([runs.names(*each) for each in declared.baselines])
            lines += [f"against {against}:", f"{signs}; no sign: undecided or not compared"]
        figure.supxlabel("\n".join(lines), fontsize="small")
    return figure


@item(
    "aggregate",
    "every learner over all scenarios, after training",
    {
        **CELL,
        "policy": "",
        "runs": "",
        "success": "success probability",
        "score": "score, clipped",
        **EFFORT,
        "every_cell_success": "success from any cell",
        "unbounded_score": "score without bounds",
        "iqm": "its interquartile mean",
    },
    best="success",
)
def aggregate(runs: Runs) -> Iterator[dict[str, Any]]:
    """`iqm` is rliable's interquartile mean of the scores without bounds; only if scenarios are pooled."""
    from rliable import metrics

    if runs.declared.reporting.pool != "scenarios":
        return
    for names, cells in runs.over_scenarios:
        row: dict[str, Any] = {**names, "policy": cells[0].policy, "runs": sum(cell.n for cell in cells)}
        row |= runs.effort(cells[0].learner)
        for start in cells[0].population.specification["evaluated_from"]:
            for name in ENDPOINTS:
                side = means_of(cells, name, start)
                row[evaluated(name, "greedy", start)] = Estimate(side.mean, *side.interval)
        final = [cell.final("unbounded_score") for cell in cells]
        row["unbounded_score"] = np.mean([values.mean() for values in final])
        row["iqm"] = metrics.aggregate_iqm(np.concatenate(final)[:, None])
        yield row


@writing("scores", "every run at the end of training, compressed", SCORES)
def scores(runs: Runs, directory: Path) -> None:
    """`every_cell_` marks episodes that start in any cell; `diverged_at` is infinite if a run did not."""
    frames = []
    for cell in runs:
        columns: dict[str, Any] = {**cell.names, "policy": cell.policy, "seed": cell.population.seeds}
        for start in cell.population.specification["evaluated_from"]:
            for name in ("success", "score", "unbounded_score", "steps", "wrong_pings"):
                columns[evaluated(name, "greedy", start)] = cell.final(name, start)
            uncomfortable = cell.final("zone_steps", start)[:, ZONES.index("uncomfortable")]
            columns[evaluated("uncomfortable_steps", "greedy", start)] = uncomfortable
        columns["greedy_success"] = cell.population.arrays["success"][:, -1]
        columns["target_cells_marked"], columns["cells_marked"] = _right_and_marked(cell)
        columns["region_overlap"] = cell.population.region_overlap
        columns["training_wrong_pings"] = cell.population.arrays["disagreements"][:, -1]
        diverged_at = cell.population.arrays["diverged_at"]
        columns["diverged_at"] = np.where(diverged_at < 0, np.inf, diverged_at)
        frames.append(pd.DataFrame(columns))
    write_csv(pd.concat(frames, ignore_index=True), directory / SCORES)


@item(
    "region",
    "cells where an agent values PING, compared with the target region",
    {**CELL, "cells_marked": "cells marked", "precision": "", "recall": "", "overlap": ""},
    best="overlap",
)
def region(runs: Runs) -> Iterator[dict[str, Any]]:
    """Means over agents; precision is of those that mark a cell, overlap is intersection over union."""
    for cell in runs:
        right, marked = _right_and_marked(cell)
        marking = marked > 0
        yield cell.row(
            n=len(right),
            cells_marked=marked.mean(),
            n_marking=int(marking.sum()),
            precision=proportion(right[marking] / marked[marking]),
            recall=proportion(right / cell.population.in_target.sum()),
            overlap=proportion(cell.population.region_overlap),
        )


@item(
    "scenarios",
    "what each scenario is, and what is possible in it",
    {
        **dict.fromkeys(["scenario", "description", "observed", "hidden"], ""),
        **dict.fromkeys(["cells", "states", "observations"], ""),
        "random_return": "random return",
        "random_success": "random success",
        "optimal_return": "optimal return",
        "memoryless_return": "best return of a memoryless policy found",
        "memoryless_success": "success of that policy",
    },
)
def scenarios(runs: Runs) -> Iterator[dict[str, Any]]:
    """Returns are sums of the grid's rewards over an episode.

    `optimal_return` is that of an agent that knows the state. `memoryless_return` is the best return of a
    policy over observations that the algorithm `memoryless` has found in `restarts` runs, `memoryless_score`
    that return as a score, and `memoryless_success` how often that policy succeeds: others succeed more often
    with a lower return.
    """
    first = {cell.scenario: cell for cell in [*runs.cells][::-1]}
    if len(first) <= 1 or runs.declared.reporting.pool == "scenarios":
        return
    for scenario in runs.scenarios:
        population = first[scenario].population
        model = population.model
        random, optimal = population.anchors["grid_return"]
        row: dict[str, Any] = {
            "scenario": scenario,
            "description": model.scenario.description,
            "cells": len(model.position),
            "states": len(model.observation),
            "observations": model.n_observations,
            "observed": in_words(model.scenario.observe),
            "hidden": in_words(model.scenario.hidden) or "nothing",
            "random_return": random,
            "random_success": first[scenario].random_success,
            "optimal_return": optimal,
        }
        found = [c for c in runs.planners if c.scenario == scenario and c.population.algorithm is SEARCH]
        if found:
            names = ("grid_return", "success", "unbounded_score")
            reached = np.concatenate([[cell.final(name) for name in names] for cell in found], axis=1)
            best = reached[:, reached[0].argmax()]
            row["restarts"] = reached.shape[1]
            row |= zip(("memoryless_return", "memoryless_success", "memoryless_score"), best, strict=True)
        yield row


@scenarios.figure("The scenarios.")
def _(tables: Frames, runs: Runs) -> Figure | None:
    models = {cell.scenario: cell.population.model for cell in runs}
    return gallery([*models.values()]) if "scenarios" in tables else None


@scenarios.sentence
def _(table: pd.DataFrame, __: Folder) -> str | None:
    """Says what is possible where something is hidden."""
    if "memoryless_score" not in table:
        return None
    short = table[table["memoryless_score"] < 1 - _NEARLY]
    found = link(str(len(table) - len(short)), "scenarios", table.drop(short.index))
    where = f"; not in {listed(short['scenario'])}" if len(short) else ""
    return (
        f"In {found} of {len(table)} scenarios, a policy over observations alone was found whose score comes "
        f"within {_NEARLY:g} of 1, the optimum of an agent that knows the state{where}. Better policies may "
        "exist, and others succeed more often with a lower return."
    )


def _right_and_marked(cell: Cell) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Returns how many cells of the target region each agent marks, and how many of all, (N,) each."""
    marked = cell.population.values_ping
    return (marked & cell.population.in_target).sum(axis=1), marked.sum(axis=1)
