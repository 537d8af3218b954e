"""What all figures share: their style, the colours and markers of learners, and how they are saved."""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from textwrap import fill
from typing import Any, Final

import matplotlib as mpl
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.style import context
from matplotlib.text import Text
from matplotlib.typing import ColorType
from numpy.typing import NDArray

from benchmark.drawing.svg import compact
from envs import InputError

WIDTH: Final = 7.9  # inches: a wider figure would be shrunk where it is read
COLOURS: Final = sns.color_palette("colorblind")
# Names beside lines: height of a line of text and distance in points, characters of a line
_LINE, _GAP, _CHARACTERS = 11.0, 16.0, 23
# Texts on coloured cells; unlike pure black and white, these are not inverted in dark mode.
INK: Final = ("#000001", "#fffffe")
# Colours and markers that experiments name, see `benchmark.experiments.schema.Variant.colour`. Published
# tables are black, grey or green, DQN and its relatives blue, PPO and its relatives orange. Within such a
# family, brightness and marker differ.
PALETTE: Final[Mapping[str, tuple[str, str]]] = {
    "black": ("#000000", "o"),
    "grey": ("#707070", "s"),
    "silver": ("#a0a0a0", "8"),
    "ash": ("#b8b8b8", "*"),
    "green": ("#00856a", "D"),
    "olive": ("#4d5d3a", "d"),
    "lime": ("#79c36a", "P"),
    "blue": ("#0173b2", "^"),
    "navy": ("#16206b", "p"),
    "violet": ("#8a63d2", "v"),
    "orange": ("#de7400", "X"),
    "brown": ("#7a3b12", "h"),
}
# Other variants take these in the order of the experiment; all 8 * 15 pairs come up before one returns.
_COLOURS: Final = ("#c2418f", "#17a2b8", "#8f1d2c", "#b59b00", "#5b5b5b", "#e58fc0", "#3f7f93", "#d98880")
_MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X", "h", "<", ">", "p", "*", "d", "8", "H")
# Linear learners have colours and markers that are not in the palette.
_LINEAR: Final = ("#b3003c", "#f08fb8"), ("<", ">", "H")
# Dashes, and how much lighter a learner is drawn; other forms of observation are solid and not lighter.
_BY_OBSERVATION: Final[Mapping[str, tuple[tuple[int, tuple[float, ...]], float]]] = {
    "coordinates": ((0, (4, 1.5)), 0.3),
    "centred": ((0, (6, 2)), 0.1),
    "offset_coordinates": ((0, (4, 1.2, 1, 1.2)), 0.15),
    **dict.fromkeys(("offset_centred", "offset_factored", "offset_tiles"), ((0, (4, 1.2, 1, 1.2)), 0.0)),
    **dict.fromkeys(("offset", "offset_one_hot"), ((0, (1, 1.2)), 0.4)),
}
_RC: Final = {
    **sns.axes_style("ticks"),
    **sns.plotting_context("paper", font_scale=1.1),
    "svg.hashsalt": "proxemic",  # otherwise equal figures get different identifiers
    "svg.fonttype": "none",  # texts stay texts
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "font.sans-serif": ["DejaVu Sans"],
}


def settings() -> AbstractContextManager[None]:
    """Sets, within a `with` block, all of matplotlib that figures depend on, whatever users have set."""
    return context(["default", _RC])


def colour_map(name: str) -> Colormap:
    """Returns a colour map of matplotlib in 256 colours; it reads its own setting for these only once."""
    return mpl.colormaps[name].resampled(256)


def check_file(path: Path, *endings: str) -> None:
    """Raises an InputError if a file's name has none of these endings, or its folder does not exist."""
    if path.suffix.lower() not in endings:
        raise InputError(f"{path}: accepted: a name that ends in {' or '.join(endings)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}.")


def save_figure(figure: Figure, path: Path) -> None:
    """Writes a figure as .png or .svg; it stays open.

    Without date and program, equal figures give equal bytes.
    """
    if path.suffix.lower() == ".svg":
        path.write_text(svg(figure), encoding="utf-8")
        return
    with settings():
        figure.savefig(path, dpi=144, metadata={"Software": None})


def svg(figure: Figure) -> str:
    """Returns the figure as the text of an SVG, see `save_figure`."""
    text = io.StringIO()
    with settings():
        figure.savefig(text, format="svg", metadata=dict.fromkeys(["Date", "Creator"]))
    return compact(text.getvalue(), _IN_DARK)


@contextmanager
def figure_of(rows: int, columns: int, size: tuple[float, float]) -> Iterator[tuple[Figure, NDArray[Any]]]:
    """Makes a figure in the project's style.

    Its size is in inches, and the axes are (rows, columns). Those in which nothing is drawn are hidden.
    """
    with settings():
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
        yield figure, axes
        for text in figure.findobj(Text):
            # "$" is a character except in the ticks of logarithmic axes, which have no text until drawn.
            if isinstance(text, Text) and "$" in text.get_text():
                text.set_parse_math(False)
        for axis in axes.flat:
            if not axis.has_data():
                axis.set_axis_off()
            if axis.get_aspect() != "auto":
                axis.label_outer()  # the maps of a figure share their axes


