"""Compiled functions are kept on disk; a damaged file is compiled again, and never used."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support import ROOT

CODE = """
from agents.compiled import compiled


@compiled
def double(x):
    return 2 * x
"""

SCALED = """
import numba

from agents.compiled import compiled


def scaled_by(factor):
    @numba.njit(_dbg_optnone=True)
    def scale(x):
        return factor * x

    def call(x):
        return scale(x)

    return compiled(call, str(factor))


twice, thrice = scaled_by(2), scaled_by(3)
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A module with a compiled function, which was called once."""
    path = tmp_path / "doubling.py"
    path.write_text(CODE)
    assert uses_files(path) == (0, 1)
    return path


def uses_files(path: Path) -> tuple[int, int]:
    """Loads the module as a new process would; returns how often the disk was used, and not."""
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
    flipped = content[:-9] + bytes([content[-9] ^ 4]) + content[-8:]
    path.write_bytes(
        {"cut": content[:-1], "flipped": flipped, "another's": another.read_bytes()}[damage]
    )
    assert uses_files(file) == (0, 1)
    assert uses_files(file) == (1, 0)


def test_functions_that_other_processes_have_compiled_are_not_mixed_up(tmp_path: Path) -> None:
    (tmp_path / "scaling.py").write_text(SCALED)
    for call, expected in (("thrice(7)", "[21]"), ("twice(7), thrice(7)", "[14, 21]")):
        code = f"import sys; sys.path.append({str(tmp_path)!r})\n"
        code += f"from scaling import *; print([{call}])"
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True
        )
        assert done.stdout == f"{expected}\n", done.stderr
