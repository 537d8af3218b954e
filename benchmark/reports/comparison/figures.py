"""What the figures of a comparison share.

Colour and marker show a learner's algorithm, and tint and dash its observation, see `drawing.style`, so that
figures can be read in grey, too. A reference implementation is drawn hollow, in the colour of its learner.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, MaxNLocator

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, MIXED, NO_VERDICT, UNDECIDED, WORSE
from benchmark.drawing.style import figure_of, learner_style
from benchmark.experiments import Experiment
from benchmark.reports.item import Frames

Style = dict[str, Any]  # arguments of matplotlib
_STYLES: Final[dict[str, Style]] = {
    BETTER: {"marker": "^", "color": "black"},
    WORSE: {"marker": "v", "color": "black"},
    EQUIVALENT: {"marker": "o", "color": "black"},
    MIXED: {"marker": "X", "color": "black"},
    UNDECIDED: {"marker": "o", "color": "0.55", "mfc": "white"},
    NO_VERDICT: {"marker": "x", "color": "0.55"},
}
_ENDPOINTS: Final = {"success": "success probability", "score": "score, clipped to [0, 1]"}
_N_MARKERS: Final = 6  # of a curve
_N_POINTS: Final = 4  # of a reference
_COLUMNS: Final = 6  # of panels, if there are many scenarios
_CHARACTERS: Final = 140  # that a line of a legend has room for
FEW: Final = 4  # scenarios that have a column each

Drawn = Mapping[str, Sequence[str]]  # learners, with the reference implementations that are drawn with them


def labelled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table with "SCENARIO under CONDITION" for its scenarios, and a column of learners."""
    table = table.copy()
    names = [table[key].fillna("") for key in ("scenario", "condition") if key in table]
    table["scenario"] = [" under ".join(filter(None, parts)) for parts in zip(*names, strict=True)] or ""
    if "algorithm" in table:
        table["learner"] = table["algorithm"] + ", " + table["observation"]
    return table


def in_lines(title: str) -> str:
    """Returns the title of a panel with the parts of a condition in lines of their own."""
    return title.replace(" under ", "\n").replace("/", "\n") if " under " in title else title


def drawn_in(frame: pd.DataFrame, experiment: Experiment) -> Drawn:
    """Returns the learners in a frame, in its order, with their references that are in it, too."""
    names = list(frame["learner"].unique())
    of = {name: experiment.learners[name].reference_for for name in names}
    return {name: [other for other in names if of[other] == name] for name in names if not of[name]}


def rows_of(frame: pd.DataFrame, drawn: Drawn) -> pd.DataFrame:
    """Returns the rows of learners and of their references."""
    return frame[frame["learner"].isin([*drawn, *chain(*drawn.values())])]


def style_of(learner: str, experiment: Experiment, observation: str | None = None) -> Style:
    """Returns a learner's colour, marker and dash, perhaps as if it had another observation."""
    variants = [other.variant for other in experiment.learners.values() if not other.reference_for]
    drawn = experiment.learners[learner]
    seen = drawn.observation if observation is None else observation
    return learner_style(drawn.variant, seen, list(dict.fromkeys(variants)), drawn.family)


