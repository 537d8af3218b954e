"""The store gives back what was put into it, whole, or says what is wrong with it."""

import os
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.execution import store as stores
from benchmark.execution.store import NoRunsError, Record, Store
from envs import InputError


def record(digest: str, status: str = "done", arrays: dict[str, NDArray[Any]] | None = None) -> Record:
    arrays = arrays or {}
    return Record(digest, "{}", status, {"wall_time_s": 1.0}, arrays, "oh" if status == "failed" else None)


def test_store_gives_back_what_it_was_given(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(7, dtype=np.int64), "c": np.empty((0, 3))}
    with Store(tmp_path / "deep" / "runs.db") as store:
        store.add([record("x", arrays=arrays), record("y")])
        store.add([record("x", "failed")])
        store.add([record("x", arrays=arrays)])
    with Store(tmp_path / "deep" / "runs.db") as store:
        assert store.statuses() == {"x": "done", "y": "done"}
        assert store.ended() == {"x", "y"}
        assert store.ended(["y", "z", "it's"]) == {"y"}
        second, first = store.get(["y", "x"])
        assert (second.arrays, first.status) == ({}, "done")
        for name, values in arrays.items():
            assert first.arrays[name].dtype == values.dtype
            assert np.array_equal(first.arrays[name], values)
            assert first.arrays[name].shape == values.shape
        with pytest.raises(InputError, match="the record of run z is damaged; run its experiment again"):
            store.get(["z"])


NUMBERS = ["i1", "u1", "<i2", ">u4", "<i8", "<f2", "<f4", ">f8", "<c16", "<M8[s]"]


@pytest.mark.parametrize("shape", [(), (0,), (3, 0), (1,), (2, 3, 5)])
def test_arrays_come_back_bit_by_bit(tmp_path: Path, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    arrays: dict[str, NDArray[Any]] = {
        # Any bits: some floats are denormal, or NaN with a payload.
        name: np.frombuffer(rng.bytes(int(np.prod(shape)) * np.dtype(name).itemsize), name).reshape(shape)
        for name in NUMBERS
    }
    arrays["bool"] = np.array(rng.random(shape) < 0.5)
    arrays["text"] = np.full(shape, "PING")
    arrays["transposed"] = np.arange(12.0).reshape(3, 4).T
    arrays["NaN"] = np.array([0x7FF8000000000123, 0xFFF0000000000001], dtype=np.uint64).view(np.float64)
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x", arrays=arrays)])
        (stored,) = store.get(["x"])
    assert stored.arrays.keys() == arrays.keys()
    for name, values in arrays.items():
        back = stored.arrays[name]
        assert (back.dtype, back.shape, back.tobytes()) == (values.dtype, values.shape, values.tobytes())


def test_equal_arrays_are_stored_as_equal_bytes(tmp_path: Path) -> None:
    arrays = {"b": np.arange(5), "a": np.arange(6.0).reshape(2, 3), "c": np.array(True)}
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x", arrays=arrays)])
        store.add([record("y", arrays=dict(reversed(arrays.items())))])
        store.add([record("z", arrays=arrays | {"a": np.asfortranarray(arrays["a"])})])
    connection = sqlite3.connect(tmp_path / "runs.db")
    assert len(connection.execute("SELECT DISTINCT arrays, checksum FROM runs").fetchall()) == 1
    connection.close()


def test_arrays_are_compressed(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record(str(i), arrays={"a": np.zeros(100_000)}) for i in range(10)])
    assert (tmp_path / "runs.db").stat().st_size < 100_000


