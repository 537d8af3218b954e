"""A folder of published results: its manifest and tables, and how its files are written.

The manifest lists the digest of each file but README and the meanings of columns, which are texts
made from the others, and ends with its own digest. So a file that was changed is refused.
"""

import fcntl
import gzip
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import pandas as pd

from envs import InputError
from envs.inputs import check_all

MANIFEST = "manifest.json"
README = "README.md"
MEANINGS = "columns.csv"
SEAL = "sha256"  # the last key: the digest of all others, as JSON with sorted keys
MAX_UNPACKED = 500_000_000  # bytes of a compressed file's content
MAX_ROWS = 10_000_000
MAX_COLUMNS = 1000
REPOSITORY = Path(__file__).parents[1]


# Reading


class Folder:
    """A folder of results, of which nothing is read that its manifest does not list."""

    def __init__(self, path: Path) -> None:
        """Reads the manifest; raises an InputError if it is missing or damaged."""
        self.path = path
        if not (path / MANIFEST).is_file():
            raise InputError(
                f"{path}: there are no results; run the experiment with --report first."
            )
        with damaged(path / MANIFEST):
            self.manifest = unsealed((path / MANIFEST).read_bytes())
            self.files: dict[str, str] = dict(self.manifest["files"])
            if any(Path(name).name != name for name in self.files):
                raise ValueError("it lists files outside its folder")

    def content(self, file: str) -> bytes:
        """Returns a file's content; an InputError says if it is missing, not listed or changed."""
        with damaged(path := self.path / file):
            if path.exists() and not path.is_file():
                raise ValueError("it is not a regular file")  # it may be a pipe that never ends
            content = path.read_bytes()
            if _sha256(content) != self.files[file]:
                raise ValueError(f"{MANIFEST} lists another digest")
        return content

    def check(self) -> None:
        """Reads all files; an InputError names those that are missing or changed."""
        check_all(*(partial(self.content, file) for file in self.files))

    def tables(self) -> dict[str, pd.DataFrame]:
        """Returns the tables by name, but not those of runs and of curves, which are compressed."""
        found = dict[str, pd.DataFrame]()
        for name in self.files:
            if name.endswith(".csv"):
                content = self.content(name)
                with damaged(self.path / name):
                    found[name.removesuffix(".csv")] = read_csv(content)
        return found


