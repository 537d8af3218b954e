"""Comparisons made by hand, for tests of what reports compute from them."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
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
from benchmark.analysis.records import Records
from benchmark.drawing.tables import write_csv
from benchmark.experiments import Experiment, Learner, Population, Reporting
from benchmark.experiments.schema import Variant
from benchmark.folder import write_manifest
from benchmark.publish.document import Document
from benchmark.publish.draw import tables_of
from benchmark.studies.comparison import REPORT
from benchmark.studies.data import Data
from benchmark.studies.item import Item
from envs import compile_scenario, load_scenario

BUDGET, POINTS = 400, 5  # steps of training, and how many evaluations
_COLUMNS = (
    "steps", "wrong_pings", "uncomfortable_steps", "greedy_success", "target_cells_marked", "cells_marked",
    "region_overlap",
)  # fmt: skip
_ALGORITHMS = {
    "tabular": "q_learning",
    "linear": "linear_q_lambda",
    "deep": f"{__name__}:NET",
    "other": "tests.agents.plain:Q_LEARNING",
    "planner": "memoryless",
}


class _Tiles(TabularAlgorithm):
    family = "linear"
    observations = ("index", "coordinates", "offset_coordinates")


class _Net(TabularAlgorithm):
    family = "deep"


TILES, NET = _Tiles(Q_LEARNING), _Net(Q_LEARNING)  # tables that reports take for linear, and for a net


class Made(NamedTuple):
    """A learner made by hand, with the same runs in every scenario unless `success` is by scenario."""

    family: str
    success: float | Sequence[float]  # share of runs, the first of which succeed
    n: int = 100  # runs in each scenario
    score: float | None = None  # of every run; by default as its success
    policy: str = "greedy"
    reference_for: str = ""
    budget: int = BUDGET
    every_run: bool = False  # whether the success is that of every run instead of a share of them
    observation: str = "index"


class Cell(NamedTuple):
    """The runs of a learner in a scenario under a condition."""

    name: str
    success: ArrayLike  # (N,) after training, or (N, T)
    scenario: str = "S1"
    family: str = "tabular"
    policy: str = "greedy"
    budget: int = BUDGET
    score: ArrayLike | None = None  # by default as success
    condition: str = "default"
    reference_for: str = ""
    wrong_pings: ArrayLike = 0  # (N, T) of training, since its start
    observation: str = "index"


def over_training(final: ArrayLike) -> NDArray[np.float64]:
    """Returns (N, T) numbers that are 0 until the last evaluation, from (N,) or (N, T)."""
    values = np.asarray(final, dtype=float)
    return values if values.ndim == 2 else np.column_stack([np.zeros((len(values), POINTS - 1)), values])


@lru_cache
def random_success(scenario: str) -> float:
    """Returns how often the random policy succeeds."""
    model = compile_scenario(load_scenario(scenario))
    return float(evaluate(model, uniform_policy(model), 200).success)


def data_of(
    cells: Sequence[Cell],
    contrasts: Sequence[tuple[str, str]] = (),
    baseline: Sequence[str] = (),
    *,
    is_partial: bool = False,
    records: Mapping[str, Records] = MappingProxyType({}),
    **reporting: Any,
) -> Data:
    """Returns a comparison of cells.

    Sides of contrasts name learners without their observation. Records are those of a scenario, whoever is
    asked for; further keys are those of `[report]`.
    """
    learners = {f"{cell.name}, {cell.observation}": _learner(cell) for cell in cells}

    def side(name: str) -> str:
        full = {learner.variant: name for name, learner in learners.items()}
        return " @ ".join(full.get(part, part) for part in name.split(" @ "))

    reporting["effects"] = tuple((side(x), side(y), name) for x, y, name in reporting.get("effects", ()))
    pairs, tables = [(side(x), side(y)) for x, y in contrasts], [side(name) for name in baseline]
    report = Reporting(kind="comparison", contrasts=tuple(pairs), baseline=tuple(tables), **reporting)
    conditions = {cell.condition: SimpleNamespace(name=cell.condition, axes={}) for cell in cells}
    texts = {"name": "made", "argument": "made"}
    declared = SimpleNamespace(**texts, horizon=200, report=report, conditions=conditions)
    scenarios = {cell.scenario: load_scenario(cell.scenario) for cell in cells}
    runs, curves, populations = [], [], []
    for cell in cells:
        success = over_training(cell.success)
        score = success if cell.score is None else over_training(cell.score)
        seeds, steps = range(len(success)), np.linspace(0, cell.budget, success.shape[1], dtype=int)
        learner, condition = learners[f"{cell.name}, {cell.observation}"], conditions[cell.condition]
        made: Any = (condition, scenarios[cell.scenario], learner, None, seeds, len(seeds))
        populations.append(Population(*made))
        over_time = {"success": success, "score": score.clip(0, 1), "unbounded_score": score}
        over_time["training_wrong_pings"] = np.broadcast_to(np.asarray(cell.wrong_pings), success.shape)
        columns: dict[str, Any] = dict.fromkeys(_COLUMNS, 0)
        columns |= {"policy": cell.policy, "budget": cell.budget, "diverged_at": np.inf, "seed": seeds}
        columns |= {name: values[:, -1] for name, values in over_time.items()}
        columns["random_success"] = random_success(cell.scenario)
        runs.append(pd.DataFrame(keys_of(populations[-1]) | columns))
        over = {"seed": np.repeat(seeds, len(steps)), "step": np.tile(steps, len(seeds))}
        over |= {name: values.ravel() for name, values in over_time.items()}
        curves.append(pd.DataFrame(keys_of(populations[-1]) | over))
    experiment = Experiment(cast(Any, declared), Path("made.toml"), learners, scenarios, populations)
    made = {
        "experiment": experiment,
        "runs": pd.concat(runs, ignore_index=True),
        "curves": pd.concat(curves, ignore_index=True),
        "records": lambda population: records[population.scenario.name],
        "is_partial": is_partial,
    }
    return cast(Data, SimpleNamespace(**made))


def _learner(cell: Cell) -> Learner:
    name = _ALGORITHMS[cell.family]
    declared = Variant(
        algorithm=name,
        observations=(cell.observation,),
        seeds=len(np.asarray(cell.success)),
        policy=cast(Any, cell.policy),
        reference_for=cell.reference_for,
    )
    return Learner(cell.name, cell.observation, declared, load_algorithm(name), cell.family, None)


def compared(
    learners: Mapping[str, Made],
    contrasts: Sequence[tuple[str, str]] = (),
    baseline: Sequence[str] = (),
    scenarios: Sequence[str] = ("S1", "S2", "S3"),
    **more: Any,
) -> Data:
    """Returns a comparison of learners; without contrasts, of each but references with every baseline."""
    cells = []
    for name, made in learners.items():
        shares = made.success if isinstance(made.success, Sequence) else [made.success] * len(scenarios)
        for scenario, share in zip(scenarios, shares, strict=False):
            success = np.full(made.n, share) if made.every_run else np.arange(made.n) < round(share * made.n)
            score = None if made.score is None else np.full(made.n, made.score)
            own = made.family, made.policy, made.budget, score
            cell = Cell(name, success, scenario, *own, reference_for=made.reference_for)
            cells.append(cell._replace(observation=made.observation))
    others = [name for name, made in learners.items() if name not in baseline and not made.reference_for]
    pairs = contrasts or [(name, table) for name in others for table in baseline]
    return data_of(cells, pairs, baseline, **more)


def item(name: str) -> Item:
    """Returns an item of the comparison."""
    return next(found for found in REPORT.items if found.name == name)


def table(name: str, data: Data) -> pd.DataFrame:
    """Returns a table of the comparison."""
    found = item(name).tabulate(data)
    assert found is not None
    return found


def folder_of(path: Path, data: Data, *names: str) -> Document:
    """Writes these tables of a comparison and its manifest, as its folder of results has them."""
    path.mkdir(parents=True, exist_ok=True)
    for name, frame in tables_of([item(name) for name in names], data).items():
        write_csv(frame, path / f"{name}.csv")
    experiment = data.experiment
    assert experiment.report is not None
    algorithms: dict[str, Any] = {}
    for learner in experiment.learners.values():
        keys = {"algorithm", "title", "policy", "tuned_by", "seeds"}
        about = learner.declared.model_dump(mode="json", include=keys)
        about |= {"family": learner.family, "runs": about.pop("seeds"), "settings": {}, "changed": []}
        algorithms.setdefault(learner.variant, about)["settings"][learner.observation] = {}
    manifest = {
        **dict.fromkeys(("description", "note", "command", "partial", "search"), ""),
        **{"experiment": "made", "argument": "made", "horizon": 200, "runs": len(data.runs)},
        "report": experiment.report.model_dump(mode="json"),
        "scenarios": {name: {} for name in experiment.scenarios},
        "algorithms": algorithms,
    }
    write_manifest(path, manifest)
    return Document(path)
