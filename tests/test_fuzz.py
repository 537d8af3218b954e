"""Drawn inputs are accepted or refused by a line for each mistake: no traceback, no hang, no gigabyte."""

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import pytest

from tests import fuzz

NUMBER = 250


def test_drawn_inputs_are_accepted_or_refused_by_one_line() -> None:
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # whose peak memory is that of the inputs
        counts, failures = pool.submit(fuzz.check_many, 0, range(NUMBER)).result()
    assert failures == []
    assert counts["accepted"] > NUMBER / 50
    assert counts["refused"] > NUMBER / 2


@pytest.mark.parametrize(
    ("given", "outcome"),
    [
        (ZeroDivisionError(), "failed"),
        (fuzz.TooLongError(), "failed"),
        (("", 0), "accepted"),
        (("error: a\n", 2), "refused"),
        (("error: a\n" * 12, 2), "failed"),
        (("error: a\n", 3), "failed"),
        (("oh\n", 2), "failed"),
        ((f"error: {'x' * 400}\n", 2), "failed"),
    ],
)
def test_failures_are_seen(given: Any, outcome: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def command(_: list[str]) -> int:
        if isinstance(given, BaseException):
            raise given
        message, code = given
        print(message, end="", file=sys.stderr)
        return int(code)

    monkeypatch.setattr(fuzz, "benchmark", command)
    monkeypatch.setattr(fuzz, "MOST_MEMORY_MB", 10**6)  # this process may have had any
    assert fuzz.check(fuzz.Input([]))[0] == outcome
    monkeypatch.setattr(fuzz, "MOST_MEMORY_MB", 1)
    assert fuzz.check(fuzz.Input([]))[0] == "failed"
