"""The command `doctor`."""

import os
import re
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.commands import doctor
from benchmark.execution import calibration, machine
from benchmark.execution.executors import cluster
from benchmark.execution.plan import Job
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment
from envs.inputs import EXTRAS
from tests.benchmark.execution.test_calibration import Planted, record
from tests.support import ROOT, command

Examine = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def examine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Examine:
    """Runs the command; returns its exit code and its lines, with single spaces."""

    def run(*arguments: str) -> tuple[int, list[str]]:
        code = main(["doctor", *arguments, "--results", str(tmp_path)])
        return code, [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]

    return run


@pytest.fixture
def planted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes every small job take 0.1 s, in records alone."""
    fake = partial(calibration.estimate, limit_s=1e6, executor=lambda _: Planted(lambda _: 0.1))
    monkeypatch.setattr(calibration, "estimate", fake)


def about(subject: str, lines: list[str]) -> list[str]:
    """Returns the findings about something, without its name."""
    return [line.replace(f" {subject} ", " ", 1) for line in lines if line.split()[1] == subject]


def test_findings_are_plain_lines(tmp_path: Path) -> None:
    done = command("doctor", "--results", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert all(re.match(r"(ok|note|problem) {2,}[a-z]+ +\S", line) for line in done.stdout.splitlines())
    assert len(done.stdout.splitlines()) <= 30
    assert "\x1b" not in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no_such"], "experiments: unknown experiment no_such"),
        (["reproduce", "--jobs", "0"], "--jobs 0: accepted: a whole number from 1 to 1024."),
        (["reproduce", "--seeds", "x"], "--seeds x: accepted: A-B"),
        (["--seeds", "1"], "--seeds: accepted only together with an experiment."),
    ],
)
def test_mistakes_are_refused_before_anything_is_examined(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", *arguments, "--results", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert said.out == ""


# The installation


def test_versions_are_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, examine: Examine) -> None:
    """An older numpy than is accepted is a problem, another torch than published a note; +cpu is ignored."""
    file = '[project]\nrequires-python = ">=3.11"\ndependencies = ["numpy>=2.0"]\n'
    file += "[project.optional-dependencies]\n"
    extras = "".join(f"{extra} = []\n" for extra in EXTRAS)
    (tmp_path / "pyproject.toml").write_text(file + extras, encoding="utf-8")
    (tmp_path / "constraints.txt").write_text(
        "# exact\ntorch==2.13.0\nscipy==1.17.1\nx==1\n", encoding="utf-8"
    )
    monkeypatch.setattr(doctor, "_ROOT", tmp_path)
    installed = {"numpy": "2.0.1", "torch": "2.13.0+cpu", "scipy": "1.17.1"}

    def version(name: str) -> str:
        if name not in installed:
            raise PackageNotFoundError(name)
        return installed[name]

    monkeypatch.setattr(doctor, "version", version)
    assert "packages as in constraints.txt" in about("versions", examine()[1])[0]
    installed["torch"] = "2.12.0+cpu"
    (note,) = about("versions", examine()[1])
    assert note.startswith("note 1 of 3 differ from constraints.txt")
    assert "torch 2.12.0 (2.13.0)" in note
    installed["numpy"] = "1.26.4"
    code, lines = examine()
    assert code == 1
    assert about("versions", lines)[0].startswith(
        "problem not accepted: numpy 1.26.4 (>=2.0); install accepted ones"
    )


def test_declared_ranges_are_those_of_the_checkout() -> None:
    python, ranges = doctor._declared()
    assert "3.11.0" in python
    assert "3.10.9" not in python
    assert {*ranges} == {"", *EXTRAS}
    assert [str(each) for each in ranges["render"]] == ["pygame-ce>=2.5"]


# The machine


def test_cores_and_memory_are_those_of_the_control_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    files = {
        "cpu.max": ["max 100000", "150000 100000"],
        "memory.max": ["1000000"],
        "memory.current": ["450000"],
        "memory.stat": ["anon 1\ninactive_file 50000"],
    }
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(machine, "_control_files", lambda name: iter(files[name]))
    assert machine.usable_cores() == 1  # one and a half
    assert machine.free_memory() == 600_000
    files["cpu.max"], files["memory.max"] = ["900000 100000"], ["max"]
    assert machine.usable_cores() == 8
    assert machine.free_memory() not in (None, 600_000)


def test_fewer_cores_than_there_are_ask_for_jobs(monkeypatch: pytest.MonkeyPatch, examine: Examine) -> None:
    monkeypatch.setattr(doctor, "usable_cores", lambda: 3)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert about("cores", examine()[1]) == ["ok 3 of 64 may be used here; each job uses one thread"]


def test_results_that_cannot_be_a_folder_are_a_problem(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main(["doctor", "--results", str(tmp_path / "file")]) == 1
    assert re.search(r"^problem +disk +.*file is not a folder; choose", capsys.readouterr().out, re.MULTILINE)


def test_cache_that_cannot_be_written_is_a_problem(tmp_path: Path) -> None:
    """As numba finds it where neither the folder of the code nor that of the user is writable."""
    code = (
        "import sys; from numba.core import caching; caching.CacheImpl._locator_classes = []\n"
        "from benchmark.__main__ import main; sys.exit(main(sys.argv[1:]))"
    )
    arguments = [sys.executable, "-c", code, "doctor", "reproduce", "--results", str(tmp_path)]
    done = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1
    assert re.search(r"^problem +compiling +.*set NUMBA_CACHE_DIR", done.stdout, re.MULTILINE), done.stderr
    assert done.stderr == ""


# The store


def stored(tmp_path: Path, n: int = 5) -> list[str]:
    """Stores runs, the last of which has failed; returns the digests of the others."""
    runs = all_specifications(load_experiment("reproduce_smoke"))[:n]
    records = [record(run, 1.0, 100.0) for run in runs]
    failed = Record(records[-1].digest, records[-1].specification, "failed", {}, {}, "ValueError: planted")
    with Store(tmp_path / "runs.db") as store:
        store.add([*records[:-1], failed])
    return [each.digest for each in records[:-1]]


def test_runs_are_counted_and_verified(tmp_path: Path, examine: Examine) -> None:
    assert about("store", examine()[1]) == [f"ok {tmp_path}/runs.db: there are no runs yet"]
    digests = stored(tmp_path)
    (tmp_path / "runs.db.damaged").write_bytes(b"x")
    code, lines = examine()
    assert code == 0
    left, counted = about("store", lines)
    assert left.startswith(f"note {tmp_path}/runs.db.damaged")
    assert counted.endswith("runs: 4 done, 1 failed; 'run EXPERIMENT' tries failed runs again")
    assert about("checksums", lines) == ["ok correct in all 4 records"]
    with sqlite3.connect(tmp_path / "runs.db") as connection:
        connection.execute("UPDATE runs SET arrays = x'00' WHERE digest = ?", digests[:1])
    connection.close()
    code, lines = examine()
    assert code == 1
    assert about("checksums", lines)[0].startswith("problem 1 of 4 checked records are damaged; 'verify'")


def test_sample_is_said_to_be_one(tmp_path: Path, examine: Examine, monkeypatch: pytest.MonkeyPatch) -> None:
    stored(tmp_path)
    monkeypatch.setattr(doctor, "_CHECK_S", 0.0)
    assert about("checksums", examine()[1])[0].startswith(
        "ok correct in 0 of 4 records, drawn at random; 'verify'"
    )


def test_unused_space_is_reported(tmp_path: Path, examine: Examine) -> None:
    stored(tmp_path, 60)
    connection = sqlite3.connect(tmp_path / "runs.db")
    with connection:
        connection.execute("DELETE FROM runs")
    connection.close()
    unused = about("store", examine()[1])[-1]
    assert "are unused; further runs fill it" in unused


def test_file_that_is_no_store_is_a_problem_in_its_own_words(tmp_path: Path, examine: Examine) -> None:
    (tmp_path / "runs.db").write_text("something else, and longer than a page" * 300)
    code, lines = examine()
    assert code == 1
    assert "cannot be used as the store of runs" in about("store", lines)[0]


@pytest.mark.usefixtures("planted")
def test_damaged_pages_are_a_problem_and_runs_are_estimated_without_them(
    tmp_path: Path, examine: Examine
) -> None:
    stored(tmp_path, 60)
    path = tmp_path / "runs.db"
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xff" * len(data[4096:])
    path.write_bytes(data)
    code, lines = examine("reproduce_smoke")
    assert code == 1
    assert any(line.startswith("problem") and "runs.db" in line for line in about("store", lines))
    assert about("runs", lines) == ["ok 156 of 156 are missing, in 23 jobs"]


def test_write_in_progress_is_reported(tmp_path: Path, examine: Examine) -> None:
    digests = stored(tmp_path)
    connection = sqlite3.connect(tmp_path / "runs.db")
    connection.execute("DELETE FROM runs WHERE digest = ?", digests[:1])
    _, lines = examine()
    connection.rollback()
    connection.close()
    assert about("store", lines)[-1].startswith(
        f"note another process is writing to {tmp_path}/runs.db; run doctor again"
    )


# The experiment


@pytest.mark.usefixtures("planted")
def test_costs_of_missing_runs_are_estimated(tmp_path: Path, examine: Examine) -> None:
    """Whatever their size, jobs take 0.1 s each, and 300 MB."""
    path = tmp_path / "mine.toml"
    path.write_text('extends = "ablation"\ndescription = ""\n[changes]\nscenarios = ["S1", "S2"]\n')
    code, lines = examine(str(path), "--seeds", "0-19", "--jobs", "1")
    assert code == 0
    assert about("runs", lines) == ["ok 160 of 160 are missing, in 160 jobs"]
    assert about("time", lines) == [
        "ok less than a minute with --jobs 1, for 8 of 8 populations (8 from small jobs)"
    ]
    assert re.fullmatch(r"ok about 31\d MB at the peak; .* are free", about("memory", lines)[-1])
    assert about("disk", lines)[-1].endswith("are free")
    assert not (tmp_path / "runs.db").exists()


def test_nothing_is_estimated_if_nothing_is_missing(tmp_path: Path, examine: Examine) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add(record(run, 1.0, 100.0) for run in all_specifications(load_experiment("reproduce_smoke")))
    code, lines = examine("reproduce_smoke")
    assert (code, about("runs", lines)) == (0, ["ok all 156 are done"])
    assert about("time", lines) == []


@pytest.mark.usefixtures("planted")
def test_disk_and_memory_that_are_not_enough_are_problems(
    monkeypatch: pytest.MonkeyPatch, examine: Examine
) -> None:
    monkeypatch.setattr(doctor, "free_memory", lambda: 1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: type("Usage", (), {"free": 1000}))
    code, lines = examine("reproduce_smoke")
    assert code == 1
    assert about("memory", lines)[-1].endswith("; 0.00 MB are free; give fewer --jobs")
    assert about("disk", lines)[-1].startswith("problem about")


def test_time_that_is_up_is_a_note(monkeypatch: pytest.MonkeyPatch, examine: Examine) -> None:
    class Stuck(Planted):
        def submit(self, job: Job, logs: Path | None = None) -> Future[list[Record]]:
            super().submit(job, logs)
            return Future()

    fake = partial(calibration.estimate, limit_s=2.0, executor=lambda _: Stuck(lambda _: 1.0))
    monkeypatch.setattr(calibration, "estimate", fake)
    code, lines = examine("reproduce_smoke")
    assert code == 0
    assert about("time", lines)[0].startswith(
        "note unknown for 23 populations (q_learning): 20 s was not enough"
    )


def test_small_jobs_run_in_a_process(tmp_path: Path) -> None:
    """The real thing, as users call it. How far it comes in 20 seconds depends on the machine."""
    done = command("doctor", "reproduce_smoke", "--results", tmp_path)
    assert done.returncode == 0
    known = [int(n) for n in re.findall(r"for (\d+) of 23 populations", done.stdout)]
    unknown = [int(n) for n in re.findall(r"unknown for (\d+) populations", done.stdout)]
    assert sum(known) + sum(unknown) == 23
    assert done.stderr == "estimating the cost, for at most 20 s ...\n"
    assert not (tmp_path / "runs.db").exists()


def test_cluster_that_does_not_answer_is_a_problem(examine: Examine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_ANSWER_S", 0.5)
    code, lines = examine("--cluster", "tcp://127.0.0.1:1")
    assert code == 1
    address = "--cluster tcp://127.0.0.1:1"
    assert about("cluster", lines) == [
        f"problem {address}: no Dask scheduler answered within 0.5 s; 'dask scheduler' starts one"
    ]
