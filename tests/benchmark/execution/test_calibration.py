"""Estimates of what runs cost, against costs that are planted."""

import json
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.execution.calibration import DOUBT, calibrate, estimate
from benchmark.execution.plan import Job, plan
from benchmark.execution.provenance import machine
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, all_specifications, load_experiment, specifications


class Planted:
    """Executes nothing: a job takes as long as a formula says, in its records alone."""

    def __init__(self, seconds: Callable[[Job], float], peak_mb: float = 300.0) -> None:
        self._seconds, self._peak_mb = seconds, peak_mb
        self.jobs: list[Job] = []
        self.is_cancelled = False

    def submit(self, job: Job, logs: Path | None = None) -> Future[list[Record]]:
        assert logs is None
        self.jobs.append(job)
        is_first = [small[0].arm for small in self.jobs].count(job[0].arm) == 1  # it also compiles
        seconds = self._seconds(job) + 9.0 * is_first
        future: Future[list[Record]] = Future()
        future.set_result([record(run, seconds / len(job), self._peak_mb) for run in job])
        return future

    def cancel(self) -> None:
        self.is_cancelled = True


def record(run: RunSpecification, seconds: float, peak_mb: float, where: str = "") -> Record:
    """Returns a record of a run that took so long."""
    measured = {"wall_time_s": seconds, "peak_memory_mb": peak_mb, "machine": where or machine()}
    arrays: dict[str, NDArray[Any]] = {"greedy": np.zeros(4, np.uint8), "values": np.zeros(4, np.float32)}
    return Record(run.digest, run.content, "done", measured, arrays)


def dqn() -> list[RunSpecification]:
    """A hundred runs, a job each, with a budget of 10,000 steps, which learn from step 100 on."""
    experiment = load_experiment("compare_deep")
    return specifications(experiment, "default", "S1", "dqn_sb3", "one_hot", range(100))


def tables() -> list[RunSpecification]:
    return specifications(load_experiment("compare_deep"), "default", "S1", "q_learning", "index")


def test_cost_of_nets_is_a_fixed_part_and_one_per_step() -> None:
    (job, *_) = plan(dqn())
    worker = Planted(lambda job: 0.5 + 3e-3 * (job[0].settings.budget - 100))
    (climb,), _ = calibrate([job], limit_s=20.0, executor=lambda _: worker)
    assert climb.cost.seconds(job) == pytest.approx(0.5 + 3e-3 * 9900)
    # No small job may take more than what is left of the 20 seconds, as the whole budget would.
    assert [small[0].settings.budget for small in worker.jobs] == [200, 200, 800, 3200]
    assert worker.is_cancelled


def test_cost_of_tables_is_that_of_whole_budgets() -> None:
    """A table that has learned is evaluated faster, so little budget says little about much."""
    (job, *_) = plan(tables())
    worker = Planted(lambda job: 0.1 + len(job) * (0.02 if job[0].settings.budget == 10_000 else 0.5))
    (climb,), _ = calibrate([job], limit_s=20.0, executor=lambda _: worker)
    assert climb.cost.seconds(job) == pytest.approx(0.1 + 25 * 0.02)


def test_one_expensive_job_leaves_time_for_other_populations() -> None:
    jobs = plan(dqn())[:1] + plan(tables())[:1]
    worker = Planted(lambda job: 6.0 if job[0].arm == "dqn_sb3" else 0.01)
    climbs, _ = calibrate(jobs, limit_s=20.0, executor=lambda _: worker)
    assert [small[0].arm for small in worker.jobs].count("dqn_sb3") == 2
    assert [bool(climb.points) for climb in climbs] == [True, True]


def test_estimate_adds_up_jobs_over_places() -> None:
    worker = Planted(lambda job: 1.0 * len(job))  # whatever the budget, so the whole budget costs no more
    runs = tables() + specifications(load_experiment("compare_deep"), "default", "S2", "q_learning", "index")
    estimated = estimate(runs, None, jobs=2, cores=2, limit_s=1e6, executor=lambda _: worker)
    low, high = estimated.seconds
    assert low == pytest.approx(100 / DOUBT["calibrated"], abs=5)  # eight jobs of 25 runs, two at a time
    assert high == pytest.approx(100 * DOUBT["calibrated"], abs=5)
    assert estimated.jobs == 8
    assert estimated.sources == {
        "calibrated": 2
    }  # one of the two stands for the other, which has the same size
    assert {small[0].scenario.name for small in worker.jobs} == {"S1"}


