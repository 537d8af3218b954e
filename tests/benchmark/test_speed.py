"""How speed is measured, and what an interrupt leaves."""

import pytest

from benchmark import speed
from benchmark.speed import Side


def test_all_turns_but_the_first_count(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("benchmark.speed.time.process_time", lambda: now[0])

    def side(*seconds: float) -> Side:
        turns = iter(seconds)

        def work() -> None:
            now[0] += next(turns)

        return Side(12, work)

    sides = side(9, 1, 2, 3, 2, 2), side(9, 4, 8, 4, 8, 6)  # 60 steps in 10 and 30 seconds
    (row,) = speed.measured([("row", *sides, "it")]).itertuples(index=False, name=None)
    assert row == ("row", 6, 2, 3, "it")
