"""Items of the report on a map: what every population took, which learner needs fewer steps, and why."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import Final

import numpy as np
import pandas as pd

from agents.hardness import Hardness, hardness
from benchmark.analysis import looks as rules
from benchmark.analysis.frames import by_step
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate, median, proportion
from benchmark.analysis.looks import VERDICTS, Contrast
from benchmark.experiments import Experiment, Population
from benchmark.reports.item import item, labelled_columns, no_rows
from envs import InputError, Scenario
from envs.observations import compile_seen
from envs.scenario import NoisyFeedback

Row = Mapping[str, object]

_LABELS: Final = {
    "cpu_time_s": "CPU seconds",
    "disagreements": "median wrong PINGs",
    "faster": "probability that x is faster",
    "n": "runs",
    "n_reference": "runs of y",
    "ratio": "median steps of y / of x",
    "solved": "share that learns",
    "steps": "median steps",
    "steps_reference": "median steps of y",
    "success": "success at the end",
    "unseen_success": "success in unseen places",
    "verdict": "verdict on x",
}
_MEANINGS: Final = {
    "columns": "columns of the room",
    "contrasts": "contrasts that ended with so many pairs of runs",
    "covering_steps": "steps in which the random policy has tried nine tenths of what it can reach",
    "cpu_time_s": "CPU seconds of training until a run has solved its scenario, median; inf if most never do",
    "disagreements": "wrong PINGs until a run has solved its scenario, of several runs the median; inf or "
    "empty if it never does",
    "faster": "probability that a run of x needs fewer steps than one of y; in `contrasts.csv`, its interval "
    "holds for all contrasts and looks at once",
    "feedback": "kind of the issuer's feedback",
    "grid": "grid of the experiment",
    "n": "runs; of contrasts, pairs of runs; in `verdicts.csv`, contrasts",
    "n_reference": "runs of the reference implementation, y",
    "n_solved": "runs that solve their scenario",
    "noise": "half the width of the interval from which the noise of feedback is drawn; 0 without",
    "permuted": "share of the issuer's cells whose coordinates are permuted",
    "places": "cells in which the issuer may stand",
    "point": "point of the grid",
    "ratio": "median steps of y divided by those of x; where one never solves, its budget counts",
    "ratio_disagreements": "the same of wrong PINGs",
    "rows": "rows of the room",
    "run": "number of the run, from 0, in the order of seeds",
    "solvable_k": "smallest k for which the scenario is k-QVI-solvable",
    "solved": "share of runs that solve their scenario",
    "steps": "steps until a run has solved its scenario, of several runs the median; inf or empty if it "
    "never does",
    "steps_reference": "the same of the reference implementation, y",
    "success": "success at the end of training, mean over runs",
    "unseen": "further cells of the issuer, never met in training",
    "unseen_success": "success with the issuer in these cells, of several runs the mean; empty without any",
    "verdict": "verdict on x",
    **dict.fromkeys(VERDICTS, "contrasts with this verdict"),
}
_item: Final = partial(item, meanings=_MEANINGS)
_COUNTED: Final = dict.fromkeys(VERDICTS, "")
_columns: Final = partial(labelled_columns, _LABELS)


@_item(
    "cells",
    "every point and learner: the share of runs that learn, and medians of what they take",
    _columns("grid point learner n solved success steps disagreements unseen_success"),
    best="-steps",
)
def cells(runs: pd.DataFrame, curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates all populations. A run that never solves its scenario takes infinitely many steps."""
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
        }


