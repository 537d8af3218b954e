"""What is shown while an experiment runs."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from benchmark.__main__ import main
from benchmark.execution.driver import plan
from benchmark.execution.progress import Display
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment

ROOT = Path(__file__).parents[2]
SMOKE = load_experiment("compare_deep_smoke")


def ended(digest: str, status: str, steps: int = 400) -> Record:
    arrays = {"steps_taken": np.array(steps)} if status != "failed" else {}
    return Record(digest, "{}", status, {}, arrays)


def display(console: Console) -> tuple[Display, list[Any]]:
    runs = all_specifications(SMOKE)
    jobs = plan(runs[1:])
    return Display(SMOKE, None, {runs[0].digest}, jobs, console), [runs, jobs]


def test_grid_shows_done_running_and_failed(tmp_path: Path) -> None:
    with (tmp_path / "out").open("w+", encoding="utf-8") as file:
        console = Console(file=file, force_terminal=True, width=110)
        shown, (_, jobs) = display(console)
        cell = "dqn", "one_hot", "S2"
        dqn = [job for job in jobs if (job[0].arm, job[0].observation, job[0].scenario.name) == cell]
        with shown:
            shown.start(dqn[0])
            shown.start(dqn[1])
            shown.advance([ended(dqn[0][0].digest, "failed")])
            console.print(shown._render())
            shown.advance([ended(dqn[1][0].digest, "diverged")])
    text = Console(width=110, color_system=None)
    with text.capture() as capture:
        text.print(shown._render())
    lines = capture.get().splitlines()
    assert lines[1].split() == ["S1", "S2", "S3"]
    rows = {" ".join(line.split()[:2]): line.split()[2:] for line in lines[2:]}
    assert rows["q_learning, index"] == ["1/4", "0/4", "0/4"]
    assert rows["dqn, one_hot"] == ["0/2", "1/2", "!1", "0/2"]
    assert "2 of 78 runs" in lines[-1]
    assert ">1" in (tmp_path / "out").read_text(encoding="utf-8")


def test_no_terminal_gets_a_line(tmp_path: Path) -> None:
    with (tmp_path / "out").open("w", encoding="utf-8") as file:
        shown, (_, jobs) = display(Console(file=file, width=200))
        with shown:
            shown.start(jobs[0])
            shown.advance([ended(run.digest, "done") for run in jobs[0]])
    told = (tmp_path / "out").read_text(encoding="utf-8")
    assert told.startswith(f"compare_deep_smoke: {1 + len(jobs[0])} of 78 runs, ")
    assert "steps/s" in told
    assert told.count("\n") == 1


def test_readings_are_the_rows_of_a_replication() -> None:
    replication = load_experiment("reproduce_smoke")
    runs = all_specifications(replication)
    text = Console(width=110, color_system=None)
    with text.capture() as capture:
        text.print(Display(replication, None, set(), plan(runs), text)._render())
    rows = [line.split() for line in capture.get().splitlines()[2:-2]]
    # The reading max_q measures the runs of the default one, and has none of its own.
    assert [row[0] for row in rows] == [name for name in replication.readings if name != "max_q"]
    own = {row[0]: row[1:] for row in rows}
    assert own["default"] == ["0/6"] * 3
    assert own["equal_pay"] == ["0/6", "0/6", "-"]  # S3 pays as by default
    assert sum(int(cell.split("/")[1]) for row in own.values() for cell in row if cell != "-") == len(runs)


def test_logs_are_refused_where_nobody_writes_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["run", "reproduce", "--results", str(tmp_path), "--tensorboard", str(tmp_path / "logs")])
    assert code == 2
    assert "--tensorboard: reproduce trains tables alone, which write no logs" in capsys.readouterr().err
    assert not (tmp_path / "runs.db").exists()


def test_logs_come_from_worker_processes_and_change_nothing(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    for results, more in (("a", ["--tensorboard", str(logs)]), ("b", [])):
        arguments = ["run", "compare_deep_smoke", "--seeds", "0", "--results", str(tmp_path / results)]
        done = subprocess.run(
            [sys.executable, "-m", "benchmark", *arguments, *more], cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    written = {str(path.parent.relative_to(logs)) for path in logs.rglob("events*")}
    assert len(written) == 27
    assert "compare_deep_smoke/S2/ppo_coordinates/seed_0" in written
    with Store(tmp_path / "a" / "runs.db") as one, Store(tmp_path / "b" / "runs.db") as other:
        digests = sorted(one.ended())
        for x, y in zip(one.get(digests), other.get(digests), strict=True):
            assert all(x.arrays[name].tobytes() == y.arrays[name].tobytes() for name in x.arrays)
