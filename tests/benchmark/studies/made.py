"""Comparisons made by hand, for tests of what is computed from them."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from agents import load_algorithm
from agents.dynamic_programming import evaluate
from agents.policy import uniform_policy
from agents.tabular.learner import TabularAlgorithm
from agents.tabular.updates import Q_LEARNING
from benchmark.analysis.frames import keys_of
from benchmark.experiments import Experiment, Learner, Population
from benchmark.experiments.schema import Variant
from benchmark.studies.comparison import STUDY
from benchmark.studies.comparison.analysis import ComparisonAnalysis, analyse
from benchmark.studies.comparison.declared import ComparisonDeclared
from benchmark.studies.item import Item
from envs import compile_scenario, load_scenario

BUDGET, POINTS = 400, 5  # steps of training, and how many evaluations
_ALGORITHMS = {"tabular": "q_learning", "deep": f"{__name__}:NET"}


class _Net(TabularAlgorithm):
    family = "deep"


NET = _Net(Q_LEARNING)  # a table that a comparison takes for a net


class Made(NamedTuple):
    """A learner made by hand, with the same runs in every scenario unless `success` is by scenario."""

    family: str
    success: float | Sequence[float]  # share of runs, the first of which succeed
    n: int = 100  # runs in each scenario
    score: float | None = None  # of every run; by default as its success
    policy: str = "greedy"
    every_run: bool = False  # whether the success is that of every run instead of a share of them


class Cell(NamedTuple):
    """The runs of a learner in a scenario."""

    name: str
    success: ArrayLike  # (N,) after training, or (N, T)
    scenario: str = "S1"
    family: str = "tabular"
    policy: str = "greedy"
    score: ArrayLike | None = None  # by default as success
    reference_for: str = ""
    wrong_pings: ArrayLike = 0  # (N, T) of training, since its start


@lru_cache
def random_success(scenario: str) -> float:
    """Returns how often the random policy succeeds."""
    model = compile_scenario(load_scenario(scenario))
    return float(evaluate(model, uniform_policy(model), 200).success)


def analysis_of(
    cells: Sequence[Cell],
    contrasts: Sequence[tuple[str, str]] = (),
    baseline: Sequence[str] = (),
    **report: Any,
) -> ComparisonAnalysis:
    """Returns a comparison of cells; further keys are those of `[report]`.

    Contrasts and baselines are named without their observation.
    """
    learners = {f"{cell.name}, index": _learner(cell) for cell in cells}
    report["contrasts"] = tuple((f"{x}, index", f"{y}, index") for x, y in contrasts)
    report["baseline"] = tuple(f"{name}, index" for name in baseline)
    condition = SimpleNamespace(name="default", axes={})
    scenarios = {cell.scenario: load_scenario(cell.scenario) for cell in cells}
    runs, curves, populations = [], [], []
    for cell in cells:
        success = _over_training(cell.success)
        seeds, steps = range(len(success)), np.linspace(0, BUDGET, success.shape[1], dtype=int)
        learner = learners[f"{cell.name}, index"]
        made: Any = (condition, scenarios[cell.scenario], learner, (), seeds, seeds)
        populations.append(Population(*made))
        over_time = {"success": success, "unbounded_score": success}
        if cell.score is not None:
            over_time["unbounded_score"] = _over_training(cell.score)
        over_time["score"] = over_time["unbounded_score"].clip(0, 1)
        over_time["training_wrong_pings"] = np.broadcast_to(np.asarray(cell.wrong_pings), success.shape)
        final: dict[str, Any] = {name: values[:, -1] for name, values in over_time.items()}
        final |= {"policy": cell.policy, "budget": BUDGET, "diverged_at": np.inf, "seed": seeds}
        final |= dict.fromkeys(("steps", "wrong_pings", "uncomfortable_steps", "greedy_success"), 0)
        final["random_success"] = random_success(cell.scenario)
        runs.append(pd.DataFrame(keys_of(populations[-1]) | final))
        over = {"seed": np.repeat(seeds, len(steps)), "step": np.tile(steps, len(seeds))}
        over |= {name: values.ravel() for name, values in over_time.items()}
        curves.append(pd.DataFrame(keys_of(populations[-1]) | over))
    declared: Any = SimpleNamespace(name="made", horizon=200, conditions={})
    data: Any = SimpleNamespace(
        experiment=Experiment(declared, Path("made.toml"), learners, scenarios, populations),
        declared=ComparisonDeclared(kind="comparison", **report),
    )
    data.runs, data.curves = (pd.concat(rows, ignore_index=True) for rows in (runs, curves))
    return analyse(data)


def _over_training(final: ArrayLike) -> NDArray[np.float64]:
    """Returns (N, T) numbers that are 0 until the last evaluation, from (N,) or (N, T)."""
    values = np.asarray(final, dtype=float)
    return values if values.ndim == 2 else np.column_stack([np.zeros((len(values), POINTS - 1)), values])


def _learner(cell: Cell) -> Learner:
    name, policy = _ALGORITHMS[cell.family], cast(Any, cell.policy)
    about = {"seeds": len(np.asarray(cell.success)), "policy": policy, "reference_for": cell.reference_for}
    declared = Variant(algorithm=name, observations=("index",), **about)
    return Learner(cell.name, "index", declared, load_algorithm(name), cell.family, None)


def compared(
    learners: Mapping[str, Made],
    contrasts: Sequence[tuple[str, str]] = (),
    baseline: Sequence[str] = (),
    scenarios: Sequence[str] = ("S1", "S2", "S3"),
    **more: Any,
) -> ComparisonAnalysis:
    """Returns a comparison of learners; without contrasts, of each with every baseline."""
    cells = []
    for name, made in learners.items():
        shares = made.success if isinstance(made.success, Sequence) else [made.success] * len(scenarios)
        for scenario, share in zip(scenarios, shares, strict=False):
            success = np.full(made.n, share) if made.every_run else np.arange(made.n) < round(share * made.n)
            score = None if made.score is None else np.full(made.n, made.score)
            own = made.family, made.policy, score
            cells.append(Cell(name, success, scenario, *own))
    others = [name for name in learners if name not in baseline]
    pairs = contrasts or [(name, table) for name in others for table in baseline]
    return analysis_of(cells, pairs, baseline, **more)


def item(name: str) -> Item:
    """Returns an item of the comparison."""
    return next(found for found in STUDY.items if found.name == name)


def table(name: str, analysis: ComparisonAnalysis) -> pd.DataFrame:
    """Returns a table of the comparison."""
    found = item(name).tabulate(analysis)
    assert found is not None
    return found
