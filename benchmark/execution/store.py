"""The only module that knows how records are stored: in one SQLite file, `runs.db`.

Only the driver writes, with one transaction per job, so that an interrupt or a crash leaves only whole
records. Every record has checksums, which are verified whenever it is read: a damaged one is never used.
"""

import json
import sqlite3
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from benchmark.execution.machine import lock
from envs import InputError

VALUE_DECIMALS: Final = 3  # to which a record's values are rounded
_APPLICATION_ID: Final = 0x50524F58  # "PROX"
_FORMAT: Final = 4
_EFFORT: Final = 1  # of compression: tables are packed in half the time of 6, and take 6 % more space
_CREATE: Final = f"""
BEGIN IMMEDIATE;
CREATE TABLE IF NOT EXISTS runs (
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
CREATE INDEX IF NOT EXISTS statuses ON runs (digest, status);
PRAGMA application_id = {_APPLICATION_ID};
PRAGMA user_version = {_FORMAT};
COMMIT
"""
_COLUMNS: Final = "digest, specification, status, error, provenance, checksum, head"
# No failure replaces a valid record: another driver may have done the run meanwhile.
_ADD: Final = f"""
INSERT OR REPLACE INTO runs ({_COLUMNS}, arrays)
WITH new ({_COLUMNS}, arrays) AS (VALUES (?, ?, ?, ?, ?, ?, ?, ?)) SELECT * FROM new
WHERE status != 'failed' OR NOT EXISTS (SELECT 1 FROM runs WHERE digest = new.digest AND status != 'failed')
"""
MOVE: Final = "move it away, or choose another folder with --results"
_DAMAGED: Final = sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB  # codes of errors
_CHECK: Final = "check that its folder is writable and has free space, and try again; what is stored is kept"
Arrays = Mapping[str, NDArray[Any]]
Provenance = Mapping[str, Any]  # a record's versions, commit, machine and times
_Row = tuple[str | int | bytes | None, ...]  # _COLUMNS, and perhaps arrays


class NoRunsError(InputError):
    """There is no store yet, or an empty file."""


class DamagedError(InputError):
    """A file is damaged, or is not a store of this version."""


@dataclass(frozen=True, eq=False)
class Record:
    """What is stored of a run.

    Its arrays are the fields of the algorithm's `Training`, without the axis N, and those of `Evaluation`,
    named by `evaluated`. However, `values` are rounded to `VALUE_DECIMALS`, as they are published;
    `stochastic` has only the last evaluation step, (1, O, A), or (0, O, A) if there is none; and `cpu_time_s`
    is part of the provenance.
    """

    digest: str
    specification: str  # canonical JSON
    status: str  # "done"; "diverged": done, but with a policy that was not finite at the end; or "failed"
    provenance: Provenance
    arrays: Arrays  # empty if it failed
    error: str | None = None


def evaluated(name: str, policy: str, start: str) -> str:
    """Returns the name that a field of `Evaluation` has in a record, by policy and where episodes start.

    >>> evaluated("success", "greedy", "start"), evaluated("success", "stochastic", "every_cell")
    ('success', 'stochastic_every_cell_success')
    """
    policy = "" if policy == "greedy" else f"{policy}_"
    return f"{policy}{'' if start == 'start' else f'{start}_'}{name}"


def _pack(arrays: Arrays) -> bytes:
    """Returns arrays as bytes, the same in whatever order they are given.

    A line of JSON has the name, dtype, shape and size in bytes of each array. The arrays follow in the same
    order, each compressed by itself, so that one can be read without the others.
    """
    data = {name: zlib.compress(array.tobytes(), _EFFORT) for name, array in sorted(arrays.items())}
    layout = [[name, arrays[name].dtype.str, arrays[name].shape, len(part)] for name, part in data.items()]
    return b"\n".join([json.dumps(layout).encode(), b"".join(data.values())])


class _Packed(Arrays):
    """Arrays by name, from the bytes of `_pack`; an array is decompressed whenever it is asked for."""

    def __init__(self, packed: bytes) -> None:
        layout, _, data = packed.partition(b"\n")
        self._arrays: dict[str, tuple[str, Sequence[int], bytes]] = {}
        end = 0
        for name, dtype, shape, size in json.loads(layout):
            start, end = end, end + size
            self._arrays[name] = dtype, shape, data[start:end]

    def __getitem__(self, name: str) -> NDArray[Any]:
        dtype, shape, data = self._arrays[name]
        return np.frombuffer(zlib.decompress(data), dtype).reshape(shape)

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)


