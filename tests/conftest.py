"""Settings for all tests."""

import os
import signal

import pytest
from hypothesis import settings

from agents.sb3 import use_same_instructions

# A test trains nets in as many processes as it needs; threads of torch would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Tests train agents of Stable-Baselines3 in their own process, which the project does in workers alone.
use_same_instructions()
# Commands that tests start need not compile the project's modules each time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Started in the background by a shell, tests would ignore interrupts, and so would the commands they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
# No test depends on timing.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begins with long files: one worker compiles nets for the other, which compiles tables meanwhile."""
    slow = ["test_make.py", "test_reproduce.py"]
    first = ["test_nets.py", *slow, "test_linear.py", "test_tabular.py", "test_update_rules.py"]
    items.sort(key=lambda item: first.index(item.path.name) if item.path.name in first else len(first))
