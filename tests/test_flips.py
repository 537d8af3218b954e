"""One changed byte of what is published or stored is noticed, wherever it is."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmark.execution.store import Store
from benchmark.experiments.search import chosen_file
from benchmark.folder import Folder
from benchmark.sealed import unsealed
from envs import InputError
from tests.benchmark.execution.test_store import content_of, record
from tests.support import ROOT

NAME = "equivalence"  # the smallest


def flips(content: bytes, n: int) -> Iterator[bytes]:
    """Yields contents in which another digit stands in the place of one."""
    rng = np.random.default_rng(1)
    places = [match.start() for match in re.finditer(rb"\d", content)]
    for place in rng.choice(places, min(n, len(places)), replace=False):
        digit = b"%d" % ((int(content[place : place + 1]) + rng.integers(1, 10)) % 10)
        yield content[:place] + digit + content[place + 1 :]


def test_every_changed_digit_of_every_published_file_is_noticed(tmp_path: Path) -> None:
    unlisted = shutil.ignore_patterns("index.html", ".*")
    folder = shutil.copytree(ROOT / "results" / NAME, tmp_path / NAME, ignore=unlisted)
    files = sorted({*folder.glob("*.*")} - {folder / "README.md"})  # which is made of the others
    assert len(files) == len(Folder(folder).manifest["files"]) + 1
    for path in files:
        content = path.read_bytes()
        for changed in flips(content, 8):
            path.write_bytes(changed)
            with pytest.raises(InputError, match=f"{NAME}/{path.name}: damaged"):
                Folder(folder).check()
        path.write_bytes(content)
    Folder(folder).check()


def test_every_changed_digit_of_chosen_settings_is_noticed() -> None:
    content = chosen_file(ROOT / "benchmark" / "experiments" / "tuning.toml").read_bytes()
    unsealed(content)
    for changed in flips(content, 50):
        with pytest.raises(ValueError, match=r"sha256 is not the digest|Extra data|Expecting|leading zero"):
            unsealed(changed)


def test_no_flipped_bit_of_the_store_is_used_silently(tmp_path: Path) -> None:
    """Whatever bit of the file is flipped: a record is as it was, or known to be damaged or missing."""
    rng = np.random.default_rng(1)
    path = tmp_path / "runs.db"
    with Store(path) as store:
        for i in range(12):
            arrays = {"q": rng.random((30, 5)), "greedy": rng.integers(0, 31, 120)}
            store.add([record(f"{i:064x}", "failed" if i == 3 else "done", arrays)])
        expected = {digest: content_of(store.get([digest])[0]) for digest in store.statuses()}
    whole = path.read_bytes()
    n_same, refused = 0, list[str]()
    for bit in rng.choice(len(whole) * 8, size=100, replace=False).tolist():
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        try:
            with Store(path) as store:
                store.discard_damaged(expected)
                digests = store.ended() & expected.keys()
                for read in store.get(sorted(digests)):
                    assert content_of(read) == expected[read.digest], bit
                n_same += len(digests) == len(expected) - 1
        except InputError as error:
            refused.append(str(error))
    assert n_same < 75  # most bits are those of records
    assert len(refused) < 15  # the header, the schema, or the index
    assert not any("\n" in message for message in refused)