def differences(frame: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Draws contrasts: a named row each and a column per endpoint, with margins and verdicts."""
    with figure_of(1, len(_ENDPOINTS), (11.0, 0.36 * len(frame) + 1.7)) as (figure, axes):
        for axis, (key, label) in zip(axes[0], _ENDPOINTS.items(), strict=True):
            margin = float(frame[f"{key}_margin"].iloc[0])
            axis.axvspan(-margin, margin, color="0.92", lw=0)
            axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
            for y, (_, row) in enumerate(frame.iterrows()):
                verdict = row[f"{key}_verdict"]
                style, difference = _STYLES[verdict], f"{key}_difference"
                for end, width in (("", 1.2), ("_90", 3.6)):
                    ends = [row[f"{difference}_low{end}"], row[f"{difference}_high{end}"]]
                    axis.plot(ends, [y, y], color=style["color"], lw=width, solid_capstyle="butt")
                axis.plot(row[difference], y, ms=7, **style)
                axis.text(1.02, y, verdict, va="center", transform=axis.get_yaxis_transform())
            label_rows(axis, names, first=axis is axes[0, 0])
            axis.set(title=label, xlabel="difference: right of the line, the first is better")
            axis.locator_params(axis="x", nbins=5)
        text = "thick: 90 %, thin: 95 % interval, not adjusted; grey band: margin of equivalence"
        figure.supxlabel(text, fontsize="small")
    return figure


@contextmanager
def curve_panels(
    curves: pd.DataFrame,
    panels: Mapping[str, Drawn],
    experiment: Experiment,
    column: str,
    label: str,
    note: str = "",
) -> Iterator[tuple[Figure, Iterable[Axes]]]:
    """Draws a column of `labelled` curves over training: a panel per scenario and group of learners.

    Groups are by the title of their panel. `label` is that of the vertical axis, and `note` is added to the
    legend, which is drawn when the caller has completed the axes.
    """
    frame = curves[curves["step"] > 0]
    scenarios = list(frame["scenario"].unique())
    is_few = len(scenarios) <= FEW
    cells = [(scenario, *panel) for panel in panels.items() for scenario in scenarios]
    n_columns = len(scenarios) if is_few else _COLUMNS
    n_rows = math.ceil(len(cells) / n_columns)
    with figure_of(n_rows, n_columns, (11.0, (2.0 if is_few else 1.55) * n_rows + 1.0)) as (figure, axes):
        used = axes.flat[: len(cells)]
        for i, (axis, (scenario, title, drawn)) in enumerate(zip(used, cells, strict=True)):
            shown = rows_of(frame[frame["scenario"] == scenario], drawn)
            _lines(axis, shown, column, drawn, experiment)
            axis.set(title=in_lines(", ".join(filter(None, [scenario, title]))))
            axis.set(xlim=(float(shown["step"].min()), float(shown["step"].max())))
            axis.xaxis.set_major_locator(MaxNLocator(4 if is_few else 2))
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
            if i % n_columns == 0:
                axis.set(ylabel=label)
            else:
                axis.tick_params(labelleft=False)
            if i + n_columns < len(cells):
                axis.tick_params(labelbottom=False)
            if i // n_columns == n_rows - 1:
                axis.set(xlabel="environment step")
        for axis in axes.flat[len(cells) :]:
            axis.set_axis_off()
        yield figure, used
        every = {name: references for panel in panels.values() for name, references in panel.items()}
        bars = " or bar" if any(every.values()) else ""
        legend(figure, every, experiment, f"line: mean over runs; shade{bars}: 95 % interval{note}")


def legend(
    figure: Figure, learners: Iterable[str], experiment: Experiment, title: str, **style: object
) -> None:
    """Names learners below a figure, under a line that says what the signs are."""
    names = {name: experiment.learners[name].title for name in learners}
    handles = [
        Line2D([], [], label=text, lw=1.3, ms=5, **style_of(name, experiment) | style)
        for name, text in names.items()
    ]
    columns = min(max(_CHARACTERS // (max(map(len, names.values())) + 9), 1), 4)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, frameon=False, handlelength=3, title=title
    )


def _lines(axis: Axes, frame: pd.DataFrame, y: str, drawn: Drawn, experiment: Experiment) -> None:
    low, high = f"{y}_low", f"{y}_high"
    for learner in drawn:
        rows, style = frame[frame["learner"] == learner], style_of(learner, experiment)
        every = max(len(rows) // _N_MARKERS, 1)
        axis.plot(rows["step"], rows[y], lw=1.3, ms=4, markevery=every, **style)
        axis.fill_between(rows["step"], rows[low], rows[high], color=style["color"], alpha=0.12, lw=0)
    references = [(name, learner) for learner, names in drawn.items() for name in names]
    for i, (reference, learner) in enumerate(references, start=1):
        rows, style = frame[frame["learner"] == reference], style_of(learner, experiment)
        every = math.ceil(len(rows) / _N_POINTS)
        rows = rows.iloc[every * i // (len(references) + 1) :: every]  # not where those of others are
        axis.vlines(
            rows["step"], rows[low], rows[high], color=style["color"], ls=style["ls"], lw=0.8, zorder=3
        )
        axis.plot(rows["step"], rows[y], **style | {"ls": ""}, ms=5, mfc="white", zorder=3)


def dot(
    axis: Axes, rows: pd.DataFrame, key: str, at: float, style: Style, *, is_hollow: bool = False
) -> None:
    """Draws the numbers of a learner with their intervals, at a height."""
    for _, row in rows.iterrows():
        ends, width = [row[f"{key}_low"], row[f"{key}_high"]], 1.2 if is_hollow else 2.2
        axis.plot(ends, [at, at], color=style["color"], lw=width, alpha=0.6)
        fill: Style = {"mfc": "white"} if is_hollow else {"mec": "white", "mew": 0.4}
        axis.plot(row[key], at, color=style["color"], marker=style["marker"], ms=6, **fill)


def label_rows(axis: Axes, names: Sequence[str], *, first: bool) -> None:
    """Names rows from top to bottom, in the first panel."""
    axis.set_yticks(np.arange(len(names)), names if first else [])
    axis.set(ylim=(len(names) - 0.5, -0.5))
    axis.grid(axis="y", lw=0.4, color="0.85")
    axis.tick_params(axis="y", length=0)


def reference_note(drawn: Drawn, tables: Frames, experiment: Experiment) -> str:
    """Returns what a figure says of reference implementations; empty if there are none."""
    names = [*chain(*drawn.values())]
    if not names:
        return ""
    sizes = ""
    if "summary" in tables:
        n = rows_of(labelled(tables["summary"]), dict.fromkeys(names, ()))["n"]
        sizes = f", {n.min()} runs" if n.min() == n.max() else f", {n.min()} to {n.max()} runs"
    is_sb3 = any("stable_baselines3" in experiment.learners[name].algorithm.packages for name in names)
    return f"; hollow: reference implementations{sizes}{', nets by Stable-Baselines3 itself' * is_sb3}"
