"""Settings for all tests."""

import os
import signal
import sys
from collections.abc import Iterator

import pytest
from hypothesis import settings

from agents.sb3 import use_same_instructions
from envs.sources import FOUND

# A test trains nets in as many processes as it needs; threads would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Tests train agents of Stable-Baselines3 in their own process, the project in workers alone.
use_same_instructions()
# Commands that tests start need not compile the project's modules each time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Started in the background by a shell, tests and the commands they start would ignore interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)
# No test depends on timing.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(autouse=True)
def users_modules_go(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Forgets modules that a test wrote: the next one may write others with the same names."""
    path = [*sys.path]
    yield
    sys.path[:] = path
    FOUND.clear()
    written = str(tmp_path_factory.getbasetemp())
    for name, module in [*sys.modules.items()]:
        if str(getattr(module, "__dict__", {}).get("__file__")).startswith(written):
            del sys.modules[name]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begins with long files: one worker compiles nets while the other compiles tables."""
    slow = ["test_make.py", "test_reproduce.py"]
    first = ["test_nets.py", *slow, "test_linear.py", "test_tabular.py", "test_update_rules.py"]
    order = {name: i for i, name in enumerate(first)}
    items.sort(key=lambda item: order.get(item.path.name, len(first)))
