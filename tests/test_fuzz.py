"""Drawn inputs are accepted or refused by a line for each mistake: no traceback, no hang, no gigabyte."""

import re
import sys
from typing import Any

import pytest

from tests import fuzz
from tests.support import make


@pytest.mark.slow
def test_drawn_inputs_are_accepted_or_refused_by_one_line() -> None:
    done = make("fuzz", "FUZZ=--inputs 100")
    assert done.returncode == 0, done.stdout + done.stderr
    ((accepted, refused),) = re.findall(r"inputs accepted: (\d+), refused: (\d+)\nfailed: 0 ", done.stdout)
    assert int(accepted) > 2
    assert int(refused) > 50


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
    assert fuzz.check(fuzz.Input([]))[0] == outcome
    monkeypatch.setattr(fuzz, "MAX_MEMORY_MB", -1)
    assert fuzz.check(fuzz.Input([]))[0] == "failed"
