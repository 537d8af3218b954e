"""Writes results so that readers never see a mixture of old and new ones, and a crash loses nothing.

Unfinished files and folders have names that begin with a dot and end in `.making`. Since only one process at
a time writes to a folder of results, those that it finds when it begins were left by a killed process.
"""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from benchmark.execution.machine import lock
from envs import InputError

_MAKING: Final = ".making"
_BEFORE: Final = ".before"  # ends the name of a folder for the moment in which another takes its place


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Waits until no other process writes to a folder, and removes what killed ones have left there.

    A missing folder is made; one that cannot be written raises an InputError.
    """
    with _input_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY)
    try:
        with _input_errors(folder):
            lock(descriptor, f"{folder}: waiting for another command that writes there ...")
            for path in folder.glob(f".*{_BEFORE}"):
                target = folder / path.name[1 : -len(_BEFORE)]
                _remove(path) if target.exists() else path.rename(target)
            for path in [*folder.glob(f".*{_MAKING}"), *folder.glob(f"*/.*{_MAKING}")]:
                _remove(path)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def replaced(folder: Path, stale: Collection[str]) -> Iterator[Path]:
    """Yields an empty folder that takes a folder's place at the end, unless there is an exception.

    Other files of the old folder stay, except those with stale names, which were made earlier. The caller
    must be `alone` in the parent folder. An InputError means that something cannot be written.
    """

    def outdated(directory: str, names: list[str]) -> list[str]:
        files = [name for name in names if directory == str(folder) and not (folder / name).is_dir()]
        return [name for name in files if (made / name).exists() or name in stale]

    folder = folder.resolve()  # a link to a folder stays one
    made, before = (folder.with_name(f".{folder.name}{end}") for end in (_MAKING, _BEFORE))
    _remove(made)
    with _input_errors(folder):
        made.mkdir()
    try:
        yield made
        with _input_errors(folder):
            if folder.exists():
                shutil.copytree(folder, made, symlinks=True, ignore=outdated, dirs_exist_ok=True)
                folder.rename(before)
            made.rename(folder)
            _remove(before)
    finally:
        _remove(made)


def write_text(path: Path, text: str) -> None:
    """Writes a file, whole, unless it has this text; an InputError if it cannot be written.

    The caller must be `alone` in its folder, or make it.
    """
    if path.is_file() and path.read_bytes() == text.encode():
        return
    made = path.with_name(f".{path.name}{_MAKING}")
    try:
        with _input_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            made.write_text(text, encoding="utf-8")
            made.replace(path)
    finally:
        _remove(made)


def _remove(path: Path) -> None:
    shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        path.unlink()


@contextmanager
def _input_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        advice = "choose another folder with --results"
        raise InputError(f"{path}: cannot be written: {error.strerror or error}; {advice}.") from error
