"""How many runs are done, and how long the others take, by hand."""

from pathlib import Path

import pytest

from benchmark.experiment import load_experiment
from benchmark.job import Job
from benchmark.progress import Display
from tests.support import specifications

RUNS = specifications(load_experiment("reproduce"), "default", "S1", "q_learning", "index")
JOBS: list[Job] = [[run] for run in RUNS[:4]]


def test_runs_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    display = Display("mine", JOBS, 1230, tmp_path)
    for job, time, n_failed in ((0, 100.0, 1), (1, 200.0, 0), (2, 201.0, 0), (3, 202.0, 0)):
        now[0] = time
        display.advance([JOBS[job][0].digest], n_failed)
    assert capsys.readouterr().err.splitlines() == [  # not a second later
        "mine: 1,230 of 1,234 done, 1 failed, about 5 minutes left",
        "mine: 1,231 of 1,234 done, 1 failed, about 3 minutes left",
        "mine: 1,233 of 1,234 done, 1 failed",
    ]
