"""How speed is measured: what is shown meanwhile, and what an interrupt leaves."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.progress import Progress

from benchmark.__main__ import main
from benchmark.reports import speed
from benchmark.reports.document import Document
from tests.support import ROOT


def test_readme_is_made_of_what_is_published_alone() -> None:
    folder = ROOT / "results" / "speed"
    assert Document(folder).readme() == (folder / "README.md").read_text(encoding="utf-8")


def test_every_turn_is_shown_with_the_time_that_the_others_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first side takes 10 s at first and then 1 s, the second always 200 s; each returns its turn."""
    now, shown = [0.0], list[tuple[int, str]]()
    monkeypatch.setattr("benchmark.reports.speed.time.monotonic", lambda: now[0])

    def update(*_: object, completed: int, description: str) -> None:
        shown.append((completed, description))

    monkeypatch.setattr(Progress, "update", update)

    def side(*seconds: float) -> Callable[[], float]:
        turns = iter(enumerate(seconds))

        def work() -> float:
            turn, takes = next(turns)
            now[0] += takes
            return float(turn)

        return work

    sides = [side(10, 1, 1), side(200, 200)]
    turns = speed._take_turns(sides, [lambda: now[0]] * 2, [0, 1, 0, 0, 1])
    assert turns == [[(1, 1), (2, 1)], [(1, 200)]]
    assert shown == [
        (1, "1 of 5 turns"),
        (2, "2 of 5 turns, about 4 min left"),  # 10 + 10 + 200 s
        (3, "3 of 5 turns, about 3 min left"),  # 1 + 200 s
        (4, "4 of 5 turns, about 3 min left"),
        (5, "5 of 5 turns, about 0 s left"),
    ]


def test_an_interrupt_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt() -> float:
        os.kill(os.getpid(), signal.SIGINT)
        return 1.0

    monkeypatch.setattr(speed, "_rows", lambda _: [speed.Row("row", "unit", (lambda: 1.0, interrupt), "it")])
    results = tmp_path / "results"
    assert main(["speed", "--smoke", "--results", str(results)]) == 130
    *_, said = capsys.readouterr().err.splitlines()
    assert said == "interrupted: a table is written only after all rows have been measured."
    assert list(results.iterdir()) == []
