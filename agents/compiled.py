"""Compiles functions with numba and keeps what was compiled on disk; damaged files are compiled again.

numba itself believes its files: a damaged one ends in an exception or a crash, or computes something else.
"""

import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile

_Function = TypeVar("_Function", bound=Callable[..., Any])
_DIGEST_SIZE = 32


def compiled(*, nogil: bool = False) -> Callable[[_Function], _Function]:
    """Returns a decorator that compiles a function when it is first called.

    Args:
      nogil: Whether it releases Python's global lock.
    """

    def compile_function(function: _Function) -> _Function:
        dispatcher: Any = numba.njit(nogil=nogil)(function)
        dispatcher._cache = _Cache(function)
        return dispatcher  # type: ignore[no-any-return]

    return compile_function


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """numba's files of one function, each with a digest of its name and content in front."""

    def _load_index(self) -> Any:
        try:
            version, stamp, overloads = pickle.loads(self._read(self._index_path))
        except (OSError, _DamagedError):
            return {}
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, pickle.dumps((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        return pickle.loads(self._read(self._data_path(name)))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as file:
            file.write(_digest(path, content) + content)

    def _read(self, path: str) -> bytes:
        stored = Path(path).read_bytes()
        content = stored[_DIGEST_SIZE:]
        if stored[:_DIGEST_SIZE] != _digest(path, content):
            raise _DamagedError(path)
        return content


class _DamagedError(OSError):
    """A file is not as it was written; numba takes an OSError for a file that is not there."""


class _Cache(FunctionCache):  # type: ignore[misc]
    """numba's cache of one function, in checked files."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, stamp)


def _digest(path: str, content: bytes) -> bytes:
    """Returns the digest of a file's name and content."""
    return hashlib.sha256(Path(path).name.encode() + b"\0" + content).digest()
