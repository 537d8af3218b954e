"""The figure of growth: a data frame becomes a picture, and nothing is computed."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from benchmark.drawing.style import arm_style, figure_of

# What is counted to the curves against it, and what these are called.
PANELS: Final[Mapping[str, Mapping[str, str]]] = {
    "agents": {"agents_tables": "tables", "agents_nets": "nets"},
    "cells": {
        "cells_compile": "compile",
        "cells_solve": "solve",
        "cells_evaluate": "evaluate",
        "cells_train": "train one table",
    },
    "stored runs": {"runs_list": "list", "runs_resume": "resume", "runs_report": "report"},
}


def growth(frame: pd.DataFrame) -> Figure:
    """Draws time and peak memory against what grows, on logarithmic scales.

    Args:
      frame: A row per point: curve, size, seconds, slowest_seconds, peak_memory_mb.
    """
    with figure_of(2, len(PANELS), (10.5, 6.0)) as (figure, axes):
        for column, (unit, curves) in zip(axes.T, PANELS.items(), strict=True):
            for place, (name, label) in enumerate(curves.items()):
                # Where points coincide, the first is the largest.
                points, style = frame[frame["curve"] == name], arm_style(place) | {"markersize": 7 - place}
                sizes, seconds = points["size"], points["seconds"]
                column[0].plot(sizes, seconds, **style, lw=1.3, label=label)
                column[0].vlines(sizes, seconds, points["slowest_seconds"], color=style["color"], lw=1)
                column[1].plot(sizes, points["peak_memory_mb"], **style, lw=1.3)
            for axis in column:
                axis.set(xscale="log", yscale="log")
                axis.yaxis.set_major_formatter(StrMethodFormatter("{x:,g}"))
                axis.yaxis.set_minor_formatter(NullFormatter())
            column[1].set_xlabel(unit)
        axes[0, 0].set_ylabel("time in s")
        axes[1, 0].set_ylabel("peak memory in MB")
        for row in axes:  # whose axes share a scale
            lowest, highest = zip(*(axis.get_ylim() for axis in row), strict=True)
            for axis in row:
                axis.set_ylim(min(lowest), max(highest))
                _lines(axis, "linear growth" if axis is axes[0, 0] else None)
        for axis in axes[0]:
            axis.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=2, frameon=False)
        for axis in axes[1]:  # one power of ten needs more numbers
            axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    return figure


def _lines(axis: Axes, label: str | None) -> None:
    """Draws the slope of linear growth behind the curves, a line for each power of ten."""
    (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
    powers = np.arange(np.floor(np.log10(bottom / right)), np.ceil(np.log10(top / left)) + 1)
    ends = np.array([left, right])
    for power in powers:
        (line,) = axis.plot(ends, ends * 10**power, color="0.85", lw=0.8, zorder=0)
    line.set_label(label)
    axis.set(xlim=(left, right), ylim=(bottom, top))
