"""The figures of a comparison."""

import math
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from agents.policy import mask_policy
from benchmark.drawing.maps import draw_policy, gallery, policy_legend
from benchmark.drawing.style import WIDTH, colour_map, figure_of, ink_on, name_lines, name_rows
from benchmark.drawing.tables import show
from benchmark.folder import with_titles
from benchmark.studies.comparison import tables
from benchmark.studies.comparison.analysis import ENDPOINTS, ComparisonAnalysis
from benchmark.studies.comparison.tables import FEW, OUTCOMES, WORDS, estimated, labelled, models_of
from benchmark.studies.data import Style, style_of
from benchmark.studies.item import COLUMNS, drawing
from envs.people import FEEDBACK
from envs.scene import COLOUR_MAP

_STYLES: Final[dict[str, Style]] = {
    "better": {"marker": "^", "color": "black"},
    "worse": {"marker": "v", "color": "black"},
    "equivalent": {"marker": "o", "color": "black"},
    "neither learned": {"marker": "s", "color": "0.55", "mfc": "white"},
    "mixed": {"marker": "X", "color": "black"},
    "undecided": {"marker": "o", "color": "0.55", "mfc": "white"},
    "no verdict": {"marker": "x", "color": "0.55"},
}
_COLUMNS: Final = 3  # of panels and maps
_N_MARKERS: Final = 6  # of a curve
_FEW_RUNS: Final = 20  # fewer are drawn one by one: their exact intervals would hide them
_MAX_CONTRASTS: Final = 36
_CHARACTERS, _MAX_COLUMNS = 66, 8  # of the names of a figure's columns in a line; columns with level names
_THRESHOLDS: Final = np.linspace(0.0, 1.0, 51)


@tables.contrasts.figure(
    "Contrasts: differences in success with 90 % (thick) and 95 % intervals, the margin (grey), and verdicts."
)
def draw_contrasts(analysis: ComparisonAnalysis, table: pd.DataFrame) -> Figure | None:
    """Draws contrasts in success, a row each, unless there are too many."""
    if len(table) > _MAX_CONTRASTS:
        return None
    titles = {name: learner.title for name, learner in analysis.experiment.learners.items()}
    rows = [row for _, row in with_titles(labelled(table), titles).iterrows()]
    parts = [
        (
            f"{row['x']}\nagainst {row['y']}",
            row["scenario"],
            "declared later" * (row.get("declared") == "later"),
        )
        for row in rows
    ]
    names = [", ".join(filter(None, each)) for each in parts]
    with figure_of(1, 1, (WIDTH, 0.38 * len(rows) + 1.2)) as (figure, axes):
        axis, margin = axes[0, 0], float(table["success_margin"].iloc[0])
        axis.axvspan(-margin, margin, color="0.92", lw=0)
        axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
        for y, row in enumerate(rows):
            verdict, difference = row["success_verdict"], "success_difference"
            style = _STYLES[verdict]
            for end, width in (("", 1.2), ("_90", 3.6)):
                ends = [row[f"{difference}_low{end}"], row[f"{difference}_high{end}"]]
                axis.plot(ends, [y, y], color=style["color"], lw=width, solid_capstyle="butt")
            axis.plot(row[difference], y, ms=7, **style)
            axis.text(1.02, y, fill(WORDS[verdict], 17), va="center", transform=axis.get_yaxis_transform())
        name_rows(axis, names)
        axis.locator_params(axis="x", nbins=5)
        figure.supxlabel(
            "difference in success; right of the dotted line, the first is better", fontsize="small"
        )
    return figure