class Store:
    """An open `runs.db`, used as a context manager."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Opens the file; creates it if it is missing and may be written.

        Raises a NoRunsError, a DamagedError, or another InputError if it cannot be opened.
        """
        self._path, self._read_only = path, read_only
        try:
            if not read_only:
                path.parent.mkdir(parents=True, exist_ok=True)
            # SQLite leaves an empty file if it is killed early.
            elif not (path.exists() and path.stat().st_size):
                raise NoRunsError(f"{path}: there are no runs yet; run the experiment first.")
        except OSError as error:
            what = f"cannot be {'read' if read_only else 'created'}: {error.strerror}"
            raise InputError(f"{path.parent}: {what}; choose another folder with --results.") from error
        # Readers, too, open it for writing, so that SQLite can undo an interrupted transaction.
        uri = f"{self._path.absolute().as_uri()}?mode={'rw' if self._read_only else 'rwc'}"
        with self._input_errors():
            self._connection = sqlite3.connect(uri, uri=True, timeout=60.0, isolation_level="IMMEDIATE")
        try:
            self._set_up()
        except BaseException:
            self._connection.close()
            raise

    def _set_up(self) -> None:
        """Creates the table if the file is new, and checks that it is a store, and not damaged."""
        # Text that is not UTF-8 is damaged, which its checksum reveals.
        self._connection.text_factory = lambda text: text.decode(errors="surrogateescape")
        with self._input_errors():
            if not self._read_only and self._number("PRAGMA schema_version") == 0:  # it is new
                self._connection.executescript(_CREATE)
            version = self._number("PRAGMA application_id"), self._number("PRAGMA user_version")
            if version != (_APPLICATION_ID, _FORMAT):
                raise DamagedError(f"{self._path}: not a store of this version of the project; {MOVE}.")
            self._connection.execute(f"PRAGMA query_only = {self._read_only}")
            if not self._read_only and (problem := self.problem()):
                raise DamagedError(f"{self._path} is damaged: {problem}; {MOVE}.")

    def _number(self, query: str) -> int:
        (number,) = self._connection.execute(query).fetchone()
        return int(number or 0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Waits until no other process trains into this store: both would train the same runs.

        The system releases the lock, on an empty file beside the store, however the process ends. Where
        nothing can be locked, there is no wait.
        """
        with ExitStack() as stack:
            with suppress(OSError):
                file = stack.enter_context(self._path.with_name(f"{self._path.name}.lock").open("a"))
                lock(file.fileno(), f"{self._path}: waiting for another command that trains runs ...")
            yield

    def statuses(self, digests: Iterable[str] | None = None) -> dict[str, str]:
        """Returns the status of stored runs, of all or of these, by digest."""
        query = "SELECT digest, status FROM runs"
        with self._input_errors():
            if digests is None:
                return dict(self._connection.execute(query))
            found = (self._connection.execute(f"{query} WHERE digest = ?", (each,)) for each in digests)
            return dict(chain.from_iterable(found))

    def ended(self, digests: Iterable[str] | None = None) -> set[str]:
        """Returns which runs, of all or of these, have a valid record: those that are done, or diverged."""
        return {digest for digest, status in self.statuses(digests).items() if status != "failed"}

    def add(self, records: Iterable[Record]) -> None:
        """Stores records, all or none; they replace earlier ones, but no failure replaces a valid record."""
        rows: list[_Row] = []
        for record in records:
            arrays, provenance = _pack(record.arrays), json.dumps(record.provenance, sort_keys=True)
            about = record.digest, record.specification, record.status, record.error, provenance
            checksum = zlib.crc32(arrays)
            rows.append((*about, checksum, _head(*about, checksum), arrays))
        self._add(rows)

    def _add(self, rows: Iterable[_Row]) -> None:
        with self._input_errors(), self._connection:
            self._connection.executemany(_ADD, rows)

    def get(self, digests: Sequence[str], *, arrays: bool = True) -> list[Record]:
        """Returns the records of these runs in this order; an InputError says which is damaged or missing."""
        with self._input_errors():
            return [self._get(digest, arrays) for digest in digests]

    def _get(self, digest: str, arrays: bool) -> Record:
        columns = _COLUMNS + ", arrays" * arrays
        row = self._connection.execute(f"SELECT {columns} FROM runs WHERE digest = ?", (digest,)).fetchone()
        # The checksum covers the digest asked for: a damaged index may lead to the record of another run.
        if row is None or not _is_whole(digest, *row[1:]):
            advice = "run its experiment again, which repeats it"
            raise InputError(f"{self._path}: the record of run {digest[:12]} is damaged; {advice}.")
        _, specification, status, error, provenance, _, _, *packed = row
        unpacked = _Packed(packed[0]) if packed else {}
        return Record(digest, specification, status, json.loads(provenance), unpacked, error)

    def damaged(self, digests: Collection[str]) -> list[str]:
        """Returns which of these stored runs have a record that is damaged or cannot be found."""
        damaged = []
        with self._input_errors():
            for digest in digests:
                try:
                    self._get(digest, arrays=True)
                except (InputError, UnicodeEncodeError):  # the digest itself may be damaged
                    damaged.append(digest)
        return damaged

    def discard_damaged(self, digests: Iterable[str]) -> int:
        """Removes damaged records of these runs, if they have ended; returns how many."""
        damaged = self.damaged(self.ended().intersection(digests))  # without an index, which may be damaged
        if damaged:
            with self._input_errors(), self._connection:
                rows = [(digest,) for digest in damaged]
                self._connection.executemany("DELETE FROM runs WHERE digest = ?", rows)
        return len(damaged)

    def problem(self) -> str:
        """Returns what is wrong with the file's structure; empty if nothing."""
        with self._input_errors():
            try:
                (result,) = self._connection.execute("PRAGMA integrity_check(1)").fetchone()
            except sqlite3.DatabaseError as error:
                if _code(error) != sqlite3.SQLITE_CORRUPT:
                    raise
                result = error
        return "" if result == "ok" else " ".join(str(result).split())

    @contextmanager
    def _input_errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            kind, advice = (DamagedError, MOVE) if _code(error) in _DAMAGED else (InputError, _CHECK)
            raise kind(f"{self._path}: cannot be used as the store of runs: {error}; {advice}.") from None


def _code(error: sqlite3.Error) -> int:
    """Returns SQLite's primary code of an error; 0 if it has none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _head(*columns: object) -> int:
    """Returns the CRC-32 of the columns of a record before `head`; its checksum stands for its arrays."""
    return zlib.crc32(json.dumps(columns, default=repr).encode())


def _is_whole(*row: object) -> bool:
    """Returns whether a record is as stored: `_COLUMNS`, and perhaps its arrays."""
    *columns, head = row[:7]
    is_same = (isinstance(arrays, bytes) and zlib.crc32(arrays) == columns[-1] for arrays in row[7:])
    return _head(*columns) == head and all(is_same)
