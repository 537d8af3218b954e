"""Tables of the report on scenarios: what the scenarios are, and where which learner does better.

Planners, which know the model, are no learners: they say what is possible. Numbers of learners are those of
`benchmark.reports.comparison.tables`; here every scenario stands for itself, and nothing is averaged over
them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate
from agents.memoryless import SEARCH
from agents.policy import uniform_policy
from benchmark.analysis.contrasts import Side
from benchmark.analysis.intervals import combined, student
from benchmark.analysis.population import Population
from benchmark.reports.comparison import tables as comparison
from benchmark.reports.comparison.data import Data
from benchmark.reports.comparison.protocol import Learner
from benchmark.reports.item import Frames

ENOUGH: Final = 0.9  # a mean success by which a scenario counts as learned


def learners(data: Data) -> Data:
    """Returns the data of the learners, without planners."""
    kept = {
        learner: populations
        for learner, populations in data.learners.items()
        if next(iter(populations.values())).algorithm.family != "planner"
    }
    return replace(data, learners=kept)


def scenarios(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates what each scenario is, and what is possible in it.

    Returns are sums of the grid's rewards over an episode. `optimal_return` is that of an agent that knows
    the state; `memoryless_return` and `memoryless_success` are those of the best policy over observations
    that the algorithm `memoryless` has found in `restarts` runs, and `memoryless_score` is that return as a
    score.
    """
    first = next(iter(learners(data).learners.values()))
    rows = []
    for scenario, population in first.items():
        model = population.model
        random, optimal = population.anchors["grid_return"]
        row: dict[str, Any] = {
            "scenario": scenario,
            "description": model.scenario.description,
            "cells": len(model.position),
            "states": len(model.observation),
            "observations": model.n_observations,
            "observed": _in_words(model.scenario.observe),
            "hidden": _in_words(model.scenario.hidden) or "nothing",
            "random_return": random,
            "random_success": float(evaluate(model, uniform_policy(model), population.horizon).success),
            "optimal_return": optimal,
        }
        found = [
            learner
            for learner, populations in data.learners.items()
            if populations[scenario].algorithm is SEARCH
        ]
        if found:
            returns, success = (
                np.concatenate([data.results(learner, scenario, name)[:, -1] for learner in found])
                for name in ("grid_return", "success")
            )
            best = int(returns.argmax())
            row |= {"restarts": len(returns), "memoryless_return": returns[best]}
            row |= {"memoryless_success": success[best]}
            row["memoryless_score"] = (returns[best] - random) / (optimal - random)
        rows.append(row)
    return pd.DataFrame(rows)


