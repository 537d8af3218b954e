"""Items of the report on a map: what every population took, and which learner needs fewer steps."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Final

import numpy as np
import pandas as pd

from benchmark.analysis import looks as rules
from benchmark.analysis.frames import by_step
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate, median, proportion
from benchmark.analysis.looks import UNITS, VERDICTS, Contrast
from benchmark.experiments import Experiment, Population
from benchmark.studies.item import COLUMNS, expanded, item, labelled_columns, no_rows
from envs import InputError
from envs.people import NoisyFeedback

Row = Mapping[str, object]

_item: Final = partial(item, meanings={**COLUMNS["map"], **dict.fromkeys(VERDICTS, "contrasts so ended")})
_KEPT: Final = ("at_all_levels", "at_some_levels", "at_no_other_level", "reversed")
_SPREAD: Final = 18  # evaluations of `success.csv`
_columns: Final = partial(labelled_columns, COLUMNS["map_labels"])


@_item(
    "cells",
    "every point and learner: the share of runs that learn, and medians of what they take",
    _columns("grid point learner n solved success steps disagreements unseen_success"),
    best="-steps",
)
def cells(runs: pd.DataFrame, curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates all populations. A run that never learns takes infinitely many steps."""
    rows = rules.rows_of(experiment, runs)
    for population, took in _took(experiment, curves).items():
        is_solved = np.isfinite(took["steps"].to_numpy())
        yield {
            **_cell(population),
            "n": len(took),
            "budget": population.first.settings.budget,
            "n_solved": int(is_solved.sum()),
            "solved": proportion(is_solved),
            "success": proportion(took["success"].to_numpy()),
            "steps": median(took["steps"].to_numpy()),
            "disagreements": median(took["disagreements"].to_numpy()),
            "unseen_success": proportion(rows[population]["unseen_success"].to_numpy()),
            "unseen_budget": proportion(rows[population]["unseen_budget"].to_numpy()),
        }


