"""Items of the report on a search: what was chosen, what that bought, and what it cost."""

import json
import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from benchmark.analysis.intervals import Estimate, interval, resample
from benchmark.analysis.search import Searched
from benchmark.drawing.maps import gallery
from benchmark.drawing.style import figure_of, learner_style
from benchmark.drawing.tables import decimals_of, link
from benchmark.experiments.search import Choice, Space, Span
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding, Frames, drawing, entry, item, no_rows
from benchmark.reports.learners import Names
from benchmark.reports.search.runs import KEY, Searches, expected_best, gain, mean
from envs import compile_scenario

_AREA: Final = "mean area under the curve of success"
_TITLES: Final = {"tabular": "tables", "deep": "nets"}
_KINDS: Final = {"tabular": "table", "deep": "net"}
_TICKS: Final = (1, 2, 4, 8, 16, 32)  # of trials
_SOME: Final = (1, 4, 16)  # numbers of trials that readers see
_CLOSE: Final = 0.05  # areas that differ by less are close to each other


@item(
    "chosen",
    "the chosen settings of each learner, and its areas under the curve of success on fresh runs",
    {
        **KEY,
        "trial": "",
        "settings": "",
        "default": "default settings",
        "chosen": "chosen settings",
        "gain": "gain",
        "per_scenario": "the best per scenario",
        "sensitivity": "gain per scenario",
        "found": "mean on the first runs",
    },
    best="chosen",
)
def chosen(data: Searches) -> Iterator[dict[str, Any]]:
    """Tabulates means over scenarios on fresh runs. `found` is the mean of the best trial's first runs."""
    for each in data.learners:
        best, default = each.everywhere(each.chosen), each.everywhere(0)
        names = each.experiment.scenarios
        apart = [each.fresh[trial, scenario] for trial, scenario in zip(each.best, names, strict=True)]
        yield _names(each) | {
            "trial": each.chosen,
            "settings": _text(each.settings(each.chosen), each),
            "default": mean(default),
            "chosen": mean(best),
            "gain": gain(best, default),
            "per_scenario": mean(apart),
            "sensitivity": gain(apart, best),
            "found": float(each.searched[each.finalists[0]].mean()),
        }


def headline(folder: Folder) -> Finding:
    """Says what the best table and the best net gain by chosen settings."""
    table, search = folder.frame("chosen"), folder.manifest["facts"]["search"]

    families, parts = folder.manifest["facts"]["families"], []
    for family, kind in _KINDS.items():
        rows = table[[families[_name(row)] == family for _, row in table.iterrows()]]
        if len(rows):
            best = rows.iloc[int(rows["chosen"].argmax())]
            ends = [link(f"{best[key]:.2f}", "chosen", best) for key in ("default", "chosen")]
            name = folder.names.told(_name(best))
            parts.append(f"from {ends[0]} to {ends[1]} for the best {kind}, {name}")
    return Finding(
        f"With the best of the defaults and {search['trials']} trials, success averaged over training goes "
        f"{', and '.join(parts)}. Means are over {len(folder.manifest['scenarios'])} "
        f"scenarios, with {search['seeds']} fresh runs in each."
    )


@item("best_of", "the expected area of the best of b trials")
def best_of(data: Searches) -> Iterator[dict[str, Any]]:
    """Tabulates `expected_best` of the trials without trial 0, with intervals over trials.

    Beyond a third of the trials there are none: the bootstrap of a maximum has too narrow ones there.
    """
    for each in data.learners:
        areas = each.searched[1:]
        samples = expected_best(areas, resample(len(areas), each.name), len(areas))
        low, high = interval(samples)
        per_trial = _budget(each) * areas[0].size
        for i, value in enumerate(samples[0]):
            ends = (min(low[i], value), max(high[i], value)) if i < len(areas) // 3 else (math.nan, math.nan)
            yield _names(each) | {
                "trials": i + 1,
                "steps": (i + 1) * per_trial,
                "expected": Estimate(value, *ends),
            }


