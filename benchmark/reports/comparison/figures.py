"""Figures of a comparison: data frames become pictures, and nothing is computed.

Colour and marker show the algorithm, so that figures can be read in grey, too; dashes show the observation.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.maps import colour_bar, dots, heat, region_legend, triangles
from benchmark.drawing.style import arm_style, figure_of
from benchmark.reports.comparison.tables import METRICS
from envs import Model
from envs.scene import colour_limits, scene_of

_DASHES: Final = {"index": "-", "one_hot": "-", "coordinates": (0, (4, 1.5))}
_FLOOR: Final = -4.0  # scores below are not drawn
_LABELS: Final = {
    "score": "score (0 random, 1 optimal)",
    "iqm": "interquartile mean",
    "median": "median",
    "mean": "mean",
    "optimality_gap": "optimality gap",
}

Learners = Sequence[tuple[str, str]]  # (algorithm, observation)
Panels = Mapping[str, Learners]  # title to the learners drawn there


def curves(frame: pd.DataFrame, panels: Panels, x: str, label: str) -> Figure:
    """Draws the mean score of the greedy policy over training, with its interval.

    The mean shows runs that fail, which the interquartile mean leaves out.

    Args:
      frame: `benchmark.reports.comparison.tables.curves` or `curves_cpu`.
      panels: One row each.
      x: The column to draw against; seconds are drawn on a logarithmic axis.
      label: What it is.
    """
    scenarios = list(frame["scenario"].unique())
    if x == "cpu_time_s":
        frame = frame[frame["step"] > 0]  # no time has passed, which has no logarithm
    with figure_of(len(panels), len(scenarios), (11.0, 2.6 * len(panels) + 1.0)) as (figure, axes):
        for row, (title, learners) in enumerate(panels.items()):
            for column, scenario in enumerate(scenarios):
                axis = axes[row, column]
                for learner in learners:
                    rows = _of(frame, learner, scenario)
                    _curve(axis, rows, x, "score_mean", learner, frame)
                axis.axhline(1.0, color="0.35", lw=0.8, ls=":")
                axis.axhline(0.0, color="0.35", lw=0.8, ls=":")
                lowest = max(float(frame["score_mean"].min()) - 0.15, _FLOOR)
                axis.set(ylim=(lowest, 1.15), title=f"{scenario}, {title}")
                axis.set(xlim=(float(frame[x].min()), float(frame[x].max())))
                if x == "cpu_time_s":
                    axis.set_xscale("log")
                else:
                    axis.xaxis.set_major_locator(MaxNLocator(4))
            axes[row, 0].set(ylabel=_LABELS["score"])
        for axis in axes[-1]:
            axis.set(xlabel=label)
        _legend(
            figure,
            frame,
            f"line: mean over runs; shade: 95 % interval; scores below {_FLOOR:g} are not drawn",
        )
    return figure


def disagreements(frame: pd.DataFrame, panels: Panels) -> Figure:
    """Draws how often the issuer disagreed while agents learned.

    Args:
      frame: `benchmark.reports.comparison.tables.curves`.
      panels: One row each.
    """
    scenarios = list(frame["scenario"].unique())
    with figure_of(len(panels), len(scenarios), (11.0, 2.4 * len(panels) + 1.0)) as (figure, axes):
        for row, (title, learners) in enumerate(panels.items()):
            for column, scenario in enumerate(scenarios):
                axis = axes[row, column]
                for learner in learners:
                    rows = _of(frame, learner, scenario).iloc[1:]
                    _curve(axis, rows, "step", "disagreements", learner, frame)
                axis.set(title=f"{scenario}, {title}", xlim=(0, float(frame["step"].max())))
                axis.set(ylim=(0, float(frame["disagreements"].max()) * 1.05))
                axis.xaxis.set_major_locator(MaxNLocator(4))
            axes[row, 0].set(ylabel="wrong PINGs\nper 1,000 steps")
        for axis in axes[-1]:
            axis.set(xlabel="environment step")
        _legend(figure, frame, "line: mean over runs; shade: 95 % interval")
    return figure


def aggregate(frame: pd.DataFrame) -> Figure:
    """Draws rliable's aggregates over all scenarios with their intervals.

    Args:
      frame: `benchmark.reports.comparison.tables.aggregate`.
    """
    shown = frame[(frame["policy"] == "greedy") & (frame["evaluated_from"] == "start")]
    learners = _learners(shown)
    with figure_of(1, len(METRICS), (11.0, 0.36 * len(learners) + 1.5)) as (figure, axes):
        for column, metric in enumerate(METRICS):
            axis = axes[0, column]
            for y, learner in enumerate(learners):
                row = shown[_is(shown, learner) & (shown["metric"] == metric)].iloc[0]
                _interval(axis, row["value"], row["low"], row["high"], y, learner, shown)
            _rows(axis, learners, first=column == 0)
            axis.set(title=_LABELS[metric], xlabel="score missed" if metric == "optimality_gap" else "score")
            axis.xaxis.set_major_locator(MaxNLocator(4))
            axis.axvline(0.0 if metric == "optimality_gap" else 1.0, color="0.35", lw=0.8, ls=":")
        figure.supxlabel(
            "greedy policies after training, all scenarios; bar: 95 % interval", fontsize="small"
        )
    return figure


def profile(frame: pd.DataFrame, panels: Panels) -> Figure:
    """Draws performance profiles: the share of runs whose score is above a number.

    Args:
      frame: `benchmark.reports.comparison.tables.profile`.
      panels: One column each.
    """
    with figure_of(1, len(panels), (11.0, 4.2)) as (figure, axes):
        for column, (title, learners) in enumerate(panels.items()):
            axis = axes[0, column]
            for learner in learners:
                _curve(axis, frame[_is(frame, learner)], "score", "share", learner, frame)
            axis.set(title=title, xlabel="score (0 random, 1 optimal)", xlim=(0, 1), ylim=(-0.03, 1.03))
        axes[0, 0].set(ylabel="share of runs above that score")
        _legend(
            figure, frame, "line: all scenarios alike; shade: 95 % interval; scores below 0 are not drawn"
        )
    return figure


def improvement(frame: pd.DataFrame) -> Figure:
    """Draws the probability that a run of one learner outscores one of another.

    Args:
      frame: `benchmark.reports.comparison.tables.improvement`.
    """
    names = list(dict.fromkeys(frame["x"]))
    names += [name for name in dict.fromkeys(frame["y"]) if name not in names]
    wide = frame.pivot(index="x", columns="y", values="probability").loc[names, names]
    with figure_of(1, 1, (9.0, 6.0)) as (figure, axes):
        axis = axes[0, 0]
        image = axis.imshow(wide.to_numpy(), cmap="cividis", norm=Normalize(0, 1), aspect="auto")
        for x, y, p, low, high in frame[["x", "y", "probability", "low", "high"]].to_numpy():
            sure = low > 0.5 or high < 0.5
            axis.text(
                names.index(y), names.index(x), f"{p:.2f}{'*' if sure else ''}",
                ha="center", va="center", fontsize="small", color="black" if p > 0.55 else "white",
            )  # fmt: skip
        axis.set_xticks(range(len(names)), [name.replace(", ", ",\n") for name in names], rotation=90)
        axis.set_yticks(range(len(names)), names)
        axis.set(ylabel="how probably a run of this learner", xlabel="outscores a run of this one")
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        figure.colorbar(image, ax=axis, label="probability; * its 95 % interval leaves out 0.5")
    return figure


def threshold(frame: pd.DataFrame) -> Figure:
    """Draws the share of runs that reach a good score, and the share that stays there.

    Args:
      frame: `benchmark.reports.comparison.tables.threshold`.
    """
    return _by_scenario(
        frame,
        {
            "reached_share": f"share of runs that ever score {GOOD_SCORE:g}",
            "stays_share": "share that stays there to the end",
        },
    )


def region(frame: pd.DataFrame) -> Figure:
    """Draws how well the cells where agents value PING match the target region.

    Args:
      frame: `benchmark.reports.comparison.tables.region`.
    """
    labels = {"precision": "precision", "recall": "recall", "overlap": "intersection over union"}
    return _by_scenario(frame, labels)


def maps(
    frame: pd.DataFrame,
    models: Mapping[str, Model],
    learners: Learners,
    action: str,
    label: str,
    limits: tuple[float, float] | None = None,
) -> Figure:
    """Draws the same map of every learner and scenario, on one colour scale.

    Args:
      frame: `benchmark.reports.comparison.tables.maps`.
      models: Scenario to compiled scenario, the columns.
      learners: The rows.
      action: `"PING"`, or `"moves"` for all others at once.
      label: What the colours are.
      limits: The ends of the colour scale; by default those of the middle 98 % of the values.
    """
    is_ping = frame["action"] == "PING"
    is_shown = np.logical_or.reduce([_is(frame, learner) for learner in learners])
    shown = frame[is_shown & (is_ping if action == "PING" else ~is_ping)]
    norm = Normalize(*(limits or colour_limits(shown["value"].to_numpy())))
    with figure_of(len(learners), len(models), (11.0, 2.75 * len(learners) + 0.9)) as (figure, axes):
        for row, learner in enumerate(learners):
            for column, (scenario, model) in enumerate(models.items()):
                values, axis, scene = _of(shown, learner, scenario), axes[row, column], scene_of(model)
                if action == "PING":
                    heat(axis, scene, values["value"].to_numpy(), norm)
                    dots(axis, values[values["marked"] > 0.5])
                else:
                    triangles(axis, scene, values, norm, "value")
                axis.set(title=f"{scenario}: {', '.join(learner)}")
        colour_bar(figure, list(axes.flat), norm, label, extend="neither" if limits else "both")
        marks = {
            "PING": Line2D(
                [], [], ls="", marker="o", color="black", ms=3, label="where most runs value PING"
            ),
            "moves": Line2D(
                [], [], ls="", marker=">", mfc="0.7", mec="none", ms=7, label="the move that way"
            ),
        }
        region_legend(figure, marks[action])
    return figure


def _by_scenario(frame: pd.DataFrame, labels: Mapping[str, str]) -> Figure:
    """Draws columns that lie in [0, 1] as dots with intervals: a row a scenario, a panel a column."""
    scenarios, learners = list(frame["scenario"].unique()), _learners(frame)
    size = (11.0, (0.27 * len(learners) + 0.75) * len(scenarios) + 0.4)
    with figure_of(len(scenarios), len(labels), size) as (figure, axes):
        for row, scenario in enumerate(scenarios):
            for column, (name, label) in enumerate(labels.items()):
                axis = axes[row, column]
                for y, learner in enumerate(learners):
                    learned = _of(frame, learner, scenario).iloc[0]
                    ends = learned[f"{name}_low"], learned[f"{name}_high"]
                    _interval(axis, learned[name], *ends, y, learner, frame)
                _rows(axis, learners, first=column == 0)
                axis.set(title=f"{scenario}: {label}", xlim=(-0.03, 1.03))
        figure.supxlabel("bar: 95 % interval over runs", fontsize="small")
    return figure


def _learners(frame: pd.DataFrame) -> list[tuple[str, str]]:
    """Lists the learners in a frame, in its order."""
    return list(dict.fromkeys(zip(frame["algorithm"], frame["observation"], strict=True)))


def _is(frame: pd.DataFrame, learner: tuple[str, str]) -> NDArray[np.bool_]:
    """Returns which rows are a learner's."""
    rows = (frame["algorithm"] == learner[0]) & (frame["observation"] == learner[1])
    return np.asarray(rows.to_numpy())


