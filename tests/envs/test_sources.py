"""The digest of users' modules: what it depends on, and that every process computes the same."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envs.sources import VARIABLES, digest_of_source, digest_when_loaded
from tests.support import ROOT

IMPORTS = {
    "mine.py": "import os, numpy\ndef f():\n    from inner import deep\n    import near_by.near",
    "inner/__init__.py": "from .first import *",
    "inner/first.py": "from ..beyond import all",
    "inner/deep.py": "from . import second as other\nNAME = '.fourth'",
    "inner/second.py": "not Python \0",
    "inner/fourth.py": "",
    "near_by/near.py": "import mine",
}

RULE = """
from pathlib import Path
import numpy as np, os
from importlib import import_module
from rates import half, os as system
here = Path(__file__).parent
LOWEST = Path(here, "lowest.txt").read_text()
MEASURED = tuple(np.loadtxt(here / f"{'measured'}.csv")), 1
chosen = import_module("chosen_by_name")
def rule():
    "HOME is only named"
    return float(system.environ.get("PATIENCE", 1.0)) + half()
"""
FILES = {
    "rule_of_mine.py": RULE,
    "rates.py": "import os\nRATE = float(open(__file__[:-8] + 'rate.' + 'txt').read())\nhalf = lambda: 1\n",
    "chosen_by_name.py": "",
    "lowest.txt": "0.1",
    "measured.csv": "1 2 3",
    "rate.txt": "0.5",
}


def test_digest_is_of_a_module_and_of_all_that_it_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for name, text in {**IMPORTS, "other.py": "", "inner/third.py": "", "mine.toml": ""}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    before = digest_of_source("mine")
    for path in sorted(tmp_path.rglob("*.*")):
        text = path.read_text(encoding="utf-8")
        path.write_text(f"{text}\n# changed", encoding="utf-8")
        name = path.relative_to(tmp_path).as_posix()
        assert (digest_of_source("mine") != before) == (name in IMPORTS), name
        path.write_text(text, encoding="utf-8")
        assert digest_of_source("mine") == before
    names = ("numpy", "random", "sys", "agents.tabular.learner", "no_such_module", "a..b", "__main__x", "")
    assert {digest_of_source(name) for name in names} == {""}


@pytest.fixture
def digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """Returns the digest in a new process, after it was asked for once more and the rule was called."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    monkeypatch.setenv("PATIENCE", "3")
    code = """
from envs.sources import *
first = digest_when_loaded("rule_of_mine")
import rule_of_mine
rule_of_mine.rule()
print(first, first == digest_of_source("rule_of_mine"))"""

    def ask() -> str:
        command = [sys.executable, "-c", code]
        digest, is_same = subprocess.check_output(command, cwd=tmp_path, text=True).split()
        assert is_same == "True"
        return digest

    return ask


def test_data_environment_and_dynamic_imports_change_the_digest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, digest: Callable[[], str]
) -> None:
    """Files that a module names, and, by the numbers that it reads, files whose names are composed."""
    digests = [digest()]
    for name in FILES:
        with (tmp_path / name).open("a", encoding="utf-8") as file:
            file.write("\n# changed" if name.endswith(".py") else "1")
        digests.append(digest())
    monkeypatch.setenv("PATIENCE", "4")
    digests.append(digest())
    assert len({*digests}) == len(FILES) + 2
    (tmp_path / "unrelated.txt").write_text("1", encoding="utf-8")
    (tmp_path / "unrelated.py").write_text("1", encoding="utf-8")
    monkeypatch.setenv("UNRELATED", "1")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert digest() == digests[-1]


def test_variables_that_this_project_sets_in_workers_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or a worker would refuse a module that reads them, as one that has changed."""
    monkeypatch.syspath_prepend(tmp_path)
    names = ["MKL_CBWR", "ATEN_CPU_CAPABILITY", "MPLBACKEND"]
    assert {*names} == VARIABLES.keys()
    for name in (*names, "OF_A_USER"):
        (tmp_path / f"reads_{name.lower()}.py").write_text(f"import os\nos.environ.get('{name}')\n")
        digests = set()
        for value in ("1", "2"):
            monkeypatch.setenv(name, value)
            digests.add(digest_of_source(f"reads_{name.lower()}"))
        assert len(digests) == (1 if name in names else 2), name


def test_what_changes_while_a_module_is_used_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    text = "N, LAST, SEEN = 0, None, []\ndef count():\n    global N, LAST\n    N += 1\n    SEEN.append(N)\n"
    (tmp_path / "counts.py").write_text(text, encoding="utf-8")
    before = digest_when_loaded("counts")
    sys.modules["counts"].count()
    assert "" != digest_of_source("counts") == before
    monkeypatch.setattr(sys.modules["counts"], "RATE", 0.5, raising=False)
    assert digest_of_source("counts") != before == digest_when_loaded("counts")
