"""What a record holds of what was trained."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark.analysis.frames import learned
from benchmark.execution.job import execute_job
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
