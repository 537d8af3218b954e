"""The display of an experiment's progress."""

import io
import re

import pytest
from rich.console import Console

from benchmark.execution.progress import Display
from benchmark.execution.store import Record
from benchmark.experiments import all_specifications, load_experiment

RUNS = all_specifications(load_experiment("reproduce_smoke"))


@pytest.mark.parametrize("is_terminal", [True, False])
def test_runs_are_counted_in_a_bar_or_in_occasional_lines(
    is_terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("benchmark.execution.progress.time.monotonic", lambda: now[0])
    console = Console(file=(file := io.StringIO()), force_terminal=is_terminal, width=110, color_system=None)
    with Display("mine", RUNS, {RUNS[9].digest}, console) as display:
        display.advance([Record(RUNS[0].digest, "{}", "failed", {}, {})])
        display._progress.refresh()
        now[0] = 31.0
        display.advance([Record(RUNS[1].digest, "{}", "diverged", {}, {})])
    lines = [" ".join(re.sub("[━╸╺]", "", line).split()) for line in file.getvalue().splitlines()]
    if is_terminal:
        assert any(f"mine 1/{len(RUNS)} 1 failed" in line for line in lines)
        assert f"mine 2/{len(RUNS)} 1 failed" in "".join(lines[-2:])
    else:
        assert len(lines) == 2
        assert all(line.startswith(f"mine: 2 of {len(RUNS)} runs, 1 failed") for line in lines)
