"""Items of the report on a map: what every population took, which learner needs fewer steps, and why."""

from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.hardness import Hardness, hardness
from benchmark.analysis import looks as decided
from benchmark.analysis.contrasts import BETTER, EQUIVALENT, UNDECIDED, WORSE
from benchmark.analysis.frames import by_step
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate, median, proportion
from benchmark.analysis.looks import NEITHER, TOO_SHORT, Contrast
from benchmark.experiments import Experiment, Population
from benchmark.reports.item import item, no_rows
from envs import InputError, Scenario
from envs.observations import compile_seen
from envs.scenario import NoisyFeedback

Row = dict[str, object]

POINT: Final = {"grid": "", "point": ""}
LEARNER: Final = {"learner": ""}
IN_WORDS: Final = {
    BETTER: "faster",
    WORSE: "slower",
    EQUIVALENT: "equally fast",
    NEITHER: "neither learns",
    TOO_SHORT: "budget too short",
    UNDECIDED: "undecided",
}
_VERDICTS: Final = dict.fromkeys(IN_WORDS.values(), "contrasts with this verdict")
_AT: Final = {
    "grid": "grid of the experiment",
    "point": "point of the grid",
    "learner": "variant and form of observation",
}
_SCENARIO: Final = {
    "columns": "columns of the room",
    "feedback": "kind of the issuer's feedback",
    "noise": "half the width of the interval from which the noise of feedback is drawn; 0 without",
    "permuted": "share of the issuer's cells whose coordinates are permuted",
    "places": "cells in which the issuer may stand",
    "rows": "rows of the room",
    "unseen": "further cells of the issuer, never met in training",
}
_MEDIAN: Final = "{} until a run has solved its scenario, median; inf if most never do"
_RUN: Final = "number of the run, from 0, in the order of seeds"
_FASTER: Final = "probability that a run of x needs fewer steps than one of y"


