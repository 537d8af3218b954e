"""The only module that knows how records are stored: in one SQLite file, `runs.db`.

A record is a run's specification, its status, where and when it ran, and the arrays it produced. Only the
driver writes, with one transaction per job, so that an interrupt or a crash leaves whole records and nothing
else. Every record has checksums, which are verified whenever it is read: a damaged one is never used.
"""

import json
import os
import shutil
import sqlite3
import struct
import sys
import time
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from envs import InputError

VALUE_DECIMALS: Final = 3  # of the values of a record
REPAIR_ADVICE: Final = "'run EXPERIMENT' saves the intact records and repeats the others"
_APPLICATION_ID: Final = 0x50524F58  # "PROX"
_FORMAT: Final = 4
_EFFORT: Final = 1  # of compression: tables are packed in half the time of 6, and take 6 % more space
_SCHEMA: Final = """
CREATE TABLE runs (
  digest TEXT PRIMARY KEY,
  specification TEXT NOT NULL,
  status TEXT NOT NULL CHECK (status IN ('done', 'diverged', 'failed')),
  error TEXT,
  provenance TEXT NOT NULL,
  arrays BLOB NOT NULL, -- see _pack
  checksum INTEGER NOT NULL, -- CRC-32 of arrays
  head INTEGER -- CRC-32 of the other columns, see _head
);
-- So that asking for all statuses reads no records.
CREATE INDEX statuses ON runs (digest, status);
"""
# The first bytes of a store, see "The Database Header" in SQLite's documentation of its file format. Those of
# `_CHANGING` count what is in the file. A new _FORMAT needs another _SCHEMA, or a newer store would be taken
# for a damaged one of this version.
_HEADER: Final = struct.pack(
    ">16sH6B20x7I20x", b"SQLite format 3", 4096, 1, 1, 0, 64, 32, 32, 4, 0, 0, 1, _FORMAT, 0, _APPLICATION_ID
)
_CHANGING: Final = slice(24, 44)
_WAL: Final = b"\2\2"  # at 18, in a file whose owner has chosen this journal
_SMALLEST_ROW: Final = 256  # bytes, fewer than any record has
_LAST_ROW: Final = 10_000_000  # no file has more; a damaged one may say so
_POLL_S: Final = 0.5  # how often to ask whether another process still trains
_COLUMNS: Final = "digest, specification, status, error, provenance, checksum, head"
# No failure replaces a valid record: another driver may have done the run meanwhile.
_ADD: Final = f"""
INSERT OR REPLACE INTO runs ({_COLUMNS}, arrays) SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8
WHERE ?3 != 'failed' OR NOT EXISTS (SELECT 1 FROM runs WHERE digest = ?1 AND status != 'failed')
"""
# What to do about an error of SQLite, by its code.
_ADVICE: Final = {
    sqlite3.SQLITE_BUSY: "another process is writing to it; try again when that has ended",
    sqlite3.SQLITE_FULL: "free some space; the same command continues, and finished runs are kept",
    sqlite3.SQLITE_IOERR: "check the disk and its free space; the same command continues",
    sqlite3.SQLITE_READONLY: "make the file and its folder writable",
    sqlite3.SQLITE_CANTOPEN: "make the file and its folder readable and writable",
    sqlite3.SQLITE_CORRUPT: f"it is damaged; {REPAIR_ADVICE}",
    sqlite3.SQLITE_NOTADB: "move it away, or choose another folder with --results",
}
_T = TypeVar("_T")


class NoRunsError(InputError):
    """There is no store yet, or an empty file."""


class DamagedError(InputError):
    """A file is damaged, or is not a store of this version."""


@dataclass(frozen=True, eq=False)
class Record:
    """What is stored of a run.

    Its arrays are the fields of the algorithm's `Training`, without the axis N, and those of `Evaluation`,
    named by `evaluated`. Three fields of `Training` differ: `values` are rounded to `VALUE_DECIMALS`, as they
    are published; `stochastic` is that of the last evaluation step alone, (1, O, A), or (0, O, A) if there is
    none; and `cpu_time_s` is part of the provenance.
    """

    digest: str
    specification: str  # canonical JSON
    status: str  # "done"; "diverged": done, but with a policy that was not finite at the end; or "failed"
    provenance: Mapping[str, Any]  # versions, commit, machine, times
    arrays: Mapping[str, NDArray[Any]]  # empty if it failed
    error: str | None = None


