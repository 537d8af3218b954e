"""How runs fall into jobs."""

from benchmark.execution.plan import JOB_WORK, plan
from benchmark.experiments import (
    EXPERIMENT_DIRECTORY,
    Experiment,
    all_specifications,
    load_experiment,
    specifications,
)
from envs.inputs import override, parse, read_toml


def test_runs_of_a_population_are_one_job() -> None:
    runs = all_specifications(load_experiment("reproduce_smoke"))
    jobs = plan(runs)
    assert [len(job) for job in jobs] == [12] * 3 + [6] * 20  # more of the default reading
    assert sorted(run.digest for job in jobs for run in job) == sorted(run.digest for run in runs)


def test_long_runs_are_split_over_jobs() -> None:
    budget = 4_000_000
    changes = {"readings.default.seeds": 30, "algorithms.q_learning.settings.budget": budget}
    data = override(read_toml(EXPERIMENT_DIRECTORY / "reproduce.toml"), changes, "test")
    experiment = parse(Experiment, data, "test", name="long")
    jobs = plan(specifications(experiment, "default", "S1", "q_learning", "index"))
    assert [len(job) for job in jobs] == [2] * 15
    assert 2 * budget <= JOB_WORK < 3 * budget


def test_first_jobs_are_of_all_populations() -> None:
    compared = load_experiment("compare_deep_smoke")
    jobs = plan(all_specifications(compared))
    first = [job[0] for job in jobs[: len(compared.populations)]]
    assert {(run.scenario.name, run.arm, run.observation) for run in first} == set(compared.populations)
    assert all(len(job) == 1 for job in jobs if job[0].algorithm in ("dqn", "ppo"))
