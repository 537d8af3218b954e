"""An executor from outside: a Python process per job, as a cluster's scheduler would start it."""

import pickle
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.execution.job import execute_job
from benchmark.execution.plan import Job, plan
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment
from tests.benchmark.execution.test_processes import arrays_of
from tests.support import ROOT

TOML = """
description = "A table in S1 and S2."
scenarios = ["S1", "S2"]
horizon = 200
evaluation_every = 200
map_every = 200
settings = { budget = 1000 }
algorithms.q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 3 }
"""
_CODE = """
import pickle, sys
from benchmark.execution.job import execute_job
pickle.dump(execute_job(pickle.load(sys.stdin.buffer)), sys.stdout.buffer)
"""


class ProcessPerJob:
    """Executes each job in a new process; without a process for the jobs of S2, if it is `broken`."""

    def __init__(self, jobs: int, *, broken: bool = False) -> None:
        self._pool = ThreadPoolExecutor(jobs)
        self._broken = broken

    def submit(self, job: Job) -> Future[list[Record]]:
        return self._pool.submit(self._execute, job)

    def cancel(self) -> None:
        self._pool.shutdown(cancel_futures=True)

    def _execute(self, job: Job) -> list[Record]:
        if self._broken and job[0].scenario.name == "S2":
            raise ConnectionError("the machine does not answer")
        command = [sys.executable, "-c", _CODE]
        done = subprocess.check_output(command, input=pickle.dumps(job), cwd=ROOT)
        records: list[Record] = pickle.loads(done)
        return records


def broken(jobs: int) -> ProcessPerJob:
    return ProcessPerJob(jobs, broken=True)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "small.toml").write_text(TOML, encoding="utf-8")
    return tmp_path / "small.toml"


def test_records_from_another_executor_are_identical_and_lost_jobs_are_failed_runs(
    path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", str(path), "--results", str(tmp_path)]
    assert main([*arguments, "--executor", f"{__name__}:broken"]) == 1
    assert "3 runs failed" in (error := capsys.readouterr().err)
    assert "First error: ConnectionError: the machine does not answer" in error
    with Store(tmp_path / "runs.db", read_only=True) as store:
        statuses = store.statuses()
    runs = all_specifications(load_experiment(path))
    assert len(statuses) == len(runs)
    assert all((statuses[run.digest] == "failed") == (run.scenario.name == "S2") for run in runs)
    assert main([*arguments, "--executor", f"{__name__}:ProcessPerJob"]) == 0
    assert "3 runs done, 3 were done already" in capsys.readouterr().out
    with Store(tmp_path / "runs.db", read_only=True) as store:
        records = store.get([run.digest for run in runs])
    expected = [record for job in plan(runs) for record in execute_job(job)]
    assert arrays_of(records) == arrays_of(expected)
    assert records[0].provenance["versions"] == expected[0].provenance["versions"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("procss", "procss (did you mean process?)"),
        ("nowhere:Executor", "nowhere:Executor cannot be imported"),
        (f"{__name__}:ROOT", f"{__name__}:ROOT is not an executor"),
    ],
)
def test_mistakes_get_one_sentence(
    path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, expected: str
) -> None:
    assert main(["run", str(path), "--results", str(tmp_path), "--executor", name]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert expected in error
