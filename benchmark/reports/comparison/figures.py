"""What the figures of a comparison share. A learner has one colour, marker and dash in all of them.

Colour and marker show its algorithm, and tint and dash its observation, so that figures can be read in grey,
too. A reference implementation is drawn hollow, in the colour of its learner.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, NullFormatter
from numpy.typing import NDArray

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, MIXED, NO_VERDICT, UNDECIDED, WORSE
from benchmark.drawing.style import COLOURS, figure_of, variant_style
from benchmark.reports.comparison import words
from benchmark.reports.comparison.declared import Learner
from benchmark.reports.comparison.runs import Runs

SIGNS: Final = {BETTER: "▲", WORSE: "▼", EQUIVALENT: "=", MIXED: "±"}  # of verdicts
# What they mean against several baselines, see `verdicts.standings`.
THAN: Final = {
    BETTER: " than all",
    WORSE: " than at least one",
    EQUIVALENT: " to at least one, worse than none",
}
_STYLES: Final[dict[str, dict[str, Any]]] = {
    BETTER: {"marker": "^", "color": COLOURS[2]},
    WORSE: {"marker": "v", "color": COLOURS[3]},
    EQUIVALENT: {"marker": "o", "color": COLOURS[0]},
    MIXED: {"marker": "X", "color": COLOURS[1]},
    UNDECIDED: {"marker": "o", "color": "0.45", "mfc": "white"},
    NO_VERDICT: {"marker": "x", "color": "0.45"},
}
_DASHES: Final[dict[str, Any]] = {  # of forms of observation; others are solid
    "coordinates": (0, (4, 1.5)),
    **dict.fromkeys(("offset", "offset_one_hot", "offset_coordinates"), (0, (1, 1.2))),
}
_TINTED: Final = ("coordinates", "offset_coordinates")  # observations of the learners that are drawn lighter
_N_MARKERS: Final = 6  # of a curve
_N_POINTS: Final = 4  # of a reference
_COLUMNS: Final = 4  # of panels, if there are many scenarios
FEW: Final = 4  # scenarios that have a column each


def learners_in(frame: pd.DataFrame, runs: Runs) -> list[Learner]:
    """Lists the learners in a frame, in its order, without reference implementations."""
    pairs = dict.fromkeys(zip(frame["algorithm"], frame["observation"], strict=True))
    return [learner for pair in pairs if (learner := Learner(*pair)) not in runs.references]


def is_of(frame: pd.DataFrame, learner: Learner) -> NDArray[np.bool_]:
    """Returns which rows are a learner's."""
    rows = (frame["algorithm"] == learner.algorithm) & (frame["observation"] == learner.observation)
    return np.asarray(rows.to_numpy())


def style_of(learner: Learner, runs: Runs) -> dict[str, Any]:
    """Returns a learner's colour, marker and dash."""
    style = variant_style(runs.algorithms.index(learner.algorithm))
    if learner.observation in _TINTED:
        style["color"] = tuple(0.5 + 0.5 * part for part in to_rgb(style["color"]))
    return {**style, "ls": _DASHES.get(learner.observation, "-")}


def differences(frame: pd.DataFrame, names: Sequence[str], endpoints: dict[str, str]) -> Figure:
    """Draws contrasts: a named row each and a labelled column per endpoint, with margins and verdicts."""
    with figure_of(1, len(endpoints), (11.0, 0.36 * len(frame) + 1.7)) as (figure, axes):
        for axis, (key, label) in zip(axes[0], endpoints.items(), strict=True):
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
            rows(axis, names, first=axis is axes[0, 0])
            axis.set(title=label, xlabel="difference")
            axis.locator_params(axis="x", nbins=5)
        text = "thick: 90 %, thin: 95 % interval, not adjusted; grey band: margin; colour and marker: verdict"
        figure.supxlabel(text, fontsize="small")
    return figure


