"""The only module that knows how records are stored: in one SQLite file, `runs.db`.

A record is a run's specification, its status, where and when it ran, and the arrays it produced. Only the
driver writes, with one transaction per job, so that an interrupt or a crash leaves whole records and nothing
else.
"""

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from envs import InputError

_APPLICATION_ID = 0x50524F58  # "PROX"
_FORMAT = 2
_SCHEMA = """
CREATE TABLE runs (
  digest TEXT PRIMARY KEY,
  specification TEXT NOT NULL,
  status TEXT NOT NULL CHECK (status IN ('done', 'diverged', 'failed')),
  error TEXT,
  provenance TEXT NOT NULL,
  arrays INTEGER NOT NULL
);
CREATE TABLE arrays (
  digest TEXT NOT NULL REFERENCES runs ON DELETE CASCADE,
  name TEXT NOT NULL,
  dtype TEXT NOT NULL,
  shape TEXT NOT NULL,
  data BLOB NOT NULL,
  PRIMARY KEY (digest, name)
);
"""


@dataclass(frozen=True, eq=False)
class Record:
    """What is stored of a run."""

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
        """Creates the tables, if the file is new."""
        with self._input_errors():
            self._connection.execute("PRAGMA foreign_keys = ON")
            with self._transaction():
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
                self._connection.execute("DELETE FROM runs WHERE digest = ?", (record.digest,))
                self._connection.execute(
                    "INSERT INTO runs VALUES (?, ?, ?, ?, ?, ?)",
                    (
                        record.digest,
                        record.specification,
                        record.status,
                        record.error,
                        json.dumps(record.provenance, sort_keys=True),
                        len(record.arrays),
                    ),
                )
                self._connection.executemany(
                    "INSERT INTO arrays VALUES (?, ?, ?, ?, ?)",
                    [
                        (record.digest, name, array.dtype.str, json.dumps(array.shape), array.tobytes())
                        for name, array in record.arrays.items()
                    ],
                )

    def get(self, digests: Sequence[str], *, arrays: bool = True) -> list[Record]:
        """Returns the records of these runs, in this order, with or without their arrays.

        Raises:
          KeyError: One of them has no record.
        """
        records = []
        with self._input_errors():
            for digest in digests:
                row = self._connection.execute(
                    "SELECT specification, status, error, provenance, arrays FROM runs WHERE digest = ?",
                    (digest,),
                ).fetchone()
                if row is None:
                    raise KeyError(digest)
                specification, status, error, provenance, n_arrays = row
                data = self._arrays(digest, n_arrays) if arrays else {}
                records.append(Record(digest, specification, status, json.loads(provenance), data, error))
        return records

    def _arrays(self, digest: str, n_arrays: int) -> dict[str, NDArray[Any]]:
        """Returns a run's arrays.

        Raises:
          InputError: The file is damaged.
        """
        rows = self._connection.execute(
            "SELECT name, dtype, shape, data FROM arrays WHERE digest = ?", (digest,)
        )
        try:
            arrays = {
                name: np.frombuffer(data, dtype=dtype).reshape(json.loads(shape))
                for name, dtype, shape, data in rows
            }
        except (TypeError, ValueError):
            arrays = {}
        if len(arrays) != n_arrays:
            raise InputError(
                f"{self._path}: the record of run {digest[:12]} is damaged; remove the file and run the "
                "experiment again."
            )
        return arrays

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
