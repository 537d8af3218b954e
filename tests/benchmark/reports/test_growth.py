"""Growth and speed: fits, what is written, and that every point has a process of its own."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.execution.provenance import peak_memory_mb
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


def test_memory_that_the_system_does_not_say_has_no_exponent() -> None:
    sizes = np.array([1.0, 2.0, 3.0])
    assert np.isnan(report.exponent(sizes, np.full(3, np.nan))).all()


# What is written


def taken() -> report.Turns:
    """Growth that is flat up to 100 and linear from there on, four times as fast with two workers."""
    turns: report.Turns = {}
    for place, curve in enumerate(curve for curves in report.PANELS.values() for curve in curves):
        unit_s = place + 1.0
        for size in (1, 10, 100, 300, 1000):
            seconds = unit_s * max(size, 100)
            turns[curve, size] = [
                {"seconds": 2 * seconds, "peak_memory_mb": 50.0},
                {"seconds": seconds, "peak_memory_mb": 70.0},
            ]
    for kind in ("processes", "dask"):
        for n in (1, 2):
            turns[f"workers_{kind}", n] = [{"seconds": each / n**2, "jobs": 16} for each in (9.0, 8.0)]
    turns["overhead", 50] = [{"seconds": 10.0, "jobs": 2, "own_seconds": 9.0} for _ in range(2)]
    return turns


def test_everything_is_written(tmp_path: Path) -> None:
    made = measured.manifest(report.REPORT) | {"facts": report.FACTS, "machines": ["one"]}
    draw.publish(report.REPORT.items, measured.Measured(taken()), tmp_path, made)
    assert {path.name for path in tmp_path.iterdir()} == {
        "README.md", "manifest.json", "growth.csv", "growth.png", "exponents.csv", "workers.csv",
        "overhead.csv",
    }  # fmt: skip
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


def large() -> Values:
    """Returns the peak of a process that fills 300 MB."""
    assert np.ones(300 * 2**17).all()
    return small()


def small() -> Values:
    return {"peak_memory_mb": peak_memory_mb() or 0.0, "process": os.getpid()}


def failing() -> Values:
    os._exit(3)


def test_the_peak_of_a_point_is_its_own() -> None:
    first, second = fresh(large), fresh(small)
    assert first["peak_memory_mb"] - second["peak_memory_mb"] > 250
    assert len({first["process"], second["process"], os.getpid()}) == 3


def test_a_point_that_fails_is_named() -> None:
    with pytest.raises(InputError, match=r"^growth: failing failed with exit code 3: "):
        fresh(failing)


def test_a_command_is_the_real_one(tmp_path: Path) -> None:
    values = command("list", "--results", str(tmp_path))
    assert values["seconds"] > 0
    assert values["peak_memory_mb"] > 20  # Python and NumPy alone take more
    with pytest.raises(InputError, match=r"^growth: the command report failed .*no runs yet"):
        command("report", "reproduce", "--results", str(tmp_path))


def test_an_interrupt_leaves_nothing(tmp_path: Path) -> None:
    """Processes of points inherit the standard error, which closes when the last of them has ended."""
    driver = subprocess.Popen(
        [sys.executable, "-m", "benchmark", "growth", "--smoke", "--results", tmp_path],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert driver.stderr is not None
    while ": agents_tables, 100:" not in driver.stderr.readline():  # then the next point is measured
        assert driver.poll() is None
    driver.send_signal(signal.SIGINT)
    _, errors = driver.communicate(timeout=120)
    assert driver.returncode == 130
    assert errors.startswith("interrupted")
    assert list(tmp_path.iterdir()) == []
