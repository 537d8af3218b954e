"""The endpoint of a map: after how many steps a run has solved its scenario."""

from collections.abc import Sequence
from typing import NamedTuple


class Solved(NamedTuple):
    """When a run has solved its scenario, by its curve so far."""

    first: int  # index of the first evaluation from which success stays; the number of evaluations if none
    is_certain: bool  # success has stayed until twice as many steps; later evaluations change nothing


def solved(success: Sequence[float], steps: Sequence[int], enough: float, until: float = 2.0) -> Solved:
    """Returns when success stays at or above a level: until twice as many steps, or to the curve's end.

    Args:
      success: At the first evaluations.
      steps: Environment steps of all evaluations, rising.
      enough: The level.
      until: How many times as many steps it has to stay.

    >>> steps = [0, 100, 200, 300, 400, 500]
    >>> solved([0, 1, 0, 1, 1], steps, 0.9), solved([0, 1, 1, 0], steps, 0.9)
    (Solved(first=3, is_certain=False), Solved(first=1, is_certain=True))
    """
    first = 0
    for i, value in enumerate(success):
        if value < enough:
            first = i + 1
        elif i > first and steps[i] >= until * steps[first]:
            return Solved(first, True)
    return Solved(first, False)
