"""Draws differences between learners with their intervals, margins and verdicts."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, NO_VERDICT, UNDECIDED, WORSE
from benchmark.drawing.style import COLOURS, figure_of

DIFFERENT: Final = "different"  # of a pair in which neither side should be better
_VERDICTS: Final[dict[str, dict[str, Any]]] = {
    BETTER: {"marker": "^", "color": COLOURS[2]},
    WORSE: {"marker": "v", "color": COLOURS[3]},
    DIFFERENT: {"marker": "X", "color": COLOURS[3]},
    EQUIVALENT: {"marker": "o", "color": COLOURS[0]},
    UNDECIDED: {"marker": "o", "color": "0.45", "mfc": "white"},
    NO_VERDICT: {"marker": "x", "color": "0.45"},
}


def differences(frame: pd.DataFrame, names: Sequence[str], endpoints: Mapping[str, str]) -> Figure:
    """Draws a row per pair and a column per endpoint.

    Args:
      frame: Columns that begin with an endpoint's name: `_difference` with the ends of its intervals (`_low`,
        `_high`, `_low_90`, `_high_90`), `_margin` and `_verdict`.
      names: Of the rows.
      endpoints: Name to label.
    """
    with figure_of(1, len(endpoints), (11.0, 0.36 * len(frame) + 1.7)) as (figure, axes):
        for axis, (key, label) in zip(axes[0], endpoints.items(), strict=True):
            margin = float(frame[f"{key}_margin"].iloc[0])
            axis.axvspan(-margin, margin, color="0.92", lw=0)
            axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
            for y, (_, row) in enumerate(frame.iterrows()):
                style = _VERDICTS[row[f"{key}_verdict"]]
                ends, inner = (
                    [row[f"{key}_difference_low{end}"], row[f"{key}_difference_high{end}"]]
                    for end in ("", "_90")
                )
                axis.plot(ends, [y, y], color=style["color"], lw=1.2)
                axis.plot(inner, [y, y], color=style["color"], lw=3.6, solid_capstyle="butt")
                axis.plot(row[f"{key}_difference"], y, ms=7, **style)
                verdict = row[f"{key}_verdict"]
                axis.text(1.02, y, verdict, va="center", transform=axis.get_yaxis_transform())
            axis.set_yticks(range(len(frame)), names if axis is axes[0, 0] else [])
            axis.set(ylim=(len(frame) - 0.5, -0.5), title=label, xlabel="difference")
            axis.tick_params(axis="y", length=0)
            axis.locator_params(axis="x", nbins=5)
        figure.supxlabel(
            "thick: 90 %, thin: 95 % interval, not adjusted; grey band: margin; colour, marker and word: "
            "verdict",
            fontsize="small",
        )
    return figure
