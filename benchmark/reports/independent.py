"""What independent checks found: estimates with many more runs, or by other implementations.

They put published numbers into perspective, and are no results of this code. Their only home.
"""

from collections.abc import Mapping
from typing import Any, Final

# A table with these settings, greedy after training, in scenario S2: an implementation written from the
# paper alone, 2,000 agents.
_PAPERS_SETTINGS: Final = {"learning_rate": 0.6, "epsilon": 0.6, "discount": 0.9, "budget": 10_000}
PAPERS_SUCCESS: Final = 0.515
PAPERS_AGENTS: Final = 2000
# How many times slower than the compiled table a table in plain Python is: the fastest and the slowest.
_PLAIN_PYTHON: Final = (125.0, 480.0)


def has_papers_settings(settings: Mapping[str, Any]) -> bool:
    """Returns whether a table has the settings that `PAPERS_SUCCESS` is about."""
    return all(settings.get(key) == value for key, value in _PAPERS_SETTINGS.items())


def of_papers_table(settings: Mapping[str, Any]) -> str:
    """Says how often the paper's table succeeds in S2; empty for a table with other settings."""
    if not has_papers_settings(settings):
        return ""
    return (
        f"With {PAPERS_AGENTS:,} agents of an independent implementation the success probability of the "
        f"paper's table in S2 is {PAPERS_SUCCESS:g}."
    )


def against_plain_python(ratio: float) -> tuple[float, float]:
    """Returns a ratio to the compiled table's CPU time as one to that of a table in plain Python.

    Returns:
      The least and the greatest, depending on how the plain table is written.
    """
    fast, slow = _PLAIN_PYTHON
    return ratio / slow, ratio / fast
