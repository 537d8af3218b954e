"""Compiles functions with numba and keeps them on disk; damaged files are compiled again.

numba trusts its files: a damaged one makes it fail, crash or compute something else. Besides, it
checks only the file of a function, not the files of functions that it calls; here, all of them
count. And it links by names with a number that it counts up from 1 in every process, so a function
that one process has saved could call another's that has the same name and number (numba's issue
10486); here, the numbers are random.
"""

import hashlib
import multiprocessing
import pickle
import secrets
import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import llvmlite
import numba
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import FunctionCache, IndexDataCacheFile

_Function = TypeVar("_Function", bound=Callable[..., object])
_DIGEST_SIZE = 32
_ROOT = Path(__file__).parents[1]

FunctionIdentity._unique_ids = iter(partial(secrets.randbits, 64), None)


def compiled(function: _Function, made_for: str = "") -> _Function:
    """Makes a function that is compiled when it is first called, without Python's global lock.

    Functions that differ only in variables around them differ in `made_for`.
    """
    dispatcher: Any = numba.njit(nogil=True)(function)
    try:
        cached = FunctionCache(function)
        locator = cached._impl.locator
        stamp = made_for, locator.get_source_stamp()
        cached._cache_file = _Files(cached._cache_path, cached._impl.filename_base, stamp)
        locator.ensure_cache_path = lambda: None  # `save` finds out
        dispatcher._cache = cached
    except (OSError, RuntimeError):  # numba finds no folder that can be written
        _say_unsaved()
    return dispatcher  # type: ignore[no-any-return]


@cache
def _say_unsaved() -> None:
    if multiprocessing.parent_process() is None:  # workers need not repeat it
        note = "note: compiled code cannot be saved; set NUMBA_CACHE_DIR to a writable folder."
        print(note, file=sys.stderr)


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """What numba keeps of one function: a file for each signature, without numba's index of them.

    A file begins with a digest of its content and of what it was made for. So one that is damaged,
    or that belongs to another version of numba or an older source, is not read any further.
    """

    def load(self, key: Any) -> object:
        """Returns what was saved for a signature and a processor; None if that cannot be used."""
        path = self._path(key)
        try:
            stored = path.read_bytes()
        except OSError:
            return None
        content = stored[_DIGEST_SIZE:]
        return (
            pickle.loads(content) if stored[:_DIGEST_SIZE] == self._digest(path, content) else None
        )

    def save(self, key: Any, data: object) -> None:
        """Saves what was compiled for a signature and a processor, if the disk has room."""
        path = self._path(key)
        content = self._dump(data)
        try:
            with self._open_for_write(str(path)) as file:
                file.write(self._digest(path, content) + content)
        except OSError:
            _say_unsaved()

    def _path(self, key: Any) -> Path:
        signature, processor, _ = key  # the last may change from process to process
        made_for, _ = self._source_stamp
        digest = hashlib.sha256(repr((signature, processor, made_for)).encode()).hexdigest()
        return Path(self._data_path(f"{Path(self._index_name).stem}.{digest[:32]}.nbc"))

    def _digest(self, path: Path, content: bytes) -> bytes:
        sources = self._source_stamp, _digest_of_sources()
        made_for = repr((self._version, llvmlite.__version__, *sources, path.name))
        return hashlib.sha256(made_for.encode() + b"\0" + content).digest()


@cache
def _digest_of_sources() -> str:
    """Returns the digest of all modules that have compiled code, or what compiled code calls."""
    paths = [*sorted((_ROOT / "agents").rglob("*.py")), _ROOT / "envs" / "model.py"]
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in paths)).hexdigest()