@best_of.figure("What tuning buys: the result that is expected of the best of b trials.")
def _(tables: Frames, data: Searches) -> Figure:
    frame, default = tables["best_of"], tables["chosen"]
    families: Any = data.facts["families"]
    panels = [family for family in _TITLES if family in families.values()]
    million = (frame["steps"] / frame["trials"]).iloc[0] / 1e6
    with figure_of(1, len(panels), (11.0, 5.0)) as (figure, axes):
        for axis, family in zip(axes[0], panels, strict=True):
            of_family = [row for _, row in default.iterrows() if families[_name(row)] == family]
            for place, each in enumerate(of_family):
                rows, style = frame[_is_of(frame, each)], _style(each, data)
                axis.plot(rows["trials"], rows["expected"], markevery=(place, 12), ms=5, lw=1.4, **style)
                ends = rows["expected_low"], rows["expected_high"]
                axis.fill_between(rows["trials"], *ends, color=style["color"], alpha=0.1, lw=0)
                axis.plot(0.8, each["default"], "x", ms=6, mew=1.8, color=style["color"])
            axis.set(xscale="log", xlabel="trials (cross: default settings)", ylim=(-0.02, 1.0))
            axis.set_xticks(_TICKS, [str(tick) for tick in _TICKS])
            steps = axis.secondary_xaxis("top")
            steps.set_xticks(_TICKS, [f"{tick * million:.3g}" for tick in _TICKS])
            steps.set_xlabel("million environment steps of the search")
            for each in (axis.xaxis, steps.xaxis):
                each.set_minor_locator(NullLocator())
            axis.set_title(_TITLES[family], fontweight="bold")
            handles = [Line2D([], [], label=_title(row, data), **_style(row, data)) for row in of_family]
            place_below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13)}
            axis.legend(handles=handles, **place_below, ncols=2, frameon=False, handlelength=3)
        axes[0, 0].set_ylabel(_AREA)
    return figure


@best_of.shown
def _(table: pd.DataFrame) -> pd.DataFrame:
    """Shows a row per learner: some numbers of trials, and how many come close to all of them."""
    n = int(table["trials"].max())
    shown = []
    groups = [rows for _, rows in table.groupby("learner", sort=False)]
    digits = decimals_of(table["expected"], is_bounded=True)
    for rows in sorted(groups, key=lambda rows: -rows["expected"].iloc[-1]):
        row: dict[str, Any] = {"learner": rows["learner"].iloc[0]}
        for b in dict.fromkeys([*(b for b in _SOME if b < n), n]):
            (_, one), *_ = rows[rows["trials"] == b].iterrows()
            row[f"best of {b}"] = entry(one, "expected", "best_of", digits)
        is_close = rows["expected"] >= rows["expected"].iloc[-1] - _CLOSE
        row[f"trials needed to come within {_CLOSE} of the best of {n}"] = (
            f"{rows.loc[is_close, 'trials'].iloc[0]}"
        )
        shown.append(row)
    return pd.DataFrame(shown)


@item(
    "cost",
    "cost of the search, excluding the runs that vary the chosen settings",
    {
        **KEY,
        "trials": "",
        "runs": "",
        "steps": "environment steps",
        "cpu_time_s": "CPU seconds",
        "cpu_ms": "CPU ms per run",
    },
    is_measured=True,
    best="-cpu_time_s",
)
def cost(data: Searches) -> Iterator[dict[str, Any]]:
    """Tabulates the effort of each search; `cpu_ms` is the mean time that a run of the search trains."""
    for each in data.learners:
        found = each.result()
        took = found.model_dump(include={"trials", "runs", "steps", "cpu_time_s"})
        yield _names(each) | took | {"cpu_ms": 1000 * found.cpu_time_s / found.runs}


@item("trials", "every trial of every learner: settings, and mean areas by scenario", where=no_rows)
def trials(data: Searches) -> Iterator[dict[str, Any]]:
    """Tabulates the means over the first runs of each trial, and over fresh runs where there are any."""
    for each in data.learners:
        names = each.experiment.scenarios
        for trial, areas in enumerate(each.searched):
            fresh = [
                each.fresh[trial, name].mean() if (trial, name) in each.fresh else math.nan for name in names
            ]
            yield _names(each) | {
                "trial": trial,
                "settings": _text(each.settings(trial), each),
                "area": float(areas.mean()),
                "fresh_area": float(np.mean(fresh)),
                **dict(zip(names, areas.mean(axis=1).tolist(), strict=True)),
            }


