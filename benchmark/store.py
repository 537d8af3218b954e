"""The only module that knows how records are stored: in one SQLite file, `runs.db`.

Only the driver writes, with one transaction per job, so that an interrupt or a crash leaves only
whole records. Checksums are verified whenever a record is read: a damaged one is never used.
"""

import json
import math
import re
import sqlite3
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from benchmark.folder import lock
from envs import InputError

VALUE_DECIMALS = 3  # to which a record's values are rounded
_APPLICATION_ID = 0x50524F58  # "PROX"
_FORMAT = 4
_EFFORT = 1  # of compression: half the time of 6, for 6 % more space
_CREATE = f"""
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
_COLUMNS = "digest, specification, status, error, provenance, checksum, head"
# No failure replaces a valid record: another driver may have executed the run meanwhile.
_ADD = f"""
INSERT OR REPLACE INTO runs ({_COLUMNS}, arrays)
WITH new ({_COLUMNS}, arrays) AS (VALUES (?, ?, ?, ?, ?, ?, ?, ?)) SELECT * FROM new
WHERE status != 'failed'
OR NOT EXISTS (SELECT 1 FROM runs WHERE digest = new.digest AND status != 'failed')
"""
MOVE = "move it away, or choose another folder with --results"
_CHECK = "check that its folder is writable and has free space, and try again"
_HELD = "stop the program that uses it; if there is none, the file system does not support locks:"
_HELD += " choose a folder on a local disk with --results"
_PATIENCE_MS = 60_000  # to wait for another program
Arrays = Mapping[str, NDArray[Any]]
Provenance = Mapping[str, Any]  # a record's versions, commit, machine and times


class DamagedError(InputError):
    """A file is damaged, or is not a store of this version."""


@dataclass(frozen=True, eq=False)
class Record:
    """What is stored of a run.

    Its arrays are the fields of the algorithm's `Training`, without the axis N, and those of
    `Evaluation`, named by `evaluated`. However, `values` are rounded to `VALUE_DECIMALS`,
    `stochastic` has only the last evaluation step, (1, O, A), or (0, O, A) if there is none, and
    `cpu_time_s` is part of the provenance.
    """

    digest: str
    specification: str  # canonical JSON
    status: str  # "done"; "diverged": its policy was not finite at the end; or "failed"
    provenance: Provenance  # empty if it failed
    arrays: Arrays  # empty if it failed
    error: str | None = None


def evaluated(name: str, policy: str) -> str:
    """Returns the name that a field of `Evaluation` has in a record, by policy.

    >>> evaluated("success", "greedy"), evaluated("success", "stochastic")
    ('success', 'stochastic_success')
    """
    return name if policy == "greedy" else f"{policy}_{name}"


class Store:
    """An open `runs.db`, used as a context manager."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Opens the file; creates it if it is missing and may be written.

        Raises a DamagedError if it is damaged, or another InputError if it cannot be opened.
        """
        self._path = path
        # SQLite leaves an empty file if it is killed early.
        if read_only and not (path.exists() and path.stat().st_size):
            raise InputError(f"{path}: there are no runs yet; run the experiment first.")
        with self._input_errors():
            if not read_only:
                path.parent.mkdir(parents=True, exist_ok=True)
            # Readers, too, open it for writing, so that SQLite can undo an interrupted transaction.
            uri = f"{path.absolute().as_uri()}?mode={'rw' if read_only else 'rwc'}"
            self._connection = sqlite3.connect(
                uri, uri=True, timeout=1.0, isolation_level="IMMEDIATE"
            )
            try:
                try:
                    self._set_up(read_only)
                except sqlite3.OperationalError as error:
                    if not _is_held(error):
                        raise
                    print(f"{path}: waiting for another program that uses it ...", file=sys.stderr)
                    self._connection.execute(f"PRAGMA busy_timeout = {_PATIENCE_MS}")
                    self._set_up(read_only)
                self._connection.execute(f"PRAGMA busy_timeout = {_PATIENCE_MS}")
            except BaseException:
                self._connection.close()
                raise

    def _set_up(self, read_only: bool) -> None:
        """Creates the table if the file is new; checks that it is a store, and not damaged."""
        # Text that is not UTF-8 is damaged, which its checksum reveals.
        self._connection.text_factory = lambda text: text.decode(errors="surrogateescape")
        if not read_only and self._pragma("schema_version") == 0:  # it is new
            self._connection.executescript(_CREATE)
        kind = self._pragma("application_id"), self._pragma("user_version")
        query = "SELECT type FROM sqlite_master WHERE name = 'runs'"  # a view may never end
        if kind != (_APPLICATION_ID, _FORMAT) or self._connection.execute(query).fetchone() != (
            "table",
        ):
            raise DamagedError(f"{self._path}: not a store of this version of the project; {MOVE}.")
        self._connection.execute(f"PRAGMA query_only = {read_only}")
        if not read_only and (problem := self._pragma("integrity_check(1)")) != "ok":
            raise DamagedError(f"{self._path} is damaged: {problem}; {MOVE}.")
        if not read_only:  # what cannot be written is refused before anything is trained
            self._connection.execute("BEGIN IMMEDIATE")
            self._connection.execute(f"PRAGMA user_version = {_FORMAT}")
            self._connection.rollback()

    def _pragma(self, name: str) -> Any:
        (value,) = self._connection.execute(f"PRAGMA {name}").fetchone()
        return value

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Waits until no other process trains into this store: both would train the same runs.

        The system releases the lock, on an empty file beside the store, however the process ends.
        """
        with self._path.with_name(f"{self._path.name}.lock").open("a") as file:
            waiting = "waiting for another command that trains runs"
            lock(file.fileno(), f"{self._path}: {waiting} ...")
            yield

    def statuses(self) -> dict[str, str]:
        """Returns the status of all stored runs, by digest."""
        with self._input_errors():
            return dict(self._connection.execute("SELECT digest, status FROM runs"))

    def ended(self) -> set[str]:
        """Returns the digests of all runs that have a valid record: done or diverged."""
        return {digest for digest, status in self.statuses().items() if status != "failed"}

    def add(self, records: Iterable[Record]) -> None:
        """Stores records, all or none; they replace earlier ones, but no failure a valid one."""
        rows = []
        for record in records:
            arrays, made = _pack(record.arrays), json.dumps(record.provenance, sort_keys=True)
            about = record.digest, record.specification, record.status, record.error, made
            checksum = zlib.crc32(arrays)
            rows.append((*about, checksum, _head(*about, checksum), arrays))
        with self._input_errors(), self._connection:
            self._connection.executemany(_ADD, rows)

    def get(self, digests: Iterable[str]) -> list[Record]:
        """Returns the records of these runs in order; an InputError says which is damaged."""
        with self._input_errors():
            return [self._get(digest) for digest in digests]

    def _get(self, digest: str) -> Record:
        query = f"SELECT {_COLUMNS}, arrays FROM runs WHERE digest = ?"
        row = self._connection.execute(query, (digest,)).fetchone()
        _, *about, checksum, head, arrays = row or [None] * 8
        is_same = isinstance(arrays, bytes) and zlib.crc32(arrays) == checksum
        # The checksum covers the digest asked for: a damaged index may lead to another run.
        if not is_same or _head(digest, *about, checksum) != head:
            what = f"the record of run {digest[:12]} is missing or damaged"
            raise InputError(f"{self._path}: {what}; run its experiment again, which repeats it.")
        specification, status, error, made = about
        return Record(digest, specification, status, json.loads(made), _Packed(arrays), error)

    def discard_damaged(self, digests: Iterable[str]) -> int:
        """Removes damaged records of these runs, if they have ended; returns how many."""
        damaged = []
        with self._input_errors(), self._connection:
            # All statuses are read without an index, which may be damaged.
            for digest in self.ended().intersection(digests):
                try:
                    self._get(digest)
                except InputError:
                    damaged.append((digest,))
            self._connection.executemany("DELETE FROM runs WHERE digest = ?", damaged)
        return len(damaged)

    @contextmanager
    def _input_errors(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError) as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
                raise DamagedError(f"{self._path} is damaged: {error}; {MOVE}.") from None
            reason = getattr(error, "strerror", None) or error
            what = f"cannot be used as the store of runs: {reason}"
            raise InputError(
                f"{self._path}: {what}; {_HELD if _is_held(error) else _CHECK}."
            ) from None


