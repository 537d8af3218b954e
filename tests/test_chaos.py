"""A little chaos: what is killed, interrupted or out of disk loses, repeats and changes no run."""

import sys

import pytest

from tests.chaos import TABLES, Broken, Chaos, disturb, local_ways

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")


@pytest.fixture(scope="module")
def chaos(tmp_path_factory: pytest.TempPathFactory) -> Chaos:
    """An experiment of tables alone; that with nets is disturbed in `tests/benchmark/execution`."""
    return Chaos(tmp_path_factory.mktemp("chaos"), TABLES, seed=1)


def test_nothing_is_lost_repeated_or_different(chaos: Chaos) -> None:
    disturb(chaos, local_ways(chaos), n_kills=3)
    chaos.disk_full()
    chaos.finish()
    assert chaos.happened["killed"] >= 3


def test_losses_and_changes_are_seen(chaos: Chaos, monkeypatch: pytest.MonkeyPatch) -> None:
    process = chaos.start()
    process.communicate()
    assert chaos.check() == len(chaos.expected)
    digest, arrays = next(iter(chaos.expected.items()))
    monkeypatch.setitem(chaos.expected, digest, arrays | {"q": b"other"})
    with pytest.raises(Broken, match=f"run {digest[:12]} is different"):
        chaos.check()
    monkeypatch.undo()
    (chaos.results / "runs.db").unlink()
    with pytest.raises(Broken, match="runs are lost"):
        chaos.check()
