"""Figures of an equivalence: data frames become pictures, and nothing is computed.

Line, dash and marker tell arms from checks and verdicts apart, so that figures can be read in grey, too.
"""

from typing import Any, Final

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from benchmark.drawing.style import COLOURS, figure_of
from benchmark.reports.equivalence.data import Name
from benchmark.reports.equivalence.tables import VERDICTS

_MEASURES: Final = {"success": "success", "score_mean": "mean score"}
_ARM: Final[dict[str, Any]] = {"color": COLOURS[0], "lw": 1.6}
_CHECK: Final[dict[str, Any]] = {
    "color": "black",
    "lw": 1.0,
    "ls": (0, (3, 2)),
    "marker": "o",
    "ms": 3.5,
    "mfc": "white",
}
_BARS: Final = 8  # of a check's curve, about
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


def curves(frame: pd.DataFrame, pairs: pd.DataFrame) -> Figure:
    """Draws the success and the mean score of arms and of their checks over training.

    Args:
      frame: `benchmark.reports.equivalence.tables.curves`.
      pairs: `benchmark.reports.equivalence.tables.equivalence`.
    """
    scenarios = list(pairs["scenario"].unique())
    rows = list(dict.fromkeys(zip(pairs["algorithm"], pairs["observation"], pairs["check"], strict=True)))
    size = (11.0, 2.0 * len(rows) + 0.9)
    with figure_of(len(rows), len(scenarios) * len(_MEASURES), size) as (figure, axes):
        for line, (arm, observation, check) in zip(axes, rows, strict=True):
            panels = [(scenario, measure) for scenario in scenarios for measure in _MEASURES]
            for axis, (scenario, measure) in zip(line, panels, strict=True):
                of_arm, of_check = (_of(frame, Name(scenario, name, observation)) for name in (arm, check))
                ends = f"{measure}_low", f"{measure}_high"
                axis.plot(of_arm["step"], of_arm[measure], **_ARM)
                axis.fill_between(
                    of_arm["step"], *(of_arm[end] for end in ends), color=_ARM["color"], alpha=0.25, lw=0
                )
                _with_bars(axis, of_check, measure)
                axis.set(title=f"{scenario}: {_MEASURES[measure]}", xlim=(0, 1.03 * frame["step"].max()))
                lowest = float(frame[f"{measure}_low"].min()) if measure == "score_mean" else 0.0
                axis.set(ylim=(lowest - 0.05, 1.1))
                axis.xaxis.set_major_locator(MaxNLocator(3))
            line[0].set(ylabel=f"{arm}, {observation}")
        for axis in axes[-1]:
            axis.set(xlabel="environment step")
        arms, checks = (", ".join(pairs[key].unique()) for key in ("algorithm", "check"))
        figure.legend(
            handles=[Line2D([], [], label=arms, **_ARM), Line2D([], [], label=checks, **_CHECK)],
            loc="outside lower center",
            ncols=2,
            frameon=False,
            title="means over runs; bands and bars: 95 % intervals",
            handlelength=4,
        )
    return figure


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


def _with_bars(axis: Axes, rows: pd.DataFrame, measure: str) -> None:
    """Draws a check's curve with some of its intervals."""
    every = max(len(rows) // _BARS, 1)
    first = (len(rows) - 1) % every  # so that the last step is among them
    axis.plot(rows["step"], rows[measure], markevery=(first, every), **_CHECK)
    some = rows.iloc[first::every]
    axis.vlines(some["step"], some[f"{measure}_low"], some[f"{measure}_high"], color=_CHECK["color"], lw=1.0)


def _of(frame: pd.DataFrame, name: Name) -> pd.DataFrame:
    """Returns the rows of a population."""
    return frame[(frame[list(Name._fields)] == list(name)).all(axis=1)]