@contextmanager
def curve_panels(
    frame: pd.DataFrame,
    runs: Runs,
    learners: Sequence[Learner],
    column: str,
    label: str,
    signs: str = "",
) -> Iterator[tuple[Figure, Iterable[Axes]]]:
    """Draws a column of `curves` over training: panels per place, if few also by groups of learners.

    Yields:
      The figure and its axes, to be completed before the legend is drawn. It also names further signs.
    """
    frame = words.by_place(frame[frame["step"] > 0])
    scenarios = list(frame["scenario"].unique())
    is_few = len(scenarios) <= FEW
    panels = runs.panels if is_few else {"": learners}
    places = [(scenario, *panel) for panel in panels.items() for scenario in scenarios]
    n_columns = len(scenarios) if is_few else _COLUMNS
    n_rows = math.ceil(len(places) / n_columns)
    with figure_of(n_rows, n_columns, (11.0, 2.2 * n_rows + 1.0)) as (figure, axes):
        for axis, (scenario, title, drawn) in zip(axes.flat, places, strict=False):
            lines(axis, frame[frame["scenario"] == scenario], "step", column, drawn, runs)
            axis.set(title=", ".join(filter(None, [scenario, title])))
            axis.set(xlim=(float(frame["step"].min()), float(frame["step"].max())))
            if is_few:
                axis.xaxis.set_major_locator(MaxNLocator(4))
            else:
                axis.set(xscale="log")
                axis.xaxis.set_minor_formatter(NullFormatter())
        for axis in axes.flat[len(places) :]:
            axis.set_axis_off()
        for axis in axes[:, 0]:
            axis.set(ylabel=label)
        for axis in axes.flat[max(len(places) - n_columns, 0) : len(places)]:
            axis.set(xlabel="environment step")
        yield figure, axes.flat[: len(places)]
        drawn = list(dict.fromkeys(learner for panel in panels.values() for learner in panel))
        bars = " or bar" if runs.references else ""
        title = with_references(f"line: mean over runs; shade{bars}: 95 % interval{signs}", runs)
        handles = [Line2D([], [], label=str(each), lw=1.3, ms=5, **style_of(each, runs)) for each in drawn]
        place: dict[str, Any] = {"loc": "outside lower center", "ncols": 4, "frameon": False}
        figure.legend(handles=handles, **place, handlelength=3, title=title)


def lines(axis: Axes, frame: pd.DataFrame, x: str, y: str, learners: Sequence[Learner], runs: Runs) -> None:
    """Draws lines with their intervals and some markers, and above them some points of their references."""
    low, high = f"{y}_low", f"{y}_high"
    for learner in learners:
        rows, style = frame[is_of(frame, learner)], style_of(learner, runs)
        axis.plot(rows[x], rows[y], lw=1.3, ms=4, markevery=max(len(rows) // _N_MARKERS, 1), **style)
        axis.fill_between(rows[x], rows[low], rows[high], color=style["color"], alpha=0.12, lw=0)
    references = [(each, learner) for learner in learners for each in references_of(learner, runs)]
    for place, (reference, learner) in enumerate(references, start=1):
        rows, style = frame[is_of(frame, reference)], style_of(learner, runs)
        every = math.ceil(len(rows) / _N_POINTS)
        rows = rows.iloc[every * place // (len(references) + 1) :: every]  # not where those of others are
        axis.vlines(rows[x], rows[low], rows[high], color=style["color"], ls=style["ls"], lw=0.8, zorder=3)
        axis.plot(rows[x], rows[y], **{**style, "ls": ""}, ms=5, mfc="white", zorder=3)


def dots(axis: Axes, frame: pd.DataFrame, key: str, learners: Sequence[Learner], runs: Runs) -> None:
    """Draws dots with intervals from top to bottom, those of references below their learners'."""
    for y, learner in enumerate(learners):
        style, together = style_of(learner, runs), [learner, *references_of(learner, runs)]
        for place, each in enumerate(together):
            for _, row in frame[is_of(frame, each)].iterrows():
                at, is_reference = y + 0.4 * (place - (len(together) - 1) / 2), place > 0
                ends, width = [row[f"{key}_low"], row[f"{key}_high"]], 1.2 if is_reference else 2.2
                axis.plot(ends, [at, at], color=style["color"], lw=width, alpha=0.6)
                fill = {"mfc": "white"} if is_reference else {"mec": "white", "mew": 0.6}
                axis.plot(row[key], at, color=style["color"], marker=style["marker"], ms=5, **fill)


def rows(axis: Axes, names: Sequence[object], *, first: bool) -> None:
    """Names rows from top to bottom, in the first panel."""
    axis.set_yticks(range(len(names)), [str(name) for name in names] if first else [])
    axis.set(ylim=(len(names) - 0.5, -0.5))
    axis.grid(axis="y", lw=0.4, color="0.85")
    axis.tick_params(axis="y", length=0)


def references_of(learner: Learner, runs: Runs) -> list[Learner]:
    """Lists the reference implementations of a learner."""
    return [reference for reference, own in runs.references.items() if own == learner]


def with_references(text: str, runs: Runs) -> str:
    """Returns what a figure says of its signs, and what it says of references."""
    return "; ".join(filter(None, [text, runs.reference_note]))
