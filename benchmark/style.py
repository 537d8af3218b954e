"""What all figures share: the looks of learners, their style, and how they are saved."""

import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.style import context
from numpy.typing import NDArray

from benchmark.experiment import OBSERVED, Learner
from envs import InputError

WIDTH = 7.9  # inches: a wider figure would be shrunk where it is read
_CHARACTERS = 23  # of a line of text beside a chart
_RC = {
    **sns.axes_style("ticks"),
    **sns.plotting_context("paper", font_scale=1.1),
    "svg.hashsalt": "proxemic",  # otherwise equal figures get different identifiers
    "svg.fonttype": "none",  # texts stay texts
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "font.sans-serif": ["DejaVu Sans", "Verdana"],  # Verdana is as wide
}

# Colour and marker of a variant, in every figure. Tables are black, grey or green, linear learners
# red, DQN blue, PPO orange. In grey, brightness differs.
Look = dict[str, Any]
_KNOWN = {
    "q_learning": ("#000000", "o"),
    "watkins_q_lambda": ("#00856a", "D"),
    "replay_table": ("#17a2b8", "*"),
    "tile_coding": ("#b3003c", "<"),
    "replay_tiles": ("#f08fb8", ">"),
    "dqn": ("#0173b2", "^"),
    "dqn_default": ("#8a63d2", "v"),
    "ppo": ("#de7400", "X"),
    "ppo_default": ("#7a3b12", "h"),
}
# Other variants take the first of these pairs that is free.
_HUES = ("#8f1d2c", "#3f7f93", "#b59b00", "#5b5b5b", "#d98880", "#6a3d9a")
_OTHERS = [(hue, marker) for marker in "sDo^vPX*dhp<>" for hue in _HUES]


def look(learner: Learner, learners: Iterable[Learner]) -> Look:
    """Returns the colour and marker of a learner's variant, and the dashes of its observation.

    A variant of Stable-Baselines3, `sb3_NAME`, looks like NAME, but hollow. No two variants of the
    learners of an experiment share both colour and marker.
    """
    drawn = learner.variant.removeprefix("sb3_")
    unknown = {each.variant.removeprefix("sb3_") for each in learners} - _KNOWN.keys()
    marks = {**_KNOWN, **dict(zip(sorted(unknown), _OTHERS, strict=False))}
    colour, marker = marks.get(drawn, _OTHERS[0])
    form = [*OBSERVED].index(learner.observation) if learner.observation in OBSERVED else 0
    dashes = (0, (1.5 * form, 1.5)) if form > 1 else "-"  # solid for the cells' index and one-hot
    filling = {} if drawn == learner.variant else {"mfc": "white"}
    return {"color": colour, "marker": marker, "ls": dashes, **filling}


def settings() -> AbstractContextManager[None]:
    """Sets all of matplotlib that figures depend on, within a `with` block."""
    return context(["default", _RC])


def colour_map(name: str) -> Colormap:
    """Returns a colour map in 256 colours, whatever users have set."""
    return mpl.colormaps[name].resampled(256)


@contextmanager
def figure_of(
    rows: int, columns: int, size: tuple[float, float]
) -> Iterator[tuple[Figure, NDArray[Any]]]:
    """Makes a figure in the project's style.

    Its size is in inches, and the axes are (rows, columns). Those without data are hidden.
    """
    with settings():
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
        yield figure, axes
        for axis in axes.flat:
            if not axis.has_data():
                axis.set_axis_off()
            if axis.get_aspect() != "auto":
                axis.label_outer()  # the maps of a figure share their axes


def check_file(path: Path, *endings: str) -> None:
    """Raises an InputError if a file has none of these endings, or its folder does not exist."""
    if path.suffix.lower() not in endings:
        raise InputError(f"{path}: accepted: a name that ends in {' or '.join(endings)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}.")


def save(figure: Figure, path: Path) -> None:
    """Writes a figure as .png or .svg; equal figures give equal bytes."""
    if path.suffix.lower() == ".svg":
        path.write_text(svg(figure), encoding="utf-8")
        return
    with settings():
        figure.savefig(path, dpi=144, metadata={"Software": None})


