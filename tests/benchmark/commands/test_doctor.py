"""The command `doctor`."""

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.commands import doctor
from benchmark.execution import machine
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment
from tests.benchmark.execution.test_progress import publish
from tests.support import small_experiment, variant

Examine = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def examine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Examine:
    """Runs the command; returns its exit code and its lines, with single spaces."""

    def run(*arguments: str) -> tuple[int, list[str]]:
        code = main(["doctor", *arguments, "--results", str(tmp_path)])
        output, errors = capsys.readouterr()
        assert errors == ""
        assert all(re.match(r"(ok|note|problem) +[a-z]+ +\S", line) for line in output.splitlines())
        return code, [" ".join(line.split()) for line in output.splitlines()]

    return run


def about(subject: str, lines: list[str]) -> list[str]:
    return [line.replace(f" {subject} ", " ", 1) for line in lines if line.split()[1] == subject]


def test_cores_and_memory_are_those_of_the_control_groups(
    monkeypatch: pytest.MonkeyPatch, examine: Examine
) -> None:
    files = {
        "cpu.max": ["max 100000", "150000 100000"],
        "memory.max": ["1000000"],
        "memory.current": ["450000"],
        "memory.stat": ["anon 1\ninactive_file 50000"],
    }
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(os, "getloadavg", lambda: (0.5, 0, 0))
    monkeypatch.setattr(machine, "_control_files", lambda name: iter(files[name]))
    assert machine.usable_cores() == 1  # one and a half
    assert machine.free_memory() == 600_000
    lines = examine()[1]
    assert about("cores", lines)[0].startswith(f"ok 1 of {os.cpu_count()} ")
    assert re.match(r"note 600\.0 kB free; .*--jobs 1", about("memory", lines)[0])
    files["cpu.max"], files["memory.max"] = ["900000 100000"], ["max"]
    assert machine.usable_cores() == 8
    assert machine.free_memory() not in (None, 600_000)


def test_missing_packages_are_named_with_what_installs_them(
    examine: Examine, monkeypatch: pytest.MonkeyPatch
) -> None:
    absent = {"distributed", "rliable", "torch"}
    monkeypatch.setattr(doctor, "_is_installed", lambda name: name not in absent)
    advice = "in a checkout, make .venv/.%s installs them"
    assert [line.partition(": ")[2] for line in about("packages", examine()[1])] == [
        "installed",
        f"missing: rliable, torch; {advice % 'deep'}",
        "installed",
        f"missing: distributed; {advice % 'cluster'}",
        "installed",
    ]


# The store


def stored(tmp_path: Path, n: int = 5) -> None:
    """Stores runs, the last of which has failed."""
    runs = all_specifications(load_experiment("reproduce", smoke=True))[:n]
    records = [Record(run.digest, run.content, "done", {}, {}) for run in runs]
    failed = Record(records[-1].digest, records[-1].specification, "failed", {}, {}, "ValueError: planted")
    with Store(tmp_path / "runs.db") as store:
        store.add([*records[:-1], failed])


def test_runs_are_counted(tmp_path: Path, examine: Examine) -> None:
    assert about("store", examine()[1]) == [f"ok {tmp_path}/runs.db: there are no runs yet"]
    stored(tmp_path)
    code, lines = examine()
    (counted,) = about("store", lines)
    assert "runs: 4 done, 1 failed;" in counted
    assert code == 0


def test_damaged_store_is_a_problem_and_runs_are_counted_without_it(tmp_path: Path, examine: Examine) -> None:
    stored(tmp_path, 60)
    data = (tmp_path / "runs.db").read_bytes()
    (tmp_path / "runs.db").write_bytes(data[:4096] + b"\xff" * (len(data) - 4096))
    code, lines = examine("reproduce")
    assert code == 1
    assert any(line.startswith("problem") and "runs.db" in line for line in about("store", lines))
    assert about("runs", lines) == ["ok 156 of 156 are missing"]
    unknown = f"ok for an unknown time: {tmp_path}/reproduce has no results of these learners"
    assert about("time", lines) == [unknown]


# The experiment


def test_costs_of_missing_runs_are_estimated(
    tmp_path: Path, examine: Examine, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mine.toml"
    variants = {name: variant(seeds=100) for name in "abcd"}
    path.write_text(small_experiment(scenarios=["S1", "S2"], algorithms=variants))
    runs = all_specifications(load_experiment(path))
    with Store(tmp_path / "runs.db") as store:
        store.add(Record(run.digest, run.content, "done", {}, {}) for run in runs if run.seed == 0)
    shape = {run.variant: {"settings": {run.observation: 0}} for run in runs}
    publish(tmp_path / "mine", "", busy_time_s=1200.0, runs=400, algorithms=shape)
    code, lines = examine(str(path), "--jobs", "1")
    assert code == 0
    assert about("runs", lines) == ["ok 792 of 800 are missing"]
    (time,) = about("time", lines)
    assert time.startswith("ok about 40 minutes with 1 worker, ")  # 792 runs of 3 s
    assert about("disk", lines)[-1].startswith("ok ")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: type("Usage", (), {"free": 1000}))
    code, lines = examine(str(path))
    assert code == 1
    assert re.match(r"problem .* 1\.0 kB are free; ", about("disk", lines)[-1])
