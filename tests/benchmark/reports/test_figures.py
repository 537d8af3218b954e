"""Figures drawn by workers and by the process itself."""

import os
import signal
import time
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from benchmark.reports.figures import Drawing
from benchmark.reports.item import Frames, Item


def _draw(_: Frames, context: Any) -> Figure:
    time.sleep(context)
    return Figure()


def _fail(_: Frames, __: Any) -> Figure:
    raise OSError("disk full")


def items(n: int) -> list[Item]:
    return [Item(name=f"figure_{i}", description="", draw=_draw) for i in range(n)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_figure_is_drawn(jobs: int, tmp_path: Path) -> None:
    with Drawing(jobs) as drawing:
        drawing.start(items(5), {}, 0.0, tmp_path, is_partial=False)
        drawing.finish()
    expected = {f"figure_{i}.{end}" for i in range(5) for end in ("png", "svg")}
    assert {path.name for path in tmp_path.iterdir()} == expected
    assert active_children() == []


def test_killed_worker_costs_no_figure(tmp_path: Path) -> None:
    with Drawing(2) as drawing:
        drawing.start(items(4), {}, 0.5, tmp_path, is_partial=False)
        (worker,) = active_children()
        assert worker.pid is not None
        os.kill(worker.pid, signal.SIGKILL)
        drawing.finish()
    assert len(list(tmp_path.iterdir())) == 8


@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_of_a_figure_come_back(jobs: int, tmp_path: Path) -> None:
    failing = [Item(name=f"figure_{i}", description="", draw=_fail) for i in range(2)]
    with Drawing(jobs) as drawing:
        drawing.start(failing, {}, None, tmp_path, is_partial=False)
        with pytest.raises(OSError, match="disk full"):
            drawing.finish()
