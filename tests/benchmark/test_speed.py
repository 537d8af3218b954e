"""How speed is measured, and what an interrupt leaves."""

import os
import signal
from pathlib import Path

import pytest

from benchmark import speed
from benchmark.__main__ import main
from benchmark.speed import Row, Side


def test_the_best_turn_counts_and_by_cpu_time_all_of_a_few_but_never_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    for clock in ("perf_counter", "process_time"):
        monkeypatch.setattr(f"benchmark.speed.time.{clock}", lambda: now[0])

    def side(*seconds: float) -> Side:
        turns = iter(seconds)

        def work() -> None:
            now[0] += next(turns)

        return 12, work

    rows = [
        Row("by_turns", "units", side(0.1, 4, 2, 3, 6, 12), side(99, 3, 6, 6, 6, 6), "it"),
        Row("by_cpu_time", "units", side(1, 2, 1, 1, 2), side(9, 6, 6, 6, 6), "it", is_by_cpu_time=True),
    ]
    frame = speed._measured(rows, 6)
    assert frame["per_second"].tolist() == [6, 8]
    assert frame["baseline"].tolist() == [4, 2]
    assert frame["ratio"].tolist() == [1.5, 4]


def test_an_interrupt_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt = 1.0, lambda: os.kill(os.getpid(), signal.SIGINT)
    monkeypatch.setattr(speed, "all_rows", lambda *_: [Row("row", "unit", (1.0, int), interrupt, "it")])
    results = tmp_path / "results"
    assert main(["speed", "--smoke", "--results", str(results)]) == 130
    *_, said = capsys.readouterr().err.splitlines()
    assert said.startswith("interrupted: ")
    assert list(results.iterdir()) == []
