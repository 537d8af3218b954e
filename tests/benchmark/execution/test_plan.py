"""How runs fall into jobs."""

from dataclasses import replace

from benchmark.execution.plan import MAX_JOB_WORK, plan
from benchmark.experiments import all_specifications, load_experiment


def test_runs_of_a_population_are_one_job_and_all_populations_come_first() -> None:
    for name, n_populations in (("reproduce", 23), ("equivalence", None)):
        runs = all_specifications(load_experiment(name, smoke=True))
        jobs = plan(runs)
        assert sorted(run.digest for job in jobs for run in job) == sorted(run.digest for run in runs)
        populations = {run.population for run in runs}
        assert {job[0].population for job in jobs[: len(populations)]} == populations
        assert n_populations in (None, len(jobs))
        assert all(len(job) == 1 for job in jobs if job[0].algorithm in ("sb3_dqn", "sb3_ppo"))


def test_long_runs_are_split_over_jobs() -> None:
    budget = 4_000_000
    run = all_specifications(load_experiment("reproduce", smoke=True))[0]
    long = replace(run, settings=run.settings.model_copy(update={"budget": budget}))
    assert [len(job) for job in plan([long.with_seed(seed) for seed in range(30)])] == [2] * 15
    assert 2 * budget <= MAX_JOB_WORK < 3 * budget
