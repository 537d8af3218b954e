"""An algorithm of another kind from outside, in this file: it plans."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pytest
from numpy.random import SeedSequence

from agents import LearnerSettings, Schedule, SequentialAlgorithm
from agents.dynamic_programming import solve
from benchmark import runs
from benchmark.__main__ import main
from envs import Model
from tests.support import small_experiment, variant


class PlannerSettings(LearnerSettings):
    """A discount."""

    discount: float = 0.9

    @property
    def discount_factor(self) -> float:
        """The discount."""
        return self.discount


class Planner(SequentialAlgorithm):
    """Knows the model, and has the optimal values from the start."""

    family = "deep"  # for the reports
    settings = PlannerSettings
    placement = "thread"

    def train_agent(
        self,
        model: Model,
        settings: Any,
        observation: str,  # noqa: ARG002
        seed: SeedSequence,  # noqa: ARG002
        schedule: Schedule,
    ) -> dict[str, Any]:
        """Returns the same plan for every agent, at every step."""
        q = solve(model, settings.discount_factor).q[model.fresh_state]
        n_steps = len(schedule.evaluation_steps)
        is_best = q >= q.max(axis=1, keepdims=True) - 1e-9
        return {
            "greedy": np.tile((is_best @ (1 << np.arange(5))).astype(np.uint8), (n_steps, 1)),
            "q": q,
            "stochastic": np.empty((0, *q.shape)),
            "values": np.tile(q.astype(np.float32), (len(schedule.map_steps), 1, 1)),
            "disagreements": np.zeros(n_steps, dtype=np.int64),
            "cpu_time_s": np.full(n_steps, 0.5),
            "updates": 0,
            "parameters": q.size,
            "diverged_at": -1,
        }


DEEP: Final = Planner()


def test_it_is_compared_like_any_other(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = small_experiment(
        report={"kind": "comparison", "contrasts": [["planner, index", "q_learning, index"]]},
        scenarios=["S1", "S3"],
        horizon=200,
        map_every=100,
        algorithms={
            "q_learning": variant(seeds=10),
            "planner": variant(f"{__name__}:DEEP", seeds=10),
        },
    )
    file.write_text(text, encoding="utf-8")
    assert main(["run", str(file), "--report", "--jobs", "1", "--results", str(tmp_path)]) == 0
    scores = runs(file, tmp_path).query("learner == 'planner, index'")
    assert scores["score"].to_numpy() == pytest.approx(1)
    (contrast,) = pd.read_csv(tmp_path / "mine" / "contrasts.csv").to_dict("records")
    assert contrast["success_verdict"] == "better"
    readme = (tmp_path / "mine" / "README.md").read_text(encoding="utf-8")
    assert "plain Python" not in readme  # nobody knows what a planner is written in
    assert (tmp_path / "mine" / "index.html").exists()
