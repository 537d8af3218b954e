"""What the figures of a comparison share.

Colour and marker show a learner's algorithm, and tint and dash its observation, see `drawing.style`, so that
figures can be read in grey, too. A reference implementation is drawn hollow, in the colour of its learner.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, MIXED, NO_VERDICT, UNDECIDED, WORSE
from benchmark.drawing.style import INK, figure_of, learner_style
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
    BETTER: {"marker": "^", "color": "black"},
    WORSE: {"marker": "v", "color": "black"},
    EQUIVALENT: {"marker": "o", "color": "black"},
    MIXED: {"marker": "X", "color": "black"},
    UNDECIDED: {"marker": "o", "color": "0.55", "mfc": "white"},
    NO_VERDICT: {"marker": "x", "color": "0.55"},
}
_N_MARKERS: Final = 6  # of a curve
_N_POINTS: Final = 4  # of a reference
_COLUMNS: Final = 6  # of panels, if there are many scenarios
_CHARACTERS: Final = 140  # that a line of a legend has room for
FEW: Final = 4  # scenarios that have a column each


def learners_in(frame: pd.DataFrame, runs: Runs) -> list[Learner]:
    """Lists the learners in a frame, in its order, without reference implementations."""
    pairs = dict.fromkeys(zip(frame["algorithm"], frame["observation"], strict=True))
    return [learner for pair in pairs if (learner := Learner(*pair)) not in runs.references]


def is_of(frame: pd.DataFrame, learner: Learner) -> NDArray[np.bool_]:
    """Returns which rows are a learner's."""
    rows = (frame["algorithm"] == learner.algorithm) & (frame["observation"] == learner.observation)
    return np.asarray(rows.to_numpy())


def is_of_any(frame: pd.DataFrame, learners: Sequence[Learner], runs: Runs) -> NDArray[np.bool_]:
    """Returns which rows are of these learners or of their references."""
    every = [*learners, *(each for learner in learners for each in references_of(learner, runs))]
    return np.asarray(np.logical_or.reduce([is_of(frame, each) for each in every]))


def style_of(learner: Learner, runs: Runs) -> dict[str, Any]:
    """Returns a learner's colour, marker and dash."""
    return learner_style(*learner, runs.algorithms)


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
            axis.set(title=label, xlabel="difference: right of the line, the first is better")
            axis.locator_params(axis="x", nbins=5)
        text = "thick: 90 %, thin: 95 % interval, not adjusted; grey band: margin of equivalence"
        figure.supxlabel(text, fontsize="small")
    return figure


@contextmanager
def curve_panels(
    frame: pd.DataFrame,
    runs: Runs,
    panels: Mapping[str, Sequence[Learner]],
    column: str,
    label: str,
    signs: str = "",
) -> Iterator[tuple[Figure, Iterable[Axes]]]:
    """Draws a column of `curves` over training: a panel per place and group of learners.

    Yields:
      The figure and its axes, to be completed before the legend is drawn. It also names further signs.
    """
    frame = words.by_place(frame[frame["step"] > 0])
    scenarios = list(frame["scenario"].unique())
    is_few = len(scenarios) <= FEW
    places = [(scenario, *panel) for panel in panels.items() for scenario in scenarios]
    n_columns = len(scenarios) if is_few else _COLUMNS
    n_rows = math.ceil(len(places) / n_columns)
    with figure_of(n_rows, n_columns, (11.0, (2.0 if is_few else 1.55) * n_rows + 1.0)) as (figure, axes):
        for axis, (scenario, title, drawn) in zip(axes.flat, places, strict=False):
            shown = frame[(frame["scenario"] == scenario) & is_of_any(frame, drawn, runs)]
            lines(axis, shown, "step", column, drawn, runs)
            axis.set(title=", ".join(filter(None, [scenario, title])))
            axis.set(xlim=(float(shown["step"].min()), float(shown["step"].max())))
            axis.xaxis.set_major_locator(MaxNLocator(4 if is_few else 2))
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
        for axis in axes.flat[len(places) :]:
            axis.set_axis_off()
        for i, axis in enumerate(axes.flat[: len(places)]):
            if i % n_columns == 0:
                axis.set(ylabel=label)
            else:
                axis.tick_params(labelleft=False)
            if i + n_columns < len(places):
                axis.tick_params(labelbottom=False)
            if i // n_columns == n_rows - 1:
                axis.set(xlabel="environment step")
        yield figure, axes.flat[: len(places)]
        drawn = list(dict.fromkeys(learner for panel in panels.values() for learner in panel))
        bars = " or bar" if any(references_of(each, runs) for each in drawn) else ""
        title = f"line: mean over runs; shade{bars}: 95 % interval{signs}"
        legend(figure, drawn, runs, with_references(title, runs) if bars else title)


def legend(figure: Figure, learners: Sequence[Learner], runs: Runs, title: str, **style: Any) -> None:
    """Names learners below a figure, under a line that says what the signs are."""
    handles = [
        Line2D([], [], label=runs.names(*each), lw=1.3, ms=5, **style_of(each, runs) | style)
        for each in learners
    ]
    widest = max(len(runs.names(*each)) for each in learners)
    columns = min(max(_CHARACTERS // (widest + 9), 1), 4)
    place: dict[str, Any] = {"loc": "outside lower center", "ncols": columns, "frameon": False}
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
        together = [learner, *references_of(learner, runs)]
        for place, each in enumerate(together):
            at = y + 0.4 * (place - (len(together) - 1) / 2)
            dot(axis, frame[is_of(frame, each)], key, at, style_of(learner, runs), is_hollow=place > 0)


def dot(
    axis: Axes, frame: pd.DataFrame, key: str, at: float, style: dict[str, Any], *, is_hollow: bool = False
) -> None:
    """Draws the numbers of a learner with their intervals, at a height."""
    for _, row in frame.iterrows():
        ends, width = [row[f"{key}_low"], row[f"{key}_high"]], 1.2 if is_hollow else 2.2
        axis.plot(ends, [at, at], color=style["color"], lw=width, alpha=0.6)
        fill = {"mfc": "white"} if is_hollow else {"mec": "white", "mew": 0.4}
        axis.plot(row[key], at, color=style["color"], marker=style["marker"], ms=6, **fill)


def text_on(axis: Axes, x: float, y: float, text: str, *, is_dark: bool) -> None:
    """Writes on a coloured cell, which is the same in the dark."""
    axis.text(x, y, text, ha="center", va="center", color=INK[int(is_dark)])


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
