"""What all figures share: style, colours and marks, a learner's among them, and how they are written."""

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
INK: Final = ("#000001", "#fffffe")  # of texts on colours, which are the same in the dark; greys are not
# Colour and mark of the variants of published experiments: tables black, grey and green, the kin of DQN blue,
# and that of PPO orange. Of the same kin, brightness and mark differ.
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
# Of other variants, in their order.
_COLOURS: Final = ("#c2418f", "#17a2b8", "#8f1d2c", "#b59b00", "#5b5b5b", "#e58fc0", "#3f7f93", "#d98880")
_MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X", "h", "<", ">", "p", "*", "d", "8", "H")
_DASHES: Final[Mapping[str, Any]] = {  # of forms of observation; others are solid
    "coordinates": (0, (4, 1.5)),
    "offset_coordinates": (0, (4, 1.2, 1, 1.2)),
    **dict.fromkeys(("offset", "offset_one_hot"), (0, (1, 1.2))),
}
_TINTS: Final[Mapping[str, float]] = {  # how much lighter a learner is drawn
    "coordinates": 0.3,
    "offset_coordinates": 0.15,
    **dict.fromkeys(("offset", "offset_one_hot"), 0.4),
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
    """Checks that a picture can be written to a file of this name.

    Raises:
      InputError: The name has none of these endings, or there is no such folder.
    """
    if path.suffix.lower() not in endings:
        raise InputError(f"{path}: accepted: a name that ends in {' or '.join(endings)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}.")


def save_figure(figure: Figure, path: Path, **options: Any) -> None:
    """Writes a figure without the date and the program: equal figures give equal bytes.

    Args:
      figure: Stays open.
      path: Of a .png, .svg or .pdf file; its ending, in small or capital letters, says the form.
      options: Of matplotlib's `savefig`.
    """
    metadata = {
        ".svg": {"Date": None, "Creator": None},
        ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }.get(path.suffix.lower(), {"Software": None})
    with plt.rc_context(_RC):
        dpi: Any = 144 if path.suffix.lower() == ".png" else "figure"
        figure.savefig(path, dpi=dpi, metadata=metadata, **options)
    if path.suffix.lower() == ".svg":
        path.write_text(compact(path.read_text(encoding="utf-8"), _IN_DARK), encoding="utf-8")


@contextmanager
def figure_of(rows: int, columns: int, size: tuple[float, float]) -> Iterator[tuple[Figure, NDArray[Any]]]:
    """Makes a figure of this size in inches in the project's style, with axes (rows, columns)."""
    with plt.rc_context(_RC):
        figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
        yield figure, axes
        for text in figure.findobj(Text):
            # "$" is a character, but for ticks of a logarithmic axis, which have no text until drawn.
            if isinstance(text, Text) and "$" in text.get_text():
                text.set_parse_math(False)
        for axis in axes.flat:
            if axis.get_aspect() != "auto":
                axis.label_outer()  # the maps of a figure share their axes


def variant_style(variant: str, variants: Sequence[str]) -> dict[str, Any]:
    """Returns the colour and mark of a variant; no two of an experiment share both.

    Those that are not known take their place in what remains. Colours and marks are each used in turn. Their
    numbers, 8 and 15, have no common divisor, so that all 120 pairs come up before one returns. From there on
    the mark is the place itself.
    """
    if variant in _KNOWN:
        colour, marker = _KNOWN[variant]
        return {"color": colour, "marker": marker}
    place = [name for name in variants if name not in _KNOWN].index(variant)
    n_pairs = len(_COLOURS) * len(_MARKERS)
    marker = _MARKERS[place % len(_MARKERS)] if place < n_pairs else f"${place}$"
    return {"color": _COLOURS[place % len(_COLOURS)], "marker": marker}


def learner_style(variant: str, observation: str, variants: Sequence[str]) -> dict[str, Any]:
    """Returns the colour, mark and dash of a learner: those of its variant, by its observation."""
    style = variant_style(variant, variants)
    if tint := _TINTS.get(observation):
        style["color"] = _lighter(style["color"], tint)
    return {**style, "ls": _DASHES.get(observation, "-")}


def _lighter(colour: Any, share: float) -> str:
    red, green, blue = (part + share * (1 - part) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def in_dark(colour: str) -> str:
    """Returns a colour as it is seen on a dark ground: the darker, the more it is lightened."""
    red, green, blue = to_rgb(colour)
    brightness = 0.3 * red + 0.59 * green + 0.11 * blue
    return _lighter(colour, max(0.0, 0.75 - 1.3 * brightness))


_DRAWN: Final = [
    _lighter(colour, tint)
    for colour in (*(colour for colour, _ in _KNOWN.values()), *_COLOURS, *map(to_hex, COLOURS))
    for tint in (0, *_TINTS.values())
]
_IN_DARK: Final = {colour: in_dark(colour) for colour in _DRAWN}


def norm_of(values: pd.Series) -> Normalize:
    """Returns the colour scale that spans all these values; of both signs, its middle is zero."""
    low, high = float(values.min()), float(values.max())
    if low < 0 < high:
        high = max(-low, high)
        low = -high
    return Normalize(low, high)