def test_records_are_added_all_or_none(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x")])
        with pytest.raises(InputError, match="CHECK constraint"):
            store.add([record("x", "failed"), record("y"), record("z", "odd")])
        assert store.statuses() == {"x": "done"}


def test_failure_does_not_replace_a_valid_record(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x", arrays={"a": np.ones(3)})])
        store.add([record("x", "failed"), record("y", "failed")])  # for example by another driver
        assert store.statuses() == {"x": "done", "y": "failed"}
        assert store.get(["x"])[0].arrays["a"].tolist() == [1, 1, 1]


def test_foreign_and_broken_stores_are_refused_and_left_alone(tmp_path: Path) -> None:
    text = tmp_path / "text.db"
    text.write_text("these are my notes, and no database at all\n" * 100)
    with pytest.raises(InputError, match=r"text\.db: cannot be used as the store of runs: file is not"):
        Store(text)
    assert text.read_text().startswith("these are my notes")
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as connection:
        connection.execute("CREATE TABLE cats (name TEXT)")
    connection.close()
    older = tmp_path / "older.db"
    with Store(older):
        pass
    with sqlite3.connect(older) as connection:
        connection.execute("PRAGMA user_version = 2")
    connection.close()
    for path in (other, older):
        before = path.read_bytes()
        with pytest.raises(
            InputError, match=rf"{path.name}: not a store of this version of the project; move"
        ):
            Store(path)
        assert path.read_bytes() == before
    with pytest.raises(InputError, match="cannot be used as the store"):
        Store(tmp_path)  # a folder
    with pytest.raises(InputError, match="cannot be created"):
        Store(text / "runs.db")


def test_whole_records_of_a_damaged_file_are_saved(tmp_path: Path) -> None:
    path = tmp_path / "runs.db"
    records = {str(i): record(str(i), arrays={"a": np.arange(500.0) + i}) for i in range(50)}
    with Store(path) as store:
        store.add(records.values())
    content = bytearray(path.read_bytes())
    content[len(content) // 2 :] = b"\x5a" * (len(content) - len(content) // 2)
    path.write_bytes(content)
    with Store(path, read_only=True) as store, pytest.raises(InputError, match=r"runs\.db: .*'run EXPERI"):
        store.get(list(records))
    assert path.read_bytes() == content  # reading changes nothing
    with Store(path) as store, Store(path) as other:
        store.damaged(records)
        saved = store.statuses().keys()
        assert 5 < len(saved) < len(records)
        assert store.salvaged == (
            f"{path} was damaged: its {len(saved)} intact records have been saved; the damaged "
            f"file is kept as {path}.damaged."
        )
        assert (tmp_path / "runs.db.damaged").read_bytes() == content
        other.add([record("new")])  # by a driver that had opened the damaged file
        assert other.salvaged == ""
        assert store.problem() == ""
        assert store.statuses().keys() == {*saved, "new"}
        for digest in saved:
            assert store.get([digest])[0].arrays["a"].tolist() == records[digest].arrays["a"].tolist()


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_whole_records_of_a_truncated_file_are_saved(tmp_path: Path, share: float) -> None:
    path = tmp_path / "runs.db"
    records = {f"{i:064x}": record(f"{i:064x}", arrays={"a": np.arange(5000.0) * i}) for i in range(50)}
    with Store(path) as store:
        store.add(records.values())
    content = path.read_bytes()[: int(share * path.stat().st_size)]
    path.write_bytes(content)
    with (
        pytest.raises(
            InputError, match=r"'run EXPERIMENT' saves the intact records|run its experiment again"
        ),
        Store(path, read_only=True) as store,
    ):
        store.get(list(records))
    assert path.read_bytes() == content
    with Store(path) as store:
        store.repair()
        assert "was damaged" in store.salvaged
        assert store.problem() == ""
        saved = store.ended()
        assert len(saved) > 50 * share / 2
        for digest in saved:
            assert content_of(store.get([digest])[0]) == content_of(records[digest])


def damaged_in_the_middle(path: Path) -> bytes:
    """Makes a store of 30 runs, some of which are damaged, and returns its content."""
    with Store(path) as store:
        store.add([record(f"{i:064x}", arrays={"a": np.arange(500.0) + i}) for i in range(30)])
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : -len(content) // 4] = b"\x5a" * len(
        content[len(content) // 2 : -len(content) // 4]
    )
    path.write_bytes(content)
    return bytes(content)


def test_damaged_file_is_kept_where_files_have_but_one_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    content = damaged_in_the_middle(tmp_path / "runs.db")
    monkeypatch.setattr(Path, "hardlink_to", refuse)
    with Store(tmp_path / "runs.db") as store:
        store.repair()
        assert "was damaged" in store.salvaged
    assert (tmp_path / "runs.db.damaged").read_bytes() == content
    assert sorted(path.name for path in tmp_path.iterdir()) == ["runs.db", "runs.db.damaged"]


def test_file_is_replaced_while_another_driver_waits_to_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged_in_the_middle(tmp_path / "runs.db")
    with Store(tmp_path / "runs.db") as first, Store(tmp_path / "runs.db") as second:
        add = second._add

        def wait_and_add(rows: Any) -> None:
            first.repair()
            add(rows)

        monkeypatch.setattr(second, "_add", wait_and_add)
        second.add([record("new")])
        assert "new" in first.ended()


def test_record_is_not_written_to_a_file_that_is_moved_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "runs.db"
    with Store(path) as store:
        add = store._add

        def replace_and_add(rows: Any) -> None:
            monkeypatch.undo()
            path.rename(tmp_path / "moved.db")
            add(rows)

        monkeypatch.setattr(store, "_add", replace_and_add)
        store.add([record("x")])
        store.add([record("y")])
        assert store.statuses() == {"x": "done", "y": "done"}
    with Store(path, read_only=True) as store:
        assert store.statuses() == {"x": "done", "y": "done"}


def test_file_is_replaced_while_another_driver_waits_to_open_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    content = damaged_in_the_middle(tmp_path / "runs.db")
    create = Store._create
    with Store(tmp_path / "runs.db") as first:

        def wait_and_create(store: Store) -> None:
            monkeypatch.undo()
            first.repair()
            first.add([record("new")])
            create(store)

        monkeypatch.setattr(Store, "_create", wait_and_create)
        with Store(tmp_path / "runs.db") as second:
            second.repair()
            assert second.salvaged == ""
            assert "new" in second.ended()
        assert capsys.readouterr().err == f"{first.salvaged}\n"
    assert (tmp_path / "runs.db.damaged").read_bytes() == content


def test_record_that_another_driver_has_mended_is_not_removed(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x"), record("y"), record("z")])
        connection = sqlite3.connect(tmp_path / "runs.db")
        with connection:
            connection.execute("UPDATE runs SET provenance = 'a' WHERE digest != 'z'")
        connection.close()
        damaged = store.damaged(["x", "y", "z"])
        assert damaged == ["x", "y"]
        with Store(tmp_path / "runs.db") as other:
            other.add([record("x")])
        assert store.remove_damaged(damaged) == 1
        assert store.ended() == {"x", "z"}


def test_digest_that_is_no_text_any_more_is_damaged(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x"), record("y")])
        connection = sqlite3.connect(tmp_path / "runs.db")
        with connection:
            connection.execute("UPDATE runs SET digest = CAST(X'FF61' AS TEXT) WHERE digest = 'x'")
        connection.close()
        assert store.damaged(sorted(store.statuses())) == ["\udcffa"]


def test_links_to_a_store_stay_links(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    damaged_in_the_middle(tmp_path / "disk" / "runs.db")
    (tmp_path / "runs.db").symlink_to(tmp_path / "disk" / "runs.db")
    with Store(tmp_path / "runs.db") as linked, Store(tmp_path / "disk" / "runs.db") as other:
        linked.repair()
        assert linked.salvaged
        other.add([record("new")])
        assert "new" in linked.ended()
    assert (tmp_path / "runs.db").is_symlink()
    assert (tmp_path / "disk" / "runs.db.damaged").exists()


@pytest.mark.parametrize("last", [0, -1, 2**62])
def test_last_row_of_a_damaged_page_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: int
) -> None:
    monkeypatch.setattr(stores, "_LAST_ROW", 1000)
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x"), record("y")])
        monkeypatch.setattr(store, "_connection", LastRow(store._connection, last))
        assert [row[0] for row in store._whole_rows()] == ["x", "y"]
        monkeypatch.undo()


class LastRow:
    """A connection to a file whose last page says another last row."""

    def __init__(self, connection: sqlite3.Connection, last: int) -> None:
        self._connection, self._last = connection, last

    def execute(self, statement: str, parameters: tuple[Any, ...] = ()) -> sqlite3.Cursor:
        if "max(rowid)" in statement:
            return self._connection.execute(f"SELECT {self._last}")
        return self._connection.execute(statement, parameters)


def test_damaged_index_is_repaired(tmp_path: Path) -> None:
    """A failed run that the index takes for another is not taken for one that is done."""
    path = tmp_path / "runs.db"
    with Store(path) as store:
        store.add([record("0123456789", "failed"), record("other")])
    content = path.read_bytes()
    index = content.index(b"0123456789failed", content.index(b"0123456789failed") - 10)
    assert content.count(b"0123456789failed") == 1  # the table has other columns in between
    path.write_bytes(content[: index + 15] + b"e" + content[index + 16 :])
    with Store(path) as store:
        assert "row" in store.problem()
        store.repair()
        assert store.statuses() == {"0123456789": "failed", "other": "done"}
        assert store.problem() == ""


def content_of(record: Record) -> tuple[object, ...]:
    arrays = {name: (array.dtype, array.shape, array.tobytes()) for name, array in record.arrays.items()}
    return record.digest, record.specification, record.status, record.error, record.provenance, arrays


def test_no_flipped_bit_is_used_silently(tmp_path: Path) -> None:
    """Whatever bit of the file is flipped: a record is as it was, or known to be damaged or missing."""
    rng = np.random.default_rng(1)
    path = tmp_path / "runs.db"
    with Store(path) as store:
        for i in range(12):
            arrays: dict[str, NDArray[Any]] = {
                "q": rng.random((30, 5)),
                "greedy": rng.integers(0, 31, 120, dtype=np.uint8),
            }
            store.add([record(f"{i:064x}", "failed" if i == 3 else "done", arrays)])
        expected = {digest: content_of(store.get([digest])[0]) for digest in store.statuses()}
    whole = path.read_bytes()
    messages: list[str] = []
    outcomes = {"same": 0, "repeated": 0, "salvaged": 0, "refused": 0}
    for bit in rng.choice(len(whole) * 8, size=200, replace=False).tolist():
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        try:
            with Store(path) as store:
                damaged = store.damaged(expected)
                store.remove_damaged(damaged)
                digests = store.ended() & expected.keys()
                for read in store.get(sorted(digests)):
                    assert content_of(read) == expected[read.digest], bit
                is_whole = len(digests) == len(expected) - 1
                outcomes["salvaged" if store.salvaged else "same" if is_whole else "repeated"] += 1
        except InputError as error:
            messages.append(str(error))
            outcomes["refused"] += 1
        for beside in tmp_path.glob("runs.db.*"):
            beside.unlink()
    assert not any("\n" in message for message in messages)
    assert outcomes["repeated"] > 50  # most bits are those of records
    assert outcomes["refused"] < 10  # the header, or the schema


@pytest.mark.parametrize(
    "damage",
    [
        "substr(arrays, 1, length(arrays) - 1)",  # without its end
        "CAST(replace(hex(arrays), '22', '20') AS BLOB)",  # other bytes
        "'text'",
        "zeroblob(0)",
    ],
)
def test_damaged_records_are_reported_in_one_sentence(tmp_path: Path, damage: str) -> None:
    arrays = {"q": np.zeros(5), "r": np.zeros(5)}
    with Store(tmp_path / "runs.db") as store:
        store.add([record("0123456789abcdef", arrays=arrays)])
    connection = sqlite3.connect(tmp_path / "runs.db")
    with connection:
        connection.execute(f"UPDATE runs SET arrays = {damage}")
    connection.close()
    expected = pytest.raises(
        InputError, match=r"runs\.db: the record of run 0123456789ab is damaged; run its"
    )
    with Store(tmp_path / "runs.db", read_only=True) as store, expected:
        store.get(["0123456789abcdef"])
    with Store(tmp_path / "runs.db") as store:
        assert store.damaged(["0123456789abcdef"]) == ["0123456789abcdef"]
        assert store.remove_damaged(["0123456789abcdef"]) == 1
        assert store.statuses() == {}


@pytest.mark.parametrize(
    "damage",
    [
        "provenance = replace(provenance, '1', '7')",
        "provenance = '{'",
        "provenance = CAST(X'7bff7d' AS TEXT)",  # no UTF-8
        "specification = '{ }'",
        "digest = 'other'",
        "status = 'diverged'",
        "error = 'oh'",
        "checksum = checksum + 1",
        "head = NULL",
    ],
)
def test_damage_besides_the_arrays_is_noticed_without_reading_them(tmp_path: Path, damage: str) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x", arrays={"q": np.zeros(5)})])
    connection = sqlite3.connect(tmp_path / "runs.db")
    with connection:
        connection.execute(f"UPDATE runs SET {damage}")
    connection.close()
    with Store(tmp_path / "runs.db", read_only=True) as store:
        for digest in store.statuses():
            with pytest.raises(InputError, match=f"the record of run {digest} is damaged"):
                store.get([digest], arrays=False)


def test_records_of_the_format_before_are_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "runs.db"
    with Store(path) as store:
        store.add([record(name, arrays={"q": np.arange(5)}) for name in "xyz"])
    connection = sqlite3.connect(path)
    with connection:
        connection.execute("ALTER TABLE runs DROP COLUMN head")
        connection.execute("UPDATE runs SET arrays = zeroblob(9) WHERE digest = 'y'")
        connection.execute("PRAGMA user_version = 3")
    connection.close()
    with Store(path, read_only=True) as store:
        assert [list(read.arrays["q"]) for read in store.get(["x", "z"])] == [[0, 1, 2, 3, 4]] * 2
        assert store.damaged("xyz") == ["y"]


# What is not a store


def test_file_without_runs_is_no_damage(tmp_path: Path) -> None:
    (tmp_path / "runs.db").touch()  # as SQLite leaves it if it is killed early
    with pytest.raises(NoRunsError, match="there are no runs yet"):
        Store(tmp_path / "runs.db", read_only=True)
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x")])
    with Store(tmp_path / "runs.db", read_only=True) as store:
        assert store.statuses() == {"x": "done"}


@pytest.mark.parametrize("read_only", [False, True])
def test_pipe_is_refused_instead_of_waited_for(tmp_path: Path, read_only: bool) -> None:
    os.mkfifo(tmp_path / "runs.db")
    with pytest.raises(
        InputError, match="cannot be used as the store of runs: it is not a file; move it away"
    ):
        Store(tmp_path / "runs.db", read_only=read_only)


def test_interrupted_write_is_put_right_by_whoever_opens_the_file(tmp_path: Path) -> None:
    """A journal that a killed driver left holds what the file had before; it must not be moved away."""
    with Store(tmp_path / "runs.db") as store:
        store.add([record(name, arrays={"q": np.zeros(5000)}) for name in "abc"])
    code = (
        "import os, sqlite3, sys\n"
        "connection = sqlite3.connect(sys.argv[1], isolation_level=None)\n"
        "connection.execute('PRAGMA cache_size = 1')\n"  # so that pages are written before the end
        "connection.execute('BEGIN')\n"
        "connection.execute('UPDATE runs SET arrays = randomblob(100000), provenance = 7')\n"
        "os._exit(1)\n"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path / "runs.db"], check=False)
    assert (tmp_path / "runs.db-journal").stat().st_size > 0
    with Store(tmp_path / "runs.db", read_only=True) as store:
        assert store.damaged("abc") == []
        assert store.statuses() == dict.fromkeys("abc", "done")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_unreadable_files_and_folders_are_named(tmp_path: Path) -> None:
    code = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from benchmark.execution.store import Store\n"
        "from envs import InputError\n"
        "os.setuid(65534)\n"
        "for read_only in (False, True):\n"
        "    try: Store(Path(sys.argv[1]), read_only=read_only)\n"
        "    except InputError as error: print(error)\n"
    )
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x")])

    def messages() -> list[str]:
        done = subprocess.run(
            [sys.executable, "-c", code, tmp_path / "runs.db"],
            capture_output=True,
            text=True,
            cwd=Path(__file__).parents[3],
        )
        assert done.stderr == ""
        return done.stdout.splitlines()

    parents = [tmp_path, *list(tmp_path.parents)[:3]]
    modes = {parent: parent.stat().st_mode for parent in parents}
    try:
        for parent in parents:
            parent.chmod(0o755)
        (tmp_path / "runs.db").chmod(0o600)
        assert all("make the file and its folder readable and writable" in text for text in messages())
        assert len(messages()) == 2
        tmp_path.chmod(0o700)
        made, read = messages()
        assert f"{tmp_path}: cannot be created: Permission denied; choose another" in made
        assert f"{tmp_path}: cannot be read: Permission denied; choose another" in read
    finally:
        for parent, mode in modes.items():
            parent.chmod(mode)


@pytest.mark.parametrize("removed", ["file", "folder"])
def test_runs_are_stored_although_the_file_was_removed_meanwhile(tmp_path: Path, removed: str) -> None:
    path = tmp_path / "results" / "runs.db"
    with Store(path) as store:
        store.add([record("x")])
        path.unlink() if removed == "file" else shutil.rmtree(path.parent)
        store.add([record("y")])
    with Store(path, read_only=True) as store:
        assert store.statuses() == {"y": "done"}


def test_every_flipped_byte_of_the_arrays_is_noticed(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x", arrays={"q": np.arange(3), "r": np.zeros(0)})])
    connection = sqlite3.connect(tmp_path / "runs.db", isolation_level=None)
    ((packed,),) = connection.execute("SELECT arrays FROM runs").fetchall()
    with Store(tmp_path / "runs.db", read_only=True) as store:
        for i in range(len(packed)):
            damaged = packed[:i] + bytes([packed[i] ^ 1]) + packed[i + 1 :]
            connection.execute("UPDATE runs SET arrays = ?", (damaged,))
            with pytest.raises(InputError, match="is damaged"):
                store.get(["x"])
        connection.execute("UPDATE runs SET arrays = ?", (packed,))
        assert store.get(["x"])[0].arrays["q"].tolist() == [0, 1, 2]
    connection.close()


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
        with pytest.raises(InputError, match="readonly"):
            store.add([record("y")])
    assert path.read_bytes() == before


class Connection:
    """A connection whose user can press Ctrl-C just before or after a statement."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self.before = self.after = ""  # statements; each interrupts once

    def execute(self, statement: str, *arguments: Any) -> Any:
        if statement == self.before:
            self.before = ""
            raise KeyboardInterrupt
        result = self._connection.execute(statement, *arguments)
        if statement == self.after:
            self.after = ""
            raise KeyboardInterrupt
        return result

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("statement", ["BEGIN IMMEDIATE", "COMMIT"])
def test_interrupt_around_a_transaction_leaves_the_store_usable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statement: str, when: str
) -> None:
    connection = Connection(sqlite3.connect(tmp_path / "runs.db", isolation_level=None))
    with monkeypatch.context() as patch:
        patch.setattr(sqlite3, "connect", lambda *_, **__: connection)
        store = Store(tmp_path / "runs.db")
    with store:
        setattr(connection, when, statement)
        with pytest.raises(KeyboardInterrupt):
            store.add([record("x")])
        store.add([record("x")])  # as the driver does with the jobs that had ended by then
        store.add([record("y")])
    with Store(tmp_path / "runs.db", read_only=True) as store:
        assert store.statuses() == {"x": "done", "y": "done"}
