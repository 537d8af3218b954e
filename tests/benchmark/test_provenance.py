"""What records say of the code, the machine and the packages that made them."""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

from benchmark import provenance
from benchmark.experiment import load_experiment
from benchmark.provenance import commit, peak_memory_mb, reset_peak_memory
from benchmark.run import execute
from benchmark.store import Store
from envs import InputError
from tests.support import ROOT, git, specifications

COMPARED = load_experiment("compare_deep", smoke=True)


def test_missing_packages_are_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_torch(name: str) -> str:
        if name == "torch":
            raise PackageNotFoundError
        return version(name)

    monkeypatch.setattr(provenance, "version", without_torch)
    tables = specifications(COMPARED, "default", "S1", "q_learning", "index", [0])
    nets = specifications(COMPARED, "default", "S1", "sb3_dqn", "one_hot", [0, 1])
    with Store(tmp_path / "runs.db") as store:
        with pytest.raises(
            InputError, match=r"^sb3_dqn needs the package torch, .*make \.venv/\.deep .*"
        ):
            execute([*tables, *nets], store, 1)
        assert store.statuses() == {}
        assert execute(tables, store, 1) == []
        (record,) = store.get([tables[0].digest])
    assert record.provenance["versions"]["numpy"] == version("numpy")
    assert record.provenance["commit"] == commit(ROOT)


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="others do not say the peak")
def test_peak_memory_is_that_of_this_process_since_the_last_reset() -> None:
    reset_peak_memory()
    before = peak_memory_mb() or 0
    data = b"x" * (300 << 20)
    during = peak_memory_mb() or 0
    del data
    reset_peak_memory()
    assert during - before > 250
    assert during - (peak_memory_mb() or 0) > 250


def test_the_commit_is_read_without_running_anything_of_the_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = ("benchmark/__init__.py", "benchmark/a.toml", "agents/b.py", "envs/c.py")
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"x = 1\r\n")
    (tmp_path / "notes.txt").touch()
    assert commit(tmp_path) is None
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "first")
    runs = f"touch {tmp_path / 'MARKER'};"
    for key in ("core.fsmonitor", "filter.f.clean", "core.hooksPath"):
        git(tmp_path, "config", key, runs)
    monkeypatch.setenv("GIT_TEST_ASSUME_DIFFERENT_OWNER", "1")  # "dubious ownership"
    head = commit(tmp_path)
    assert head is not None
    assert len(head) == 12
    for name, content in [("envs/c.py", b"x = 2\n"), ("agents/new.py", b""), (files[1], None)]:
        before = (tmp_path / name).read_bytes() if name in files else None
        for text, expected in ((content, f"{head}-changed"), (before, head)):
            (tmp_path / name).unlink(missing_ok=True)
            if text is not None:
                (tmp_path / name).write_bytes(text)
            assert commit(tmp_path) == expected
    assert not (tmp_path / "MARKER").exists()
    assert commit(tmp_path / "benchmark") is None  # a copy inside another repository
