"""Items of the report on a search: what was chosen, what that bought, and what it cost."""

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from benchmark.analysis.intervals import Estimate, interval, resample
from benchmark.analysis.search import Searched
from benchmark.drawing.maps import gallery
from benchmark.drawing.style import COLOURS, figure_of
from benchmark.drawing.tables import decimals_of, link
from benchmark.experiments.search import Choice, Space, Span
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding, Frames, drawing, entry, item, no_rows
from benchmark.reports.search.runs import KEY, Searches, expected_best, gain, mean
from envs import compile_scenario

_AREA: Final = "mean area under the curve of success"
_COLOURS: Final = {"tabular": COLOURS[1], "deep": COLOURS[0]}
_MARKERS: Final = {"tabular": "s", "deep": "o"}
_TITLES: Final = {"tabular": "tables", "deep": "nets"}
_KINDS: Final = {"tabular": "table", "deep": "net"}
_COLUMNS: Final = 5  # of panels
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
        f"The chosen settings, the best of the defaults and {search['trials']} trials, change success "
        f"averaged over training {', and '.join(parts)}. Means are over {len(folder.manifest['scenarios'])} "
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


@best_of.figure(
    "What tuning buys: the expected area of the best of b trials, by learner. Crosses: the defaults."
)
def _(tables: Frames, data: Searches) -> Figure:
    figure = _panels(tables, data, "trials", dict.fromkeys((each.name for each in data.learners), 1.0))
    million = _budget(data.learners[0]) * data.learners[0].searched[0].size / 1e6
    for axis in figure.axes:
        axis.set_xticks(_TICKS, [str(tick) for tick in _TICKS])
        steps = axis.secondary_xaxis("top")
        steps.set_xticks(_TICKS, [f"{tick * million:.3g}" for tick in _TICKS])
        steps.set_xlabel("million environment steps of the search")
        for each in (axis.xaxis, steps.xaxis):
            each.set_minor_locator(NullLocator())
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


@cost.figure(
    "The expected area of the best of b trials against the CPU seconds that they take. Crosses: the defaults."
)
def _(tables: Frames, data: Searches) -> Figure:
    rows = tables["cost"]
    seconds = {_name(row): row["cpu_ms"] / 1000 for _, row in rows.iterrows()}
    sizes = {each.name: each.searched[0].size for each in data.learners}
    scale = {name: value * sizes[name] for name, value in seconds.items()}
    return _panels(tables, data, "CPU seconds", scale)


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


@trials.figure(
    "Every trial of every learner. Bar: the chosen settings on fresh runs, with their 95 % interval."
)
def _(tables: Frames, data: Searches) -> Figure:
    frame, chosen_ones = tables["trials"], tables["chosen"]
    families: Any = data.facts["families"]
    with figure_of(1, 1, (8.0, 0.34 * len(chosen_ones) + 1.3)) as (figure, axes):
        axis = axes[0, 0]
        for y, (each, (_, row)) in enumerate(zip(data.learners, chosen_ones.iterrows(), strict=True)):
            family, rows = families[each.name], frame[_is_of(frame, each)]
            axis.plot(rows["area"][1:], [y] * (len(rows) - 1), "|", ms=9, mew=0.9, color="0.55")
            axis.plot(row["default"], y, "x", ms=7, mew=2, color="black")
            axis.plot(
                [row["chosen_low"], row["chosen_high"]], [y, y], lw=3, alpha=0.5, color=_COLOURS[family]
            )
            axis.plot(row["chosen"], y, _MARKERS[family], ms=7, color=_COLOURS[family], mec="white")
        axis.set_yticks(range(len(chosen_ones)), [_name(row) for _, row in chosen_ones.iterrows()])
        axis.set(
            ylim=(len(chosen_ones) - 0.5, -0.5),
            xlim=(-0.02, 1.0),
            xlabel=f"{_AREA}, over scenarios (more is better)",
        )
        axis.grid(axis="y", lw=0.4, color="0.85")
        axis.tick_params(axis="y", length=0)
        handles = [
            Line2D([], [], ls="", marker="|", ms=9, color="0.55", label="a trial"),
            Line2D([], [], ls="", marker="x", mew=2, color="black", label="default settings"),
            *(
                Line2D(
                    [],
                    [],
                    ls="",
                    marker=_MARKERS[key],
                    color=_COLOURS[key],
                    label=f"chosen settings of a {text}",
                )
                for key, text in (("tabular", "table"), ("deep", "net"))
            ),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False)
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


