"""How long runs take: forecasts by hand, from planted times, and what is shown."""

from pathlib import Path

import pandas as pd
import pytest

from benchmark import progress
from benchmark.experiment import load_experiment
from benchmark.job import Job
from benchmark.progress import Display, Forecast, about
from tests.support import specifications

COMPARED = load_experiment("compare_deep")
NETS: list[Job] = [
    [run] for run in specifications(COMPARED, "default", "S1", "sb3_dqn", "one_hot", range(50))
]
TABLES: Job = specifications(COMPARED, "default", "S1", "q_learning", "index", range(10))


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 10,000 steps each, as those here, a net took 180 s and a table 2 s."""
    learners = ["sb3_dqn, one_hot", "sb3_dqn, one_hot", "q_learning, index"]
    times = {"wall_time_s": [170.0, 190.0, 2.0], "budget": 10_000}
    table = pd.DataFrame({"learner": learners, **times})
    monkeypatch.setattr(progress, "read_table", lambda *_: table)


@pytest.mark.usefixtures("published")
@pytest.mark.parametrize(
    ("jobs", "workers", "seconds"),
    [
        ([*NETS, TABLES], 2, 25 * 180 + 20),
        ([TABLES, *NETS[:2]], 2, 180 + 20),
        (NETS[:3], 2, 2 * 180),  # not 1.5 x 180: one worker has two of them
        (NETS[:4], 64, 180),
    ],
)
def test_workers_take_jobs_in_order(jobs: list[Job], workers: int, seconds: float) -> None:
    forecast = Forecast(jobs, Path("here"), workers)
    assert forecast.seconds(0.0) == pytest.approx(seconds)
    expected = f"{about(seconds)} with {workers} workers, if as fast as for the results in here"
    assert str(forecast) == expected


@pytest.mark.usefixtures("published")
def test_ended_jobs_say_how_long_the_others_take() -> None:
    """Two workers, five nets. The first ends after 360 s instead of 180: all take twice as long."""
    forecast = Forecast(NETS[:5], Path("here"), 2)
    forecast.start(0.0)
    assert forecast.seconds(100.0) == pytest.approx(3 * 180 - 100)
    forecast.end(0, 360.0)
    # The second is late, and two more wait for a worker; the last follows.
    assert forecast.seconds(360.0) == pytest.approx(2 * 360)
    forecast.end(1, 360.0)
    assert forecast.seconds(460.0) == pytest.approx(2 * 360 - 100)
    for job, now in ((2, 720.0), (3, 720.0), (4, 1080.0)):
        forecast.end(job, now)
    assert forecast.seconds(1080.0) == 0


def test_the_time_of_learners_without_results_is_unknown_until_a_job_ends(tmp_path: Path) -> None:
    forecast = Forecast(NETS[:3], tmp_path / "none", 1)
    assert f"{tmp_path / 'none'} has no results of these learners" in str(forecast)
    forecast.start(0.0)
    assert forecast.seconds(50.0) is None
    forecast.end(0, 60.0)
    assert forecast.seconds(60.0) == pytest.approx(120)


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
    jobs = NETS[:4]
    display = Display("mine", jobs, Forecast(jobs, tmp_path, 1), 1230)
    for job, time, n_failed in ((0, 100.0, 1), (1, 200.0, 0), (2, 201.0, 0), (3, 202.0, 0)):
        now[0] = time
        display.advance([jobs[job][0].digest], n_failed)
    display.close()
    second = "mine: 1,231 of 1,234 done, 1 failed, about 3 minutes left"
    shown = capsys.readouterr().err.replace("\r\x1b[K", "\n").split("\n")
    assert shown[int(is_terminal)] == "mine: 1,230 of 1,234 done, 1 failed, about 5 minutes left"
    assert second in shown
    assert shown[-2] == "mine: 1,233 of 1,234 done, 1 failed"
    assert ("1,232 of" in "".join(shown)) == is_terminal  # a second later; elsewhere after 30 s
