"""An algorithm of another kind from outside, in this file: it plans, and has neither a kernel nor a net."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pandas as pd
import pytest
from numpy.random import SeedSequence

from agents import Algorithm, LearnerSettings, Schedule, Training
from agents.dynamic_programming import solve
from agents.policy import greedy_masks
from benchmark.__main__ import main
from envs import Model


class PlannerSettings(LearnerSettings):
    """A discount."""

    discount: float = 0.9

    @property
    def discount_factor(self) -> float:
        """The discount."""
        return self.discount


@dataclass(frozen=True)
class Planner:
    """Knows the model, and has the optimal values from the start."""

    family: Literal["tabular", "deep"]
    version: int = 1
    settings: type[LearnerSettings] = PlannerSettings
    observations: tuple[str, ...] = ("index",)
    packages: tuple[str, ...] = ()
    batch_size: int = 5
    placement: Literal["thread", "process"] = "thread"
    writes_logs: bool = False

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,  # noqa: ARG002
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),  # noqa: ARG002
    ) -> Training:
        """Returns the same plan for every agent, at every step."""
        q = solve(model, settings.discount_factor).q[model.fresh_state]
        n, n_steps = len(seeds), len(schedule.evaluation_steps)
        return Training(
            greedy=np.tile(greedy_masks(q, 1e-9), (n, n_steps, 1)),
            q=np.tile(q, (n, 1, 1)),
            stochastic=np.empty((n, 0, *q.shape)),
            values=np.tile(q.astype(np.float32), (n, len(schedule.map_steps), 1, 1)),
            disagreements=np.zeros((n, n_steps), dtype=np.int64),
            cpu_time_s=np.full((n, n_steps), 0.5),
            updates=np.zeros(n, dtype=np.int64),
            parameters=np.full(n, q.size),
            diverged_at=np.full(n, -1),
        )


DEEP: Final = Planner("deep")
TABULAR: Final = Planner("tabular")

EXPERIMENT = """
description = "A planner, and tables that have no time to learn."
report = "comparison"
scenarios = ["S1", "S3"]
horizon = 200
evaluation_every = 100
map_every = 100
settings = {{ budget = 200 }}
algorithms.q_learning = {{ algorithm = "q_learning", observations = ["index"], seeds = {seeds} }}
algorithms.planner = {{ algorithm = "{planner}", observations = ["index"], seeds = {seeds} }}
"""


def test_it_meets_the_contract() -> None:
    assert isinstance(DEEP, Algorithm)


@pytest.mark.parametrize(("seeds", "expected"), [(10, "deep RL earns its keep"), (3, "there is no verdict")])
def test_it_is_compared_like_any_other(tmp_path: Path, seeds: int, expected: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(EXPERIMENT.format(planner=f"{__name__}:DEEP", seeds=seeds), encoding="utf-8")
    assert main(["run", str(file), "--report", "--jobs", "1", "--results", str(tmp_path)]) == 0
    scores = pd.read_csv(tmp_path / "mine" / "scores.csv").query("algorithm == 'planner'")
    assert scores["score"].to_numpy() == pytest.approx(1)
    (headline, *_) = pd.read_csv(tmp_path / "mine" / "findings.csv")["text"]
    assert expected in headline
    assert ("a verdict takes 10 runs" in headline) == (seeds < 10)
    assert "plain Python" not in headline  # nobody knows what a planner is written in
    assert (tmp_path / "mine" / "index.html").exists()


def test_two_tables_are_drawn_without_a_verdict(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(EXPERIMENT.format(planner=f"{__name__}:TABULAR", seeds=2), encoding="utf-8")
    assert main(["run", str(file), "--report", "--jobs", "1", "--results", str(tmp_path)]) == 0
    assert pd.read_csv(tmp_path / "mine" / "findings.csv").empty
    assert "planner" in (tmp_path / "mine" / "aggregate.md").read_text(encoding="utf-8")
