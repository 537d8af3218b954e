"""Estimates of what runs cost, against costs that are planted."""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.execution.calibration import DOUBT, estimate
from benchmark.execution.plan import Job
from benchmark.execution.provenance import machine
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, all_specifications, load_experiment, specifications

COMPARED = load_experiment("compare_deep")


class Planted:
    """Executes nothing: a job takes as long as a formula says, in its records alone.

    A job whose time is None never ends.
    """

    def __init__(self, seconds: Callable[[Job], float | None], error: str | None = None) -> None:
        self._seconds, self._error = seconds, error
        self.jobs: list[Job] = []
        self.is_cancelled = False

    def submit(self, job: Job, logs: Path | None = None) -> Future[list[Record]]:
        assert logs is None
        compiles = job[0].algorithm not in {small[0].algorithm for small in self.jobs}
        self.jobs.append(job)
        future: Future[list[Record]] = Future()
        if (seconds := self._seconds(job)) is not None:
            each = (seconds + 9.0 * compiles) / len(job)
            future.set_result([record(run, each, 300.0, error=self._error) for run in job])
        return future

    def cancel(self) -> None:
        self.is_cancelled = True


def record(
    run: RunSpecification, seconds: float, peak_mb: float, where: str = "", error: str | None = None
) -> Record:
    """Returns a record of a run that took so long."""
    measured = {"wall_time_s": seconds, "peak_memory_mb": peak_mb, "machine": where or machine()}
    arrays: dict[str, NDArray[Any]] = {"greedy": np.zeros(4, np.uint8), "values": np.zeros(4, np.float32)}
    return Record(run.digest, run.content, "done" if error is None else "failed", measured, arrays, error)


# A hundred runs, a job each, which learn from step 100 of 10,000 on; and as many in jobs of 25.
NETS = specifications(COMPARED, "default", "S1", "dqn_sb3", "one_hot", range(100))
TABLES = specifications(COMPARED, "default", "S1", "q_learning", "index")


@pytest.mark.parametrize(
    ("runs", "seconds", "a_run"),
    [
        (NETS, lambda job: 3e-3 * (job[0].settings.budget - 100), 3e-3 * 9900),
        (TABLES, lambda job: 2e-5 * len(job) * job[0].settings.budget, 0.2),
    ],
)
def test_time_is_in_proportion_to_runs_and_budget(
    runs: list[RunSpecification], seconds: Callable[[Job], float], a_run: float
) -> None:
    worker = Planted(seconds)
    estimated = estimate(runs, None, jobs=4, cores=2, executor=lambda _: worker)
    expected = (100 * a_run / 2 / DOUBT["short jobs"], 100 * a_run / 2 * DOUBT["short jobs"])
    assert estimated.seconds == pytest.approx(expected, rel=0.01)
    assert estimated.sources == {"short jobs": 1}
    assert sum(seconds(job) for job in worker.jobs) < a_run * 10
    assert worker.is_cancelled


def test_one_short_job_stands_for_all_of_its_kind() -> None:
    """A table's time goes into evaluations of all states; here other scenarios have as many."""
    runs = all_specifications(load_experiment("reproduce_smoke"))
    worker = Planted(lambda job: 1.0 * len(job))
    estimated = estimate(runs, None, jobs=2, cores=2, executor=lambda _: worker)
    assert estimated.seconds[1] == pytest.approx(156 / 2 * DOUBT["short jobs"], rel=0.6)
    assert estimated.sources == {"short jobs": 23}
    assert len(worker.jobs) < 23


def test_stored_runs_of_such_a_machine_are_believed(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add(record(run, 3.0, 450.0) for run in NETS[:25])
        store.add([record(NETS[25], 1e6, 450.0, "another machine")])
        store.add([record(NETS[26].with_seed(700), 3.0, 500.0)])  # a seed that is not declared
        estimated = estimate(NETS[50:], store, 2, 2, executor=lambda _: pytest.fail("nothing is executed"))
        few = estimate(NETS[98:], store, jobs=64, cores=2)
    assert estimated.seconds == pytest.approx((75 / DOUBT["stored runs"], 75 * DOUBT["stored runs"]))
    assert estimated.size == 50 * NETS[0].record_size
    assert few.seconds == pytest.approx((3 / DOUBT["stored runs"], 3 * DOUBT["stored runs"]))
    for each in (estimated, few):  # two jobs, each in a process of its own
        assert each.peak_memory == 2 * 500 * 2**20
        assert each.sources == {"stored runs": 1}


def test_kinds_are_unknown_if_the_time_is_up_or_a_job_fails() -> None:
    worker = Planted(lambda job: 0.1 if job[0].variant == "q_learning" else None)
    estimated = estimate([*TABLES, *NETS], None, 2, 2, limit_s=0.1, executor=lambda _: worker)
    assert worker.is_cancelled
    assert (estimated.sources, estimated.unknown) == ({"short jobs": 1}, ["dqn_sb3"])
    failing = Planted(lambda _: 1.0, "ValueError: planted")
    estimated = estimate(NETS, None, 2, 2, executor=lambda _: failing)
    assert estimated.errors == ["S1, dqn_sb3, one_hot: ValueError: planted"]
    assert (estimated.unknown, estimated.sources) == (["dqn_sb3"], {})


def test_short_jobs_are_valid_runs() -> None:
    """They fill rollouts, and have maps among evaluations."""
    worker = Planted(lambda _: 1e-9)
    runs = [run for run in all_specifications(COMPARED) if run.scenario.name == "S1"]
    estimate(runs, None, 2, 2, executor=lambda _: worker)
    assert len(worker.jobs) > 5
    for run, *_ in worker.jobs:
        assert {*run.schedule.map_steps} <= {*run.schedule.evaluation_steps}
        type(run.settings).model_validate_json(run.settings.model_dump_json(exclude_unset=True))
