"""What an independent check found: an estimate by an implementation written from the paper alone.

It puts a published number into perspective, and is no result of this code. Its only home.
"""

from collections.abc import Mapping
from typing import Any, Final

# Success probability of a table with these settings, greedy after training, in scenario S2.
_PAPERS_SETTINGS: Final = {"learning_rate": 0.6, "epsilon": 0.6, "discount": 0.9, "budget": 10_000}
PAPERS_SUCCESS: Final = 0.515
PAPERS_AGENTS: Final = 2000


def has_papers_settings(settings: Mapping[str, Any]) -> bool:
    """Returns whether a table has the settings that `PAPERS_SUCCESS` is about."""
    return all(settings.get(key) == value for key, value in _PAPERS_SETTINGS.items())
