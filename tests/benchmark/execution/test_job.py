"""What a record holds of what was trained."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from benchmark.analysis.frames import learned
from benchmark.execution import job as execution
from benchmark.execution.job import execute_job, failures, recorded
from benchmark.experiments import all_specifications, load_experiment
from envs import load_scenario
from envs.sources import digest_when_loaded
from tests.support import small_experiment, variant

SOLVED = small_experiment(
    scenarios=["Anywhere"],
    horizon=60,
    map_every=100,
    solved={"success": 0.9, "growth": 1.2},
    settings={"time_limit": 60},
    algorithms={
        "table": variant(seeds=1, settings={"budget": 20_000, "epsilon": 0.1}),
        "net": variant(
            "sb3_dqn",
            "coordinates",
            seeds=1,
            settings={"budget": 2000, "learning_rate": 1e-9, "policy_kwargs": {"net_arch": [8]}},
        ),
    },
)
VALUES = st.floats(-8000, 8000, width=32) | st.floats(-1, 1, width=32) | st.just(np.nan)


@given(arrays(np.float32, (1, 2, 3, 5), elements=VALUES))
def test_recorded_values_have_the_decimals_that_are_published(values: NDArray[np.float32]) -> None:
    made = recorded({"values": values, "stochastic": np.empty((1, 0, 3, 5))})["values"]
    assert made.dtype == np.float32
    published = np.round(values.astype(np.float64), 3)
    assert np.round(made.astype(np.float64), 3).tobytes() == published.tobytes()
    assert np.array_equal(made, published.astype(np.float32), equal_nan=True)


def test_recorded_probabilities_are_those_after_training() -> None:
    values = np.zeros((2, 1, 3, 5), dtype=np.float32)
    stochastic = np.random.default_rng(0).dirichlet(np.ones(5), (2, 4, 3))
    made = recorded({"values": values, "stochastic": stochastic, "updates": np.arange(2)})
    assert np.array_equal(made["stochastic"], stochastic[:, 3:])
    assert made["updates"].tolist() == [0, 1]
    assert recorded({"values": values, "stochastic": stochastic[:, :0]})["stochastic"].shape == (2, 0, 3, 5)


def test_runs_share_the_time_of_their_job(monkeypatch: pytest.MonkeyPatch) -> None:
    """A job that started at 4 s and ends at 12 s: 2 s for each of 4 runs."""
    monkeypatch.setattr(execution, "time", SimpleNamespace(perf_counter=lambda: 12.0))
    job = load_experiment("reproduce", smoke=True).populations[0].runs(range(4))
    records = failures(job, ValueError("oh"), started=4.0)
    assert [record.provenance["wall_time_s"] for record in records] == [2, 2, 2, 2]


def test_a_job_fails_where_a_module_has_changed_since_the_driver_loaded_it(tmp_path: Path) -> None:
    text = "from tests.agents.plain import Q_LEARNING as LEARNER\n"
    (module := tmp_path / "learner_of_mine.py").write_text(text, encoding="utf-8")
    mine = small_experiment(algorithms={"mine": variant("learner_of_mine:LEARNER")})
    (path := tmp_path / "mine.toml").write_text(mine, encoding="utf-8")
    runs = all_specifications(load_experiment(path))
    assert [record.status for record in execute_job(runs)] == ["done", "done"]
    module.write_text(f"{text}# changed\n", encoding="utf-8")
    digest_when_loaded.cache_clear()  # as in a worker that starts now
    for record in execute_job(runs):
        assert record.error == (
            "InputError: a module that the run depends on has changed; run the experiment again."
        )


@pytest.mark.parametrize(
    ("learner", "unseen", "has_ended"), [("table", 0, False), ("table", 13, False), ("net", 0, True)]
)
def test_a_run_that_is_given_up_never_learns(
    tmp_path: Path, learner: str, unseen: int, has_ended: bool
) -> None:
    (path := tmp_path / "mine.toml").write_text(SOLVED, encoding="utf-8")
    first = next(each for each in load_experiment(path).populations if each.learner.variant == learner).first
    run = replace(first, scenario=load_scenario("Anywhere", {"issuer.places": 4, "issuer.unseen": unseen}))
    assert run.solved is not None
    steps = run.schedule.evaluation_steps

    def trained(**more: float) -> Any:
        (record,) = execute_job([replace(run, solved={**(run.solved or {}), **more})])
        assert record.status == "done", record.error
        return record.arrays

    whole = trained()
    late = next((i for i, success in enumerate(whole["success"]) if success >= 0.45), 5)
    assert late > 1
    assert (learned(whole["success"][None], steps, 0.9, until=2)[0] < len(steps)) == (learner == "table")
    # At the evaluation before it reaches half of the level, it is given up; at that evaluation, no longer.
    given_up = trained(given_up_after=steps[late - 1] / steps[-1] - 1e-9)
    for name in ("success", "disagreements"):
        expected = [*whole[name][:late], *[whole[name][late - 1]] * (len(steps) - late)]
        assert given_up[name].tolist() == expected
    for level in (0.9, 0.45):
        assert learned(given_up["success"][None], steps, level, until=2)[0] == len(steps)
    assert (given_up["updates"] < whole["updates"]) == has_ended
    if learner == "table":
        kept = trained(given_up_after=steps[late] / steps[-1] - 1e-9)
        assert all(np.array_equal(kept[name], whole[name]) for name in ("success", "disagreements"))
