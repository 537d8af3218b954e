"""Comparisons made by hand, for tests of what reports compute from them and say of them."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.tabular.learner import TabularAlgorithm
from agents.tabular.updates import Q_LEARNING
from benchmark.drawing.tables import write_csv
from benchmark.reports.comparison import REPORT
from benchmark.reports.comparison.declared import Declared, Learner
from benchmark.reports.comparison.runs import Cell, Runs
from benchmark.reports.document import Document
from benchmark.reports.draw import tables_of
from benchmark.reports.item import Item
from tests.benchmark.populations import population

BUDGET, POINTS = 400, 5  # steps of training, and how many evaluations
_ALGORITHMS = {"tabular": "q_learning", "deep": "compiled_dqn", "planner": "memoryless"}


class _Net(TabularAlgorithm):
    family = "deep"


NET = _Net(Q_LEARNING)  # a table that reports take for a net


class Made(NamedTuple):
    """A learner made by hand, with the same runs in every scenario unless `success` is by scenario."""

    family: str
    success: float | Sequence[float]  # share of runs, the first of which succeed
    n: int = 100  # runs in each scenario
    score: float | Sequence[float] | None = None  # of every run; by default as its success
    policy: str = "greedy"
    reference_for: str = ""
    budget: int = BUDGET
    every_run: bool = False  # whether the success is that of every run instead of a share of them


def over_training(final: ArrayLike) -> NDArray[np.float64]:
    """Returns (N, T) numbers that are 0 until the last evaluation, from (N,) or (N, T)."""
    values = np.asarray(final, dtype=float)
    return values if values.ndim == 2 else np.column_stack([np.zeros((len(values), POINTS - 1)), values])


def cell(
    name: str,
    success: ArrayLike,
    scenario: str = "S1",
    family: str = "tabular",
    policy: str = "greedy",
    budget: int = BUDGET,
    *,
    score: ArrayLike | None = None,
    condition: str = "default",
    observation: str = "index",
    **arrays: Any,
) -> Cell:
    """Returns runs with this success and score, (N,) after training or (N, T)."""
    success = over_training(success)
    score = success if score is None else over_training(score)
    prefix = "" if policy == "greedy" else "stochastic_"
    random, optimal = population(scenario).anchors["grid_return"]
    arrays = {
        f"{prefix}success": success,
        f"{prefix}grid_return": random + score * (optimal - random),
        **arrays,
    }
    algorithm = _ALGORITHMS[family]
    made = population(
        scenario, len(success), algorithm, budget=budget, every=budget // 4, observation=observation, **arrays
    )
    return Cell(scenario, condition, Learner(name, observation), made, policy, condition != "default")


def runs_of(
    cells: Sequence[Cell],
    contrasts: Sequence[tuple[str, str]] = (),
    baseline: str | Sequence[str] = "",
    *,
    references: Mapping[str, str] | None = None,
    missing: str = "",
    planners: Sequence[Cell] = (),
    **reporting: Any,
) -> Runs:
    """Returns a comparison of cells; contrasts and baselines name learners without their observation."""
    axes = {
        "scenarios": list(dict.fromkeys(each.scenario for each in cells)),
        "conditions": list(dict.fromkeys(each.condition for each in cells)),
    }
    learners = {str(each.learner): each.population.algorithm.family for each in cells}

    def side(name: str) -> str:
        parts = [f"{part}, index" if f"{part}, index" in learners else part for part in name.split(" @ ")]
        return " @ ".join(parts)

    reporting["effects"] = [(side(x), side(y), name) for x, y, name in reporting.get("effects", ())]
    pairs = [(side(x), side(y)) for x, y in contrasts]
    baselines = side(baseline) if isinstance(baseline, str) else [side(name) for name in baseline]
    declared = {"kind": "comparison", "contrasts": pairs, "baseline": baselines, **reporting}
    facts = {"declared": json.dumps(declared), "learners": learners, "axes": axes}
    return Runs(
        cells,
        planners,
        Declared.from_manifest({"facts": facts, "experiment": "made"}),
        groups={},
        references={Learner(x, "index"): Learner(y, "index") for x, y in (references or {}).items()},
        missing=missing,
    )


def compared(
    learners: Mapping[str, Made],
    contrasts: Sequence[tuple[str, str]] = (),
    baseline: str | Sequence[str] = "",
    scenarios: Sequence[str] = ("S1", "S2", "S3"),
    **more: Any,
) -> Runs:
    """Returns a comparison of learners; without contrasts, of each with every baseline."""
    cells = []
    for name, made in learners.items():
        success, score = (
            each if isinstance(each, Sequence) else [each] * len(scenarios)
            for each in (made.success, made.score)
        )
        for scenario, share, each in zip(scenarios, success, score, strict=False):
            assert share is not None
            reached = np.full(made.n, share) if made.every_run else np.arange(made.n) < round(share * made.n)
            scored = None if each is None else np.full(made.n, each)
            own = made.family, made.policy, made.budget
            cells.append(cell(name, reached, scenario, *own, score=scored))
    baselines = [baseline] * bool(baseline) if isinstance(baseline, str) else baseline
    others = [name for name in learners if name not in baselines]
    pairs = contrasts or [(name, table) for name in others for table in baselines]
    references = {name: made.reference_for for name, made in learners.items() if made.reference_for}
    return runs_of(cells, pairs, baseline, references=references, **more)


def item(name: str) -> Item:
    """Returns an item of the comparison."""
    return next(each for each in REPORT.items if each.name == name)


def folder_of(path: Path, runs: Runs, *names: str) -> Document:
    """Writes tables and the manifest of a comparison, as its folder of results has them; by default all."""
    path.mkdir(parents=True, exist_ok=True)
    items = [each for each in REPORT.items if not names or each.name in names]
    for name, frame in tables_of(items, runs).items():
        write_csv(frame, path / f"{name}.csv")
    references = {str(check): str(checked.algorithm) for check, checked in runs.references.items()}
    algorithms = {
        each.learner.algorithm: {
            "family": each.population.algorithm.family,
            "packages": [],
            "policy": each.policy,
            "reference_for": references.get(str(each.learner), ""),
            "settings": each.population.specification["settings"],
        }
        for each in runs
    }
    manifest = {
        "experiment": "made",
        "description": "Made by hand.",
        "note": "",
        "command": "none",
        "argument": "made",
        "report": runs.declared.reporting.model_dump(mode="json"),
        "facts": runs.facts,
        "scenarios": {name: {} for name in runs.scenarios},
        "algorithms": algorithms,
        "partial": runs.note,
        "horizon": 200,
        "runs": 1,
        "looks": [],
    }
    (path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return Document(path)
