"""How runs fall into jobs, and what records hold of what was trained."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import load_algorithm
from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from benchmark.experiment import load_experiment
from benchmark.job import execute_job, plan
from benchmark.specification import solved
from envs import compile_scenario, load_scenario
from envs.sources import digest_when_loaded
from tests.support import all_specifications, made, small_experiment, specifications, variant

SMALL = load_experiment("reproduce", smoke=True)
SOLVED = small_experiment(
    scenarios=["Anywhere"],
    horizon=60,
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


def test_runs_of_a_population_are_one_job_and_all_populations_come_first(tmp_path: Path) -> None:
    tables = all_specifications(SMALL)
    assert len(plan(tables)) == len({run.population for run in tables}) == 23
    variants = {"table": variant(), "net": variant("sb3_dqn", "one_hot", "coordinates")}
    text = small_experiment(algorithms=variants)
    nets = all_specifications(made(tmp_path / "mine.toml", text))
    jobs, populations = plan(nets), {run.population for run in nets}
    assert sorted(r.digest for job in jobs for r in job) == sorted(run.digest for run in nets)
    assert {job[0].population for job in jobs[: len(populations)]} == populations
    assert {len(job) for job in jobs if job[0].algorithm.startswith("sb3")} == {1}
    settings = tables[0].settings.model_copy(update={"budget": 4_000_000})  # of at most 10 million
    long = replace(tables[0], settings=settings)
    assert [len(job) for job in plan([long.with_seed(seed) for seed in range(30)])] == [2] * 15


def test_records_hold_what_training_and_evaluation_gave() -> None:
    runs = specifications(SMALL, "budget", "S2", "q_learning", "index")
    model = compile_scenario(runs[0].scenario)
    seeds = [run.seed_sequence for run in runs]
    algorithm = load_algorithm("q_learning")
    training = algorithm.train(model, runs[0].settings, "index", seeds, runs[0].schedule)
    evaluation = evaluate(model, mask_policy(training.greedy), SMALL.declared.horizon)
    none = evaluate(model, training.stochastic, SMALL.declared.horizon)
    records = execute_job(runs)
    expected = vars(training) | vars(evaluation)
    expected |= {f"stochastic_{name}": values for name, values in vars(none).items()}
    del expected["cpu_time_s"]  # measured, and so a part of the provenance
    expected["values"] = np.round(training.values.astype(np.float64), 3).astype(np.float32)
    for i, record in enumerate(records):
        assert record.arrays.keys() == expected.keys()
        for name, values in expected.items():
            assert np.array_equal(record.arrays[name], values[i]), name
        assert record.arrays["episodes_ended"] == 400
        assert len(record.provenance["cpu_time_s"]) == len(runs[0].schedule.evaluation_steps)


def test_a_job_fails_where_a_module_has_changed_since_the_driver_loaded_it(tmp_path: Path) -> None:
    text = "from tests.agents.plain import Q_LEARNING as LEARNER\n"
    (module := tmp_path / "learner_of_mine.py").write_text(text, encoding="utf-8")
    mine = small_experiment(algorithms={"mine": variant("learner_of_mine:LEARNER")})
    runs = all_specifications(made(tmp_path / "mine.toml", mine))
    assert [record.status for record in execute_job(runs)] == ["done", "done"]
    module.write_text(f"{text}# changed\n", encoding="utf-8")
    digest_when_loaded.cache_clear()  # as in a worker that starts now
    for record in execute_job(runs):
        assert record.error == (
            "InputError: a module that the run depends on has changed; run it again."
        )


@pytest.mark.parametrize(("learner", "unseen"), [("table", 0), ("table", 13), ("net", 0)])
def test_a_run_that_is_given_up_never_learns(tmp_path: Path, learner: str, unseen: int) -> None:
    """A net ends when it is given up, a table goes on; the net has a learning rate of 1e-9."""
    populations = made(tmp_path / "mine.toml", SOLVED).populations
    first = next(each.first for each in populations if each.learner.variant == learner)
    places = {"issuer.places": 4, "issuer.unseen": unseen}
    run = replace(first, scenario=load_scenario("Anywhere", places))
    steps = run.schedule.evaluation_steps

    def trained(**more: float) -> Any:
        (record,) = execute_job([replace(run, solved={**(run.solved or {}), **more})])
        assert record.status == "done", record.error
        return record.arrays

    whole = trained()
    late = next((i for i, success in enumerate(whole["success"]) if success >= 0.45), 5)
    assert (solved(whole["success"].tolist(), steps, 0.9)[0] < len(steps)) == (learner == "table")
    # Given up at the evaluation before it reaches half of the level
    given_up = trained(given_up_after=steps[late - 1] / steps[-1] - 1e-9)
    for name in ("success", "disagreements"):
        expected = [*whole[name][:late], *[whole[name][late - 1]] * (len(steps) - late)]
        assert given_up[name].tolist() == expected
    assert (given_up["updates"] < whole["updates"]) == (learner == "net")
    assert whole["unseen_success"].shape == ((1, 2) if unseen else (0, 2))
    if learner == "table":
        kept = trained(given_up_after=steps[late] / steps[-1] - 1e-9)
        assert kept["success"].tolist() == whole["success"].tolist()