_TAG = re.compile(r"<[a-z][^>]*>")
_LENGTHS = re.compile(r' (?:d|x|y|width|height|transform)="[^"]*"')
_DECIMAL = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
_NAME = re.compile(r'( id="|href="#|url\(#)([^")]*)')


def svg(figure: Figure) -> str:
    """Returns the figure as the text of an SVG, which is the same on every processor.

    Lengths are rounded; identifiers, which are digests of unrounded ones, are numbered.
    """
    file, names = io.StringIO(), dict[str, str]()
    with settings():
        figure.savefig(file, format="svg", metadata=dict.fromkeys(["Date", "Creator"]))

    def named(match: re.Match[str]) -> str:
        return match[1] + names.setdefault(match[2], f"i{len(names)}")

    def rounded(match: re.Match[str]) -> str:
        return _DECIMAL.sub(lambda number: f"{round(float(number[0]), 2) + 0.0:g}", match[0])

    return _TAG.sub(lambda tag: _NAME.sub(named, _LENGTHS.sub(rounded, tag[0])), file.getvalue())


def name_rows(axis: Axes, names: Sequence[str]) -> None:
    """Names the rows of a chart, the first above, with a line through each."""
    axis.set_yticks(range(len(names)), names)
    axis.set(ylim=(len(names) - 0.5, -0.5))
    axis.grid(axis="y", lw=0.4, color="0.85")
    axis.tick_params(axis="y", length=0)


class Row(NamedTuple):
    """A number in a chart, with its interval; without a look, its name is a heading."""

    name: str
    look: Look
    ends: tuple[float, float, float] = (np.nan, np.nan, np.nan)  # the value, low, high
    text: str = ""  # right of the chart


def draw_rows(axis: Axes, rows: Sequence[Row], *, is_named: bool = True) -> None:
    """Draws numbers one below the other, the first above."""
    name_rows(axis, [row.name if is_named else "" for row in rows])
    for y, (row, label) in enumerate(zip(rows, axis.get_yticklabels(), strict=True)):
        label.set(fontsize="small", fontweight="normal" if row.look else "bold")
        value, low, high = row.ends
        if row.look:
            axis.hlines(y, low, high, color=row.look["color"], lw=2)
            axis.plot(value, y, **row.look | {"ls": ""})
            note_beside(axis, y, row.text)


def note_beside(axis: Axes, y: float, text: str) -> None:
    """Writes a text right of a row of a chart."""
    axis.text(1.02, y, text, fontsize="small", va="center", transform=axis.get_yaxis_transform())


def name_lines(axis: Axes, lines: Mapping[str, tuple[float, Look]]) -> None:
    """Names lines right of a chart, given where each ends and its look; the highest comes first."""
    names = sorted(lines, key=lambda name: lines[name][0], reverse=True)
    marks = [Line2D([], [], ms=5, lw=1, **lines[name][1]) for name in names]
    texts = [fill(name, _CHARACTERS, break_on_hyphens=False) for name in names]
    axis.legend(
        marks, texts, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small"
    )


def draw_cells(
    axis: Axes,
    cells: Sequence[Sequence[tuple[str, str]]],
    rows: Sequence[str],
    columns: Sequence[str],
) -> None:
    """Draws a table of texts, each on the colour of its cell, with names of rows and columns."""
    for y, row in enumerate(cells):
        for x, (text, colour) in enumerate(row):
            axis.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="white", lw=2))
            axis.text(x, y, text, ha="center", va="center", fontsize="small")
    axis.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(rows) - 0.5, -0.5))
    axis.set_xticks(range(len(columns)), columns, fontsize="small")
    axis.set_yticks(range(len(rows)), rows, fontsize="small")
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)


def norm_of(values: pd.Series) -> Normalize:
    """Returns the colour scale that spans values; with both signs, zero is in its middle."""
    low, high = float(values.min()), float(values.max())
    limit = max(-low, high)
    return Normalize(-limit, limit) if low < 0 < high else Normalize(low, high)
