"""The figure of an equivalence: a data frame becomes a picture, and nothing is computed."""

from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from benchmark.drawing.style import COLOURS, figure_of
from benchmark.reports.equivalence.tables import VERDICTS

_VERDICTS: Final[dict[str, dict[str, Any]]] = dict(
    zip(
        VERDICTS,
        (
            {"marker": "o", "color": COLOURS[0]},
            {"marker": "X", "color": COLOURS[3]},
            {"marker": "o", "color": "0.45", "mfc": "white"},
        ),
        strict=True,
    )
)


def equivalence(pairs: pd.DataFrame) -> Figure:
    """Draws the differences of arms and their checks, with the margin and the verdicts.

    Args:
      pairs: `benchmark.reports.equivalence.tables.equivalence`.
    """
    margin = float(pairs["margin"].iloc[0])
    with figure_of(1, 2, (11.0, 0.36 * len(pairs) + 1.6)) as (figure, axes):
        success, score = axes[0]
        success.axvspan(-margin, margin, color="0.92", lw=0)
        for y, (_, row) in enumerate(pairs.iterrows()):
            style = _VERDICTS[row["verdict"]]
            for axis, key in ((success, "success_difference"), (score, "score_difference")):
                axis.plot([row[f"{key}_low"], row[f"{key}_high"]], [y, y], color=style["color"], lw=1.2)
            ends = [row["success_difference_low_90"], row["success_difference_high_90"]]
            success.plot(ends, [y, y], color=style["color"], lw=3.6, solid_capstyle="butt")
            success.plot(row["success_difference"], y, ms=7, **style)
            score.plot(row["score_difference"], y, ms=7, **style)
            success.text(1.02, y, row["verdict"], va="center", transform=success.get_yaxis_transform())
        names = [
            f"{row.scenario}: {row.algorithm} − {row.check}, {row.observation}" for row in pairs.itertuples()
        ]
        for axis in (success, score):
            axis.set_yticks(range(len(pairs)), names if axis is success else [])
            axis.set(ylim=(len(pairs) - 0.5, -0.5))
            axis.axvline(0.0, color="0.35", lw=0.8, ls=":")
            axis.tick_params(axis="y", length=0)
            axis.locator_params(axis="x", nbins=6)
        success.text(1.02, 1.02, "verdict", transform=success.transAxes)
        success.set(title="difference in success")
        score.set(title="difference in mean score")
        figure.supxlabel(
            f"thick: 90 % interval; thin: 95 % interval; grey band: margin of {margin:g}; "
            "colour and marker: verdict on success",
            fontsize="small",
        )
    return figure