def evaluated(name: str, policy: str, start: str) -> str:
    """Returns the name that a field of `Evaluation` has in a record, by policy and where episodes start.

    >>> evaluated("success", "greedy", "start"), evaluated("success", "stochastic", "every_cell")
    ('success', 'stochastic_every_cell_success')
    """
    policy = "" if policy == "greedy" else f"{policy}_"
    return f"{policy}{'' if start == 'start' else f'{start}_'}{name}"


def _pack(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Returns arrays as bytes, the same in whatever order they are given.

    First a line of JSON with the name, dtype, shape and size in bytes of each array; then the arrays, in the
    same order, each compressed by itself, so that one can be read without the others.
    """
    data = {name: zlib.compress(array.tobytes(), _EFFORT) for name, array in sorted(arrays.items())}
    layout = [[name, arrays[name].dtype.str, arrays[name].shape, len(part)] for name, part in data.items()]
    return b"\n".join([json.dumps(layout).encode(), b"".join(data.values())])


class _Packed(Mapping[str, NDArray[Any]]):
    """What `_pack` returned, as arrays by name; an array is decompressed whenever it is asked for."""

    def __init__(self, packed: bytes) -> None:
        layout, _, self._data = packed.partition(b"\n")
        self._places: dict[str, tuple[str, Sequence[int], slice]] = {}
        end = 0
        for name, dtype, shape, size in json.loads(layout):
            start, end = end, end + size
            self._places[name] = dtype, shape, slice(start, end)

    def __getitem__(self, name: str) -> NDArray[Any]:
        dtype, shape, where = self._places[name]
        return np.frombuffer(zlib.decompress(self._data[where]), dtype).reshape(shape)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class Store:
    """An open `runs.db`, used as a context manager.

    A file that turns out to be damaged is replaced by one with its whole records if it may be written; the
    damaged one is kept beside it, which is said on stderr.
    """

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Opens the file; creates it if it is missing and may be written.

        Raises:
          NoRunsError: There is nothing to read.
          DamagedError: It is not an SQLite file, holds something else, or is damaged and may not be written.
          InputError: It cannot be opened.
        """
        self._path = path  # where the file is, not a link to it
        self._read_only = read_only
        self._inode: int | None = None  # of the file, once it is open
        try:
            if path.is_symlink():
                self._path = Path(os.path.realpath(path))
            if not read_only:
                self._path.parent.mkdir(parents=True, exist_ok=True)
            is_there, is_file = self._path.exists(), self._path.is_file()
            # SQLite leaves an empty file if it is killed early.
            has_no_runs = not is_there or (is_file and self._path.stat().st_size == 0)
        except OSError as error:
            folder = self._path.parent
            reason = "it is a file" if folder.is_file() else error.strerror
            what = f"cannot be {'read' if read_only else 'created'}: {reason}"
            raise InputError(f"{folder}: {what}; choose another folder with --results.") from error
        if is_there and not is_file:
            raise self._unusable(f"it is not a file; {_ADVICE[sqlite3.SQLITE_NOTADB]}")
        if read_only and has_no_runs:
            raise NoRunsError(f"{self._path}: there are no runs yet; run the experiment first.")
        self._connect()

    def _connect(self) -> None:
        """Opens the file, creates its table if it is new, and checks that it is a store."""
        self._mend_header()
        # Also for reading it is opened for writing: what an interrupted transaction left is then put right.
        uri = f"{self._path.absolute().as_uri()}?mode={'rw' if self._read_only else 'rwc'}"
        with self._input_errors():
            self._connection = sqlite3.connect(uri, uri=True, timeout=60.0, isolation_level=None)
        inode = self._inode_now()  # before it waits for another driver, which may replace the file
        # Text that is no UTF-8 any more is found by its checksum.
        self._connection.text_factory = lambda text: text.decode(errors="surrogateescape")
        try:
            with self._input_errors():
                try:
                    if not self._read_only:
                        self._create()
                    self._check()
                    self._connection.execute(f"PRAGMA query_only = {self._read_only}")
                except sqlite3.DatabaseError as error:
                    is_corrupt = _code(error) == sqlite3.SQLITE_CORRUPT
                    if self._read_only or not is_corrupt or not self._has_our_header():
                        raise
                    # SQLite refuses a file that is shorter than it should be, but not then.
                    self._connection.execute("PRAGMA writable_schema = ON")
                    self._inode = inode
                    self._salvage()
                else:
                    self._inode = inode
        except BaseException:
            self._connection.close()
            raise

    def _mend_header(self) -> None:
        """Restores the first bytes of the file if they are damaged: all else tells that it is a store."""
        try:
            with self._path.open("rb") as file:
                page = file.read(4096)
        except OSError:  # SQLite says what is wrong
            return
        found, sound = page[: len(_HEADER)], bytearray(_HEADER)
        sound[_CHANGING] = found[_CHANGING]
        if int.from_bytes(found[16:18]).bit_count() == 1:
            sound[16:18] = found[16:18]  # the size of a page may be another power of two
        is_ours = _SCHEMA.partition(";")[0].strip().encode() in page
        is_older = 0 < int.from_bytes(found[60:64]) < _FORMAT
        if found == sound or not is_ours or is_older or found[18:20] == _WAL:
            return
        if self._read_only:
            raise self._unusable(f"its header is damaged; {REPAIR_ADVICE}", DamagedError)
        try:
            with self._path.open("r+b") as file:  # no other driver ever writes other bytes there
                file.write(sound[: _CHANGING.start])
                file.seek(_CHANGING.stop)
                file.write(sound[_CHANGING.stop :])
        except OSError as error:
            raise self._unusable(f"{error.strerror}; {_ADVICE[sqlite3.SQLITE_READONLY]}") from error
        print(f"{self._path}: its header was damaged, and has been restored.", file=sys.stderr)

    def _has_our_header(self) -> bool:
        """Returns whether the file begins like a store of this version, whatever follows."""
        with self._path.open("rb") as file:
            header = file.read(72)  # these places are part of SQLite's format
        return (header[60:64], header[68:]) == (_FORMAT.to_bytes(4), _APPLICATION_ID.to_bytes(4))

    def _create(self) -> None:
        """Creates the table, if the file is new."""
        with self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            if self._number("SELECT count(*) FROM sqlite_master") == 0:
                for statement in _SCHEMA.split(";"):
                    self._connection.execute(statement)
                self._connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
                self._connection.execute(f"PRAGMA user_version = {_FORMAT}")

    def _check(self) -> None:
        """Checks that the database is one of this version of the project."""
        found = self._number("PRAGMA application_id"), self._number("PRAGMA user_version")
        if found != (_APPLICATION_ID, _FORMAT):
            advice = _ADVICE[sqlite3.SQLITE_NOTADB]
            raise DamagedError(f"{self._path}: not a store of this version of the project; {advice}.")

    def _number(self, query: str) -> int:
        (number,) = self._connection.execute(query).fetchone()
        return int(number or 0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Waits until no other process trains into this store, which would train the same runs again.

        The lock is one of SQLite on an empty file beside the store: the system releases it however the
        process ends. Where nothing can be locked, there is no wait.
        """
        with ExitStack() as stack:
            with suppress(sqlite3.Error):
                path = self._path.with_name(f"{self._path.name}.lock")
                self._lock(stack.enter_context(closing(sqlite3.connect(path, 0.0, isolation_level=None))))
            yield

    def _lock(self, connection: sqlite3.Connection) -> None:
        """Waits until a connection has locked its file; says so, if it has to wait."""
        is_waiting = False
        while True:
            try:
                connection.execute("BEGIN EXCLUSIVE")
                return
            except sqlite3.OperationalError as error:
                if _code(error) != sqlite3.SQLITE_BUSY:
                    raise
            if not is_waiting:
                print(f"{self._path}: waiting for another command that trains runs ...", file=sys.stderr)
            is_waiting = True
            time.sleep(_POLL_S)

    def statuses(self) -> dict[str, str]:
        """Returns the status of every stored run, by digest."""
        return self._do(lambda: dict(self._connection.execute("SELECT digest, status FROM runs")))

    def ended(self) -> set[str]:
        """Returns the digests of the runs with a valid record: those that are done, or diverged."""
        return {digest for digest, status in self.statuses().items() if status != "failed"}

    def contents(self) -> dict[str, str]:
        """Returns the specification of every run that has ended, by digest."""
        query = "SELECT digest, specification FROM runs WHERE status != 'failed'"
        return self._do(lambda: dict(self._connection.execute(query)))

    def add(self, records: Iterable[Record]) -> None:
        """Stores records, all or none; they replace earlier ones, but no failure replaces a valid record."""
        rows = []
        for record in records:
            arrays, provenance = _pack(record.arrays), json.dumps(record.provenance, sort_keys=True)
            about = record.digest, record.specification, record.status, record.error, provenance
            checksum = zlib.crc32(arrays)
            rows.append((*about, checksum, _head(*about, checksum), arrays))
        self._do(lambda: self._add(rows))

    def _add(self, rows: Iterable[tuple[Any, ...]]) -> None:
        """Stores rows of `_COLUMNS` and arrays, all or none."""
        with self._connection:
            self._connection.execute("BEGIN IMMEDIATE")
            self._connection.executemany(_ADD, rows)

    def get(self, digests: Sequence[str], *, arrays: bool = True) -> list[Record]:
        """Returns the records of these runs, in this order, with or without their arrays.

        Raises:
          InputError: A record is damaged or cannot be found.
        """
        return self._do(lambda: [self._get(digest, arrays) for digest in digests])

    def _get(self, digest: str, arrays: bool) -> Record:
        columns = _COLUMNS + ", arrays" * arrays
        row = self._connection.execute(f"SELECT {columns} FROM runs WHERE digest = ?", (digest,)).fetchone()
        # The digest is that asked for: in a damaged index it may lead to the record of another run.
        if row is None or not _is_whole(digest, *row[1:]):
            advice = "run its experiment again, which repeats it"
            raise InputError(f"{self._path}: the record of run {digest[:12]} is damaged; {advice}.")
        _, specification, status, error, provenance, _, _, *packed = row
        unpacked = _Packed(packed[0]) if packed else {}
        return Record(digest, specification, status, json.loads(provenance), unpacked, error)

    def damaged(self, digests: Collection[str]) -> list[str]:
        """Returns which of these stored runs have a record that is damaged or cannot be found."""
        return self._do(lambda: [digest for digest in digests if self._is_damaged(digest)])

    def _is_damaged(self, digest: str) -> bool:
        try:
            self._get(digest, arrays=True)
        except (InputError, UnicodeEncodeError):  # the digest itself may be damaged
            return True
        return False

    def discard_damaged(self, digests: Iterable[str]) -> int:
        """Removes the records of these runs that have ended and are damaged; returns how many are.

        If the structure of the file is damaged, it is replaced by one with its whole records first.
        """
        if self.problem():
            with self._input_errors():
                self._salvage()
        damaged = self.damaged(self.ended().intersection(digests))

        def remove() -> int:
            with self._connection:
                self._connection.execute("BEGIN IMMEDIATE")
                self._connection.execute("REINDEX")  # an index may be what is damaged
                # Meanwhile another driver may have replaced some by whole ones.
                rows = [(digest,) for digest in damaged if self._is_damaged(digest)]
                self._connection.executemany("DELETE FROM runs WHERE digest = ?", rows)
            return len(rows)

        return self._do(remove) if damaged else 0

    def problem(self) -> str:
        """Returns what is wrong with the file's structure; empty if nothing."""
        with self._input_errors():
            try:
                (found,) = self._connection.execute("PRAGMA integrity_check(1)").fetchone()
            except sqlite3.DatabaseError as error:
                if _code(error) != sqlite3.SQLITE_CORRUPT:
                    raise
                found = str(error)
        return "" if found == "ok" else " ".join(str(found).split())

    def _do(self, action: Callable[[], _T]) -> _T:
        """Returns what an action on the database returns.

        If the file is damaged, what is whole is saved first; if it was replaced or removed, the one that is
        there now is opened, or a new one.

        Raises:
          InputError: SQLite cannot do it.
        """
        with self._input_errors():
            try:
                return action()
            except sqlite3.DatabaseError as error:
                if self._read_only:
                    raise
                if self._inode_now() != self._inode:  # replaced or removed: SQLite does not write to it
                    self._connection.close()
                    with suppress(OSError):  # SQLite says what is wrong
                        self._path.parent.mkdir(parents=True, exist_ok=True)
                    self._connect()
                elif _code(error) == sqlite3.SQLITE_CORRUPT:
                    self._salvage()
                else:
                    raise
            return action()

    def _inode_now(self) -> int:
        """Returns the inode of the file that is at the path now; -1 if there is none."""
        try:
            return self._path.stat().st_ino
        except OSError:
            return -1

    def _salvage(self) -> None:
        """Replaces a damaged file by one with its whole records, and keeps it beside."""
        self._distrust_size()
        self._connection.execute("BEGIN EXCLUSIVE")  # waits for other drivers
        if self._inode_now() == self._inode:  # else one of them has done it meanwhile
            kept = self._path.with_name(f"{self._path.name}.damaged")
            fresh = self._path.with_name(f"{self._path.name}.salvaged")
            fresh.unlink(missing_ok=True)
            with Store(fresh) as store:
                store._add(self._whole_rows())
                n_records = len(store.statuses())
            kept.unlink(missing_ok=True)
            try:
                kept.hardlink_to(self._path)
            except OSError:  # where a file has but one name
                shutil.copyfile(self._path, kept)
            fresh.replace(self._path)
            what = f"{self._path} was damaged: its {n_records} intact records have been saved"
            print(f"{what}; the damaged file is kept as {kept}.", file=sys.stderr)
        self._connection.close()
        self._connect()

    def _distrust_size(self) -> None:
        """Makes SQLite read a file to its end, if its header says that it ends earlier."""
        with self._path.open("r+b") as file:
            header = file.read(len(_HEADER))
            size, pages = int.from_bytes(header[16:18]), int.from_bytes(header[28:32])
            if 0 < pages * size < self._path.stat().st_size:
                file.seek(24)  # a counter: as its copy at 92 differs, the number of pages is not believed
                file.write(bytes([header[24] ^ 1]))

    def _whole_rows(self) -> Iterator[tuple[Any, ...]]:
        """Yields the rows of a damaged file that are whole."""
        last = self._path.stat().st_size // _SMALLEST_ROW
        with suppress(sqlite3.DatabaseError):
            last = max(last, self._number("SELECT max(rowid) FROM runs NOT INDEXED"))
        query = f"SELECT {_COLUMNS}, arrays FROM runs NOT INDEXED WHERE rowid = ?"
        for row_id in range(1, min(last, _LAST_ROW) + 1):
            with suppress(sqlite3.DatabaseError):
                row = self._connection.execute(query, (row_id,)).fetchone()
                if row is not None and _is_whole(*row):
                    yield row

    @contextmanager
    def _input_errors(self) -> Iterator[None]:
        """Turns an error of SQLite into an `InputError`."""
        try:
            yield
        except sqlite3.Error as error:
            code = _code(error)
            if code == sqlite3.SQLITE_CORRUPT and self._inode is None and not self._has_our_header():
                code = sqlite3.SQLITE_NOTADB  # damaged where the file says what it holds
            advice = _ADVICE.get(code, "try again, or choose another folder with --results")
            kind = DamagedError if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB) else InputError
            raise self._unusable(f"{' '.join(str(error).split())}; {advice}", kind) from error

    def _unusable(self, reason: str, kind: type[InputError] = InputError) -> InputError:
        return kind(f"{self._path}: cannot be used as the store of runs: {reason}.")


def _code(error: sqlite3.Error) -> int:
    """Returns SQLite's primary code of an error; 0 if it has none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _head(*columns: Any) -> int:
    """Returns the CRC-32 of the columns of a record before `head`: the checksum stands for its arrays."""
    return zlib.crc32(json.dumps(columns, default=repr).encode())


def _is_whole(*row: Any) -> bool:
    """Returns whether a record is as stored: `_COLUMNS`, and perhaps its arrays."""
    *columns, head = row[:7]
    return _head(*columns) == head and all(
        isinstance(arrays, bytes) and zlib.crc32(arrays) == columns[-1] for arrays in row[7:]
    )
