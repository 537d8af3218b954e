"""The display of an experiment's progress."""

import io

import numpy as np
import pytest
from rich.console import Console

from benchmark.execution.plan import plan
from benchmark.execution.progress import Display
from benchmark.execution.store import Record
from benchmark.experiments import RunSpecification, all_specifications, load_experiment

RUNS = all_specifications(load_experiment("compare_deep_smoke"))


def ended(run: RunSpecification, status: str = "done") -> Record:
    arrays = {"updates": np.array(400)} if status != "failed" else {}
    return Record(run.digest, "{}", status, {}, arrays)


def shown(display: Display) -> list[str]:
    """The lines of the display."""
    console = Console(width=110, color_system=None, file=io.StringIO())
    with console.capture() as capture:
        console.print(display)
    return [line.strip() for line in capture.get().splitlines()]


@pytest.mark.parametrize("is_terminal", [True, False])
def test_runs_are_counted_per_learner_or_in_one_line(is_terminal: bool) -> None:
    console = Console(file=(file := io.StringIO()), force_terminal=is_terminal, width=110)
    display = Display("mine", RUNS, {RUNS[0].digest}, plan(RUNS[1:]), console)
    learner = [run for run in RUNS if (run.variant, run.observation) == ("dqn_sb3", "one_hot")]
    with display:
        display.start(learner[:1])
        display.start(learner[1:2])
        display.advance([ended(learner[0], "failed")])
        assert f"dqn_sb3, one_hot: 0 of {len(learner)} done, 1 running, 1 failed" in shown(display)
        display.advance([ended(learner[1], "diverged")])
    lines = shown(display)
    assert f"dqn_sb3, one_hot: 1 of {len(learner)} done, 1 failed" in lines
    table = [run for run in RUNS if run.variant == RUNS[0].variant]
    assert f"{RUNS[0].variant}, index: 1 of {len(table)} done" in lines
    assert f"2 of {len(RUNS)} runs, 1 failed" in lines[-1]
    if is_terminal:
        assert "dqn_sb3, one_hot" in file.getvalue()
    else:
        assert file.getvalue().startswith(f"mine: 2 of {len(RUNS)} runs, 1 failed, ")
        assert file.getvalue().count("\n") == 1
