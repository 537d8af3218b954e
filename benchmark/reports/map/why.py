"""Items on why: which measure of a scenario goes with whose cost."""

import math
from collections.abc import Iterator
from functools import lru_cache
from textwrap import fill
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import stats

from agents.hardness import Hardness, hardness
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate
from benchmark.drawing.style import figure_of
from benchmark.drawing.tables import link
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding, Frames, item, no_rows
from benchmark.reports.learners import Names
from benchmark.reports.map.data import Maps
from benchmark.reports.map.figures import styles
from envs import Scenario
from envs.observations import compile_seen

_MEASURES: Final = {
    "covering_steps": "covering steps of the random policy",
    "solvable_k": "smallest k of QVI-solvability",
    "reciprocal_gaps": "sum of reciprocal action gaps",
    "error_across_places": "error of the nearest other place",
    "error_nearby": "error of the nearest observation",
}
_LINEAR: Final = ("error_across_places", "error_nearby")  # measures between 0 and 1
_FEWEST: Final = 5  # cells for a correlation


@item("measures", "measures of every point, for the places of its first run", where=no_rows)
def measures(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates `agents.hardness`, beside the median steps."""
    seen: set[tuple[str, str, str]] = set()
    for cell, ends in data.ends.items():
        scenario = data.scenario(cell).drawn(data.experiment.algorithms[cell.variant].first_seed)
        key = scenario.model_dump_json(), cell.variant, cell.observation
        if data.is_reference(cell) or key in seen:
            continue  # a cell of several grids counts once
        seen.add(key)
        if scenario.following[0].shape[1] > 1:
            continue  # what follows an action is random
        found = _hardness(scenario, cell.observation, data.experiment.horizon)
        steps = float(data.medians(cell, "steps")[0])
        names = {"algorithm": cell.variant, "observation": cell.observation, "n": ends.n}
        yield {**data.key(cell), **names, **found._asdict(), "steps": steps}


@lru_cache(maxsize=1024)
def _hardness(scenario: Scenario, observation: str, horizon: int) -> Hardness:
    return hardness(compile_seen(scenario, observation), observation, horizon)


@item(
    "predictors",
    "exploratory: rank correlations of measures with median steps, over points and learners",
    {"family": "", "measure": "", "n": "points", "correlation": "rank correlation"},
)
def predictors(data: Maps) -> Iterator[dict[str, Any]]:
    """Tabulates Spearman's correlation, with an interval by resampling cells.

    Median steps that are not known, as most runs never solve, rank last.
    """
    frame = measures.table(data)
    if frame is None:
        return
    for family, rows in frame.groupby(_families(frame, data), sort=False):
        for name in _MEASURES:
            known = rows[rows[name].notna()]
            if len(known) >= _FEWEST:
                yield {
                    "family": {"tabular": "tables", "deep": "nets"}[str(family)],
                    "measure": name,
                    "n": len(known),
                    "correlation": _correlation(known[name].to_numpy(float), known["steps"].to_numpy(float)),
                }


def _families(frame: pd.DataFrame, data: Maps) -> pd.Series:
    names = {(cell.variant, cell.observation): data.family(cell) for cell in data.ends}
    keys = zip(frame["algorithm"], frame["observation"], strict=True)
    return pd.Series([names[key] for key in keys], index=frame.index)


def _correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> Estimate:
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    drawn = [np.arange(len(x)), *rng.integers(len(x), size=(RESAMPLES, len(x)))]
    found = []
    for places in drawn:
        one, other = (stats.rankdata(each[places]) for each in (x, y))
        is_constant = np.ptp(one) == 0 or np.ptp(other) == 0
        found.append(math.nan if is_constant else float(np.corrcoef(one, other)[0, 1]))
    known = [each for each in found[1:] if not math.isnan(each)]
    low, high = np.percentile(known, [2.5, 97.5]) if known else (math.nan, math.nan)
    return Estimate(found[0], float(low), float(high))


@predictors.figure("Which measures of a scenario correlate with the steps that learners need.")
def _(tables: Frames, data: Maps) -> Figure | None:
    frame, found = tables["measures"], tables.get("predictors")
    if found is None:
        return None
    families, style, names = _families(frame, data), styles(data), Names.of(data.experiment)
    shown = [name for name in _MEASURES if name in set(found["measure"])]
    most = frame.loc[np.isfinite(frame["steps"]), "steps"].max() * 2
    with figure_of(2, len(shown), (min(2.4 * len(shown), 11.0), 5.6)) as (figure, axes):
        for row, (family, title) in enumerate({"tabular": "tables", "deep": "nets"}.items()):
            for axis, name in zip(axes[row], shown, strict=True):
                part = frame[(families == family) & frame[name].notna()]
                for (variant, observation), points in part.groupby(["algorithm", "observation"], sort=False):
                    look = style[f"{variant}, {observation}"]
                    y = points["steps"].where(np.isfinite(points["steps"]), most)
                    mark = {
                        "marker": look["marker"],
                        "color": look["color"],
                        "ls": "",
                        "mew": 0,
                        "alpha": 0.7,
                    }
                    axis.plot(points[name], y, ms=4.5, label=names(str(variant), str(observation)), **mark)
                is_it = (found["measure"] == name) & (found["family"] == title)
                for _, each in found[is_it].iterrows():
                    ends = f"[{each['correlation_low']:.2f}, {each['correlation_high']:.2f}]"
                    text = f"{title}: {each['correlation']:.2f} {ends}".replace("-", "−")
                    axis.set_title(text, fontsize="small")
                axis.set(yscale="log", xscale="linear" if name in _LINEAR else "log")
                axis.minorticks_off()
                if part.empty:
                    axis.set_axis_off()
                else:
                    axis.axhline(most, color="0.6", lw=0.6, ls=":")
                if row == 1 or frame.loc[families == "deep", name].isna().all():
                    axis.set_xlabel(fill(_MEASURES[name], 22), fontsize="small")
            axes[row, 0].set_ylabel(f"median steps of {title}")
        handles = {h.get_label(): h for axis in axes.flat for h in axis.get_legend_handles_labels()[0]}
        title = (
            "above each panel: rank correlation and its 95 % interval; on the dotted line: most runs never"
        )
        place: dict[str, Any] = {"loc": "outside lower center", "ncols": 3, "frameon": False}
        figure.legend(handles=[*handles.values()], title=title, **place)
    return figure


@predictors.sentence
def _(table: pd.DataFrame, _: Folder) -> Finding | None:
    """Says which measure goes best with the cost of tables, and which with that of nets."""
    parts = []
    for family, rows in table.groupby("family", sort=False):
        if rows["correlation"].isna().all():
            continue
        best = rows.iloc[int(np.nanargmax(rows["correlation"].abs()))]
        value = f"{best['correlation']:.2f}"
        name = _MEASURES[str(best["measure"])]
        parts.append(
            f"for {family}, the {name} ({link(value, 'predictors', best)} "
            f"[{best['correlation_low']:.2f}, {best['correlation_high']:.2f}])"
        )
    if not parts:
        return None
    return Finding(
        f"Exploratory: the measure with the largest rank correlation with median steps is, "
        f"{' and, '.join(parts)}. Intervals do not account for this choice."
    )
