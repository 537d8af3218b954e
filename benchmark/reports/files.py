"""Writes results so that readers never see a mixture of old and new ones, and a crash loses nothing.

What is being made has a name that begins with a dot and ends in `.making`. Since one process at a time writes
to a folder of results, what has such a name when a process begins was left by a killed one.
"""

import fcntl
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Final

from envs import InputError

_MAKING: Final = ".making"
_BEFORE: Final = ".before"  # ends the name of a folder for the moment in which another takes its place


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Waits until no other process writes to a folder, and removes what killed ones have left there.

    A missing folder is made.

    Raises:
      InputError: It cannot be written.
    """
    with _input_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder):
        with _input_errors(folder):
            for path in folder.glob(f".*{_BEFORE}"):
                target = folder / path.name[1 : -len(_BEFORE)]
                _remove(path) if target.exists() else path.rename(target)
            for path in [*folder.glob(f".*{_MAKING}"), *folder.glob(f"*/.*{_MAKING}")]:
                _remove(path)
        yield


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    with ExitStack() as stack:
        with _input_errors(folder):
            descriptor = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, descriptor)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                print(f"{folder}: waiting for another command that writes there ...", file=sys.stderr)
                fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


@contextmanager
def replaced(folder: Path, is_stale: Callable[[str], bool]) -> Iterator[Path]:
    """Yields an empty folder that takes a folder's place at the end, unless there is an exception.

    Files and folders in the old one that are not made anew stay, unless they are stale. The caller must be
    alone in the folder around it, see `alone`.

    Args:
      folder: Need not exist.
      is_stale: Whether a file of this name was made before, and is removed if it is not made again.

    Raises:
      InputError: A folder has the name of a file that is made, or something cannot be written.
    """
    around = folder.parent.resolve()
    folder = folder.resolve()
    made = folder.with_name(f".{folder.name}{_MAKING}")
    is_elsewhere = folder.parent != around  # a link leads to a folder that is not locked yet
    with _locked(folder.parent) if is_elsewhere else nullcontext():
        _remove(made)
        with _input_errors(folder):
            made.mkdir()
        try:
            yield made
            with _input_errors(folder):
                _take_over(folder, made, is_stale)
                before = folder.with_name(f".{folder.name}{_BEFORE}")
                if folder.exists():
                    folder.rename(before)
                made.rename(folder)
                _remove(before)
        finally:
            _remove(made)


def write_text(path: Path, text: str) -> None:
    """Writes a file, whole or not at all, unless it has this text. The caller must be `alone` in its folder.

    Raises:
      InputError: It cannot be written.
    """
    with suppress(OSError):
        if path.read_bytes() == text.encode():
            return
    made = path.with_name(f".{path.name}{_MAKING}")
    try:
        with _input_errors(path):
            made.write_text(text, encoding="utf-8")
            made.replace(path)
    finally:
        _remove(made)


def _take_over(folder: Path, made: Path, is_stale: Callable[[str], bool]) -> None:
    """Gives a new folder the files and folders of the old one that stay."""
    for path in folder.iterdir() if folder.exists() else ():
        target = made / path.name
        if path.is_dir() and not path.is_symlink():
            if target.exists():
                raise InputError(f"{path}: cannot be written: it is a folder; move it away.")
            shutil.copytree(path, target, symlinks=True)
        elif not target.exists() and not is_stale(path.name):
            shutil.copy2(path, target, follow_symlinks=False)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)


@contextmanager
def _input_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written: {error.strerror or error}; choose another folder with --results."
        ) from error
