"""Worker processes: nothing is lost or repeated when they, or their driver, are killed or interrupted."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from benchmark.execution.driver import pending, run
from benchmark.execution.executors.processes import Processes
from benchmark.execution.job import execute_job
from benchmark.execution.plan import plan
from benchmark.execution.store import Record, Store
from benchmark.experiments import (
    Experiment,
    RunSpecification,
    all_specifications,
    load_experiment,
    specifications,
)
from envs import InputError
from tests.support import ROOT, command

SMALL = load_experiment("compare_deep_smoke")


def population(
    arm: str, observation: str, seeds: list[int], experiment: Experiment = SMALL
) -> list[RunSpecification]:
    return specifications(experiment, "default", "S1", arm, observation, seeds)


def test_runs_are_the_same_alone_in_a_pool_and_after_an_interrupt(tmp_path: Path) -> None:
    runs = population("dqn_sb3", "one_hot", [0, 1, 2]) + population("ppo_sb3", "coordinates", [0, 1])
    with Store(tmp_path / "runs.db") as store:

        def interrupt(_: list[Record]) -> None:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            run(runs, store, 2, interrupt)
        assert 1 <= len(store.statuses()) < len(runs)
        assert multiprocessing.active_children() == []
        assert run(runs, store, 2) == []
        assert multiprocessing.active_children() == []
        assert pending(runs, store) == []
        pooled = store.get([run.digest for run in runs])
    for i in (0, 3):
        alone = execute_job([runs[i]])[0]
        assert alone.arrays.keys() == pooled[i].arrays.keys()
        for name, values in alone.arrays.items():
            assert values.tobytes() == pooled[i].arrays[name].tobytes(), name
    weights = {record.arrays["weights"].tobytes() for record in pooled}
    assert len(weights) == len(runs)


def test_workers_stay_for_the_next_job() -> None:
    executor = Processes(1)
    try:
        pids = []
        for seed in (0, 1):
            (record,) = executor.submit(population("dqn_sb3", "one_hot", [seed])).result()
            assert record.error is None
            pids.append([process.pid for process in multiprocessing.active_children()])
    finally:
        executor.cancel()
    assert len(pids[0]) == 1
    assert pids[0] == pids[1]


def test_killed_worker_costs_its_run_alone_and_is_tried_again(tmp_path: Path) -> None:
    runs = population("dqn_sb3", "one_hot", [0, 1, 2, 3])

    def kill() -> None:
        deadline = time.monotonic() + 60
        while not multiprocessing.active_children() and time.monotonic() < deadline:
            time.sleep(0.01)
        child = multiprocessing.active_children()[0]
        assert child.pid is not None
        os.kill(child.pid, signal.SIGKILL)

    with Store(tmp_path / "runs.db") as store:
        killer = threading.Thread(target=kill)
        killer.start()
        errors = run(runs, store, 2)
        killer.join()
        assert len(errors) == 1
        assert "its process was killed by signal 9" in errors[0]
        statuses = store.statuses()
        assert sorted(statuses.values()) == ["done", "done", "done", "failed"]
        (failed,) = (run for run in runs if statuses[run.digest] == "failed")
        (record,) = store.get([failed.digest])
        assert record.error == errors[0]
        assert pending(runs, store) == [failed]
        assert run(runs, store, 2) == []
        assert set(store.statuses().values()) == {"done"}


def test_error_in_a_worker_is_stored_and_returned(tmp_path: Path) -> None:
    runs = population("dqn_sb3", "one_hot", [0, 1])
    object.__setattr__(runs[1], "observation", "nonsense")
    with Store(tmp_path / "runs.db") as store:
        (error,) = run(runs, store, 1)
        assert error.startswith("InputError: observation: unknown form nonsense")
        assert store.statuses()[runs[0].digest] == "done"


def test_more_seeds_use_the_runs_that_are_there(tmp_path: Path) -> None:
    runs = population("dqn_linear_sb3", "one_hot", [0, 1])
    with Store(tmp_path / "runs.db") as store:
        assert run(runs, store, 2) == []
        arm = SMALL.algorithms["dqn_linear_sb3"].model_copy(update={"seeds": 3})
        more = SMALL.model_copy(update={"algorithms": {"dqn_linear_sb3": arm}})
        wanted = specifications(more, "default", "S1", "dqn_linear_sb3", "one_hot")
        assert pending(wanted, store) == [wanted[2]]


# A driver that is killed or interrupted


EXPERIMENT = """
description = ""
report = "comparison"
scenarios = ["S1"]
horizon = 200
evaluation_every = 100
map_every = 200
settings = { budget = 400, time_limit = 200 }

