"""The display of an experiment's progress."""

import io
import re

import pytest
from rich.console import Console

from benchmark.execution.progress import Display, about


@pytest.mark.parametrize("is_terminal", [True, False])
def test_runs_are_counted_in_a_bar_or_in_occasional_lines(
    is_terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("benchmark.execution.progress.time.monotonic", lambda: now[0])
    console = Console(file=(file := io.StringIO()), force_terminal=is_terminal, width=110, color_system=None)
    monkeypatch.setattr("benchmark.execution.progress.Console", lambda **_: console)
    costs = {"slow": 9000.0, "failing": 500.0, "quick": 500.0}  # of 10,000 s, where 2 workers take 5,000
    with Display("mine", costs, 5000.0, 1233) as display:
        display.advance([], name="first")
        display._progress.refresh()
        now[0] = 20.0
        display.advance(["failing"], 1)
        display._progress.refresh()
        now[0] = 500.0
        display.advance(["quick"])
    lines = [" ".join(re.sub("[━╸╺]", "", line).split()) for line in file.getvalue().splitlines()]
    # After a tenth of the work, the expected time counts half. It was right.
    last = "first: 1,234 of 1,236 done, 1 failed, about 75 minutes left"
    if is_terminal:
        assert "first 1,233 of 1,236 done, about 83 minutes left" in "".join(lines)
        assert last.replace(":", "") in "".join(lines[-2:])
    else:
        assert lines == [last] * 2


def test_without_an_expected_time_that_left_is_judged_by_what_is_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("benchmark.execution.progress.time.monotonic", lambda: now[0])
    with Display("mine", dict.fromkeys("abcd", 1.0), 0.0) as display:
        display._print_line()
        now[0] = 600.0
        display.advance(["a"])
        display.advance(["b", "c", "d"])
    assert capsys.readouterr().err.splitlines() == [
        "mine: 0 of 4 done",
        "mine: 1 of 4 done, about 30 minutes left",
        "mine: 4 of 4 done",
    ]


def test_the_time_left_falls_while_jobs_run_and_starting_up_does_not_add_to_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr("benchmark.execution.progress.time.monotonic", lambda: now[0])
    display = Display("mine", {"first": 1.0, "second": 499.0, "third": 500.0}, 6000.0)
    assert display._text() == "0 of 3 done, about 1.7 hours left"
    now[0] = 1200.0
    assert display._text() == "0 of 3 done, about 80 minutes left"
    display.advance(["first"])  # twenty minutes of compiling do not make the rest last 200 times as long
    assert display._text() == "1 of 3 done, about 100 minutes left"
    now[0] += 3000.0
    display.advance(["second"])
    assert display._text() == "2 of 3 done, about 50 minutes left"
    now[0] += 9000.0
    assert display._text() == "2 of 3 done, less than a minute left"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (7, "less than a minute"),
        (80, "about a minute"),
        (1000, "about 17 minutes"),
        (9000, "about 2.5 hours"),
    ],
)
def test_times_are_rounded_for_readers(seconds: float, text: str) -> None:
    assert about(seconds) == text
