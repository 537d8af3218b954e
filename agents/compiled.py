"""Compiles functions with numba and keeps what was compiled on disk; damaged files are compiled again.

Where nothing can be kept, each process compiles what it calls.

numba trusts its files: with a damaged one it fails, crashes or computes something else. And it looks only at
the file of a function, not at the files of what the function calls; here all of them count.
"""

import hashlib
import multiprocessing
import pickle
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import llvmlite
import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile

_Function = TypeVar("_Function", bound=Callable[..., object])
_DIGEST_SIZE = 32
_ROOT = Path(__file__).parents[1]


def compiled(function: _Function) -> _Function:
    """Makes a function that is compiled when it is first called, and that releases Python's global lock."""
    dispatcher: Any = numba.njit(nogil=True)(function)
    try:
        dispatcher._cache = _Cache(function)
    except (OSError, RuntimeError):  # numba finds no folder that can be written
        _say_uncached()
    return dispatcher  # type: ignore[no-any-return]


@cache
def _say_uncached() -> None:
    if multiprocessing.parent_process() is None:  # once for all workers
        advice = "NUMBA_CACHE_DIR=FOLDER names another folder"
        print(
            f"note: compiled code cannot be saved, so every start compiles it again; {advice}.",
            file=sys.stderr,
        )


class _Cache(FunctionCache):  # type: ignore[misc]
    """Where numba looks for a compiled function, and saves it."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        base, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = _Files(self._cache_path, base, stamp)

    def save_overload(self, sig: object, data: object) -> None:
        """Saves a compiled function if it can: the disk may be full, or the folder no longer there."""
        try:
            super().save_overload(sig, data)
        except OSError:
            _say_uncached()


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """What numba keeps of one function: a file for each signature, without numba's index of them.

    A file begins with a digest of its content and of what it was made for. So one that is damaged, or that
    belongs to another version of numba or an older source, is not read any further.
    """

    def load(self, key: object) -> object:
        """Returns what was saved for a signature and a processor; None if that cannot be used."""
        path = self._path(key)
        try:
            stored = path.read_bytes()
        except OSError:
            return None
        content = stored[_DIGEST_SIZE:]
        return pickle.loads(content) if stored[:_DIGEST_SIZE] == self._digest(path, content) else None

    def save(self, key: object, data: object) -> None:
        """Saves what was compiled for a signature and a processor."""
        path, content = self._path(key), self._dump(data)
        with self._open_for_write(str(path)) as file:
            file.write(self._digest(path, content) + content)

    def _path(self, key: object) -> Path:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()
        return Path(self._data_path(f"{Path(self._index_name).stem}.{digest[:32]}.nbc"))

    def _digest(self, path: Path, content: bytes) -> bytes:
        made_for = repr(
            (self._version, llvmlite.__version__, self._source_stamp, _digest_of_sources(), path.name)
        )
        return hashlib.sha256(made_for.encode() + b"\0" + content).digest()


@cache
def _digest_of_sources() -> str:
    """Returns the digest of all modules that have compiled code, or what compiled code calls."""
    paths = [*sorted((_ROOT / "agents").rglob("*.py")), _ROOT / "envs" / "model.py"]
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in paths)).hexdigest()