@tables.summary.figure("How often each learner succeeds after training.")
def draw_summary(analysis: ComparisonAnalysis, table: pd.DataFrame) -> Figure | None:
    """Draws success by scenario and learner, with means over scenarios if these are pooled."""
    frame, every = labelled(table), analysis.experiment.learners
    learners = [
        name for name in frame["learner"].unique() if name in {*analysis.plan.drawn, *analysis.plan.curves}
    ]
    values = frame.pivot(index="scenario", columns="learner", values="success")[learners]
    scenarios = [*frame["scenario"].unique()]
    if len(scenarios) > FEW:  # the highest first
        scenarios.sort(key=lambda name: -values.loc[name].sum())
    scenarios, groups = _grouped(analysis, scenarios)
    values = values.loc[scenarios]
    if len(scenarios) > 1 and analysis.aggregate and "condition" not in analysis.names:
        means = {
            f"{row['variant']}, {row['observation']}": row["success"].value for row in analysis.aggregate
        }
        values.loc["mean"] = pd.Series(means)
    is_crowded = len(learners) > _MAX_COLUMNS  # then their names are turned
    characters = 24 if is_crowded else max(_CHARACTERS // len(learners), 11)
    titles = [fill(every[name].title, characters, break_on_hyphens=False) for name in learners]
    cells = {"vmin": 0.0, "vmax": 1.0, "cmap": colour_map(COLOUR_MAP), "cbar": False, "linewidths": 2}
    texts = {"annot": values.map(lambda value: show(value, 2)), "fmt": "", "annot_kws": {"size": "small"}}
    with figure_of(1, 1, (WIDTH, 0.32 * len(values) + 1.3 + is_crowded)) as (figure, axes):
        axis = sns.heatmap(values, ax=axes[0, 0], xticklabels=False, yticklabels=False, **cells, **texts)
        axis.set_xticks(np.arange(len(titles)) + 0.5, titles)
        axis.set_yticks(np.arange(len(values)) + 0.5, [*values.index])
        shown = values.to_numpy().ravel()
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


def _grouped(analysis: ComparisonAnalysis, scenarios: list[str]) -> tuple[list[str], dict[int, str]]:
    """Returns scenarios, sorted by outcome if each has its own, and the titles of their groups.

    The key of each title is the index of the group's first scenario.
    """
    if analysis.is_pooled or not analysis.outcomes:
        return scenarios, {0: ""}
    rows = labelled(pd.DataFrame(analysis.outcomes))
    outcome_of = dict(zip(rows["scenario"], rows["outcome"], strict=True))
    ranked = sorted(scenarios, key=lambda name: [*OUTCOMES].index(outcome_of[name]))
    first = {outcome_of[name]: at for at, name in reversed([*enumerate(ranked)])}
    return ranked, {at: OUTCOMES[outcome] for outcome, at in reversed(first.items())}


@tables.curves.figure(
    "Mean success during training; shades: 95 % intervals; thin lines: single runs, where there are fewer "
    f"than {_FEW_RUNS}."
)
def draw_curves(analysis: ComparisonAnalysis, table: pd.DataFrame) -> Figure | None:
    """Draws success over training, a panel for each of few scenarios.

    Learners are named at the ends of their lines, in the last panel of each row.
    """
    frame, learners = labelled(table), analysis.experiment.learners
    if frame["scenario"].nunique() > FEW:
        return None
    frame = frame[(frame["step"] > 0) & frame["learner"].isin(analysis.plan.curves)]
    runs = labelled(analysis.curves[[*analysis.names, "seed", "step", "success"]])
    panels = [*frame.groupby("scenario", sort=False)]
    feedback = {
        name: f": {FEEDBACK.get(each.issuer.feedback.kind, 'own feedback')}"
        for name, each in analysis.experiment.scenarios.items()
    }
    n_columns = min(len(panels), _COLUMNS)
    n_rows = math.ceil(len(panels) / n_columns)
    with figure_of(n_rows, n_columns, (WIDTH, 2.3 * n_rows + 0.5)) as (figure, axes):
        for i, (axis, (scenario, rows)) in enumerate(zip(axes.flat, panels, strict=False)):
            lines = dict[str, tuple[float, Style]]()
            for learner, curve in rows.groupby("learner", sort=False):
                style, every = style_of(str(learner), analysis.experiment), max(len(curve) // _N_MARKERS, 1)
                look = style | {"lw": 1.3, "ms": 4, "mec": style["color"], "mew": 1, "markevery": every}
                sns.lineplot(curve, x="step", y="success", estimator=None, ax=axis, **look)
                own = runs[(runs["scenario"] == scenario) & (runs["learner"] == learner)]
                if own["seed"].nunique() < _FEW_RUNS:
                    each = own.pivot(index="step", columns="seed", values="success")
                    axis.plot(each, color=style["color"], alpha=0.12, lw=0.7)
                else:
                    ends = curve["success_low"], curve["success_high"]  # exact, which seaborn's are not
                    axis.fill_between(curve["step"], *ends, color=style["color"], alpha=0.12, lw=0)
                lines[learners[str(learner)].title] = curve["success"].iloc[-1], style
            title = str(scenario).replace(" under ", "\n").replace("/", "\n")
            axis.set_title(title + feedback[str(scenario).partition(" under ")[0]], fontsize="small")
            axis.set(xlim=(float(rows["step"].min()), float(rows["step"].max())))
            axis.xaxis.set_major_locator(MaxNLocator(3))
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
            axis.tick_params(labelleft=i % n_columns == 0, labelbottom=i + n_columns >= len(panels))
            axis.set(xlabel="", ylabel="" if i % n_columns else "success", ylim=(-0.0309, 1.03))
            if (i + 1) % n_columns == 0 or i + 1 == len(panels):
                name_lines(axis, lines)
        figure.supxlabel("environment step", fontsize="medium")
    return figure


@tables.rliable.figure(
    "Aggregates of success and of the clipped score and, if there is a baseline, the probability that a run "
    "does better than one of the first baseline; bars: 95 % intervals of a bootstrap within scenarios. "
    "Dotted: the score of giving up at once."
)
def draw_rliable(analysis: ComparisonAnalysis, table: pd.DataFrame) -> Figure | None:
    """Draws a row of panels for each endpoint, unless there are several conditions."""
    frame = labelled(table)
    frame = frame[frame["learner"].isin(analysis.plan.drawn)]
    if "condition" in frame or frame.empty:
        return None
    labels, learners = COLUMNS["comparison_labels"], analysis.experiment.learners
    measures = [name for name in (*tables.AGGREGATES, "p_improvement") if name in frame]
    names = [*frame[frame["endpoint"] == ENDPOINTS[0]].sort_values("mean", kind="stable")["learner"]]
    titles = [fill(learners[name].title, 30, break_on_hyphens=False) for name in names]
    line = max(0.3, 0.17 * max(title.count("\n") + 1 for title in titles))
    with figure_of(2, len(measures), (WIDTH, 2 * line * len(names) + 2.0)) as (figure, axes):
        for endpoint, panels in zip(ENDPOINTS, axes, strict=True):
            rows = frame[frame["endpoint"] == endpoint].set_index("learner").loc[names]
            for axis, key in zip(panels, measures, strict=True):
                for y, (name, row) in enumerate(rows.iterrows()):
                    style = style_of(str(name), analysis.experiment)
                    axis.plot([row[f"{key}_low"], row[f"{key}_high"]], [y, y], lw=3, color=style["color"])
                    axis.plot(row[key], y, ms=5, **{**style, "ls": ""})
                level = rows["giving_up"].iloc[0]
                if key in tables.AGGREGATES and not np.isnan(level):
                    at = 1 - level if key == "optimality_gap" else level
                    axis.axvline(at, color="0.35", lw=0.8, ls=":")
                axis.set(title="\n".join(labels.get(key, key).rsplit(" ", 1)), ylim=(-0.6, len(rows) - 0.4))
                axis.set_yticks(range(len(rows)), [])
                axis.xaxis.set_major_locator(MaxNLocator(2))
                axis.margins(x=0.15)
                axis.grid(lw=0.4, color="0.85")
            panels[0].set_yticklabels(titles)
            panels[0].set_ylabel(endpoint, fontweight="bold")
    return figure


@drawing(
    "profiles",
    "performance profiles: the share of runs with a higher clipped score",
    "Performance profiles: the share of runs whose clipped score is above a threshold; shade: 95 % interval. "
    "Dotted: the score of giving up at once.",
)
def profiles(analysis: ComparisonAnalysis, _: pd.DataFrame) -> Figure | None:
    """Draws the profiles of the learners that the outcome is about, unless there are several conditions."""
    drawn = [(name, own) for _, name, own in analysis.matrices("score") if name in analysis.plan.drawn]
    if not drawn or "condition" in analysis.names:
        return None
    with figure_of(1, 1, (WIDTH, 3.6)) as (figure, axes):
        axis = axes[0, 0]
        for name, scores in drawn:
            style = style_of(name, analysis.experiment)
            shares, ends = estimated(scores, lambda own: (own[..., None] > _THRESHOLDS).mean(axis=(0, 1)))
            title = fill(analysis.experiment.learners[name].title, 30, break_on_hyphens=False)
            axis.plot(_THRESHOLDS, shares, lw=1.3, ms=4, markevery=10, label=title, **style)
            axis.fill_between(_THRESHOLDS, *ends, color=style["color"], alpha=0.12, lw=0)
        axis.axvline(tables.giving_up(analysis), color="0.35", lw=0.8, ls=":")
        axis.set(xlim=(0, 1), ylim=(-0.03, 1.03), xlabel="clipped score τ", ylabel="share of runs above τ")
        figure.legend(loc="outside lower center", ncols=3, fontsize="small")
    return figure


@tables.scenarios.figure("The scenarios.")
def draw_scenarios(analysis: ComparisonAnalysis, _: pd.DataFrame) -> Figure:
    """Draws each scenario."""
    return gallery([*models_of(analysis).values()])


@drawing(
    "policies",
    "what the first run of each learner does after training",
    "What the first run of each learner does after training in the first scenario, before any PING.",
)
def policies(analysis: ComparisonAnalysis, _: pd.DataFrame) -> Figure | None:
    """Draws the policies of compared learners that have runs in the first scenario."""
    runs, experiment = analysis.data.runs, analysis.experiment
    scenario, condition = (str(runs[key].iloc[0]) for key in ("scenario", "condition"))
    own = runs[(runs["scenario"] == scenario) & (runs["condition"] == condition)].groupby("learner")
    names = [name for name in analysis.plan.drawn if name in own.groups]
    n_columns = min(len(names), _COLUMNS)
    n_rows, norm = -(-len(names) // n_columns), Normalize(0.0, 1.0)
    with figure_of(n_rows, n_columns, (WIDTH, 2.6 * n_rows + 1.0)) as (figure, axes):
        figure.set_layout_engine("compressed")
        for axis, name in zip(axes.flat, names, strict=False):
            first, learner = own.get_group(name).iloc[0], experiment.learners[name]
            found = analysis.data.records(experiment.population(condition, scenario, name)).subset(0, 1)
            policy = found.arrays[learner.declared.policy][0, -1]
            if learner.declared.policy == "greedy":
                policy = mask_policy(policy)
            draw_policy(axis, found.model, policy, norm)
            title = fill(learner.title, 30, break_on_hyphens=False)
            axis.set_title(f"{title}\nsuccess {first['success']:.2f}", fontsize="small")
        policy_legend(figure, [*axes.flat], found.model, norm)
    return figure