@contextmanager
def damaged(path: Path) -> Iterator[None]:
    """Turns whatever goes wrong while a file is read into an InputError."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        fault = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        if isinstance(error, FileNotFoundError):
            fault = "it is missing"
        what = f"damaged, or made by another version of this project ({fault})"
        raise InputError(f"{path}: {what}; make these results again.") from error


def unsealed(text: bytes) -> dict[str, Any]:
    """Returns the content of a sealed file; raises a ValueError if its digest is another."""
    content = dict(json.loads(text))
    if content != _with_seal(content):
        raise ValueError(f"{SEAL} is not the digest of the content")
    return content


def committed(name: str, file: str) -> bytes | None:
    """Returns a file of a folder of results in the last commit; None if there is no such file."""
    return git(REPOSITORY, "cat-file", "blob", f"HEAD:results/{name}/{file}")


def git(folder: Path, *arguments: str) -> bytes | None:
    """Returns what a git command prints that only reads objects; None if it fails.

    Such a command starts no program that the repository's settings name, since nothing is fetched.
    So the repository may be somebody else's.
    """
    command = ["git", "-c", "safe.directory=*", "-C", str(folder), *arguments]
    alone = os.environ | {"GIT_NO_LAZY_FETCH": "1", "GIT_ALLOW_PROTOCOL": "none"}
    try:
        return subprocess.run(command, check=True, capture_output=True, env=alone).stdout
    except (OSError, subprocess.CalledProcessError):
        return None


def unpacked(packed: bytes) -> bytes:
    """Returns the content of a gzip file; raises an error if it is damaged, or too large."""
    content = gzip.GzipFile(fileobj=BytesIO(packed)).read(MAX_UNPACKED + 1)
    if len(content) > MAX_UNPACKED:
        raise ValueError(f"it unpacks to more than {MAX_UNPACKED:,} bytes")
    return content


def check_size(content: bytes) -> None:
    """Raises a ValueError if a table has too many rows, or entries in a row."""
    if (n := content.count(b"\n")) > MAX_ROWS:
        raise ValueError(f"it has {n:,} rows, more than {MAX_ROWS:,}")
    n = max(line.count(b",") for line in content.split(b"\n")) + 1
    if n > MAX_COLUMNS:
        raise ValueError(f"it has {n:,} columns, more than {MAX_COLUMNS:,}")


def read_csv(content: bytes) -> pd.DataFrame:
    """Reads a table. Only "nan" and, among numbers, an empty entry are missing values, not "NA"."""
    check_size(content)
    texts = pd.read_csv(BytesIO(content), keep_default_na=False, dtype=str)
    table = pd.read_csv(BytesIO(content), keep_default_na=False, na_values=["", "nan"])
    are_texts = [name for name in table if table[name].dtype == object or not texts[name].any()]
    return table.assign(**texts[are_texts])


# Writing


def sealed(content: Mapping[str, Any], indent: int = 2) -> str:
    """Returns JSON that carries its own digest, which replaces an earlier one."""
    return json.dumps(_with_seal(content), indent=indent) + "\n"


def _with_seal(content: Mapping[str, Any]) -> dict[str, Any]:
    others = {key: value for key, value in content.items() if key != SEAL}
    return others | {SEAL: _sha256(json.dumps(others, sort_keys=True).encode())}


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def digests(path: Path, but: Collection[str] = ()) -> dict[str, str]:
    """Returns the SHA-256 digest of each file of a folder, by name, but pages and hidden files."""
    return {
        file.name: _sha256(file.read_bytes())
        for file in sorted(path.iterdir())
        if file.is_file() and file.name not in (*but, "index.html") and file.name[0] != "."
    }


def write_manifest(path: Path, content: Mapping[str, Any]) -> None:
    """Writes the manifest of a folder: files that are there join those that it lists already."""
    files = {**content.get("files", {}), **digests(path, but=(MANIFEST, README, MEANINGS))}
    (path / MANIFEST).write_text(sealed({**content, "files": files}), encoding="utf-8")


def csv_text(frame: pd.DataFrame) -> str:
    """Returns a table as CSV; floats have six significant digits, and are read as floats.

    >>> numbers = [1.0, 1e-7, 2 / 3, 1234567.0, float("inf"), float("nan"), -1e-16]
    >>> csv_text(pd.DataFrame({"x": numbers})).split()
    ['x', '1.0', '1e-07', '0.666667', '1.23457e+06', 'inf', 'nan', '0.0']
    """
    frame = frame.infer_objects()
    texts = frame.select_dtypes(object).fillna("")
    return frame.assign(**texts).to_csv(
        index=False, lineterminator="\n", float_format=_number, na_rep="nan"
    )


def _number(value: Any) -> str:
    text = f"{0.0 if abs(value) < 1e-12 else value:.6g}"  # zero but for rounding
    return f"{text}.0" if text.lstrip("-").isdecimal() else text


def write_text(path: Path, text: str) -> None:
    """Writes a file, whole, unless it has this text; an InputError if it cannot be written."""
    content = text.encode(errors="replace")
    if path.is_file() and path.read_bytes() == content:
        return
    with _unwritable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        made = _aside(path)
        made.write_bytes(content)
        made.replace(path)


def check_writable(folder: Path) -> None:
    """Raises an InputError if a folder exists, but is not writable."""
    if folder.exists():
        with _unwritable(folder), TemporaryFile(dir=folder):
            pass


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Waits until no other process writes to a folder, which is made if it is missing."""
    with _unwritable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY)
    try:
        lock(descriptor, f"{folder}: waiting for another command that writes there ...")
        yield
    finally:
        os.close(descriptor)


def lock(descriptor: int, waiting: str) -> None:
    """Locks an open file or folder; says that it is waiting if another process has locked it.

    Where nothing can be locked, there is no wait.
    """
    with suppress(OSError):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(waiting, file=sys.stderr)
            fcntl.flock(descriptor, fcntl.LOCK_EX)


@contextmanager
def replaced(folder: Path, stale: Iterable[str] = ()) -> Iterator[Path]:
    """Yields an empty folder, whose files replace those of a folder at the end, if all goes well.

    Stale files are removed, others stay. The manifest comes last, so a folder that was only half
    replaced does not match it. The caller must be `alone` in the folder that both are in.
    """
    made = _aside(folder)
    shutil.rmtree(made, ignore_errors=True)  # of a killed process
    with _unwritable(folder):
        made.mkdir()
    try:
        yield made
        with _unwritable(folder):
            folder.mkdir(exist_ok=True)
            names = {file.name for file in made.iterdir()}
            for name in {*stale} - names:
                (folder / name).unlink(missing_ok=True)
            for name in sorted(names, key=lambda name: (name == MANIFEST, name)):
                (made / name).replace(folder / name)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _aside(path: Path) -> Path:
    return path.with_name(f".{path.name}.making")


@contextmanager
def _unwritable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        advice = "choose another folder with --results"
        raise InputError(f"{path}: cannot be written: {reason}; {advice}.") from error
