"""Drawn inputs are accepted or refused by one line: no traceback, no hang, no gigabyte."""

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from tests import fuzz

NUMBER = 400


def test_drawn_inputs_are_accepted_or_refused_by_one_line() -> None:
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # whose peak memory is that of the inputs
        counts, failures = pool.submit(fuzz.check_many, 0, range(NUMBER)).result()
    assert [f"input {failure.number}: {failure.what}" for failure in failures] == []
    assert counts["accepted"] > NUMBER / 50
    assert counts["refused"] > NUMBER / 2


def test_failures_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz, "MOST_MEMORY_MB", 10**6)  # this process may have had any
    given = fuzz.Input(["list"])
    for error in (ZeroDivisionError, fuzz.TooLongError):
        monkeypatch.setattr(fuzz, "benchmark", lambda _, error=error: (_ for _ in ()).throw(error()))
        assert fuzz.check(given)[0] == "failed"
    monkeypatch.setattr(fuzz, "benchmark", lambda _: 0)
    assert fuzz.check(given)[0] == "accepted"
    monkeypatch.setattr(fuzz, "MOST_MEMORY_MB", 1)
    assert fuzz.check(given)[0] == "failed"
    monkeypatch.setattr(fuzz, "MOST_MEMORY_MB", 10**6)
    for message, code in (("oh\n", 2), ("error: a\nb\n", 2), (f"error: {'x' * 400}\n", 2), ("error: a\n", 3)):

        def refuse(_: list[str], message: str = message, code: int = code) -> int:
            print(message, end="", file=sys.stderr)
            return code

        monkeypatch.setattr(fuzz, "benchmark", refuse)
        assert fuzz.check(given)[0] == "failed"
