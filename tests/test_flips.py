"""One changed byte of what is published or stored is noticed, wherever it is."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmark.folder import Folder, unsealed
from benchmark.store import Record, Store
from envs import InputError
from tests.support import ROOT

NAME = "equivalence"  # the smallest
CHOSEN = ROOT / "benchmark" / "experiments" / "tuning.chosen.json"


def flips(content: bytes, n: int) -> Iterator[bytes]:
    """Yields contents in which another digit stands in the place of one."""
    rng = np.random.default_rng(1)
    places = [match.start() for match in re.finditer(rb"\d", content)]
    for place in rng.choice(places, min(n, len(places)), replace=False):
        digit = b"%d" % ((int(content[place : place + 1]) + rng.integers(1, 10)) % 10)
        yield content[:place] + digit + content[place + 1 :]


def test_changed_digits_of_published_files_and_chosen_settings_are_noticed(tmp_path: Path) -> None:
    folder = shutil.copytree(ROOT / "results" / NAME, tmp_path / NAME)
    for path in (folder / file for file in ("manifest.json", *Folder(folder).files)):
        content = path.read_bytes()
        for changed in flips(content, 8):
            path.write_bytes(changed)
            with pytest.raises(InputError, match=f"{NAME}/{path.name}: damaged"):
                Folder(folder).check()
        path.write_bytes(content)
    Folder(folder).check()
    for changed in flips(CHOSEN.read_bytes(), 50):
        with pytest.raises(ValueError, match=r"sha256 is|Extra data|Expecting|leading zero"):
            unsealed(changed)


def test_no_flipped_bit_of_the_store_is_used_silently(tmp_path: Path) -> None:
    """Whatever bit is flipped: a record is as it was, or known to be damaged or missing."""
    rng = np.random.default_rng(1)
    path = tmp_path / "runs.db"
    arrays = {f"{i:064x}": {"q": rng.random((30, 5))} for i in range(12)}
    with Store(path) as store:
        store.add([Record(digest, "{}", "done", {}, own) for digest, own in arrays.items()])
    whole, n_same, refused = path.read_bytes(), 0, list[str]()
    for bit in rng.choice(len(whole) * 8, size=100, replace=False).tolist():
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        try:
            with Store(path) as store:
                store.discard_damaged(arrays)
                digests = sorted(store.ended() & arrays.keys())
                for found in store.get(digests):
                    assert (found.arrays["q"] == arrays[found.digest]["q"]).all(), bit
                    assert (found.specification, found.status) == ("{}", "done"), bit
                n_same += len(digests) == len(arrays)
        except InputError as error:
            refused.append(str(error))
    assert n_same < 75  # most bits are those of records
    assert len(refused) < 15  # the header, the schema, or the index
    assert not any("\n" in message for message in refused)