def name_rows(axis: Axes, names: Sequence[str]) -> None:
    """Names the rows of a chart, the first above, with a line through each."""
    axis.set_yticks(range(len(names)), names)
    axis.set(ylim=(len(names) - 0.5, -0.5))
    axis.grid(axis="y", lw=0.4, color="0.85")
    axis.tick_params(axis="y", length=0)


def name_lines(axis: Axes, lines: Mapping[str, tuple[float, Mapping[str, Any]]]) -> None:
    """Writes names right of lines, given where each ends on the linear y axis and its colour and marker.

    Names that would overlap are moved apart, and lead back to their lines.
    """
    box = axis.get_window_extent().transformed(axis.figure.dpi_scale_trans.inverted())
    width, height = 72 * box.width, 72 * box.height
    bottom, top = axis.get_ylim()
    texts = {name: fill(name, _CHARACTERS, break_on_hyphens=False) for name in lines}
    half = {name: _LINE * (text.count("\n") + 1.25) / 2 for name, text in texts.items()}
    heights = {name: (end - bottom) / (top - bottom) * height for name, (end, _) in lines.items()}
    upwards = sorted(lines, key=lambda name: heights[name])
    at, below, above = dict[str, float](), -_LINE, height + _LINE
    for name in upwards:
        at[name] = max(heights[name], below + half[name])
        below = at[name] + half[name]
    for name in reversed(upwards):
        at[name] = min(at[name], above - half[name])
        above = at[name] - half[name]
    for name, (_, style) in lines.items():
        ends = [1, 1 + _GAP / width], [heights[name] / height, at[name] / height]
        look = {"marker": "", "mfc": style["color"], **style, "mec": style["color"], "ls": ":", "lw": 1}
        axis.plot(*ends, **look, ms=5, markevery=[1], transform=axis.transAxes, clip_on=False)
        axis.text(
            1 + 1.4 * _GAP / width, at[name] / height, texts[name],
            va="center", fontsize="small", transform=axis.transAxes,
        )  # fmt: skip


def draw_cells(
    axis: Axes, cells: Sequence[Sequence[tuple[str, str]]], rows: Sequence[str], columns: Sequence[str]
) -> None:
    """Draws a table of texts, each with the colour of its cell, and the names of its rows and columns."""
    for y, row in enumerate(cells):
        for x, (text, colour) in enumerate(row):
            axis.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="white", lw=2))
            axis.text(x, y, text, ha="center", va="center", fontsize="small", color=ink_on(colour))
    axis.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(rows) - 0.5, -0.5))
    axis.set_xticks(range(len(columns)), columns, fontsize="small")
    axis.set_yticks(range(len(rows)), rows, fontsize="small")
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)


def ink_on(colour: ColorType) -> str:
    """Returns the colour of a text on a colour."""
    return INK[int(_brightness(colour) < 0.45)]


def learner_style(
    variant: str, observation: str, colours: Mapping[str, str | None], family: str = ""
) -> dict[str, Any]:
    """Returns the colour and marker of a variant, and tint and dashes of its observation.

    `colours` has the names in the palette that an experiment gives to its variants. No two of the first 120
    variants without one share both colour and marker, or, if they are linear, no two of the first 6.
    """
    if name := colours[variant]:
        colour, marker = PALETTE[name]
    else:
        i = [other for other in colours if not colours[other]].index(variant)
        hues, markers = _LINEAR if family == "linear" else (_COLOURS, _MARKERS)
        colour, marker = hues[i % len(hues)], markers[i % len(markers)]
    dashes, tint = _BY_OBSERVATION.get(observation, ("-", 0.0))
    return {"color": _lighter(colour, tint), "marker": marker, "ls": dashes}


def _lighter(colour: str, share: float) -> str:
    red, green, blue = (part + share * (1 - part) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def in_dark(colour: str) -> str:
    """Returns a colour for a dark background: the darker it is, the more it is lightened."""
    return _lighter(colour, max(0.0, 0.75 - 1.3 * _brightness(colour)))


def _brightness(colour: ColorType) -> float:
    red, green, blue = to_rgb(colour)
    return 0.3 * red + 0.59 * green + 0.11 * blue


_IN_DARK: Final = {
    (drawn := _lighter(colour, tint)): in_dark(drawn)
    for colour in (*(hue for hue, _ in PALETTE.values()), *_COLOURS, *_LINEAR[0], *map(to_hex, COLOURS))
    for tint in (0.0, *(tint for _, tint in _BY_OBSERVATION.values()))
}


def norm_of(values: pd.Series) -> Normalize:
    """Returns the colour scale that spans values; if they have both signs, zero is in its middle."""
    low, high = float(values.min()), float(values.max())
    limit = max(-low, high)
    return Normalize(-limit, limit) if low < 0 < high else Normalize(low, high)
