"""Growth and speed: fits, what is written, and that every point has a process of its own."""

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from threading import Thread

import numpy as np
import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.reports import draw, measured
from benchmark.reports.document import Document
from benchmark.reports.growth import report
from benchmark.reports.growth.points import Values, command, fresh
from envs import InputError
from tests.support import ROOT, mistyped_columns

# Fits


def test_exponent_of_an_exact_power_law() -> None:
    sizes = np.array([1.0, 10.0, 100.0, 1000.0])
    assert report.exponent(sizes, 3 * sizes**2) == pytest.approx((2.0, 2.0, 2.0))
    assert np.isnan(report.exponent(sizes, np.full(4, np.nan))).all()  # memory that the system does not say


def test_exponent_and_interval_by_hand() -> None:
    """With x = 0, 1, 2 and y = 0, 1, 1.

    The line is 1/6 + x/2, the residuals are -1/6, 1/3 and -1/6, and their squares sum to 1/6. With one degree
    of freedom and a spread of x of 2, the standard error is sqrt(1/12); Student's t is 12.7062.
    """
    found = report.exponent(np.exp([0.0, 1.0, 2.0]), np.exp([0.0, 1.0, 1.0]))
    half = 12.7062 * np.sqrt(1 / 12)
    assert found == pytest.approx((0.5, 0.5 - half, 0.5 + half), abs=1e-4)


@pytest.mark.parametrize(("n", "finite"), [(1, 0), (2, 1), (3, 3)])
def test_too_few_points_have_no_interval(n: int, finite: int) -> None:
    sizes = np.arange(1.0, n + 1)
    assert np.isfinite(report.exponent(sizes, sizes)).sum() == finite


# What is written


def taken() -> report.Turns:
    """Growth that is flat up to 100 and linear from there on, four times as fast with two workers."""
    turns: dict[str, dict[int, list[Values]]] = {}
    for place, curve in enumerate(curve for curves in report.PANELS.values() for curve in curves):
        seconds = {size: (place + 1.0) * max(size, 100) for size in (1, 10, 100, 300, 1000)}
        turns[curve] = {
            size: [{"seconds": 2 * each, "peak_memory_mb": 50.0}, {"seconds": each, "peak_memory_mb": 70.0}]
            for size, each in seconds.items()
        }
    for kind in ("processes", "dask"):
        turns[f"workers_{kind}"] = {
            n: [{"seconds": each / n**2, "jobs": 16} for each in (9.0, 8.0)] for n in (1, 2)
        }
    turns["overhead"] = {50: [{"seconds": 10.0, "jobs": 2, "own_seconds": 9.0}] * 2}
    return turns


def test_everything_is_written(tmp_path: Path) -> None:
    made = measured.manifest(report.REPORT) | {"facts": report.FACTS, "machines": ["one"]}
    draw.publish(report.REPORT.items, measured.Measured(taken()), tmp_path, made)
    tables = {path.stem: pd.read_csv(path).to_dict("records") for path in tmp_path.glob("*.csv")}
    assert all(mistyped_columns(path) == [] for path in tmp_path.glob("*.csv"))
    (point,) = (row for row in tables["growth"] if (row["curve"], row["size"]) == ("runs_list", 1000))
    assert point == {
        "curve": "runs_list", "size": 1000, "unit": "stored runs", "seconds": 7000, "slowest_seconds": 14_000,
        "peak_memory_mb": 50, "rounds": 2,
    }  # fmt: skip
    everything, decade = (row for row in tables["exponents"] if row["curve"] == "runs_resume")
    assert (decade["sizes"], decade["n"], decade["smallest"], decade["largest"]) == (
        "largest decade", 3, 100, 1000,
    )  # fmt: skip
    assert (decade["time_exponent"], decade["memory_exponent"]) == pytest.approx((1, 0))
    assert (everything["sizes"], everything["n"]) == ("all", 5)
    assert 0 < everything["time_exponent"] < 1
    assert {row["workers"]: row["ratio_to_one"] for row in tables["workers"]} == {
        "1 processes": 1, "2 processes": 4, "1 dask": 1, "2 dask": 4,
    }  # fmt: skip
    assert tables["overhead"][0] == pytest.approx({
        "jobs": 2, "agents": 50, "seconds_per_job": 5, "own_seconds_per_job": 4.5,
        "share": 0.1,
    })  # fmt: skip
    readme = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "With 1,000 stored runs, `list` takes 7,000 s" in readme


@pytest.mark.parametrize("name", list(measured.REPORTS))
def test_readme_is_made_of_what_is_published_alone(name: str) -> None:
    folder = ROOT / "results" / name
    assert Document(folder).readme() == (folder / "README.md").read_text(encoding="utf-8")


# Processes


def test_the_peak_of_a_point_is_its_own() -> None:
    large, small = fresh(exec, "b'x' * 300 * 2**20"), fresh(exec, "pass")
    assert large["peak_memory_mb"] - small["peak_memory_mb"] > 200
    with pytest.raises(InputError, match=r"^growth: _exit failed with exit code 3: "):
        fresh(os._exit, 3)


def test_a_command_is_the_real_one(tmp_path: Path) -> None:
    values = command("list", "--results", str(tmp_path))
    assert values["seconds"] > 0
    assert values["peak_memory_mb"] > 20  # Python and NumPy alone take more
    with pytest.raises(InputError, match=r"^growth: the command report failed .*no runs yet"):
        command("report", "reproduce", "--results", str(tmp_path))


def test_an_interrupt_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupts a point whose process has started another one; this holds a pipe open until it ends."""
    pipe, results = tmp_path / "pipe", tmp_path / "results"
    os.mkfifo(pipe)
    call = partial(fresh, subprocess.check_call, ["sh", "-c", f"exec > {pipe}; echo started; exec sleep 600"])
    monkeypatch.setattr(report, "_points", lambda *_: [("sleeping", 1, call)])

    def interrupt() -> None:
        with pipe.open() as output:
            output.readline()
            os.kill(os.getpid(), signal.SIGINT)
            output.read()

    interrupting = Thread(target=interrupt, daemon=True)
    interrupting.start()
    assert main(["growth", "--smoke", "--results", str(results)]) == 130
    interrupting.join(timeout=60)
    assert not interrupting.is_alive()
    assert list(results.iterdir()) == []


def test_a_killed_command_leaves_no_process(tmp_path: Path) -> None:
    """As above, but nothing of the command is left to end what it has started."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    script = f"exec > {pipe}; echo started; exec sleep 600"
    code = (
        "import subprocess; from benchmark.reports.growth.points import fresh; "
        f"fresh(subprocess.check_call, ['sh', '-c', {script!r}])"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as process, pipe.open() as output:
        output.readline()
        process.kill()
        reading = Thread(target=output.read, daemon=True)
        reading.start()
        reading.join(timeout=60)
        assert not reading.is_alive()