def _of(frame: pd.DataFrame, learner: tuple[str, str], scenario: str) -> pd.DataFrame:
    """Returns the rows of a learner in a scenario."""
    return frame[_is(frame, learner) & (frame["scenario"] == scenario).to_numpy()]


def _style(learner: tuple[str, str], frame: pd.DataFrame) -> dict[str, Any]:
    """Returns a learner's colour, marker and dash, the same in every figure of a comparison."""
    place = list(dict.fromkeys(frame["algorithm"])).index(learner[0])
    return {**arm_style(place), "ls": _DASHES.get(learner[1], "-")}


def _curve(
    axis: Axes, rows: pd.DataFrame, x: str, y: str, learner: tuple[str, str], frame: pd.DataFrame
) -> None:
    """Draws a line with its interval, and some markers."""
    style = _style(learner, frame)
    low, high = ("low", "high") if y == "share" else (f"{y}_low", f"{y}_high")
    axis.plot(rows[x], rows[y], lw=1.3, ms=4, markevery=max(len(rows) // 6, 1), **style)
    axis.fill_between(rows[x], rows[low], rows[high], color=style["color"], alpha=0.12, lw=0)


def _interval(
    axis: Axes, value: float, low: float, high: float, y: int, learner: tuple[str, str], frame: pd.DataFrame
) -> None:
    """Draws a dot with its interval; nothing where there is no number."""
    style = _style(learner, frame)
    axis.plot([low, high], [y, y], color=style["color"], ls=style["ls"], lw=2.2, alpha=0.6)
    axis.plot(value, y, color=style["color"], marker=style["marker"], ms=6, mec="white", mew=0.6)


def _rows(axis: Axes, learners: Learners, *, first: bool) -> None:
    """Names the rows of dots, from top to bottom."""
    axis.set_yticks(range(len(learners)), [", ".join(learner) for learner in learners] if first else [])
    axis.set(ylim=(len(learners) - 0.5, -0.5))
    axis.grid(axis="y", lw=0.4, color="0.85")
    axis.tick_params(axis="y", length=0)


def _legend(figure: Figure, frame: pd.DataFrame, title: str) -> None:
    """Draws the legend that names each learner's line."""
    handles = [
        Line2D([], [], label=", ".join(learner), lw=1.3, ms=5, **_style(learner, frame))
        for learner in _learners(frame)
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=4, frameon=False, title=title, handlelength=3
    )
