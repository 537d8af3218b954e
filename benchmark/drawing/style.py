"""What all figures share: their style, the colours and markers of learners, and how they are saved."""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")

import pandas as pd
import seaborn as sns
from matplotlib import pyplot as plt
from matplotlib.colors import Normalize, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from benchmark.drawing.svg import compact
from envs import InputError

COLOURS: Final = sns.color_palette("colorblind")
# Of texts on coloured cells; unlike pure black and white, not inverted in dark mode.
INK: Final = ("#000001", "#fffffe")
# Of the variants of published experiments: tables are black, grey or green, DQN and its relatives blue, PPO
# and its relatives orange. Within such a family, brightness and marker differ.
_KNOWN: Final[Mapping[str, tuple[str, str]]] = {
    "q_learning": ("#000000", "o"),
    "q_learning_tuned": ("#707070", "s"),
    "q_learning_long": ("#a0a0a0", "8"),
    "watkins_q_lambda": ("#00856a", "D"),
    "expected_sarsa": ("#4d5d3a", "d"),
    "softmax_table": ("#79c36a", "P"),
    "memoryless": ("#b8b8b8", "*"),
    **dict.fromkeys(("dqn", "dqn_offset"), ("#0173b2", "^")),
    "dqn_linear": ("#16206b", "p"),
    "dqn_default": ("#8a63d2", "v"),
    **dict.fromkeys(("ppo", "ppo_offset"), ("#de7400", "X")),
    "ppo_default": ("#7a3b12", "h"),
}
# Of other variants, in the order of the experiment: all 8 * 15 pairs come up before one returns.
_COLOURS: Final = ("#c2418f", "#17a2b8", "#8f1d2c", "#b59b00", "#5b5b5b", "#e58fc0", "#3f7f93", "#d98880")
_MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X", "h", "<", ">", "p", "*", "d", "8", "H")
# Of linear learners, in colours and markers that no table and no net above has.
_LINEAR: Final = ("#b3003c", "#f08fb8"), ("<", ">", "H")
# Dashes, and how much lighter a learner is drawn; other forms of observation are solid and not lighter.
_BY_OBSERVATION: Final[Mapping[str, tuple[tuple[int, tuple[float, ...]], float]]] = {
    "coordinates": ((0, (4, 1.5)), 0.3),
    "offset_coordinates": ((0, (4, 1.2, 1, 1.2)), 0.15),
    **dict.fromkeys(("offset", "offset_one_hot"), ((0, (1, 1.2)), 0.4)),
    **dict.fromkeys(("nearest", "nearest_one_hot", "nearest_coordinates"), ((0, (5, 1, 1, 1, 1, 1)), 0.5)),
    **dict.fromkeys(("centre", "centre_one_hot", "centre_coordinates"), ((0, (2, 2)), 0.55)),
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


def check_file(path: Path, *endings: str) -> None:
    """Raises an InputError if a file's name has none of these endings, or its folder does not exist."""
    if path.suffix.lower() not in endings:
        raise InputError(f"{path}: accepted: a name that ends in {' or '.join(endings)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}.")


def save_figure(figure: Figure, path: Path, *, is_tight: bool = False) -> None:
    """Writes a figure as .png or .svg, cut to what is drawn if it is tight; it stays open.

    Without date and program, equal figures give equal bytes.
    """
    if path.suffix.lower() == ".svg":
        path.write_text(svg(figure, is_tight=is_tight), encoding="utf-8")
        return
    with plt.rc_context({**_RC, "savefig.dpi": 144}):
        metadata = dict.fromkeys(["Software"])
        figure.savefig(path, metadata=metadata, bbox_inches="tight" if is_tight else None)


def svg(figure: Figure, *, is_tight: bool = False) -> str:
    """Returns the figure as the text of an SVG, see `save_figure`."""
    text = io.StringIO()
    with plt.rc_context({**_RC, "savefig.dpi": "figure"}):
        metadata = dict.fromkeys(["Date", "Creator"])
        figure.savefig(text, format="svg", metadata=metadata, bbox_inches="tight" if is_tight else None)
    return compact(text.getvalue(), _IN_DARK)


@contextmanager
def figure_of(rows: int, columns: int, size: tuple[float, float]) -> Iterator[tuple[Figure, NDArray[Any]]]:
    """Makes a figure in the project's style; its size is in inches, and the axes are (rows, columns)."""
    with plt.rc_context(_RC):
        figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
        yield figure, axes
        for text in figure.findobj(Text):
            # "$" is a character except in the ticks of logarithmic axes, which have no text until drawn.
            if isinstance(text, Text) and "$" in text.get_text():
                text.set_parse_math(False)
        for axis in axes.flat:
            if axis.get_aspect() != "auto":
                axis.label_outer()  # the maps of a figure share their axes


def learner_style(
    variant: str, observation: str, variants: Sequence[str], family: str = ""
) -> dict[str, Any]:
    """Returns the colour and marker of a variant of an experiment, and tint and dashes of its observation.

    No two of the first 120 variants that are not published share both colour and marker, or, if they are
    linear, no two of the first 6.
    """
    if variant in _KNOWN:
        colour, marker = _KNOWN[variant]
    else:
        i = [name for name in variants if name not in _KNOWN].index(variant)
        colours, markers = _LINEAR if family == "linear" else (_COLOURS, _MARKERS)
        colour, marker = colours[i % len(colours)], markers[i % len(markers)]
    dashes, tint = _BY_OBSERVATION.get(observation, ("-", 0.0))
    return {"color": _lighter(colour, tint), "marker": marker, "ls": dashes}


def _lighter(colour: str, share: float) -> str:
    red, green, blue = (part + share * (1 - part) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def in_dark(colour: str) -> str:
    """Returns a colour for a dark background: the darker it is, the more it is lightened."""
    red, green, blue = to_rgb(colour)
    brightness = 0.3 * red + 0.59 * green + 0.11 * blue
    return _lighter(colour, max(0.0, 0.75 - 1.3 * brightness))


_IN_DARK: Final = {
    (drawn := _lighter(colour, tint)): in_dark(drawn)
    for colour in (*(colour for colour, _ in _KNOWN.values()), *_COLOURS, *_LINEAR[0], *map(to_hex, COLOURS))
    for tint in (0.0, *(tint for _, tint in _BY_OBSERVATION.values()))
}


def norm_of(values: pd.Series) -> Normalize:
    """Returns the colour scale that spans values; if they have both signs, zero is in its middle."""
    low, high = float(values.min()), float(values.max())
    most = max(-low, high)
    return Normalize(-most, most) if low < 0 < high else Normalize(low, high)
