"""What all figures share: style, colours, markers, and how they are written."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")

import pandas as pd
import seaborn as sns
from matplotlib import pyplot as plt
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from envs import InputError

COLOURS: Final = sns.color_palette("colorblind")
# Of an experiment's variants, in their order. `compare_deep` declares its tables first: black and grey.
_VARIANT_COLOURS: Final = ("black", "0.5", *(COLOURS[i] for i in (0, 2, 3, 9, 1, 4)))
_VARIANT_MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X", "h", "<", ">", "p", "*", "d", "8", "H")
_RC: Final = {
    **sns.axes_style("ticks"),
    **sns.plotting_context("paper", font_scale=1.1),
    "svg.hashsalt": "proxemic",  # otherwise equal figures get different identifiers
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
        dpi: Any = 160 if path.suffix.lower() == ".png" else "figure"
        figure.savefig(path, dpi=dpi, metadata=metadata, **options)


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


def variant_style(place: int) -> dict[str, Any]:
    """Returns the colour and marker of a variant by its place in the experiment; no two share both.

    Colours and markers are each used in turn. Their numbers, 8 and 15, have no common divisor, so that
    all 120 pairs come up before one returns. From there on the marker is the place itself.
    """
    n_pairs = len(_VARIANT_COLOURS) * len(_VARIANT_MARKERS)
    marker = _VARIANT_MARKERS[place % len(_VARIANT_MARKERS)] if place < n_pairs else f"${place}$"
    return {"color": _VARIANT_COLOURS[place % len(_VARIANT_COLOURS)], "marker": marker}


def norm_of(values: pd.Series) -> Normalize:
    """Returns the colour scale that spans all these values."""
    return Normalize(float(values.min()), float(values.max()))
