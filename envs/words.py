"""The wording of lists and numbers, in messages and reports."""

from collections.abc import Iterable


def listed(items: Iterable[object]) -> str:
    """Returns items as a list in a sentence; of none, "".

    >>> listed(["S1"]), listed(["S1", "S2"]), listed(["S1", "S2", "S3"])
    ('S1', 'S1 and S2', 'S1, S2 and S3')
    """
    *rest, last = [*map(str, items)] or [""]
    return f"{', '.join(rest)} and {last}" if rest else last


def counted(n: int, noun: str) -> str:
    """Returns a number of things, whose plural ends in s.

    >>> counted(1, "run"), counted(2000, "run")
    ('1 run', '2,000 runs')
    """
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