@item(
    "cells",
    "every point and learner: the share of runs that learn, and medians of what they take",
    {
        **POINT,
        **LEARNER,
        "n": "runs",
        "solved": "share that learns",
        "success": "success at the end",
        "steps": "median steps",
        "disagreements": "median wrong PINGs",
        "unseen_success": "success in unseen places",
    },
    best="-steps",
    meanings={
        **_AT,
        **_SCENARIO,
        "n_solved": "runs that solve their scenario",
        "solved": "share of runs that solve their scenario",
        "success": "success at the end of training, mean over runs",
        "steps": _MEDIAN.format("steps"),
        "disagreements": _MEDIAN.format("wrong PINGs"),
        "unseen_success": "success with the issuer in these cells, mean over runs; empty without any",
    },
)
def cells(runs: pd.DataFrame, curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates all populations. A run that never solves its scenario takes infinitely many steps."""
    unseen_success = decided.in_populations(runs)
    for population, took in populations(curves, experiment):
        unseen = unseen_success[decided.key(population)]["unseen_success"].to_numpy()
        is_solved = np.isfinite(took["steps"].to_numpy())
        yield {
            **_point(population),
            **_learner(population),
            "n": len(took),
            "budget": population.first.settings.budget,
            "n_solved": int(is_solved.sum()),
            "solved": proportion(is_solved),
            "success": proportion(took["success"].to_numpy()),
            "steps": median(took["steps"].to_numpy()),
            "disagreements": median(took["disagreements"].to_numpy()),
            "unseen_success": proportion(unseen[: len(took)]),
        }


@item(
    "cpu",
    "measured: median CPU seconds of training until a run has learned",
    {**POINT, **LEARNER, "n": "runs", "cpu_time_s": "CPU seconds"},
    is_measured=True,
    where=no_rows,
    meanings={**_AT, **_SCENARIO, "cpu_time_s": _MEDIAN.format("CPU seconds of training")},
)
def cpu(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the time of training alone: no evaluation counts."""
    for population, took in populations(curves, experiment):
        time = median(took["cpu_time_s"].to_numpy())
        yield {**_point(population), **_learner(population), "n": len(took), "cpu_time_s": time}


@item(
    "contrasts",
    "which learner needs fewer steps, at the first look that decides it, or at the last",
    {
        **POINT,
        "x": "",
        "y": "",
        "n": "pairs of runs",
        "verdict": "verdict on x",
        "faster": "probability that x is faster",
        "ratio": "median steps of y / of x",
    },
    meanings={
        **_AT,
        **_SCENARIO,
        "n": "pairs of runs",
        "verdict": "verdict on x",
        "faster": f"{_FASTER}; its interval holds for all contrasts and looks at once",
        "ratio": "median steps of y divided by those of x; where one never solves, its budget counts",
        "ratio_disagreements": "the same of wrong PINGs",
    },
)
def contrasts(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the declared contrasts. Intervals of `faster` hold for all contrasts and looks at once.

    `ratio` is of medians, with a 95 % interval by resampling runs and what they draw, not adjusted; where one
    of the two never solves, its budget counts in its place, and the ratio is a bound.

    Raises:
      InputError: No contrast has enough runs for a look.
    """
    for contrast in _decided(curves, experiment):
        sides = contrast.x, contrast.y
        yield {
            **_point(contrast.x),
            **_sides(contrast),
            "n": contrast.decision.n,
            "budget": min(side.first.settings.budget for side in sides),
            "verdict": IN_WORDS[contrast.decision.verdict],
            "faster": contrast.decision.faster,
            "ratio": ratio(*contrast.took, "steps"),
            "ratio_disagreements": ratio(*contrast.took, "disagreements"),
        }


@item(
    "verdicts",
    "how many verdicts each contrast has, over the points of a grid",
    {"grid": "", "x": "", "y": "", "n": "points", **dict.fromkeys(_VERDICTS, "")},
    meanings={**_AT, **_VERDICTS},
)
def verdicts(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Counts verdicts; a point of two grids counts in both."""
    counts: dict[tuple[str, str, str], Counter[str]] = {}
    for contrast in _decided(curves, experiment):
        key = contrast.x.condition.axes["grid"], contrast.x.learner.name, contrast.y.learner.name
        counts.setdefault(key, Counter()).update([IN_WORDS[contrast.decision.verdict]])
    for (grid, x, y), ended in counts.items():
        yield {"grid": grid, "x": x, "y": y, "n": ended.total()} | {name: ended[name] for name in _VERDICTS}


@item(
    "looks",
    "how many pairs of runs the contrasts took, and how they ended",
    {"n": "pairs of runs", "contrasts": "", **dict.fromkeys(_VERDICTS, "")},
    meanings={
        **_VERDICTS,
        "n": "pairs of runs",
        "contrasts": "contrasts that ended with so many pairs of runs",
    },
)
def looks(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Counts contrasts by the look that decided them, those of several grids once."""
    assert experiment.report is not None
    distinct = {
        decided.identity(contrast.x, contrast.y): contrast.decision
        for contrast in _decided(curves, experiment)
    }
    for n in experiment.report.looks:
        ended = Counter(IN_WORDS[decision.verdict] for decision in distinct.values() if decision.n == n)
        yield {"n": n, "contrasts": ended.total()} | {name: ended[name] for name in _VERDICTS}


@item(
    "reference",
    "exploratory: DQN and PPO of Stable-Baselines3 compared with the compiled ones",
    {
        **POINT,
        "x": "",
        "y": "reference",
        "n": "runs of x",
        "n_reference": "runs of the reference",
        "steps": "median steps of x",
        "steps_reference": "of the reference",
        "faster": "probability that x is faster",
    },
    meanings={
        **_AT,
        **_SCENARIO,
        "n": "runs of x",
        "n_reference": "runs of y, the reference implementation",
        "steps": _MEDIAN.format("steps").replace("a run", "a run of x"),
        "steps_reference": "the same of y",
        "faster": _FASTER,
    },
)
def reference(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Compares runs of other seeds and other code: by pairs of one run of each, all with all."""
    steps = {
        decided.key(population): took["steps"].to_numpy()
        for population, took in populations(curves, experiment)
    }
    for population in experiment.populations:
        condition, name = decided.key(population)
        of = population.learner.reference_for
        if (condition, of) in steps and (condition, name) in steps:
            x, y = steps[condition, of], steps[condition, name]
            yield {
                **_point(population),
                "x": of,
                "y": name,
                "n": len(x),
                "n_reference": len(y),
                "steps": median(x),
                "steps_reference": median(y),
                "faster": float(np.where(x[:, None] == y, 0.5, x[:, None] < y).mean()),
            }


@item(
    "pairs",
    "what every contrast uses: the steps of its pairs of runs, within one budget",
    where=no_rows,
    meanings={
        **_AT,
        "run": _RUN,
        "steps": "steps until the run has solved its scenario, within the smaller budget; empty if it does "
        "not",
    },
)
def pairs(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates the runs of each contrast; steps are empty where a run does not learn within that budget."""
    for contrast in _decided(curves, experiment):
        sides = (_finite(took["steps"]) for took in contrast.took)
        for i, (x, y) in enumerate(zip(*sides, strict=True)):
            point, names = _name(contrast.x), _sides(contrast)
            yield {**point, **names, "run": i, "steps_x": x, "steps_y": y}


@item(
    "runs",
    "every run: what it took until it had learned, within its own budget",
    where=no_rows,
    meanings={
        **_AT,
        "run": _RUN,
        "steps": "steps until the run has solved its scenario; empty if it never does",
        "disagreements": "wrong PINGs until the run has solved its scenario; empty if it never does",
    },
)
def runs(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates all runs, numbered by seed; empty where a run never solves its scenario."""
    for population, took in populations(curves, experiment):
        names = {**_name(population), "learner": population.learner.name}
        values = (_finite(took[name]) for name in ("steps", "disagreements"))
        for i, (steps, disagreements) in enumerate(zip(*values, strict=True)):
            yield {**names, "run": i, "steps": steps, "disagreements": disagreements}


@item(
    "unseen",
    "every run with unseen places: success in them at the end of training",
    where=no_rows,
    meanings={**_AT, "run": _RUN, "unseen_success": "success with the issuer in unseen places"},
)
def unseen(runs: pd.DataFrame, curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates all runs of the points that have unseen places."""
    of = decided.in_populations(runs)
    for population, took in populations(curves, experiment):
        if population.scenario.issuer.unseen:
            names = {**_name(population), "learner": population.learner.name}
            values = of[decided.key(population)]["unseen_success"].to_numpy()[: len(took)]
            for i, value in enumerate(values):
                yield {**names, "run": i, "unseen_success": value}


@item(
    "measures",
    "measures of every point, for the places of its first run",
    where=no_rows,
    meanings={
        **_AT,
        **_SCENARIO,
        "steps": _MEDIAN.format("steps"),
        "covering_steps": "steps in which the random policy has tried nine tenths of what it can reach",
        "solvable_k": "smallest k for which the scenario is k-QVI-solvable",
    },
)
def measures(curves: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Tabulates `agents.hardness`, beside the median steps.

    Points at which a learner does the same count once: those that differ in unseen places, or for a table in
    permuted coordinates. They are known by the wrong PINGs of the first run.
    """
    seen: set[tuple[str, bytes]] = set()
    of = decided.in_populations(curves)
    for population, took in populations(curves, experiment):
        scenario, learner = population.scenario.drawn(population.seeds.start), population.learner
        wrong_pings = by_step(of[decided.key(population)], "training_wrong_pings")[0]
        same = learner.name, wrong_pings.tobytes()
        if learner.reference_for or same in seen or scenario.following[0].shape[1] > 1:
            continue  # the last: what follows an action is random
        seen.add(same)
        yield {
            **_point(population),
            **_learner(population),
            "n": len(took),
            **_hardness(scenario, learner.observation, experiment.declared.horizon)._asdict(),
            "steps": float(np.median(took["steps"])),
        }


def populations(curves: pd.DataFrame, experiment: Experiment) -> Iterator[tuple[Population, pd.DataFrame]]:
    """Yields every population with what its runs took, see `looks.took`."""
    assert experiment.declared.solved is not None
    rows = decided.in_populations(curves)
    for population in experiment.populations:
        if decided.key(population) in rows:
            took = decided.took(rows[decided.key(population)], experiment.declared.solved.success)
            yield population, decided.without_gaps(took, population)


def _decided(curves: pd.DataFrame, experiment: Experiment) -> list[Contrast]:
    """Returns the contrasts, see `looks.contrasts`; refuses, by an InputError, too few runs for all."""
    if found := decided.contrasts(experiment, curves):
        return found
    raise InputError(f"{experiment.name}: no contrast has enough runs yet: run the experiment first.")


def ratio(x: pd.DataFrame, y: pd.DataFrame, currency: str) -> Estimate:
    """Returns how many times as much y takes as x, by medians over pairs of runs.

    Where most runs never solve, what they spend within the smaller budget counts. It is NaN if that is so of
    both, or if a median is 0. The interval is by resampling pairs, whose runs have the same draw of the
    scenario.

    Args:
      x: What the runs of one side took, see `looks.took`.
      y: The same of the other side.
      currency: One of the keys of `looks.SPENT`.
    """
    n = len(x)
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    drawn = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
    x_medians, y_medians = (np.median(took[currency].to_numpy()[drawn], axis=1) for took in (x, y))
    if (np.isinf(x_medians[0]) and np.isinf(y_medians[0])) or 0 in (x_medians[0], y_medians[0]):
        return Estimate(np.nan, np.nan, np.nan)
    x_spent, y_spent = (np.median(took[f"spent_{currency}"]) for took in (x, y))
    with np.errstate(divide="ignore", invalid="ignore"):  # some runs may have solved at step 0
        samples = _or(y_medians, y_spent) / _or(x_medians, x_spent)
    return Estimate(float(samples[0]), *map(float, np.nanpercentile(samples[1:], [2.5, 97.5])))


def _or(medians: NDArray[np.float64], spent: np.floating) -> NDArray[np.float64]:
    """Returns medians, or what was spent where they are infinite."""
    return np.where(np.isinf(medians), spent, medians)


def _name(population: Population) -> Row:
    """Returns the columns that name a point: its grid, and its name there."""
    axes = {key: value for key, value in population.condition.axes.items() if key != "reading"}
    return {"grid": axes.pop("grid"), "point": ", ".join(f"{axis} {axes[axis]}" for axis in axes)}


def _point(population: Population) -> Row:
    """Returns the same, and what the scenario is there."""
    scenario = population.scenario
    issuer, feedback = scenario.issuer, scenario.issuer.feedback
    return _name(population) | {
        "rows": scenario.grid.rows,
        "columns": scenario.grid.columns,
        "places": len(scenario.places) - issuer.unseen,
        "unseen": issuer.unseen,
        "feedback": feedback.kind,
        "noise": feedback.noise if isinstance(feedback, NoisyFeedback) else 0.0,
        "permuted": issuer.permuted,
    }


def _learner(population: Population) -> Row:
    return {"algorithm": population.learner.variant, "observation": population.learner.observation}


def _sides(contrast: Contrast) -> Row:
    return {"x": contrast.x.learner.name, "y": contrast.y.learner.name}


def _finite(values: pd.Series) -> NDArray[np.float64]:
    """Returns NaN for infinite values."""
    return np.where(np.isinf(values), np.nan, values)


@lru_cache(maxsize=1024)
def _hardness(scenario: Scenario, observation: str, horizon: int) -> Hardness:
    return hardness(compile_seen(scenario, observation), horizon)