@importance.figure(
    "The share of the variance between trials that is due to each setting by itself, by functional ANOVA."
)
def _(tables: Frames, _: Searches) -> Figure:
    frame = tables["importance"]
    table = frame.assign(learner=[_name(row) for _, row in frame.iterrows()]).pivot_table(
        index="learner", columns="setting", values="share", sort=False
    )
    with figure_of(1, 1, (0.75 * table.shape[1] + 2.6, 0.32 * len(table) + 1.9)) as (figure, axes):
        axis = axes[0, 0]
        axis.imshow(table, cmap="Greys", vmin=0, vmax=1, aspect="auto")
        for (row, column), value in np.ndenumerate(table.to_numpy()):
            if not math.isnan(value):
                ink = "white" if value > 0.55 else "black"
                axis.text(column, row, f"{value:.2f}", ha="center", va="center", color=ink)
        axis.set_xticks(
            range(table.shape[1]), [str(key).split(".")[-1] for key in table], rotation=30, ha="left"
        )
        axis.set_yticks(range(len(table)), table.index)
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


@around.figure(
    "One setting changed at a time. Dots grow with the value, or in the order declared; line: none changed."
)
def _(tables: Frames, data: Searches) -> Figure:
    frame, learners = tables["around"], data.learners
    n_rows = math.ceil(len(learners) / _COLUMNS)
    with figure_of(n_rows, _COLUMNS, (13.0, 2.2 * n_rows)) as (figure, axes):
        for axis, each in zip(axes.flat, learners, strict=False):
            space = each.experiment.algorithms[each.variant].search
            rows = frame[_is_of(frame, each)]
            axis.axvline(rows.loc[rows["setting"] == "none", "area"].iloc[0], color="black", lw=1)
            for y, (key, declared) in enumerate(space.items()):
                marks = [json.dumps(value) for value in declared.marks]
                part = rows[rows["setting"] == key]
                sizes = [18 + 40 * marks.index(value) for value in part["value"]]
                axis.scatter(part["area"], [y] * len(part), s=sizes, color=COLOURS[0], alpha=0.6, lw=0)
            names = [key.split(".")[-1] for key in space]
            axis.set_yticks(range(len(names)), names, fontsize="x-small")
            axis.set(ylim=(len(names) - 0.5, -0.5), xlim=(-0.03, 1.03))
            axis.set_title(each.name.replace(", ", "\n"), fontsize="small")
            axis.grid(axis="y", lw=0.4, color="0.85")
        for axis in axes.flat[len(learners) :]:
            axis.set_axis_off()
        figure.supxlabel(_AREA, fontsize="small")
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


def _panels(tables: Frames, data: Searches, label: str, scale: Mapping[str, float]) -> Figure:
    """Draws the expected area of the best of b trials: tables left, nets right; crosses: default settings."""
    frame, default = tables["best_of"], tables["chosen"]
    families: Any = data.facts["families"]
    panels = [family for family in _TITLES if family in families.values()]
    with figure_of(1, len(panels), (11.0, 4.8)) as (figure, axes):
        for axis, family in zip(axes[0], panels, strict=True):
            axis.sharex(axes[0, 0])
            for place, each in enumerate(each for each in data.learners if families[each.name] == family):
                rows, style = frame[_is_of(frame, each)], _line(place)
                x = rows["trials"] * scale[each.name]
                axis.plot(x, rows["expected"], label=each.name, markevery=(place, 12), ms=5, **style)
                ends = rows["expected_low"], rows["expected_high"]
                axis.fill_between(x, *ends, color=style["color"], alpha=0.1, lw=0)
                start = default.loc[_is_of(default, each), "default"].iloc[0]
                axis.plot(x.iloc[0] * 0.8, start, "x", ms=6, mew=1.8, color=style["color"])
            axis.set(xscale="log", xlabel=label, ylim=(-0.02, 1.0), ylabel=_AREA)
            axis.xaxis.set_major_formatter("{x:,g}")
            axis.set_title(_TITLES[family], fontweight="bold")
            place_below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16)}
            axis.legend(**place_below, ncols=2, frameon=False, fontsize="small")
    return figure


def _line(place: int) -> dict[str, Any]:
    """Returns colour and marker of a learner among tables or nets."""
    colours = ["black", *(COLOURS[i] for i in (0, 1, 2, 3, 4, 9)), "0.55"]
    return {"color": colours[place % len(colours)], "marker": "osD^vPX*"[place % 8], "lw": 1.4}


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


def _is_of(frame: pd.DataFrame, each: Searched) -> Any:
    """Returns which rows are a learner's."""
    return (frame["algorithm"] == each.variant) & (frame["observation"] == each.observation)


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
