"""The command `run`: what is missing is executed once, stored, and published."""

import fcntl
import sqlite3
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NoReturn, TextIO

import pytest

from benchmark import executors
from benchmark import job as execution
from benchmark.__main__ import main
from benchmark.experiment import load_experiment
from benchmark.job import Job, execute_job
from benchmark.run import execute, pending
from benchmark.store import Record, Store
from benchmark.tables import read
from tests.support import ROOT, SLOW_EXPERIMENT, all_specifications, made, small_experiment, variant

SMALL = load_experiment("reproduce", smoke=True)


def test_failed_runs_are_stored_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = all_specifications(SMALL)[:6]

    def fail(*_: object) -> NoReturn:
        raise FloatingPointError("diverged")

    with Store(tmp_path / "runs.db") as store:
        with monkeypatch.context() as patch:
            patch.setattr(execution, "compile_seen", fail)
            errors = execute(runs, store, jobs=1)
        assert errors == ["FloatingPointError: diverged"] * 6
        assert set(store.statuses().values()) == {"failed"}
        assert {record.error for record in store.get([run.digest for run in runs])} == set(errors)
        assert pending(runs, store) == runs
        assert execute(runs, store, jobs=1) == []
        assert pending(runs, store) == []


def test_interrupt_keeps_the_jobs_that_are_running(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = all_specifications(SMALL)
    executed: list[str] = []
    execute_job = execution.execute_job
    together = threading.Barrier(3, timeout=60)

    def slow(job: Job) -> list[Record]:
        records = execute_job(job)
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

    monkeypatch.setattr(executors, "execute_job", slow)
    with Store(tmp_path / "runs.db") as store:
        with pytest.raises(KeyboardInterrupt):
            execute(runs, store, 3, interrupt)
        assert len(executed) >= 12
        assert set(store.statuses()) == set(executed)
        assert len(executed) < len(runs)


def test_second_driver_waits_for_the_first_and_repeats_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first stores a run meanwhile, and is killed, which releases its lock."""
    compiled = SLOW_EXPERIMENT.replace("tests.agents.plain:Q_LEARNING", "q_learning")  # in threads
    experiment = made(tmp_path / "compiled.toml", compiled)
    runs = all_specifications(experiment)
    code = (
        "import sys; from pathlib import Path; from benchmark.store import Store\n"
        "with Store(Path(sys.argv[1])) as store, store.alone():\n"
        "    print(flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "runs.db")]
    first = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert first.stdout is not None
    first.stdout.readline()

    def lock(file: TextIO, operation: int) -> None:
        if operation == fcntl.LOCK_EX:  # now the second has to wait
            with Store(tmp_path / "runs.db") as store:
                store.add(execute_job(runs[:1]))
            first.kill()
            first.communicate()
        flock(file, operation)

    flock = fcntl.flock
    monkeypatch.setattr(fcntl, "flock", lock)
    arguments = ["run", str(experiment.path), "--results", str(tmp_path), "--jobs", "1"]
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert said.err.count("runs.db: waiting for another command that trains runs ...") == 1
    assert f"{len(runs) - 1} runs done, 1 were done already" in said.out


ONE = "WHERE digest = (SELECT max(digest) FROM runs)"


def test_published_tables_stay_as_they_are_when_runs_are_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only costs differ then. With other seeds, tables have a folder of their own."""
    file = tmp_path / "mine.toml"
    file.write_text(small_experiment(), encoding="utf-8")
    command = ["run", str(file), "--results", str(tmp_path), "--jobs", "1"]
    assert main(command) == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "mine").iterdir()}
    assert before.keys() == {"runs.csv.gz", "curves.csv.gz", "agents.json.gz", "manifest.json"}
    (tmp_path / "runs.db").unlink()
    assert main(command) == 0
    assert {path.name: path.read_bytes() for path in (tmp_path / "mine").iterdir()} == before
    with sqlite3.connect(tmp_path / "runs.db") as connection:  # a damaged record
        connection.execute(f"UPDATE runs SET arrays = X'00' {ONE}")
    assert main([*command, "--seeds", "0-1"]) == 0
    said = capsys.readouterr()
    assert "repeating runs whose records are damaged: 1." in said.err
    assert "1 runs done, 1 were done already" in said.out
    assert not (tmp_path / "mine_seeds_0-1").exists()  # these are the declared ones
    assert main([*command, "--seeds", "5"]) == 0
    assert read(tmp_path / "mine_seeds_5")[0]["seed"].tolist() == [5]


def test_shares_of_given_seeds_are_published_and_reported(tmp_path: Path) -> None:
    learners = {"most": variant(seeds=9), "few": variant("sarsa", seeds=3)}
    text = small_experiment(report={"kind": "comparison"}, algorithms=learners)
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    command = ["run", str(tmp_path / "mine.toml"), "--seeds", "0-5", "--report"]
    assert main([*command, "--results", str(tmp_path), "--jobs", "1"]) == 0
    runs, _ = read(tmp_path / "mine_seeds_0-5")
    assert runs.groupby("learner").size().to_dict() == {"most, index": 6, "few, index": 2}
