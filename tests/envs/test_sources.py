"""The digest of users' modules: what it depends on, and that every process computes the same."""

import subprocess
import sys
from pathlib import Path

import pytest

from envs.sources import digest_of_source, digest_when_loaded
from tests.support import ROOT

COUNTED = {
    "mine.py": "import os, numpy\ndef f():\n    from inner import deep\n    import near_by.near",
    "inner/__init__.py": "from .first import *",
    "inner/first.py": "import sys",
    "inner/deep.py": "from . import second as other",
    "inner/second.py": "not Python \0",
    "near_by/near.py": "import mine",
}
OTHERS = {"other.py": "", "inner/third.py": "", "mine.toml": "", "near_by/rate.txt": ""}

RULE = """
from pathlib import Path
import numpy as np
from rates import half, os as system
MEASURED = tuple(np.loadtxt(Path(__file__).with_name("measured.csv"))), 1
PATIENCE = float(system.environ.get("PATIENCE", 1.0))
def rule():
    return PATIENCE + half()
"""
FILES = {
    "rule_of_mine.py": RULE,
    "rates.py": "import os\nhalf = lambda: RATE\n"
    "RATE = float(open(__file__[:-8] + 'rate.txt').read())\n",
    "measured.csv": "1 2 3",
    "rate.txt": "0.5",
}
ASK = """
from envs.sources import *
print(digest_when_loaded("rule_of_mine"))
import rule_of_mine
rule_of_mine.rule()
print(digest_of_source("rule_of_mine"))
"""


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def test_digest_is_of_a_module_and_of_all_that_it_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    write(tmp_path, COUNTED | OTHERS)
    before = digest_of_source("mine")
    for name, text in (COUNTED | OTHERS).items():
        write(tmp_path, {name: f"{text}\n# changed"})
        assert (digest_of_source("mine") != before) == (name in COUNTED), name
        write(tmp_path, {name: text})
    names = "numpy", "random", "sys", "agents.tabular.learner", "no_such_module", "a..b", ""
    assert {digest_of_source(name) for name in names} == {""}


def test_numbers_from_files_and_the_environment_change_the_digest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In new processes, before and after the rule is used."""
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    write(tmp_path, FILES)
    digests = []
    changes = [
        ("PATIENCE", "3"),
        *FILES.items(),
        ("PATIENCE", "4"),
        ("HOME", "x"),
        ("unrelated.py", ""),
    ]
    for name, text in changes:
        if name.isupper():
            monkeypatch.setenv(name, text)
        else:
            write(tmp_path, {name: text + ("\n# changed" if name.endswith(".py") else "1")})
        answer = subprocess.check_output([sys.executable, "-c", ASK], cwd=tmp_path, text=True)
        first, again = answer.split()
        assert first == again
        digests.append(first)
    assert digests[-3:] == [digests[-1]] * 3
    assert len({*digests}) == len(changes) - 2


def test_what_changes_while_a_module_is_used_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    text = "N, SEEN = 0, []\ndef count():\n    global N\n    N += 1\n    SEEN.append(N)\n"
    write(tmp_path, {"counts.py": text})
    before = digest_when_loaded("counts")
    sys.modules["counts"].count()
    assert "" != digest_of_source("counts") == before
    monkeypatch.setattr(sys.modules["counts"], "RATE", 0.5, raising=False)
    assert digest_of_source("counts") != before == digest_when_loaded("counts")