def test_other_settings_of_an_algorithm_are_similar() -> None:
    runs = all_specifications(load_experiment("compare_deep"))
    chosen = [run for run in runs if run.algorithm == "q_learning" and run.scenario.name == "S1"]

    class OnlyTuned(Planted):
        def submit(self, job: Job, logs: Path | None = None) -> Future[list[Record]]:
            future = super().submit(job, logs)
            return future if job[0].arm == "q_learning_tuned" else Future()

    workers = [OnlyTuned(lambda _: 0.1)]
    chosen.sort(key=lambda run: run.arm, reverse=True)
    estimated = estimate(chosen, None, 1, 1, 3.0, executor=lambda _: workers[0])
    assert estimated.sources == {"calibrated": 1, "similar": 1}
    low, high = estimated.seconds
    assert high > 0.1 * 4 * (DOUBT["calibrated"] + DOUBT["similar"]) > low


def test_stored_runs_of_such_a_machine_are_believed(tmp_path: Path) -> None:
    runs = dqn()
    with Store(tmp_path / "runs.db") as store:
        store.add(record(run, 3.0, 450.0) for run in runs[:25])
        store.add([record(runs[25], 1e6, 450.0, "another machine")])
        store.add([record(runs[26].with_seed(7), 3.0, 500.0)])  # a seed that is not declared
        estimated = estimate(runs[50:], store, 2, 2, executor=lambda _: pytest.fail("nothing is executed"))
        _, size = store.contents()[runs[0].digest]
    assert estimated.seconds == pytest.approx((75 / DOUBT["stored"], 75 * DOUBT["stored"]))
    assert estimated.peak_memory == 2 * 500 * 2**20  # each job in a process of its own
    assert estimated.size == pytest.approx(50 * (size + len(runs[0].content)), rel=0.01)
    with Store(tmp_path / "runs.db") as store:
        estimated = estimate(runs[98:], store, jobs=64, cores=2)
    assert estimated.seconds == pytest.approx((3 / DOUBT["stored"], 3 * DOUBT["stored"]))
    assert estimated.peak_memory == 2 * 500 * 2**20  # there are only two jobs
    assert estimated.sources == {"stored": 1}


def test_time_is_up_whatever_is_running() -> None:
    class Stuck(Planted):
        def submit(self, job: Job, logs: Path | None = None) -> Future[list[Record]]:
            super().submit(job, logs)
            return Future()

    worker = Stuck(lambda _: 1.0)
    estimated = estimate(dqn(), None, 2, 2, limit_s=2.0, executor=lambda _: worker)
    assert worker.is_cancelled
    assert (len(worker.jobs), len(estimated.unknown)) == (1, 1)


def test_failing_jobs_are_reported() -> None:
    class Failing(Planted):
        def submit(self, job: Job, logs: Path | None = None) -> Future[list[Record]]:
            future = super().submit(job, logs)
            failed = [Record(run.digest, run.content, "failed", {}, {}, "ValueError: planted") for run in job]
            future = Future()
            future.set_result(failed)
            return future

    estimated = estimate(dqn(), None, 2, 2, executor=lambda _: Failing(lambda _: 1.0))
    assert estimated.failures == ["S1, dqn_sb3, one_hot: ValueError: planted"]


@pytest.mark.parametrize("experiment", ["compare_deep", "beyond", "reproduce", "compare_deep_smoke"])
def test_small_jobs_are_accepted_by_settings_and_grow(experiment: str) -> None:
    """Rollouts fill budgets, maps are among evaluations, and the whole job is the end."""
    jobs = {job[0].population: job for job in plan(all_specifications(load_experiment(experiment)))}
    worker = Planted(lambda _: 1e-9)
    calibrate([*jobs.values()], limit_s=1e6, executor=lambda _: worker)
    last = {}
    for small in worker.jobs:
        run = small[0]
        assert {*run.map_steps} <= {*run.evaluation_steps}
        last[json.dumps([run.scenario.model_dump(mode="json"), run.arm, run.observation])] = small
    whole = {
        json.dumps([job[0].scenario.model_dump(mode="json"), job[0].arm, job[0].observation]): job
        for job in jobs.values()
    }
    if experiment != "reproduce":  # where conditions share these names
        assert {key: (len(job), job[0].population) for key, job in last.items()} == {
            key: (len(job), job[0].population) for key, job in whole.items()
        }
