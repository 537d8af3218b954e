"""What the figures of a comparison share.

Colour and marker show a learner's algorithm, and tint and dash its observation, see `drawing.style`, so that
figures can be read in grey, too.
"""

import math
from collections.abc import Iterable, Sequence
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, MIXED, NEITHER, NO_VERDICT, UNDECIDED, WORSE
from benchmark.drawing.style import WIDTH, figure_of, learner_style, name_lines
from benchmark.experiments import Experiment
from benchmark.studies.comparison.columns import WORDS

Style = dict[str, Any]  # arguments of matplotlib
_STYLES: Final[dict[str, Style]] = {
    BETTER: {"marker": "^", "color": "black"},
    WORSE: {"marker": "v", "color": "black"},
    EQUIVALENT: {"marker": "o", "color": "black"},
    NEITHER: {"marker": "s", "color": "0.55", "mfc": "white"},
    MIXED: {"marker": "X", "color": "black"},
    UNDECIDED: {"marker": "o", "color": "0.55", "mfc": "white"},
    NO_VERDICT: {"marker": "x", "color": "0.55"},
}
_N_MARKERS: Final = 6  # of a curve
_COLUMNS: Final = 3  # of panels
FEW: Final = 4  # scenarios whose learners are listed, and drawn over training


def labelled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table with "SCENARIO under CONDITION" for its scenarios, and a column of learners."""
    table = table.copy()
    names = [table[key].fillna("") for key in ("scenario", "condition") if key in table]
    table["scenario"] = [" under ".join(filter(None, parts)) for parts in zip(*names, strict=True)] or ""
    if "variant" in table:
        table["learner"] = table["variant"] + ", " + table["observation"]
    return table


def style_of(learner: str, experiment: Experiment, observation: str | None = None) -> Style:
    """Returns a learner's colour, marker and dash, perhaps as if it had another observation.

    A reference implementation has the colour and marker of its learner, hollow and on a dotted line.
    """
    declared = {other.variant: other.declared for other in experiment.learners.values()}
    colours = {name: variant.colour for name, variant in declared.items() if not variant.reference_for}
    drawn = experiment.learners[learner]
    seen = drawn.observation if observation is None else observation
    of = drawn.declared.reference_for
    style = learner_style(of or drawn.variant, seen, colours, drawn.family)
    return style | {"mfc": "white", "ls": (0, (1, 1))} if of else style


def differences(frame: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Draws contrasts in success: a named row each, with the margin and its verdict."""
    with figure_of(1, 1, (WIDTH, 0.38 * len(frame) + 1.2)) as (figure, axes):
        axis, margin = axes[0, 0], float(frame["success_margin"].iloc[0])
        axis.axvspan(-margin, margin, color="0.92", lw=0)
        axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
        for y, (_, row) in enumerate(frame.iterrows()):
            verdict, difference = row["success_verdict"], "success_difference"
            style, word = _STYLES[verdict], fill(WORDS[verdict], 17)
            for end, width in (("", 1.2), ("_90", 3.6)):
                ends = [row[f"{difference}_low{end}"], row[f"{difference}_high{end}"]]
                axis.plot(ends, [y, y], color=style["color"], lw=width, solid_capstyle="butt")
            axis.plot(row[difference], y, ms=7, **style)
            axis.text(1.02, y, word, va="center", transform=axis.get_yaxis_transform())
        axis.set_yticks(np.arange(len(names)), names)
        axis.set(ylim=(len(names) - 0.5, -0.5))
        axis.grid(axis="y", lw=0.4, color="0.85")
        axis.tick_params(axis="y", length=0)
        axis.locator_params(axis="x", nbins=5)
        text = "difference in success; right of the dotted line, the first is better"
        figure.supxlabel(text, fontsize="small")
    return figure


def curve_panels(curves: pd.DataFrame, learners: Iterable[str], experiment: Experiment) -> Figure:
    """Draws success over training from `labelled` curves, a panel per scenario.

    Learners are named at the ends of their lines, in the last panel of each row.
    """
    frame = curves[(curves["step"] > 0) & curves["learner"].isin([*learners])]
    panels = [*frame.groupby("scenario", sort=False)]
    n_columns = min(len(panels), _COLUMNS)
    n_rows = math.ceil(len(panels) / n_columns)
    with figure_of(n_rows, n_columns, (WIDTH, 2.3 * n_rows + 0.5)) as (figure, axes):
        for i, (axis, (scenario, rows)) in enumerate(zip(axes.flat, panels, strict=False)):
            lines = dict[str, tuple[float, Style]]()
            for learner, curve in rows.groupby("learner", sort=False):
                style, every = style_of(str(learner), experiment), max(len(curve) // _N_MARKERS, 1)
                look = style | {"lw": 1.3, "ms": 4, "mec": style["color"], "mew": 1, "markevery": every}
                sns.lineplot(curve, x="step", y="success", estimator=None, ax=axis, **look)
                ends = curve["success_low"], curve["success_high"]  # exact, which seaborn's are not
                axis.fill_between(curve["step"], *ends, color=style["color"], alpha=0.12, lw=0)
                lines[experiment.learners[str(learner)].title] = curve["success"].iloc[-1], style
            axis.set(title=str(scenario).replace(" under ", "\n").replace("/", "\n"))
            axis.set(xlim=(float(rows["step"].min()), float(rows["step"].max())))
            axis.xaxis.set_major_locator(MaxNLocator(3))
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
            axis.tick_params(labelleft=i % n_columns == 0, labelbottom=i + n_columns >= len(panels))
            axis.set(xlabel="", ylabel="" if i % n_columns else "success", ylim=(-0.0309, 1.03))
            if (i + 1) % n_columns == 0 or i + 1 == len(panels):
                name_lines(axis, lines)
        for axis in axes.flat[len(panels) :]:
            axis.set_axis_off()
        figure.supxlabel("environment step", fontsize="medium")
    return figure
