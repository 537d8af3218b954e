"""The replication at the size of the paper, in a clean copy: killed, continued, as published."""

import platform
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support import copy_compiled, copy_sources, git, make, n_stored

RUNS = 5000
pytestmark = pytest.mark.slow


def kill_early(folder: Path) -> int:
    """Starts all runs and kills the driver once some are stored; returns how many were seen."""
    process = subprocess.Popen([sys.executable, "-m", "benchmark", "run", "reproduce"], cwd=folder)
    count = 0
    while count < 100 and process.poll() is None:
        time.sleep(0.02)
        count = n_stored(folder / "results")
    process.kill()
    assert process.wait() == -signal.SIGKILL
    return count


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A copy of the working tree, committed, after a killed run and `make reproduce`."""
    folder = tmp_path_factory.mktemp("clean") / "clone"
    copy_sources(folder)
    git(folder, "init", "--quiet")
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "-m", "The working tree")
    copy_compiled(folder)
    count = kill_early(folder)
    assert 100 <= count < RUNS
    done = make("reproduce", cwd=folder)
    assert done.returncode == 0, done.stderr
    ((n_done, n_before),) = re.findall(r"(\d+) runs done, (\d+) were done already", done.stdout)
    assert int(n_before) >= count  # nothing finished was lost or repeated
    assert int(n_done) + int(n_before) == RUNS
    return folder, done.stdout


def test_results_are_the_published_ones_after_a_kill(clone: tuple[Path, str]) -> None:
    folder, output = clone
    changed = git(folder, "status", "--porcelain", "--", "results/reproduce").splitlines()
    assert [line for line in changed if line.endswith(".csv")] == [], (
        "out of date: run make reproduce"
    )
    # Elsewhere the last digit of a figure's coordinates may differ.
    if (platform.system(), platform.machine()) == ("Linux", "x86_64"):
        assert "reproduce: identical to the published results." in output
        assert git(folder, "status", "--porcelain") == ""


def test_second_time_makes_nothing_again(clone: tuple[Path, str]) -> None:
    folder, _ = clone
    again = make("reproduce", cwd=folder)
    assert again.returncode == 0, again.stderr
    assert f"all {RUNS:,} runs are done already" in again.stdout
    assert git(folder, "status", "--porcelain", "results") == ""