@_item(
    "cpu",
    "measured: median CPU seconds of training until a run has learned",
    _columns("grid point learner n cpu_time_s"),
    is_measured=True,
    where=no_rows,
)
def cpu(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the time of training alone: no evaluation counts."""
    for population, took in _took(experiment, curves).items():
        yield _cell(population) | {"n": len(took), "cpu_time_s": median(took["cpu_time_s"].to_numpy())}


@_item(
    "contrasts",
    "which learner needs fewer steps, at the first look that decides it, or at the last",
    _columns("grid point x y n verdict faster ratio") | {"n": "pairs of runs"},
)
def contrasts(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the declared contrasts."""
    for contrast in _contrasts(experiment, curves):
        yield {
            **_point(contrast.x),
            **_sides(contrast),
            "n": contrast.decision.n,
            "budget": min(side.first.settings.budget for side in (contrast.x, contrast.y)),
            "verdict": contrast.decision.verdict,
            "faster": contrast.decision.faster,
            "ratio": ratio(*contrast.took, "steps"),
            "ratio_disagreements": ratio(*contrast.took, "disagreements"),
        }


@_item(
    "verdicts",
    "how many verdicts each contrast has, over the points of a grid",
    {"grid": "", "x": "", "y": "", "n": "points", **_COUNTED},
)
def verdicts(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Counts verdicts; a point of two grids counts in both."""
    decided = pd.DataFrame(
        _name(contrast.x) | _sides(contrast) | {"verdict": contrast.decision.verdict}
        for contrast in _contrasts(experiment, curves)
    )
    for (grid, x, y), ended in decided.groupby(["grid", "x", "y"], sort=False)["verdict"]:
        yield {"grid": grid, "x": x, "y": y, "n": len(ended), **_counted([*ended])}


@_item(
    "looks",
    "how many pairs of runs the contrasts took, and how they ended",
    {"n": "pairs of runs", "contrasts": "", **_COUNTED},
)
def looks(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Counts contrasts by the look that decided them, those of several grids once."""
    assert experiment.report is not None
    distinct = {
        (contrast.x.first.digest, contrast.y.first.digest): contrast.decision
        for contrast in _contrasts(experiment, curves)
    }
    for n in experiment.report.looks:
        ended = [decision.verdict for decision in distinct.values() if decision.n == n]
        yield {"n": n, "contrasts": len(ended), **_counted(ended)}


@_item(
    "reference",
    "exploratory: DQN and PPO of Stable-Baselines3 compared with the compiled ones",
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


@_item("pairs", "what every contrast uses: the steps of its pairs of runs, within one budget", where=no_rows)
def pairs(curves: pd.DataFrame, experiment: Experiment) -> pd.DataFrame | None:
    """Tabulates the runs of each contrast; steps are empty where a run does not learn within that budget."""
    return _numbered(
        (_name(contrast.x) | _sides(contrast), pd.DataFrame({"steps_x": x["steps"], "steps_y": y["steps"]}))
        for contrast in _contrasts(experiment, curves)
        for x, y in [contrast.took]
    )


@_item("runs", "every run: what it took until it had learned, within its own budget", where=no_rows)
def runs(curves: pd.DataFrame, experiment: Experiment) -> pd.DataFrame | None:
    """Tabulates all runs, numbered by seed; empty where a run never solves its scenario."""
    return _numbered(
        (_name(population) | {"learner": population.learner.name}, took[["steps", "disagreements"]])
        for population, took in _took(experiment, curves).items()
    )


@_item("unseen", "every run with unseen places: success in them at the end of training", where=no_rows)
def unseen(runs: pd.DataFrame, experiment: Experiment) -> pd.DataFrame | None:
    """Tabulates all runs of the points that have unseen places."""
    return _numbered(
        (_name(population) | {"learner": population.learner.name}, rows[["unseen_success"]])
        for population, rows in rules.rows_of(experiment, runs).items()
        if population.scenario.issuer.unseen
    )


def _numbered(tables: Iterable[tuple[Mapping[str, str], pd.DataFrame]]) -> pd.DataFrame | None:
    """Returns the rows of runs as one table, with their names and numbers, and NaN for infinite values."""
    frames = [
        pd.DataFrame(
            {**names, "run": range(len(rows)), **rows.reset_index(drop=True).replace(np.inf, np.nan)}
        )
        for names, rows in tables
    ]
    return pd.concat(frames, ignore_index=True) if frames else None


@_item("measures", "measures of every point, for the places of its first run", where=no_rows)
def measures(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates `agents.hardness`, beside the median steps.

    Points at which a learner does the same count once: those that differ in unseen places, or for a table in
    permuted coordinates. They are known by the wrong PINGs of the first run.
    """
    seen, rows = set[tuple[str, bytes]](), rules.rows_of(experiment, curves)
    for population, took in _took(experiment, curves).items():
        scenario, learner = population.scenario.drawn(population.seeds.start), population.learner
        same = learner.name, by_step(rows[population], "training_wrong_pings")[0].tobytes()
        if learner.reference_for or same in seen or scenario.following[0].shape[1] > 1:
            continue  # the last: what follows an action is random
        seen.add(same)
        measured = _hardness(scenario, learner.observation, experiment.declared.horizon)._asdict()
        steps = {"steps": float(np.median(took["steps"]))}
        yield _cell(population) | {"n": len(took)} | measured | steps


def _took(experiment: Experiment, curves: pd.DataFrame) -> dict[Population, pd.DataFrame]:
    solved, rows = experiment.declared.solved, rules.rows_of(experiment, curves)
    assert solved is not None
    return {population: rules.took(own, solved.success) for population, own in rows.items()}


def _contrasts(experiment: Experiment, curves: pd.DataFrame) -> list[Contrast]:
    if contrasts := rules.contrasts(experiment, curves):
        return contrasts
    raise InputError(f"{experiment.name}: no contrast has enough runs yet: run the experiment first.")


def ratio(x: pd.DataFrame, y: pd.DataFrame, currency: str) -> Estimate:
    """Returns how many times as much y takes as x, by medians over pairs of runs, given what they took.

    Where most runs never solve, what they spend within the smaller budget counts, so the ratio is a bound. It
    is NaN if that is so of both, or if a median is 0. The 95 % interval is by resampling pairs.
    """
    n, rng = len(x), np.random.default_rng(BOOTSTRAP_SEED)
    drawn = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
    medians = [np.median(took[currency].to_numpy()[drawn], axis=1) for took in (x, y)]
    if all(np.isinf(median[0]) for median in medians) or any(median[0] == 0 for median in medians):
        return Estimate(np.nan, np.nan, np.nan)
    spent = [np.median(took[f"spent_{currency}"]) for took in (x, y)]
    of_x, of_y = (np.where(np.isinf(m), other, m) for m, other in zip(medians, spent, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):  # some runs may have solved at step 0
        samples = of_y / of_x
    return Estimate(float(samples[0]), *map(float, np.nanpercentile(samples[1:], [2.5, 97.5])))


def _counted(ended: Sequence[str]) -> dict[str, int]:
    return {verdict: ended.count(verdict) for verdict in VERDICTS}


def _name(population: Population) -> dict[str, str]:
    """Returns the columns that name a point: its grid, and its name there."""
    axes = {axis: value for axis, value in population.condition.axes.items() if axis != "reading"}
    return {"grid": axes.pop("grid"), "point": ", ".join(f"{axis} {axes[axis]}" for axis in axes)}


def _point(population: Population) -> dict[str, object]:
    """Returns the same, and what the scenario is there."""
    scenario, issuer = population.scenario, population.scenario.issuer
    return _name(population) | {
        "rows": scenario.grid.rows,
        "columns": scenario.grid.columns,
        "places": len(scenario.places) - issuer.unseen,
        "unseen": issuer.unseen,
        "feedback": issuer.feedback.kind,
        "noise": issuer.feedback.noise if isinstance(issuer.feedback, NoisyFeedback) else 0.0,
        "permuted": issuer.permuted,
    }


def _cell(population: Population) -> dict[str, object]:
    """Returns the same, and what names the learner."""
    learner = population.learner
    return _point(population) | {"algorithm": learner.variant, "observation": learner.observation}


def _sides(contrast: Contrast) -> dict[str, str]:
    return {"x": contrast.x.learner.name, "y": contrast.y.learner.name}


@lru_cache(maxsize=1024)
def _hardness(scenario: Scenario, observation: str, horizon: int) -> Hardness:
    return hardness(compile_seen(scenario, observation), horizon)
