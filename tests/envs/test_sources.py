"""The digest of users' modules: what it depends on, and that every process computes the same."""

import subprocess
import sys
from pathlib import Path

import pytest

from envs.sources import VARIABLES, digest_of_source
from tests.support import ROOT

COUNTED = {
    "mine.py": "import os, numpy\ndef f():\n    from inner import deep\n    import near_by.near",
    "inner/__init__.py": "from .first import *",
    "inner/first.py": "from ..beyond import all",
    "inner/deep.py": "from . import second as other\nNAMES = 'inner.fourth', 'rate.txt'",
    "inner/second.py": "not Python \0",
    "inner/fourth.py": "",
    "inner/rate.txt": "0.5",
    "near_by/near.py": "import mine",
}
OTHERS = {"other.py": "", "inner/third.py": "", "mine.toml": "", "near_by/rate.txt": ""}


def test_digest_is_of_a_module_and_of_all_that_it_imports_or_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for name, text in (COUNTED | OTHERS).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    before = digest_of_source("mine")
    for name, text in (COUNTED | OTHERS).items():
        (tmp_path / name).write_text(f"{text}\n# changed", encoding="utf-8")
        assert (digest_of_source("mine") != before) == (name in COUNTED), name
        (tmp_path / name).write_text(text, encoding="utf-8")
    names = "numpy", "random", "sys", "agents.tabular.learner", "no_such_module", "a..b", ""
    assert {digest_of_source(name) for name in names} == {""}
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    code = "from envs.sources import *; print(digest_of_source('mine'))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == before


def test_variables_that_this_project_sets_in_workers_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or a worker would refuse a module that reads them, as one that has changed."""
    monkeypatch.syspath_prepend(tmp_path)
    for name in (*VARIABLES, "OF_A_USER"):
        module = f"reads_{name.lower()}"
        (tmp_path / f"{module}.py").write_text(f"import os\nos.environ.get('{name}')\n")
        digests = set()
        for value in ("1", "2"):
            monkeypatch.setenv(name, value)
            digests.add(digest_of_source(module))
        assert len(digests) == (1 if name in VARIABLES else 2), name
