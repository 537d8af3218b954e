"""Whenever a command is killed or interrupted, no run is lost, repeated or different."""

import os
import resource
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from benchmark.executors import Threads
from benchmark.experiment import load_experiment
from benchmark.run import execute
from benchmark.specification import RunSpecification
from benchmark.store import Store
from tests.support import ROOT, SLOW_EXPERIMENT, all_specifications, arrays_of, n_stored, until

Arrays = dict[str, dict[str, bytes]]


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("experiment") / "stopped.toml"
    path.write_text(SLOW_EXPERIMENT, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def runs(experiment: Path) -> list[RunSpecification]:
    return all_specifications(load_experiment(experiment))


@pytest.fixture(scope="module")
def expected(runs: list[RunSpecification], tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    """The arrays of all its runs by digest, each executed in this process."""
    with Store(tmp_path_factory.mktemp("expected") / "runs.db") as store:
        assert execute(runs, store, 1, executor=Threads(1)) == []
        return arrays_of(store.get(sorted(store.ended())))


def start(experiment: Path, results: Path, **more: Any) -> subprocess.Popen[str]:
    """Starts a driver in its own session, so that an interrupt reaches it as from a terminal."""
    options = ["--results", str(results), "--jobs", "1"]
    return subprocess.Popen(
        [sys.executable, "-m", "benchmark", "run", str(experiment), *options],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        **more,
    )


def resume(runs: list[RunSpecification], results: Path, expected: Arrays) -> int:
    """Executes what is missing, and nothing else; returns how many runs were stored."""
    done = list[str]()
    with Store(results / "runs.db") as store:
        stored = store.ended()
        assert arrays_of(store.get(sorted(stored))).items() <= expected.items()
        assert execute(runs, store, 1, lambda digests, _: done.extend(digests), Threads(1)) == []
        assert sorted(done) == sorted(expected.keys() - stored)
        assert arrays_of(store.get(sorted(store.statuses()))) == expected
    return len(stored)


def children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_stopped_driver_loses_only_the_runs_in_flight(
    experiment: Path,
    runs: list[RunSpecification],
    expected: Arrays,
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    process = start(experiment, tmp_path)
    until(lambda: n_stored(tmp_path) > 0)
    workers = children(process.pid)
    assert workers
    os.killpg(process.pid, number) if number == signal.SIGINT else process.kill()
    _, stderr = process.communicate(timeout=60)
    until(lambda: not any(Path(f"/proc/{pid}/stat").exists() for pid in workers))
    assert process.returncode == (130 if number == signal.SIGINT else -number)
    assert "Traceback" not in stderr
    assert 1 <= resume(runs, tmp_path, expected) < len(expected)


@pytest.mark.slow
def test_an_interrupt_prints_no_traceback_whenever_it_comes(
    experiment: Path, tmp_path: Path
) -> None:
    for i in range(12):
        process = start(experiment, tmp_path / str(i))
        time.sleep(0.3 + 0.2 * i)
        os.killpg(process.pid, signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
        # On a loaded machine, Python itself may not have begun with us.
        assert process.returncode in (-signal.SIGINT, 130) or "benchmark/" not in stderr, stderr
        assert "Exception" not in stderr, stderr


@pytest.mark.slow
def test_full_disk_is_one_line_and_keeps_what_is_stored(
    experiment: Path, runs: list[RunSpecification], expected: Arrays, tmp_path: Path
) -> None:
    """A file may not become larger than so many bytes: one that is too few for all runs."""
    with Store(tmp_path / "runs.db") as store:
        assert execute(runs[:3], store, 1, executor=Threads(1)) == []
    limit = (tmp_path / "runs.db").stat().st_size + 2000
    limited = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit))
    process = start(experiment, tmp_path, preexec_fn=limited)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 2
    assert stderr.splitlines()[-1].startswith(f"error: {tmp_path / 'runs.db'}: ")
    assert "Traceback" not in stderr
    assert 3 <= resume(runs, tmp_path, expected) < len(expected)
