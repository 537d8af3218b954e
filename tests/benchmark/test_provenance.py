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
from tests.support import ROOT, specifications

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
