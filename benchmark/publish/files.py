"""Writes results so that a crash loses nothing: files are made aside, and moved when all are there.

Unfinished files and folders have names that begin with a dot and end in `.making`. The next process that
writes the same removes those of a killed one.
"""

import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmark.execution.machine import lock
from benchmark.folder import MANIFEST
from envs import InputError


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Waits until no other process writes to a folder.

    A missing folder is made; one that cannot be written raises an InputError.
    """
    with _input_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY)
    try:
        with _input_errors(folder):
            lock(descriptor, f"{folder}: waiting for another command that writes there ...")
        yield
    finally:
        os.close(descriptor)


@contextmanager
def replaced(folder: Path, stale: Collection[str]) -> Iterator[Path]:
    """Yields an empty folder whose files replace those of a folder at the end, unless there is an exception.

    Other files of the folder stay, except those with stale names, which were made earlier. The manifest
    comes last, so a folder that was only half replaced does not match it. The caller must be `alone` in the
    parent folder. An InputError means that something cannot be written.
    """
    made = _aside(folder)
    shutil.rmtree(made, ignore_errors=True)
    with _input_errors(folder):
        made.mkdir()
    try:
        yield made
        with _input_errors(folder):
            folder.mkdir(exist_ok=True)
            names = {file.name for file in made.iterdir()}
            for name in {*stale} - names:
                (folder / name).unlink(missing_ok=True)
            for name in sorted(names, key=lambda name: (name == MANIFEST, name)):
                (made / name).replace(folder / name)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    """Writes a file, whole, unless it has this text; an InputError if it cannot be written.

    The caller must be `alone` in its folder, or make it.
    """
    if path.is_file() and path.read_bytes() == text.encode():
        return
    made = _aside(path)
    with _input_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        made.write_text(text, encoding="utf-8")
        made.replace(path)


def _aside(path: Path) -> Path:
    return path.with_name(f".{path.name}.making")


@contextmanager
def _input_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        advice = "choose another folder with --results"
        raise InputError(f"{path}: cannot be written: {error.strerror or error}; {advice}.") from error
