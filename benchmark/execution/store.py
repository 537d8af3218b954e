"""The only module that knows how records are stored: in one SQLite file, `runs.db`.

A record is a run's specification, its status, where and when it ran, and the arrays it produced. Only the
driver writes, with one transaction per job, so that an interrupt or a crash leaves whole records and nothing
else.
"""

import json
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from envs import InputError

VALUE_DECIMALS: Final = 3  # of the values of a record
_APPLICATION_ID = 0x50524F58  # "PROX"
_FORMAT = 3
_EFFORT: Final = (
    1  # of compression: a run of a table takes half as long to pack as with 6, and 6 % more space
)
_SCHEMA = """
CREATE TABLE runs (
  digest TEXT PRIMARY KEY,
  specification TEXT NOT NULL,
  status TEXT NOT NULL CHECK (status IN ('done', 'diverged', 'failed')),
  error TEXT,
  provenance TEXT NOT NULL,
  arrays BLOB NOT NULL, -- see _pack
  checksum INTEGER NOT NULL -- CRC-32 of arrays
);
-- So that asking for all statuses reads no records.
CREATE INDEX statuses ON runs (digest, status);
"""


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
    """Returns the name that a field of `Evaluation` has in a record.

    Args:
      name: The field.
      policy: `"greedy"` or `"stochastic"`.
      start: Where episodes start, `"start"` or `"every_cell"`.

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
    """An open `runs.db`, used as a context manager."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Opens the file; creates it if it is missing and may be written.

        Raises:
          InputError: It cannot be opened, is not an SQLite file, or holds something else.
        """
        self._path = path
        if not read_only:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                reason = "it is a file" if path.parent.is_file() else error.strerror
                raise InputError(
                    f"{path.parent}: cannot be made: {reason}; choose another folder with --results."
                ) from error
        elif not path.exists():
            raise InputError(f"{path}: there are no runs yet; run the experiment first.")
        uri = f"{path.resolve().as_uri()}?mode={'ro' if read_only else 'rwc'}"
        with self._input_errors():
            self._connection = sqlite3.connect(uri, uri=True, timeout=60.0, isolation_level=None)
        try:
            if not read_only:
                self._create()
            self._check()
        except BaseException:
            self._connection.close()
            raise

    def _create(self) -> None:
        """Creates the table, if the file is new."""
        with self._input_errors(), self._transaction():
            (tables,) = self._connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
            if tables == 0:
                for statement in _SCHEMA.split(";"):
                    self._connection.execute(statement)
                self._connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
                self._connection.execute(f"PRAGMA user_version = {_FORMAT}")

    def _check(self) -> None:
        """Checks that the database is one of this project."""
        with self._input_errors():
            (application,) = self._connection.execute("PRAGMA application_id").fetchone()
            (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        if application != _APPLICATION_ID or version != _FORMAT:
            raise InputError(
                f"{self._path}: not a store of this version of the project; "
                f"move it away, or choose another folder with --results."
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def statuses(self) -> dict[str, str]:
        """Returns the status of every stored run, by digest."""
        with self._input_errors():
            return dict(self._connection.execute("SELECT digest, status FROM runs"))

    def ended(self) -> set[str]:
        """Returns the digests of the runs with a valid record: those that are done, or diverged."""
        return {digest for digest, status in self.statuses().items() if status != "failed"}

    def add(self, records: Iterable[Record]) -> None:
        """Stores records, all or none; they replace earlier ones, but no failure replaces a valid record."""
        with self._input_errors(), self._transaction():
            for record in records:
                row = self._connection.execute(
                    "SELECT status FROM runs WHERE digest = ?", (record.digest,)
                ).fetchone()
                if row not in (None, ("failed",)) and record.status == "failed":
                    continue  # meanwhile another driver has done it
                arrays = _pack(record.arrays)
                self._connection.execute(
                    "INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?, ?)",
                    (
                        record.digest,
                        record.specification,
                        record.status,
                        record.error,
                        json.dumps(record.provenance, sort_keys=True),
                        arrays,
                        zlib.crc32(arrays),
                    ),
                )

    def get(self, digests: Sequence[str], *, arrays: bool = True) -> list[Record]:
        """Returns the records of these runs, in this order, with or without their arrays.

        Raises:
          InputError: A record is damaged.
          KeyError: One of them has no record.
        """
        columns = "specification, status, error, provenance" + ", arrays, checksum" * arrays
        records = []
        with self._input_errors():
            for digest in digests:
                row = self._connection.execute(
                    f"SELECT {columns} FROM runs WHERE digest = ?", (digest,)
                ).fetchone()
                if row is None:
                    raise KeyError(digest)
                specification, status, error, provenance, *packed = row
                unpacked = self._unpack(digest, *packed) if arrays else {}
                records.append(Record(digest, specification, status, json.loads(provenance), unpacked, error))
        return records

    def _unpack(self, digest: str, packed: Any, checksum: Any) -> Mapping[str, NDArray[Any]]:
        """Returns a run's arrays.

        Raises:
          InputError: The file is damaged.
        """
        if not isinstance(packed, bytes) or zlib.crc32(packed) != checksum:
            raise InputError(
                f"{self._path}: the record of run {digest[:12]} is damaged; remove the file and run the "
                "experiment again."
            )
        return _Packed(packed)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Makes the statements that follow take effect all together, or not at all."""
        if self._connection.in_transaction:  # left open by an interrupt between two statements
            self._connection.execute("ROLLBACK")
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")

    @contextmanager
    def _input_errors(self) -> Iterator[None]:
        """Turns an error of SQLite into an `InputError`."""
        try:
            yield
        except sqlite3.Error as error:
            raise InputError(
                f"{self._path}: cannot be used as the store of runs: {error}; "
                f"move it away, free it, or choose another folder with --results."
            ) from error
