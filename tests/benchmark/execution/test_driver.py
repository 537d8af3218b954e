"""The driver executes what is missing, once, and stores what comes of it."""

import threading
import time
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from agents import load_algorithm
from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from benchmark.execution import job as execution
from benchmark.execution.driver import pending, run
from benchmark.execution.plan import Job
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment
from envs import compile_scenario
from tests.support import specifications

SMALL = load_experiment("reproduce", smoke=True)


def test_records_hold_what_training_and_evaluation_gave(tmp_path: Path) -> None:
    runs = specifications(SMALL, "budget", "S2", "q_learning", "index")
    model = compile_scenario(runs[0].scenario)
    seeds = [run.seed_sequence for run in runs]
    algorithm = load_algorithm("q_learning")
    training = algorithm.train(model, runs[0].settings, "index", seeds, runs[0].schedule)
    evaluation = evaluate(model, mask_policy(training.greedy), SMALL.declared.horizon)
    none = evaluate(model, training.stochastic, SMALL.declared.horizon)
    with Store(tmp_path / "runs.db") as store:
        assert run(runs, store, jobs=2) == []
        records = store.get([run.digest for run in runs])
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


def test_failed_runs_are_stored_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = all_specifications(SMALL)[:6]

    def fail(_: str) -> NoReturn:
        raise FloatingPointError("diverged")

    with Store(tmp_path / "runs.db") as store:
        with monkeypatch.context() as patch:
            patch.setattr(execution, "load_algorithm", fail)
            errors = run(runs, store, jobs=1)
        assert errors == ["FloatingPointError: diverged"] * 6
        assert set(store.statuses().values()) == {"failed"}
        assert {record.error for record in store.get([run.digest for run in runs])} == set(errors)
        assert pending(runs, store) == runs
        assert run(runs, store, jobs=1) == []
        assert pending(runs, store) == []


def test_interrupt_keeps_the_jobs_that_are_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = all_specifications(SMALL)
    executed: list[str] = []
    execute = execution.execute_job
    together = threading.Barrier(3, timeout=60)

    def slow(job: Job) -> list[Record]:
        records = execute(job)
        executed.extend(run.digest for run in job)
        if len(executed) <= 3 * len(job):  # the first three jobs end together
            together.wait()
        else:
            time.sleep(0.2)  # so that the interrupt comes before the last of them
        return records

    calls: list[int] = []

    def interrupt(ended: list[str], _: int) -> None:
        calls.append(len(ended))
        if len(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(execution, "execute_job", slow)
    with Store(tmp_path / "runs.db") as store:
        with pytest.raises(KeyboardInterrupt):
            run(runs, store, 3, interrupt)
        assert len(executed) >= 12
        assert set(store.statuses()) == set(executed)
        assert len(executed) < len(runs)
