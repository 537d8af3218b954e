"""The store gives back what was put into it, whole, or says what is wrong with it."""

import os
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark import store as store_module
from benchmark.folder import check_writable
from benchmark.store import Arrays, Record, Store
from envs import InputError


def record(digest: str, status: str = "done", arrays: Arrays | None = None) -> Record:
    error = "oh" if status == "failed" else None
    return Record(digest, "{}", status, {"wall_time_s": 1.0}, arrays or {}, error)


def execute(path: Path, *statements: str, parameters: Sequence[object] = ()) -> list[Any]:
    """Does something to the file that the store does not know of."""
    connection = sqlite3.connect(path, isolation_level=None)
    rows = [connection.execute(statement, parameters).fetchall() for statement in statements]
    connection.close()
    return rows[-1]


def test_store_gives_back_what_it_was_given(tmp_path: Path) -> None:
    with Store(tmp_path / "deep" / "runs.db") as store:
        store.add([record("x", arrays={"a": np.ones(3)}), record("y")])
        store.add([record("x", "failed"), record("z", "failed")])  # for example by another driver
        with pytest.raises(InputError):  # all or none
            store.add([record("y", "failed"), record("v"), record("w", "odd")])
    with Store(tmp_path / "deep" / "runs.db") as store:
        assert store.statuses() == {"x": "done", "y": "done", "z": "failed"}
        assert store.ended() == {"x", "y"}
        second, first = store.get(["y", "x"])
        assert (second.arrays, first.arrays["a"].tolist()) == ({}, [1, 1, 1])
        assert (first.provenance, first.error) == ({"wall_time_s": 1.0}, None)
        assert store.get(["z"])[0].error == "oh"
        with pytest.raises(InputError, match="the record of run other is missing"):
            store.get(["other"])


@pytest.mark.parametrize("shape", [(), (3, 0), (2, 3, 5)])
def test_arrays_come_back_bit_by_bit(tmp_path: Path, shape: tuple[int, ...]) -> None:
    # Arbitrary bits: some floats are denormal, or NaN with a payload.
    size, rng = int(np.prod(shape)), np.random.default_rng(0)
    arrays: dict[str, NDArray[np.generic]] = {
        name: np.frombuffer(rng.bytes(8 * size), name)[:size].reshape(shape)
        for name in ("i1", ">u4", "<i8", "<f4", ">f8")
    }
    arrays["text"] = np.full(shape, "PING")
    arrays["transposed"] = np.arange(12.0).reshape(3, 4).T
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x", arrays=arrays)])
        (found,) = store.get(["x"])
    assert found.arrays.keys() == arrays.keys()
    for name, array in arrays.items():
        there = found.arrays[name]
        assert (there.dtype, there.shape) == (array.dtype, array.shape)
        assert there.tobytes() == array.tobytes()


# Damage


@pytest.mark.parametrize("share", [0.1, 0.4, 0.95])
def test_a_shortened_file_is_refused_and_left_alone(tmp_path: Path, share: float) -> None:
    path = tmp_path / "runs.db"
    with Store(path) as store:
        store.add(record(f"{i:064x}", arrays={"a": np.arange(500.0) + i}) for i in range(50))
    content = path.read_bytes()[: int(share * path.stat().st_size)]
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"runs\.db.*move it away"), Store(path):
        pass
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    "damage",
    [
        "arrays = substr(arrays, 1, length(arrays) - 1)",  # without its end
        "provenance = CAST(X'7bff7d' AS TEXT)",  # no UTF-8
        "specification = '{ }'",
        "head = NULL",
    ],
)
def test_damaged_records_are_reported_and_removed(tmp_path: Path, damage: str) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add(
            [record("0123456789abcdef", arrays={"q": np.zeros(5), "r": np.zeros(5)}), record("y")]
        )
    execute(tmp_path / "runs.db", f"UPDATE runs SET {damage} WHERE digest != 'y'")
    with Store(tmp_path / "runs.db") as store:
        with pytest.raises(InputError, match=r"runs\.db: the record of run 0123456789ab\b"):
            store.get(["0123456789abcdef"])
        assert store.discard_damaged(["0123456789abcdef", "y"]) == 1
        assert store.statuses() == {"y": "done"}


def test_no_flipped_bit_of_the_store_is_used_silently(tmp_path: Path) -> None:
    """Whatever bit is flipped: a record is as it was, or known to be damaged or missing."""
    rng = np.random.default_rng(1)
    path = tmp_path / "runs.db"
    arrays = {f"{i:064x}": {"q": rng.random((30, 5))} for i in range(12)}
    with Store(path) as store:
        store.add(record(digest, arrays=own) for digest, own in arrays.items())
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


# What is not a store, or cannot be used


def test_foreign_files_are_refused_and_left_alone(tmp_path: Path) -> None:
    text, other, older = (tmp_path / f"{name}.db" for name in ("text", "other", "older"))
    text.write_text("these are my notes, and no database at all\n" * 100)
    execute(other, "CREATE TABLE cats (name TEXT)")
    with Store(older):
        pass
    execute(older, "PRAGMA user_version = 3")
    for path in (text, other, older):
        before = path.read_bytes()
        for read_only in (False, True):
            with pytest.raises(InputError, match=rf"{path.name}.*move it away"):
                Store(path, read_only=read_only)
        assert path.read_bytes() == before
    with pytest.raises(InputError, match=r"runs\.db: cannot be used as the store .*exists"):
        Store(text / "runs.db")


def test_reading_needs_a_store_and_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "runs.db"
    with pytest.raises(InputError, match=r"runs\.db: there are no runs yet"):
        Store(path, read_only=True)
    assert not path.exists()
    with Store(path) as store:
        store.add([record("x")])
    before = path.read_bytes()
    with Store(path, read_only=True) as store:
        assert store.statuses() == {"x": "done"}
        with pytest.raises(InputError):
            store.add([record("y")])
    assert path.read_bytes() == before


def test_a_store_that_another_program_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(store_module, "_PATIENCE_MS", 10)
    with Store(path := tmp_path / "runs.db") as ours:
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(InputError, match=r"stop the program that uses it; .* with --results"):
            Store(path)
        assert f"{path}: waiting for another program" in capsys.readouterr().err
        other.close()
        error = sqlite3.OperationalError("disk I/O error")
        cases = {"SQLITE_IOERR_LOCK": "does not support locks", "SQLITE_FULL": "free space"}
        for name, advice in cases.items():
            error.sqlite_errorname = name
            with pytest.raises(InputError, match=advice), ours._input_errors():
                raise error


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can act as somebody else")
def test_what_somebody_else_may_not_write_is_refused_before_training() -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        Store(folder / "runs.db").__exit__()
        (folder / "mine").mkdir()
        os.seteuid(65534)
        try:
            with pytest.raises(InputError, match=r"runs\.db: cannot be used"):
                Store(folder / "runs.db")
            with pytest.raises(InputError, match="mine: cannot be written"):
                check_writable(folder / "mine")
        finally:
            os.seteuid(0)
        check_writable(folder / "mine")