def _is_held(error: Exception) -> bool:
    """Returns whether another program has locked the file, or nothing can be locked there."""
    return re.search("BUSY|LOCK|PROTOCOL", getattr(error, "sqlite_errorname", "")) is not None


# Bytes of a record


def _pack(arrays: Arrays) -> bytes:
    """Returns arrays as bytes, the same in whatever order they are given.

    A line of JSON has the name, dtype, shape and size in bytes of each array. The arrays follow in
    the same order, each compressed by itself, so that one can be read without the others.
    """
    data = {name: zlib.compress(array.tobytes(), _EFFORT) for name, array in sorted(arrays.items())}
    layout = [[name, arrays[name].dtype.str, arrays[name].shape, len(data[name])] for name in data]
    return b"\n".join([json.dumps(layout).encode(), b"".join(data.values())])


class _Packed(Arrays):
    """Arrays by name, from the bytes of `_pack`; each is decompressed whenever it is asked for."""

    def __init__(self, packed: bytes) -> None:
        layout, _, data = packed.partition(b"\n")
        self._arrays: dict[str, tuple[str, Sequence[int], bytes]] = {}
        end = 0
        for name, dtype, shape, size in json.loads(layout):
            start, end = end, end + size
            self._arrays[name] = dtype, shape, data[start:end]

    def __getitem__(self, name: str) -> NDArray[Any]:
        dtype, shape, data = self._arrays[name]
        size = np.dtype(dtype).itemsize * math.prod(shape)
        content = zlib.decompressobj().decompress(data, size + 1)  # not more, whatever is there
        return np.frombuffer(content, dtype).reshape(shape)

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)


def _head(*columns: object) -> int:
    """Returns the CRC-32 of the columns before `head`; its checksum stands for its arrays."""
    return zlib.crc32(json.dumps(columns, default=repr).encode())