@_item(
    "cpu", "measured: median CPU seconds of training until a run has learned", is_measured=True, where=no_rows
)
def cpu(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the time of training alone: no evaluation counts."""
    for population, took in _took(experiment, curves).items():
        yield _cell(population) | {"n": len(took), "cpu_time_s": median(took["cpu_time_s"].to_numpy())}


@_item(
    "contrasts",
    "which learner needs fewer steps, at the first look that decides it, or at the last",
    _columns("grid point x y n verdict faster ratio wrong_pings_verdict fewer_wrong_pings")
    | {"n": "pairs of runs"},
)
def contrasts(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the declared contrasts."""
    for contrast in _contrasts(experiment, curves):
        steps, wrong_pings = (contrast.decisions[unit] for unit in UNITS)
        yield {
            **_point(contrast.x),
            **_sides(contrast),
            "n": steps.n,
            "verdict": steps.verdict,
            "why_none": steps.why,
            "faster": steps.faster,
            "ratio": ratio(contrast, "steps"),
            "ratio_disagreements": ratio(contrast, "disagreements"),
            "n_wrong_pings": wrong_pings.n,
            "wrong_pings_verdict": wrong_pings.verdict,
            "fewer_wrong_pings": wrong_pings.faster,
            **{f"verdict_{level:g}": verdict for level, verdict in contrast.at_level.items()},
        }


@_item("verdicts", "how many verdicts each contrast has, over the points of a grid, by unit", where=no_rows)
def verdicts(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Counts verdicts; a point of two grids counts in both."""
    decided = pd.DataFrame(
        name_of(contrast.x) | _sides(contrast) | {"unit": UNITS[unit], "verdict": decision.verdict}
        for contrast in _contrasts(experiment, curves)
        for unit, decision in contrast.decisions.items()
    )
    keys = ["grid", "x", "y", "unit"]
    for names, ended in decided.groupby(keys, sort=False)["verdict"]:
        yield dict(zip(keys, names, strict=True)) | {"n": len(ended), **_counted([*ended])}


@_item(
    "levels",
    "exploratory: how many verdicts are the same at lower levels of success, over the points of all grids",
)
def levels(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Counts how verdicts change with the level of success; a point of two grids counts once."""
    decided = pd.DataFrame(
        _sides(contrast) | {"kept": _kept(contrast.decisions["steps"].verdict, [*contrast.at_level.values()])}
        for contrast in _distinct(experiment, curves)
        if contrast.at_level
    )
    for (x, y), own in decided.groupby(["x", "y"], sort=False)["kept"] if len(decided) else ():
        counts = {kept: int((own == kept).sum()) for kept in _KEPT}
        yield {"x": x, "y": y, "points": len(own), "decided": sum(counts.values()), **counts}


def _kept(verdict: str, others: Sequence[str]) -> str:
    """Returns what other levels make of a verdict, one of `_KEPT`; empty if it names no winner."""
    winners, n = {rules.FASTER, rules.SLOWER}, others.count(verdict)
    if verdict not in winners:
        return ""
    if {*others} & winners - {verdict}:
        return "reversed"
    return "at_no_other_level" if n == 0 else "at_all_levels" if n == len(others) else "at_some_levels"


@_item(
    "looks",
    "how many pairs of runs the contrasts took, and how they ended, by unit",
    {"unit": "", "n": "pairs of runs", "contrasts": "", **dict.fromkeys(VERDICTS, "")},
)
def looks(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Counts contrasts by the look that decided them, those of several grids once."""
    assert experiment.report is not None
    decisions = [contrast.decisions for contrast in _distinct(experiment, curves)]
    for unit, n in product(UNITS, experiment.report.looks):
        ended = [of_unit[unit].verdict for of_unit in decisions if of_unit[unit].n == n]
        yield {"unit": UNITS[unit], "n": n, "contrasts": len(ended), **_counted(ended)}


@_item(
    "reference",
    "exploratory: reference implementations compared with the learners whose settings they share",
    _columns("grid point x y n n_reference steps steps_reference faster")
    | {"n": "runs of x", "steps": "median steps of x"},
)
def reference(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Compares runs of other seeds and other code: by pairs of one run of each, all with all."""
    every = _took(experiment, curves)
    steps = {(key.condition.name, key.learner.name): took["steps"].to_numpy() for key, took in every.items()}
    for population in every:
        condition, learner = population.condition.name, population.learner
        if (condition, learner.reference_for) in steps:
            x, y = steps[condition, learner.reference_for], steps[condition, learner.name]
            yield {
                **_point(population),
                "x": learner.reference_for,
                "y": learner.name,
                "n": len(x),
                "n_reference": len(y),
                "steps": median(x),
                "steps_reference": median(y),
                "faster": float(np.where(x[:, None] == y, 0.5, x[:, None] < y).mean()),
            }


@_item("success", "success at up to 18 evaluations of training, mean over runs", where=no_rows)
def success(curves: pd.DataFrame, experiment: Experiment) -> pd.DataFrame | None:
    """Tabulates success over training; a run that has ended counts with its last evaluation.

    To keep the file small, it has two digits, and where it stays the same, only the ends have a row.
    """
    tables = []
    for population, rows in rules.rows_of(experiment, curves).items():
        steps, values = by_step(rows, "step")[0], by_step(rows, "success")
        wanted = np.geomspace(steps[1], steps[-1], _SPREAD)
        at = np.unique(abs(np.log(steps[1:, None] / wanted)).argmin(axis=0)) + 1
        names = {key: _cell(population)[key] for key in ("grid", "point", "variant", "observation")}
        success = expanded({"success": proportion(values[:, at])})
        table = pd.DataFrame({**names, "step": steps[at].astype(int), **success}).round(2)
        numbers = table[[*success]]
        is_inner = (numbers.eq(numbers.shift()) & numbers.eq(numbers.shift(-1))).all(axis=1)
        tables.append(table[~is_inner])
    return pd.concat(tables, ignore_index=True) if tables else None


@_item("pairs", "what every contrast uses: the steps and wrong PINGs of its pairs of runs", where=no_rows)
def pairs(curves: pd.DataFrame, experiment: Experiment) -> pd.DataFrame | None:
    """Tabulates the runs of each contrast; numbers are empty where a run does not learn."""
    names = {"steps": "steps", "disagreements": "wrong_pings"}
    return _numbered(
        (
            name_of(contrast.x) | _sides(contrast),
            pd.DataFrame({f"{names[unit]}_{side}": took[unit] for unit in UNITS for side, took in both}),
        )
        for contrast in _contrasts(experiment, curves)
        for both in [[*zip("xy", contrast.took, strict=True)]]
    )


@_item("runs", "every run: what it took until it had learned", where=no_rows)
def runs(curves: pd.DataFrame, experiment: Experiment) -> pd.DataFrame | None:
    """Tabulates all runs, numbered by seed; empty where a run never solves its scenario."""
    return _numbered(
        (name_of(population) | {"learner": population.learner.name}, took[["steps", "disagreements"]])
        for population, took in _took(experiment, curves).items()
    )


@_item("unseen", "every run with unseen places: success in them by both policies", where=no_rows)
def unseen(runs: pd.DataFrame, experiment: Experiment) -> pd.DataFrame | None:
    """Tabulates all runs of the points that have unseen places."""
    return _numbered(
        (name_of(population) | {"learner": population.learner.name}, rows.filter(like="unseen_"))
        for population, rows in rules.rows_of(experiment, runs).items()
        if population.scenario.issuer.unseen
    )


def _numbered(tables: Iterable[tuple[Mapping[str, str], pd.DataFrame]]) -> pd.DataFrame | None:
    """Returns the rows of runs as one table, with their names and numbers, and NaN for infinite values."""
    frames = []
    for names, rows in tables:
        numbers = rows.reset_index(drop=True).replace(np.inf, np.nan)
        frames.append(pd.DataFrame({**names, "run": range(len(rows)), **numbers}))
    return pd.concat(frames, ignore_index=True) if frames else None


def _took(experiment: Experiment, curves: pd.DataFrame) -> dict[Population, pd.DataFrame]:
    solved, rows = experiment.declared.solved, rules.rows_of(experiment, curves)
    assert solved is not None
    return {population: rules.took(own, solved.success) for population, own in rows.items()}


def _contrasts(experiment: Experiment, curves: pd.DataFrame) -> list[Contrast]:
    if contrasts := rules.contrasts(experiment, curves):
        return contrasts
    raise InputError(f"{experiment.name}: no contrast has enough runs yet: run the experiment first.")


def _distinct(experiment: Experiment, curves: pd.DataFrame) -> list[Contrast]:
    """Returns the contrasts, those of several grids once."""
    every = _contrasts(experiment, curves)
    return [*{(contrast.x.first.digest, contrast.y.first.digest): contrast for contrast in every}.values()]


def ratio(contrast: Contrast, unit: str) -> Estimate:
    """Returns how many times as much y takes as x, by medians over the pairs of runs of the verdict in steps.

    Where most runs never learn, what they spend within the budget counts, so the ratio is a bound. It
    is NaN if that is so of both, or if a median is 0. The 95 % interval is by resampling pairs.
    """
    n, rng = contrast.decisions["steps"].n, np.random.default_rng(BOOTSTRAP_SEED)
    drawn = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
    medians = [np.median(took[unit].to_numpy()[drawn], axis=1) for took in contrast.took]
    if all(np.isinf(median[0]) for median in medians) or any(median[0] == 0 for median in medians):
        return Estimate(np.nan, np.nan, np.nan)
    spent = [np.median(took[f"spent_{unit}"][:n]) for took in contrast.took]
    of_x, of_y = (np.where(np.isinf(m), other, m) for m, other in zip(medians, spent, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):  # some runs may have solved at step 0
        samples = of_y / of_x
    return Estimate(float(samples[0]), *map(float, np.nanpercentile(samples[1:], [2.5, 97.5])))


def _counted(ended: Sequence[str]) -> dict[str, int]:
    return {verdict: ended.count(verdict) for verdict in VERDICTS}


def name_of(population: Population) -> dict[str, str]:
    """Returns the columns that name a point: its grid, and its name there."""
    axes = {axis: value for axis, value in population.condition.axes.items() if axis != "reading"}
    return {"grid": axes.pop("grid"), "point": ", ".join(f"{axis} {axes[axis]}" for axis in axes)}


def _point(population: Population) -> dict[str, object]:
    """Returns the same, and what the scenario is there."""
    scenario, issuer = population.scenario, population.scenario.issuer
    return name_of(population) | {
        "rows": scenario.grid.rows,
        "columns": scenario.grid.columns,
        "places": len(scenario.layout.places) - issuer.unseen,
        "unseen": issuer.unseen,
        "feedback": issuer.feedback.kind,
        "noise": issuer.feedback.noise if isinstance(issuer.feedback, NoisyFeedback) else 0.0,
        "permuted": issuer.permuted,
    }


def _cell(population: Population) -> dict[str, object]:
    """Returns the same, and what names the learner."""
    learner = population.learner
    return _point(population) | {"variant": learner.variant, "observation": learner.observation}


def _sides(contrast: Contrast) -> dict[str, str]:
    return {"x": contrast.x.learner.name, "y": contrast.y.learner.name}
