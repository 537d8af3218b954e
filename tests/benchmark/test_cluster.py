"""A Dask cluster: a real scheduler and real workers, all on this machine's loopback interface."""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Self

import pytest
from distributed import Client

from benchmark import cluster
from benchmark.__main__ import main
from benchmark.cluster import Cluster
from benchmark.executors import Threads
from benchmark.experiment import load_experiment
from benchmark.job import execute_job, plan
from benchmark.run import execute, pending
from benchmark.store import Store
from tests.support import (
    PATIENCE_S,
    ROOT,
    SLOW_EXPERIMENT,
    all_specifications,
    arrays_of,
    made,
    n_stored,
    until,
)

MIXED = """
description = "Tables and a compiled net: nine jobs, so that each of three workers gets one."
scenarios = ["S1", "S2", "S3"]
horizon = 200
evaluation_every = 100
map_every = 200
settings = { budget = 400, time_limit = 200 }

[algorithms]
q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 8 }
beside = { algorithm = "beside_cluster:LEARNER", observations = ["index"], seeds = 1 }
dqn = { algorithm = "compiled_dqn", observations = ["one_hot"], seeds = 1 }
"""
# What workers execute before they start.
ELSEWHERE = """
import platform, types
from benchmark import provenance
provenance.platform = types.SimpleNamespace(
    system=lambda: "Elsewhere",
    machine=platform.machine,
    processor=platform.processor,
    python_version=platform.python_version,
)
"""
OTHER_NUMPY = """
from importlib.metadata import version
from benchmark import provenance
provenance.version = lambda package: "0.1" if package == "numpy" else version(package)
"""
KILLED = """
import os, signal
from benchmark import cluster
cluster.execute_job = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
"""


class Machines:
    """A scheduler, its workers and drivers, a process each, and what they write, in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        """Starts the scheduler, outside the repository: it needs nothing of this project."""
        file = self._folder / "scheduler.json"
        network = ["--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0"]
        dask = ["dask", "scheduler", *network, "--scheduler-file", str(file)]
        self.scheduler = self._start(self._folder, *dask)
        until(lambda: file.exists() and file.read_text().endswith("}"))
        self.address: str = json.loads(file.read_text())["address"]
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()

    def add(self, name: str, preload: str = ELSEWHERE) -> subprocess.Popen[bytes]:
        (file := self._folder / f"preload_{name}.py").write_text(preload, encoding="utf-8")
        own = ["--name", name, "--nthreads", "1", "--local-directory", str(self._folder)]
        own += ["--no-nanny", "--no-dashboard", "--preload", str(file)]
        return self._start(ROOT, "dask", "worker", self.address, *own)

    def addresses(self, *names: str) -> dict[str, str]:
        """Waits until these workers are there, and no others, and returns their addresses."""
        with Client(self.address, set_as_default=False) as client:

            def workers() -> dict[str, str]:
                known = client.scheduler_info()["workers"]
                return {worker["name"]: address for address, worker in known.items()}

            until(lambda: workers().keys() == set(names))
            return workers()

    def _start(self, cwd: Path, *module: str) -> subprocess.Popen[bytes]:
        with (self._folder / "log.txt").open("ab") as file:
            command = [sys.executable, "-m", *module]
            self._processes.append(subprocess.Popen(command, cwd=cwd, stdout=file, stderr=file))
        return self._processes[-1]


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machines]:
    with Machines(tmp_path_factory.mktemp("pair")) as machines:
        machines.add("a")
        machines.add("b")
        machines.addresses("a", "b")
        yield machines


@pytest.mark.slow
def test_runs_are_the_same_as_here_even_if_a_worker_is_killed(
    pair: Machines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The module of a learner is beside the experiment, and nowhere on the path of workers."""
    module = "from tests.agents.plain import Q_LEARNING as LEARNER\n"
    (tmp_path / "beside_cluster.py").write_text(module, encoding="utf-8")
    (mixed := tmp_path / "mixed.toml").write_text(MIXED, encoding="utf-8")
    jobs = plan(all_specifications(load_experiment(mixed)))
    expected = [record for job in jobs for record in execute_job(job)]
    killed = pair.add("killed", KILLED)  # in the middle of its first job
    pair.addresses("a", "b", "killed")
    assert main(["run", str(mixed), "--results", str(tmp_path), "--cluster", pair.address]) == 0
    assert killed.wait(PATIENCE_S) == -signal.SIGKILL
    assert f"{len(expected)} runs done, 0 were done already" in capsys.readouterr().out
    with Store(tmp_path / "runs.db") as store:
        assert len(store.statuses()) == len(expected)
        records = store.get([record.digest for record in expected])
        assert arrays_of(records) == arrays_of(expected)
        for stored, record in zip(records, expected, strict=True):
            assert stored.status == record.status == "done"
            assert stored.provenance["machine"].startswith("Elsewhere")
            for name in ("versions", "commit"):
                assert stored.provenance[name] == record.provenance[name]


@pytest.mark.slow
def test_workers_that_differ_are_refused(pair: Machines, tmp_path: Path) -> None:
    (job, *_) = plan(all_specifications(made(tmp_path / "mine.toml", SLOW_EXPERIMENT)))
    pair.addresses("a", "b")
    executor = Cluster(pair.address)
    other = pair.add("package", OTHER_NUMPY)
    try:
        address = pair.addresses("a", "b", "package")["package"]
        refused = f"worker {address} has numpy 0.1, but here it is {version('numpy')}"

        def has_had_a_job() -> bool:
            errors = [executor.submit(job).exception(PATIENCE_S) for _ in range(4)]
            assert all(error is None or str(error).startswith(refused) for error in errors)
            return any(errors)

        until(has_had_a_job)
    finally:
        executor.cancel()
        other.terminate()
    pair.addresses("a", "b")


@pytest.mark.slow
def test_death_of_the_scheduler_ends_the_run_which_can_be_resumed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = SLOW_EXPERIMENT.replace("60000", "150000")
    runs = all_specifications(made(tmp_path / "slow.toml", slow))
    with Machines(tmp_path) as machines:
        machines.add("a")
        machines.addresses("a")
        address = machines.address

        def kill() -> None:
            until(lambda: n_stored(tmp_path) > 0)
            machines.scheduler.kill()

        killer = threading.Thread(target=kill)
        killer.start()
        command = ["run", f"{tmp_path}/slow.toml", "--results", str(tmp_path)]
        assert main([*command, "--cluster", address]) == 1
        killer.join()
    last = capsys.readouterr().err.splitlines()[-1]
    with Store(tmp_path / "runs.db") as store:
        n_failed = len(pending(runs, store))
        assert 0 < n_failed < 8
        assert last.startswith(f"error: {n_failed} runs failed")
        assert f"the scheduler {address} is gone" in last
        assert execute(runs, store, 1, executor=Threads(1)) == []
        assert len(store.ended()) == 8


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "localhost:8786"])
def test_addresses_without_a_scheduler_are_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    address: str,
) -> None:
    monkeypatch.setattr(cluster, "_ANSWER_S", 0.5)
    assert main(["run", "reproduce", "--results", str(tmp_path), "--cluster", address]) == 2
    assert capsys.readouterr().err.startswith(f"error: --cluster {address}: ")
