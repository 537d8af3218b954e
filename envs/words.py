"""The wording of lists, in messages and reports."""

from collections.abc import Iterable


def listed(items: Iterable[object]) -> str:
    """Returns items as a list in a sentence; of none, "".

    >>> listed(["S1"]), listed(["S1", "S2"]), listed(["S1", "S2", "S3"])
    ('S1', 'S1 and S2', 'S1, S2 and S3')
    """
    *rest, last = [*map(str, items)] or [""]
    return f"{', '.join(rest)} and {last}" if rest else last
