"""Drawn inputs are accepted or refused by one line: no traceback, no hang, no gigabyte."""

import sys

import pytest

from tests import fuzz

NUMBER = 2000
PARTS = 8


@pytest.mark.parametrize("part", range(PARTS))
def test_drawn_inputs_are_accepted_or_refused_by_one_line(part: int) -> None:
    size = NUMBER // PARTS
    counts, failures = fuzz.check_many(0, range(part * size, (part + 1) * size))
    assert [f"input {failure.number}: {failure.what}" for failure in failures] == []
    assert counts["accepted"] > size / 50
    assert counts["refused"] > size / 2


def test_failures_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """What would be a failure counts as one."""
    given = fuzz.Input(["list"], {})
    for error in (ZeroDivisionError, fuzz.TooLongError):
        monkeypatch.setattr(fuzz, "benchmark", lambda _, error=error: (_ for _ in ()).throw(error()))
        assert fuzz.check(given)[0] == "failed"
    for message, code in (("oh\n", 2), ("error: a\nb\n", 2), (f"error: {'x' * 400}\n", 2), ("error: a\n", 3)):

        def refuse(_: list[str], message: str = message, code: int = code) -> int:
            print(message, end="", file=sys.stderr)
            return code

        monkeypatch.setattr(fuzz, "benchmark", refuse)
        assert fuzz.check(given)[0] == "failed"