@trials.figure("What each trial of the search reached, and what the chosen settings reach in fresh runs.")
def _(tables: Frames, data: Searches) -> Figure:
    frame, chosen_ones = tables["trials"], tables["chosen"]
    with figure_of(1, 1, (9.0, 0.3 * len(chosen_ones) + 1.2)) as (figure, axes):
        axis = axes[0, 0]
        for y, (_, row) in enumerate(chosen_ones.iterrows()):
            rows, style = frame[_is_of(frame, row)], _style(row, data)
            axis.plot(rows["area"][1:], [y] * (len(rows) - 1), "|", ms=9, mew=0.9, color="0.55")
            axis.plot(row["default"], y, "x", ms=7, mew=2, color="black")
            ends = [row["chosen_low"], row["chosen_high"]]
            axis.plot(ends, [y, y], lw=3, alpha=0.5, color=style["color"])
            axis.plot(row["chosen"], y, style["marker"], ms=7, color=style["color"], mec="white", mew=0.4)
        names = [_title(row, data) for _, row in chosen_ones.iterrows()]
        axis.set_yticks(range(len(names)), names)
        axis.set(ylim=(len(names) - 0.5, -0.5), xlim=(-0.02, 1.0), xlabel=f"{_AREA}, over scenarios")
        axis.grid(axis="y", lw=0.4, color="0.85")
        axis.tick_params(axis="y", length=0)
        handles = [
            Line2D([], [], ls="", marker="|", ms=9, color="0.55", label="a trial"),
            Line2D([], [], ls="", marker="x", mew=2, color="black", label="default settings"),
            Line2D([], [], lw=3, marker="o", color="0.4", label="chosen settings, 95 % interval"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False)
    return figure


@item(
    "importance",
    "how much of the variance between trials is due to each setting by itself",
    where=no_rows,
)
def importance(data: Searches) -> Iterator[dict[str, Any]]:
    """Tabulates the shares by functional ANOVA (Hutter et al. 2014), as Optuna computes them.

    It is one of a random forest that is fitted to the trials. The rest is due to settings together.
    """
    for each in data.learners:
        space = each.experiment.algorithms[each.variant].search
        settings = [_values(each.settings(trial), space) for trial in range(1, each.n_trials)]
        shares = _shares(space, settings, each.searched[1:].mean(axis=(1, 2)).tolist())
        for key in space:
            yield _names(each) | {"setting": key, "share": shares[key]}


@importance.figure("Which settings the result of a trial depends on: shares of the variance between trials.")
def _(tables: Frames, data: Searches) -> Figure:
    frame = tables["importance"]
    table = frame.assign(learner=[_title(row, data) for _, row in frame.iterrows()]).pivot_table(
        index="learner", columns="setting", values="share", sort=False
    )
    n_rows, n_columns = table.shape
    with figure_of(1, 1, (0.6 * n_columns + 2.6, 0.27 * n_rows + 1.4)) as (figure, axes):
        axis = axes[0, 0]
        edges = np.arange(n_columns + 1) - 0.5, np.arange(n_rows + 1) - 0.5
        axis.pcolormesh(*edges, table, cmap="Greys", vmin=0, vmax=1)
        for (row, column), value in np.ndenumerate(table.to_numpy()):
            if not math.isnan(value):
                ink = "white" if value > 0.55 else "black"
                axis.text(column, row, f"{value:.2f}", ha="center", va="center", color=ink)
        names = [_in_words(str(key)) for key in table]
        axis.set_xticks(range(n_columns), names, rotation=35, ha="left", rotation_mode="anchor")
        axis.set_yticks(range(n_rows), table.index)
        axis.set(ylim=(n_rows - 0.5, -0.5))
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
    return figure


@item(
    "around",
    "one setting at a time around the chosen ones",
    {**KEY, "setting": "", "value": "", "n": "runs", "area": "", "difference": "difference from the chosen"},
    where=no_rows,
)
def around(data: Searches) -> Iterator[dict[str, Any]]:
    """Tabulates the chosen settings, and the same with one setting at another value, on runs of their own."""
    for each in data.learners:
        found = {key: _by_scenario(each, key) for key in each.around}
        for (setting, value), areas in found.items():
            yield _names(each) | {
                "setting": setting or "none",
                "value": value or "as chosen",
                "n": sum(map(len, areas)),
                "area": mean(areas),
                "difference": gain(areas, found["", ""]),
            }


@around.figure("What changes if one of the chosen settings is changed.")
def _(tables: Frames, data: Searches) -> Figure:
    """Draws a row of panels per algorithm, and a panel per form of observation."""
    frame, algorithms = tables["around"], data.experiment.algorithms
    keys = {name: [*declared.search] for name, declared in algorithms.items()}
    n_columns = max(len(declared.observations) for declared in algorithms.values())
    height = 0.25 * sum(map(len, keys.values())) + 0.55 * len(keys)
    with figure_of(len(keys), n_columns, (11.0, height + 0.6)) as (figure, axes):
        axes[0, 0].get_gridspec().set_height_ratios([len(each) + 1.5 for each in keys.values()])
        for i, (name, declared) in enumerate(algorithms.items()):
            row = axes[i]
            for axis in row[len(declared.observations) :]:
                axis.set_axis_off()
            for axis, observation in zip(row, declared.observations, strict=False):
                learner = pd.Series({"algorithm": name, "observation": observation})
                rows, style = frame[_is_of(frame, learner)], _style(learner, data)
                unchanged = rows[rows["setting"] == "none"].iloc[0]
                axis.axvspan(unchanged["area_low"], unchanged["area_high"], color="0.92", lw=0)
                axis.axvline(unchanged["area"], color="0.35", lw=0.8, ls=":")
                for y, key in enumerate(keys[name]):
                    marks = [json.dumps(value) for value in declared.search[key].marks]
                    for _, each in rows[rows["setting"] == key].iterrows():
                        place = marks.index(each["value"]) - (len(marks) - 1) / 2
                        at, ends = y + 0.27 * place, [each["area_low"], each["area_high"]]
                        axis.plot(ends, [at, at], color=style["color"], lw=0.9, alpha=0.7)
                        size = 3 + 1.6 * marks.index(each["value"])
                        axis.plot(each["area"], at, "o", ms=size, color=style["color"], mew=0)
                names = [_in_words(key) for key in keys[name]]
                axis.set_yticks(range(len(names)), names if axis is row[0] else [])
                axis.set(ylim=(len(names) - 0.4, -0.6), xlim=(-0.03, 1.03), xticks=(0, 0.5, 1))
                axis.set_title(_title(learner, data), fontsize="small", fontweight="bold")
                axis.tick_params(labelbottom=i == len(algorithms) - 1, axis="x")
                for y in range(len(names) - 1):
                    axis.axhline(y + 0.5, color="0.85", lw=0.4)
        figure.supxlabel(
            f"{_AREA}; bars: 95 % intervals; larger dots: larger values, or later in the order declared;\n"
            "dotted line and grey band: nothing changed",
            fontsize="small",
        )
    return figure


@item(
    "spaces",
    "the declared range of every setting, and why",
    {"algorithm": "", "setting": "", "default": "", "range": "", "why": ""},
)
def spaces(data: Searches) -> Iterator[dict[str, Any]]:
    """Tabulates what was declared before the search."""
    for name, declared in data.experiment.algorithms.items():
        each = next(each for each in data.learners if each.variant == name)
        default = each.runs(0, each.experiment.scenarios[0])[0].settings
        for key, axis in declared.search.items():
            yield {
                "algorithm": name,
                "setting": key,
                "default": json.dumps(_at(default, key)),
                "range": _range(axis),
                "why": axis.why,
            }


@drawing("scenes", "the scenarios of the search", "The scenarios of the search.")
def scenes(_: Frames, data: Searches) -> Figure:
    """Draws where settings are searched for."""
    runs = (data.learners[0].runs(0, name)[0] for name in data.experiment.scenarios)
    return gallery([compile_scenario(run.scenario) for run in runs])


def _range(axis: Span | Choice) -> str:
    if isinstance(axis, Choice):
        return " or ".join(map(json.dumps, axis.values))
    return f"{axis.low:g} to {axis.high:g}{', logarithmic' * (axis.scale == 'log')}{', whole' * axis.whole}"


def _shares(space: Space, settings: list[dict[str, Any]], areas: list[float]) -> dict[str, float]:
    """Returns the share of the variance of areas that is due to each setting by itself."""
    import optuna
    from optuna import distributions

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    declared: dict[str, distributions.BaseDistribution] = {}
    for key, axis in space.items():
        if isinstance(axis, Choice):
            declared[key] = distributions.CategoricalDistribution([*map(json.dumps, axis.values)])
        elif axis.whole:
            is_log = axis.scale == "log"
            declared[key] = distributions.IntDistribution(round(axis.low), round(axis.high), log=is_log)
        else:
            declared[key] = distributions.FloatDistribution(axis.low, axis.high, log=axis.scale == "log")
    study = optuna.create_study(direction="maximize")
    for each, area in zip(settings, areas, strict=True):
        study.add_trial(optuna.create_trial(params=each, distributions=declared, value=area))
    try:
        return optuna.importance.FanovaImportanceEvaluator(seed=0).evaluate(study)
    except RuntimeError:  # the forest finds no variance
        return dict.fromkeys(space, math.nan)


def _values(settings: dict[str, Any], space: Space) -> dict[str, Any]:
    """Returns the settings that a search varies; choices as texts."""
    found = {key: _at(settings, key) for key in space}
    return {
        key: json.dumps(value) if isinstance(space[key], Choice) else value for key, value in found.items()
    }


def _style(row: pd.Series, data: Searches) -> dict[str, Any]:
    """Returns the colour, marker and dash of a row's learner."""
    return learner_style(row["algorithm"], row["observation"], [*data.experiment.algorithms])


def _title(row: pd.Series, data: Searches) -> str:
    """Returns what readers call a row's learner."""
    return Names.of(data.experiment)(row["algorithm"], row["observation"])


def _in_words(key: str) -> str:
    """Returns a setting's name as readers see it.

    >>> _in_words("policy_kwargs.net_arch")
    'net arch'
    """
    return key.split(".")[-1].replace("_", " ")


def _by_scenario(each: Searched, key: tuple[str, str]) -> list[Any]:
    """Returns the areas of runs around the chosen settings, by scenario."""
    areas = each.areas(each.around[key])
    return np.split(areas, len(each.experiment.scenarios))


def _budget(each: Searched) -> int:
    return each.runs(0, each.experiment.scenarios[0])[0].settings.budget


def _names(each: Searched) -> dict[str, str]:
    return {"algorithm": each.variant, "observation": each.observation}


def _name(row: pd.Series) -> str:
    return f"{row['algorithm']}, {row['observation']}"


def _is_of(frame: pd.DataFrame, row: pd.Series) -> Any:
    """Returns which rows are of the same learner as a row."""
    return (frame["algorithm"] == row["algorithm"]) & (frame["observation"] == row["observation"])


def _at(settings: object, key: str) -> Any:
    """Returns the value of a dotted key; None if it is not set."""
    value: Any = settings
    for name in key.split("."):
        value = value.get(name) if isinstance(value, dict) else getattr(value, name, None)
    return value


def _text(settings: dict[str, Any], each: Searched) -> str:
    """Returns the searched settings as readers see them; those of trial 0 are the defaults."""
    found = {key: _at(settings, key) for key in each.experiment.algorithms[each.variant].search}
    texts = [f"{key.split('.')[-1]} {json.dumps(value)}" for key, value in found.items() if value is not None]
    return ", ".join(texts) or "default"
