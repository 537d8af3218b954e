"""How long runs take: estimates by hand, from planted times, and what is shown."""

from pathlib import Path

import pandas as pd
import pytest

from benchmark import progress
from benchmark.experiment import load_experiment
from benchmark.job import Job
from benchmark.progress import Display
from tests.support import specifications

RUNS = specifications(load_experiment("reproduce"), "default", "S1", "q_learning", "index")
JOBS: list[Job] = [[run] for run in RUNS[:4]]


def test_published_runs_say_how_long_others_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 10,000 steps each, as those here, they took 170 s and 190 s."""
    times = {"wall_time_s": [170.0, 190.0], "budget": 10_000}
    table = pd.DataFrame({"learner": "q_learning, index", **times})
    monkeypatch.setattr(progress, "read_table", lambda *_: table)
    display = Display("mine", JOBS, 0, Path("here"), 2)
    expected = "about 6 minutes with 2 workers, if as fast as for the results in here"
    assert display.forecast() == expected


@pytest.mark.parametrize("is_terminal", [True, False])
def test_runs_are_counted(
    is_terminal: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    monkeypatch.setattr("sys.stderr.isatty", lambda: is_terminal)
    display = Display("mine", JOBS, 1230, tmp_path, 1)
    assert display.forecast().startswith(f"duration unknown, since {tmp_path} has no results")
    for job, time, n_failed in ((0, 100.0, 1), (1, 200.0, 0), (2, 201.0, 0), (3, 202.0, 0)):
        now[0] = time
        display.advance([JOBS[job][0].digest], n_failed)
    display.close()
    second = "mine: 1,231 of 1,234 done, 1 failed, about 3 minutes left"
    shown = capsys.readouterr().err.replace("\r\x1b[K", "\n").split("\n")
    assert shown[int(is_terminal)] == "mine: 1,230 of 1,234 done, 1 failed, about 5 minutes left"
    assert second in shown
    assert shown[-2] == "mine: 1,233 of 1,234 done, 1 failed"
    assert ("1,232 of" in "".join(shown)) == is_terminal  # a second later; elsewhere after 30 s
