"""What chaos says: that nothing is lost or different, only if nothing is. `tests/test_make.py` runs it."""

import shutil
from pathlib import Path

import pytest

from tests.chaos import Broken, Chaos
from tests.support import variant


@pytest.mark.slow
def test_losses_and_changes_are_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chaos = Chaos(tmp_path, {"table": variant()}, seed=1)
    chaos.results.mkdir()
    shutil.copy(tmp_path / "expected.db", chaos.results / "runs.db")
    assert chaos.check() == len(chaos.expected)
    digest, arrays = next(iter(chaos.expected.items()))
    monkeypatch.setitem(chaos.expected, digest, arrays | {"q": b"other"})
    with pytest.raises(Broken, match=f"run {digest[:12]} is different"):
        chaos.check()
    monkeypatch.undo()
    (chaos.results / "runs.db").unlink()
    with pytest.raises(Broken, match="runs are lost"):
        chaos.check()
