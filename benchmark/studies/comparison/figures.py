"""The figures of a comparison."""

import math
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from benchmark.drawing.style import WIDTH, figure_of, name_lines, name_rows
from benchmark.folder import with_titles
from benchmark.studies.comparison import tables
from benchmark.studies.comparison.analysis import ENDPOINTS, ComparisonAnalysis
from benchmark.studies.comparison.tables import AGGREGATES, WORDS
from benchmark.studies.data import Style, style_of
from benchmark.studies.item import COLUMNS
from envs.people import FEEDBACK

_STYLES: Final[dict[str, Style]] = {
    "better": {"marker": "^", "color": "black"},
    "worse": {"marker": "v", "color": "black"},
    "equivalent": {"marker": "o", "color": "black"},
    "neither learned": {"marker": "s", "color": "0.55", "mfc": "white"},
    "mixed": {"marker": "X", "color": "black"},
    "undecided": {"marker": "o", "color": "0.55", "mfc": "white"},
    "no verdict": {"marker": "x", "color": "0.55"},
}
_COLUMNS: Final = 3  # of panels
_N_MARKERS: Final = 6  # of a curve
_FEW_RUNS: Final = 20  # fewer are drawn one by one: their exact intervals would hide them


@tables.contrasts.figure(
    "Contrasts: differences in success with 90 % (thick) and 95 % intervals, the margin (grey), and verdicts."
)
def draw_contrasts(analysis: ComparisonAnalysis, table: pd.DataFrame) -> Figure:
    """Draws contrasts in success, a row each."""
    titles = {name: learner.title for name, learner in analysis.experiment.learners.items()}
    rows, names = [row for _, row in with_titles(table, titles).iterrows()], []
    for row in rows:
        name = [f"{row['x']}\nagainst {row['y']}", row["scenario"]]
        name += ["declared later"] if row.get("declared") == "later" else []
        names.append(", ".join(filter(None, name)))
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


@tables.curves.figure(
    "Mean success during training; shades: 95 % intervals; thin lines: single runs, where there are fewer "
    f"than {_FEW_RUNS}."
)
def draw_curves(analysis: ComparisonAnalysis, table: pd.DataFrame) -> Figure:
    """Draws success over training, a panel for each scenario.

    Learners are named at the ends of their lines, in the last panel of each row.
    """
    frame, runs, learners = with_titles(table, {}), analysis.curves, analysis.experiment.learners
    frame = frame[(frame["step"] > 0) & frame["learner"].isin(analysis.over_training)]
    panels = [*frame.groupby("scenario", sort=False)]
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
            kind = analysis.experiment.scenarios[str(scenario)].issuer.feedback.kind
            axis.set_title(f"{scenario}: {FEEDBACK.get(kind, 'own feedback')}", fontsize="small")
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
def draw_rliable(analysis: ComparisonAnalysis, table: pd.DataFrame) -> Figure:
    """Draws a row of panels for each endpoint."""
    frame = with_titles(table, {})
    frame = frame[frame["learner"].isin(analysis.drawn)]
    labels, learners = COLUMNS["comparison_labels"], analysis.experiment.learners
    measures = [name for name in (*AGGREGATES, "p_improvement") if name in frame]
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
                if key in AGGREGATES and not np.isnan(level):
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
