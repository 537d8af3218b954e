"""Compiled functions are kept on disk; a damaged file is compiled again, and never used."""

import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

import pytest

CODE = """
from agents.compiled import compiled


@compiled
def double(x):
    return 2 * x
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A module with a compiled function, which was called once."""
    path = tmp_path / "doubling.py"
    path.write_text(CODE)
    assert uses_files(path) == (0, 1)
    return path


def uses_files(path: Path) -> tuple[int, int]:
    """Loads the module as a new process would; returns how often what is on disk was used, and was not."""
    spec = importlib.util.spec_from_file_location("doubling", path)
    assert spec is not None
    assert spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    sys.modules["doubling"] = module
    spec.loader.exec_module(module)
    del sys.modules["doubling"]
    assert module.double(21) == 42
    stats = module.double.stats
    return sum(stats.cache_hits.values()), sum(stats.cache_misses.values())


@pytest.mark.parametrize("damage", ["cut", "flipped", "another's"])
def test_damaged_files_are_compiled_again(file: Path, damage: str) -> None:
    (path,) = file.parent.rglob("doubling*.nbc")
    content = path.read_bytes()
    (file.parent / "another.py").write_text(CODE)
    uses_files(file.parent / "another.py")
    (another,) = file.parent.rglob("another*.nbc")
    path.write_bytes(
        {
            "cut": content[:-1],
            "flipped": content[:-9] + bytes([content[-9] ^ 4]) + content[-8:],
            "another's": another.read_bytes(),
        }[damage]
    )
    assert uses_files(file) == (0, 1)
    assert uses_files(file) == (1, 0)


def test_old_code_is_not_used_for_a_new_source(file: Path) -> None:
    """As if the process that compiled the new source had been killed before it saved anything."""
    file.write_text(CODE.replace("2 * x", "x + x "))  # as long as before
    os.utime(file, (0, 0))
    assert uses_files(file) == (0, 1)
