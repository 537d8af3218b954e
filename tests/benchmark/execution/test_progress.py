"""The display of an experiment's progress."""

import heapq
import io
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from rich.console import Console

from benchmark.execution.plan import plan
from benchmark.execution.progress import Display, kind_of
from benchmark.execution.store import Record
from benchmark.experiments import RunSpecification, all_specifications, load_experiment

RUNS = all_specifications(load_experiment("compare_deep_smoke"))


def ended(run: RunSpecification, status: str = "done") -> Record:
    arrays = {"updates": np.array(400)} if status != "failed" else {}
    return Record(run.digest, "{}", status, {}, arrays)


def test_time_left_is_within_a_factor_of_two_after_a_tenth_of_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two workers; tables cost nothing and come first, nets take long, each kind with its own time."""
    now = [0.0]
    monkeypatch.setattr("benchmark.execution.progress.time.monotonic", lambda: now[0])
    tables = [run for run in RUNS if run.algorithm == "q_learning"][:2]
    others = [run for run in RUNS if run.algorithm != "q_learning"]
    kinds = sorted({kind_of(run) for run in others})
    seconds = {run.digest: 0.01 for run in tables}
    seconds |= {run.digest: 5.0 + 20 * kinds.index(kind_of(run)) for run in others}
    jobs = [[run] for run in [*tables, *others]]
    display = Display("mine", [job[0] for job in jobs], set(), jobs, Console(file=io.StringIO()))
    ties, waiting, running, told = count(), iter(jobs), list[tuple[float, int, RunSpecification]](), []

    def start() -> None:
        for (run,) in (job for job in [next(waiting, None)] if job):
            display.start([run])
            heapq.heappush(running, (now[0] + seconds[run.digest], next(ties), run))

    start()
    start()
    done = 0.0
    while running:
        now[0], _, run = heapq.heappop(running)
        done += seconds[run.digest]
        record = ended(run)
        display.advance([replace(record, provenance={"wall_time_s": seconds[run.digest]})])
        start()
        told.append((now[0], done / sum(seconds.values()), display.seconds_left()))
    for at, share, left in told[:-1]:
        assert left is None if share < 0.1 else True
        assert left is None or 0.5 < (left + 1) / (now[0] - at + 1) < 2, (at, left)
    assert told[1][2] is None  # after the tables
    assert sum(left is not None for _, _, left in told) > len(told) / 3
    assert told[-1][2] == 0


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
