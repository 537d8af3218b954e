"""The digest of users' modules: what it depends on, and that every process computes the same."""

import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from envs import InputError
from envs.sources import digest_of_source, digest_when_loaded, imported, search_beside
from tests.support import ROOT, small_experiment, variant

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
from importlib import import_module
from pathlib import Path
import numpy as np
from agents.tabular.learner import TabularAlgorithm
from agents.tabular.updates import UpdateRule
from rates import half, os as system
MEASURED = tuple(np.loadtxt(Path(__file__).with_name("measured.csv"))), 1
PATIENCE = float(system.environ.get("PATIENCE", 1.0))
others = import_module("oth" + "ers")
KIND = system.environ.get("KIND", "fast")
def made(rate):
    return lambda after, step=float(system.environ.get("STEP", 1.0)): rate
RULE = TabularAlgorithm(UpdateRule(made(float(system.environ.get("RATE", 1.0)))))
def rule():
    return PATIENCE + half()
"""
FILES = {
    "rule_of_mine.py": RULE,
    "rates.py": "import os\nhalf = lambda: RATE\n"
    "RATE = float(open(__file__[:-8] + 'rate.txt').read())\n",
    "others.py": "RATE = 1",
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
    write(tmp_path, {"parts/__init__.py": "", "parts/one.py": "", "parts/two.py": ""})
    before = digest_when_loaded("parts.one")
    import_module("parts.two")  # as another process may not
    assert digest_of_source("parts.one") == before != ""


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
        *[("KIND", "slow"), ("STEP", "2"), ("RATE", "2")],
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


def test_only_modules_that_are_named_and_what_they_import_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran, path = list[str](), [*sys.path]
    monkeypatch.setattr(sys, "ran", ran, raising=False)
    imports = {
        "named.py": "import beside, several.inner\ndef late():\n    import later\n"
        "    return importlib.import_module('much_later'), pkgutil.resolve_name('last')\n",
        **dict.fromkeys(("several/inner.py", "later.py", "much_later.py", "last.py"), ""),
        "beside.py": "try:\n    import numpy.unnamed, unnamed\nexcept ImportError:\n    pass\n",
        **dict.fromkeys(("of_nobody.py", "other/named.py"), ""),
    }
    begin = "import sys, importlib, pkgutil\nsys.ran.append(__name__)\n"
    write(tmp_path, {name: begin + text for name, text in imports.items()})
    search_beside(tmp_path / "mine.toml")
    late: Any = imported("named:late", "mine.toml", "function")
    assert digest_when_loaded("named") == digest_of_source("named") != ""
    late()
    assert ran == ["named", "beside", "several.inner", "later", "much_later", "last"]
    assert (sys.path, find_spec("of_nobody"), find_spec("other")) == (path, None, None)
    search_beside(tmp_path / "other" / "mine.toml")
    with pytest.raises(InputError, match="accepted: another name, or a new process"):
        imported("named:late", "mine.toml", "function")


@pytest.mark.slow
def test_no_file_runs_that_nobody_has_named(tmp_path: Path) -> None:
    """Beside an experiment, and where the command runs; also in its workers."""
    names = ["cffi", "zstandard", "linkify_it", "tensorboard", "json", "socket", "random", "rich"]
    bad = f"open({str(tmp_path / 'MARKER')!r}, 'w')\n"
    write(tmp_path, dict.fromkeys([f"{where}/{name}.py" for name in names for where in "ab"], bad))
    settings = {"budget": 200, "n_steps": 100}
    learner = variant("stable_baselines3:A2C", "one_hot", settings=settings)
    text = small_experiment(algorithms={"net": learner}, report="comparison")
    write(tmp_path, {"a/mine.toml": text})
    for where in "ab":
        command = [sys.executable, "-m", "benchmark", "run", "../a/mine.toml", "--report"]
        subprocess.run(command, cwd=tmp_path / where, check=True)
    assert not (tmp_path / "MARKER").exists()
