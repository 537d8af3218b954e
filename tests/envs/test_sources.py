"""The digest of users' modules: what it depends on."""

from pathlib import Path

import pytest

from envs.sources import digest_of_source

COUNTED = {
    "mine.py": "import os, numpy\ndef f():\n    from inner import deep\n    import near_by.near",
    "inner/__init__.py": "from .first import *",
    "inner/first.py": "import sys",
    "inner/deep.py": "from . import second as other",
    "inner/second.py": "not Python \0",
    "near_by/near.py": "import mine",
}
OTHERS = {"other.py": "", "inner/third.py": "", "mine.toml": "", "near_by/rate.txt": ""}


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
        digest_of_source.cache_clear()
        assert (digest_of_source("mine") != before) == (name in COUNTED), name
        write(tmp_path, {name: text})
    names = "numpy", "random", "sys", "agents.tabular.learner", "no_such_module", "a..b", ""
    assert {digest_of_source(name) for name in names} == {""}