def summary(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates every population at the end of training, with the issuer's disagreements while it learned.

    `disagreements` are wrong PINGs per 1,000 steps of the whole training, with Student's interval.
    """
    frame = comparison.summary(learners(data))
    columns = [_disagreements(population) for _, _, population in learners(data).populations]
    steps = [population.settings.budget for _, _, population in learners(data).populations]
    frame.insert(5, "budget", steps)
    return pd.concat([frame, pd.DataFrame(columns)], axis=1)


def scores(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates every run at the end of training, see `benchmark.reports.comparison.tables.scores`."""
    wanted = ["scenario", "algorithm", "observation", "policy", "seed", "success", "score", "steps"]
    wanted += ["wrong_pings", "disagreements", "diverged_at"]
    return comparison.scores(learners(data))[wanted]


def curves(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates success and disagreements over training, see `benchmark.reports.comparison.tables.curves`."""
    frame = comparison.curves(learners(data))
    return frame[[name for name in frame if not str(name).startswith("score")]]


def cost(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates what a run costs, see `benchmark.reports.comparison.tables.cost`."""
    return comparison.cost(learners(data))


def region(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates how well agents know the target region, see `benchmark.reports.comparison.tables.region`."""
    return comparison.region(learners(data))


def contrasts(data: Data, _: Frames) -> pd.DataFrame | None:
    """Tabulates the contrasts of the protocol in every scenario, with verdicts.

    P-values are adjusted for all contrasts in all scenarios together, for each endpoint.

    Returns:
      One row per scenario and contrast of learners that are there; None if there is none.
    """
    protocol, data = data.protocol, learners(data)
    if protocol is None:
        return None
    pairs = [pair for pair in protocol.contrasts if set(pair) <= data.learners.keys()]
    cases = [(scenario, *pair) for scenario in _scenarios(data) for pair in pairs]
    if not cases:
        return None
    rows: list[dict[str, Any]] = [{"scenario": s, "x": str(x), "y": str(y)} for s, x, y in cases]
    for endpoint, field in comparison.ENDPOINTS.items():
        sides = [(_side(data, x, s, field), _side(data, y, s, field)) for s, x, y in cases]
        comparison.judge(rows, endpoint, sides, protocol, is_incomplete=data.is_incomplete)
    return pd.DataFrame(rows)


def steps(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates after how many steps each population has learned a scenario.

    `step` is the first evaluation from which the mean success over runs stays at or above `ENOUGH` to the
    last evaluation; infinite if there is none. `below_at` is the last evaluation before it, so that the
    scenario was learned between the two; empty if there is none.
    """
    rows = []
    for learner, scenario, population in learners(data).populations:
        mean = data.results(learner, scenario, "success").mean(axis=0)
        below = np.flatnonzero(mean < ENOUGH)
        first = 0 if not len(below) else int(below[-1]) + 1
        when = [*population.evaluation_steps, np.inf]
        rows.append(
            {
                "scenario": scenario,
                **learner._asdict(),
                "n": len(population.seeds),
                "budget": population.evaluation_steps[-1],
                "step": float(when[first]),
                "below_at": float(when[first - 1]) if first > 0 else np.nan,
                "final_success": float(mean[-1]),
            }
        )
    return pd.DataFrame(rows)


def ahead(data: Data, _: Frames) -> pd.DataFrame | None:
    """Tabulates between which steps x of each contrast succeeds more often than y: exploratory.

    A step counts if the 95 % interval of the difference of the means, not adjusted, lies above 0. Only steps
    at which both are evaluated count. `first_step` and `last_step` are infinite if none does.

    Returns:
      One row per scenario and contrast, and the same with x and y exchanged; None if there is no contrast.
    """
    protocol, data = data.protocol, learners(data)
    if protocol is None:
        return None
    rows = []
    for scenario in _scenarios(data):
        for pair in protocol.contrasts:
            if set(pair) <= data.learners.keys():
                rows += [_ahead(data, scenario, *each) for each in (pair, pair[::-1])]
    return pd.DataFrame(rows) if rows else None


def effects(data: Data, _: Frames) -> pd.DataFrame | None:
    """Tabulates what each declared difference between two scenarios does to every learner: exploratory.

    Differences are those of the scenario minus those of the one that it is compared with, in success, clipped
    score, and disagreements per 1,000 steps of training, with 95 % intervals that are not adjusted.

    Returns:
      One row per effect and learner; None if there are no effects.
    """
    declared, data = data.effects, learners(data)
    rows = []
    for effect in declared:
        for learner, populations in data.learners.items():
            there = [populations[name] for name in (effect.scenario, effect.against)]
            row: dict[str, Any] = {
                "effect": effect.name,
                "scenario": effect.scenario,
                "against": effect.against,
                **learner._asdict(),
                "n": min(len(each.seeds) for each in there),
            }
            for name, field in comparison.ENDPOINTS.items():
                sides = [_side(data, learner, s, field) for s in (effect.scenario, effect.against)]
                means, sizes = [side.mean for side in sides], [side.sizes[0] for side in sides]
                low, high = combined([1, -1], means, sizes)
                row |= {f"{name}_with": means[0], f"{name}_without": means[1]}
                row |= {name: means[0] - means[1], f"{name}_low": low, f"{name}_high": high}
            rates = [_disagreements(each) for each in there]
            value = rates[0]["disagreements"] - rates[1]["disagreements"]
            reaches = [each["disagreements_high"] - each["disagreements"] for each in rates]
            reach = float(np.hypot(reaches[0], reaches[1]))
            row |= {"disagreements": value, "disagreements_low": value - reach}
            row |= {"disagreements_high": value + reach}
            rows.append(row)
    return pd.DataFrame(rows) if rows else None


def _in_words(parts: Sequence[str]) -> str:
    """Returns parts of the state as readers see them."""
    return ", ".join(parts).replace("wrong_pings", "wrong PINGs")


def _scenarios(data: Data) -> Iterator[str]:
    """Returns the scenarios, in the order declared."""
    return iter(next(iter(data.learners.values())))


def _side(data: Data, learner: Learner, scenario: str, field: str) -> Side:
    """Returns a learner's mean in a scenario at the end of training."""
    final = data.results(learner, scenario, field)[:, -1]
    return Side([float(final.mean())], [len(final)])


def _disagreements(population: Population) -> dict[str, float]:
    """Returns the disagreements per 1,000 steps of training, with Student's interval."""
    rate = population.arrays["disagreements"][:, -1:] / population.evaluation_steps[-1] * 1000
    low, high = student(rate)
    names = ("disagreements", "disagreements_low", "disagreements_high")
    return dict(zip(names, (float(rate.mean()), max(float(low[0]), 0.0), float(high[0])), strict=True))


def _ahead(data: Data, scenario: str, x: Learner, y: Learner) -> Mapping[str, Any]:
    """Returns when x is ahead of y in a scenario."""
    means: list[NDArray[np.float64]] = []
    when = [data.learners[each][scenario].evaluation_steps for each in (x, y)]
    common = sorted(set(when[0]) & set(when[1]))
    sizes = []
    for learner, evaluated in zip((x, y), when, strict=True):
        results = data.results(learner, scenario, "success")
        means.append(results.mean(axis=0)[[evaluated.index(step) for step in common]])
        sizes.append(len(results))
    low = np.array([combined([1, -1], [float(a), float(b)], sizes)[0] for a, b in zip(*means, strict=True)])
    is_ahead = low > 0
    difference = means[0] - means[1]
    most = int(difference.argmax())
    return {
        "scenario": scenario,
        "x": str(x),
        "y": str(y),
        "n": min(sizes),
        "steps_ahead": int(is_ahead.sum()),
        "first_step": float(common[int(is_ahead.argmax())]) if is_ahead.any() else np.inf,
        "last_step": float(common[len(common) - 1 - int(is_ahead[::-1].argmax())])
        if is_ahead.any()
        else np.inf,
        "largest_difference": float(difference[most]),
        "largest_at": common[most],
        "largest_x": float(means[0][most]),
        "largest_y": float(means[1][most]),
    }