[algorithms]
q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 8 }
dqn = { algorithm = "compiled_dqn", observations = ["one_hot"], seeds = 2 }
dqn_sb3 = { algorithm = "dqn", observations = ["one_hot"], seeds = 3 }
ppo_sb3 = { algorithm = "ppo", observations = ["coordinates"], seeds = 3, settings.n_steps = 200 }
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight tables, which are trained in this process, two compiled nets, and six single nets."""
    path = tmp_path_factory.mktemp("experiment") / "stopped.toml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def expected(experiment: Path) -> dict[str, dict[str, bytes]]:
    """The arrays of all its runs by digest, each job executed in this process."""
    jobs = plan(all_specifications(load_experiment(experiment)))
    return arrays_of([record for job in jobs for record in execute_job(job)])


def arrays_of(records: list[Record]) -> dict[str, dict[str, bytes]]:
    return {
        record.digest: {name: values.tobytes() for name, values in record.arrays.items()}
        for record in records
    }


def children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def start(experiment: Path, results: Path) -> tuple[subprocess.Popen[str], list[int]]:
    """Starts an experiment, and waits until both workers are busy and some of their runs are stored."""
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmark", "run", str(experiment), "--results", str(results), "--jobs", "2"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # so that an interrupt reaches it and its workers, as from a terminal
    )
    deadline = time.monotonic() + 240
    while time.monotonic() < deadline:
        time.sleep(0.02)
        if (results / "runs.db").exists():
            try:
                with Store(results / "runs.db", read_only=True) as store:
                    stored = len(store.statuses())
            except InputError:
                continue  # not created yet
            if stored > 9:  # eight tables, and then nets
                return process, children(process.pid)
    process.kill()
    raise AssertionError("too slow")


def are_gone(pids: list[int], within_s: float = 20) -> bool:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if not any(Path(f"/proc/{pid}/stat").exists() for pid in pids):
            return True
        time.sleep(0.1)
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_stopped_driver_loses_only_the_runs_in_flight(
    experiment: Path, expected: dict[str, dict[str, bytes]], tmp_path: Path, number: signal.Signals
) -> None:
    process, workers = start(experiment, tmp_path)
    python = [pid for pid in workers if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text()]
    assert len(python) == 2
    for pid in python:  # none of them hears the terminal's interrupt
        blocked = int(Path(f"/proc/{pid}/status").read_text().split("SigBlk:")[1].split()[0], 16)
        assert blocked >> (signal.SIGINT - 1) & 1
    if number == signal.SIGINT:
        os.killpg(process.pid, number)
    else:
        process.kill()
    _, stderr = process.communicate(timeout=60)
    assert are_gone(workers)
    assert process.returncode == (130 if number == signal.SIGINT else -number)
    if number == signal.SIGINT:
        assert "interrupted: finished runs are kept" in stderr
        assert "Traceback" not in stderr
    with Store(tmp_path / "runs.db", read_only=True) as store:
        stored = len(store.ended())
    assert 9 < stored < len(expected)
    again = command("run", experiment, "--results", tmp_path, "--jobs", "1")
    assert again.returncode == 0, again.stderr
    assert f"{len(expected) - stored} runs done, {stored} were done already" in again.stdout
    with Store(tmp_path / "runs.db", read_only=True) as store:
        assert arrays_of(store.get(sorted(store.statuses()))) == expected
