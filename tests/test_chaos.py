"""What chaos says: that nothing is lost or different, only if nothing is. `tests/test_make.py` runs it."""

import re
import shutil

import pytest

from tests.chaos import TABLES, Broken, Chaos


@pytest.fixture(scope="module")
def chaos(tmp_path_factory: pytest.TempPathFactory) -> Chaos:
    """A few tables, executed undisturbed."""
    few = re.sub(r"seeds = \d+", "seeds = 2", TABLES)
    return Chaos(tmp_path_factory.mktemp("chaos"), few, seed=1)


def test_losses_and_changes_are_seen(chaos: Chaos, monkeypatch: pytest.MonkeyPatch) -> None:
    chaos.results.mkdir()
    shutil.copy(chaos.results.with_name("expected.db"), chaos.results / "runs.db")
    assert chaos.check() == len(chaos.expected)
    digest, arrays = next(iter(chaos.expected.items()))
    monkeypatch.setitem(chaos.expected, digest, arrays | {"q": b"other"})
    with pytest.raises(Broken, match=f"run {digest[:12]} is different"):
        chaos.check()
    monkeypatch.undo()
    (chaos.results / "runs.db").unlink()
    with pytest.raises(Broken, match="runs are lost"):
        chaos.check()
