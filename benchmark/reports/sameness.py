"""Whether files are the same: as when they were made, as published, or as drawn again.

Files are compared by git's ids of their contents. A *stamp* beside a folder's files, which is not published,
notes these ids and what the files were made from: what is up to date need not be made again. A *certificate*
says whether a folder is the same as a published one, except files that hold measured times. If a summary
differs, it also says how far its numbers are from the published ones, relative to their 95 % intervals.
"""

import gzip
import hashlib
import io
import json
import os
import platform
import subprocess
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from importlib.metadata import distributions
from pathlib import Path
from typing import Final

import pandas as pd

from benchmark.execution.provenance import digest_of_code
from benchmark.reports.folder import MANIFEST

STAMP: Final = ".stamp"
REPOSITORY: Final = Path(__file__).parents[2]
_SUMMARY: Final = "summary.csv"
_LISTED: Final = 6  # differing files that a sentence names


@dataclass(frozen=True)
class Certificate:
    """What comparing a folder with the published one gave."""

    name: str
    compared: tuple[str, ...]
    differing: tuple[str, ...]  # of these: other bytes, missing, or not published
    measured: tuple[str, ...]  # hold measured times; not compared
    distance: str  # how far the numbers of the summary are, if it differs
    other: str  # what was compared with, in words

    @property
    def is_identical(self) -> bool:
        """Whether every compared file is identical."""
        return not self.differing

    def __str__(self) -> str:
        """The certificate in words."""
        n_differing, n = len(self.differing), len(self.compared)
        apart = f"; files with measured times, not compared: {len(self.measured)}" if self.measured else ""
        if self.is_identical:
            return f"{self.name}: identical to {self.other} ({n} of {n} files{apart})."
        more = f" and {n_differing - _LISTED} more" if n_differing > _LISTED else ""
        files = f"{', '.join(self.differing[:_LISTED])}{more}"
        text = f"{self.name}: different from {self.other}: {n_differing} of {n} files: {files}{apart}."
        return f"{text}\n{self.name}: {self.distance}" if self.distance else text


def compare(
    folder: Path, name: str, measured: Collection[str], other: Path | None = None
) -> Certificate | None:
    """Compares a folder with another one.

    Args:
      folder: What was made.
      name: The experiment's name.
      measured: Names of files that hold measured times, as patterns.
      other: A folder that was made from the same store, whose manifest is compared, too; other files in it do
        not count. By default it is the folder that the last commit of this checkout has.

    Returns:
      The certificate; None if there is no other folder.
    """
    made, expected = _ids(folder), _published_ids(name) if other is None else _ids(other)
    if other is None:
        for blobs in (made, expected):
            blobs.pop(MANIFEST, None)  # says who made the files, and when
    else:
        known = {*made, *stamped(other / STAMP)}
        expected = {file: blob for file, blob in expected.items() if file in known}
    if not expected:
        return None
    files = sorted(made | expected)
    apart = tuple(file for file in files if any(fnmatchcase(file, pattern) for pattern in measured))
    compared = tuple(file for file in files if file not in apart)
    differing = tuple(file for file in compared if made.get(file) != expected.get(file))
    distance = ""
    if _SUMMARY in differing and _SUMMARY in made and _SUMMARY in expected:
        content = (other / _SUMMARY).read_bytes() if other else published_file(name, _SUMMARY)
        distance = _distance(folder / _SUMMARY, content or b"")
    where = f"the files in {other}" if other else "the published results"
    return Certificate(name, compared, differing, apart, distance, where)


def published_file(name: str, file: str) -> bytes | None:
    """Returns the content of a file of the last commit's results; None if there is no such file."""
    return _git("show", f"HEAD:results/{name}/{file}")


def keep_published(folder: Path, name: str) -> None:
    """Takes the published bytes of packed files that have the same content, since versions of zlib differ."""
    for path in folder.glob("*.gz"):
        published = published_file(name, path.name)
        if published and gzip.decompress(published) == gzip.decompress(path.read_bytes()):
            path.write_bytes(published)


def is_up_to_date(stamp: Path, inputs: str) -> bool:
    """Returns whether the files of a stamp were made from these inputs and are as they were made."""
    noted, blobs = _noted(stamp)
    paths = {stamp.parent / name: blob for name, blob in blobs.items()}
    return noted == inputs and all(path.is_file() and _id(path) == blob for path, blob in paths.items())


def write_stamp(stamp: Path, inputs: str, files: Iterable[Path]) -> None:
    """Notes what files were made from, see `digest_of_inputs`; paths are relative to the stamp's folder."""
    noted = {os.path.relpath(path, stamp.parent): _id(path) for path in sorted(files)}
    stamp.write_text(json.dumps({"inputs": inputs, "files": noted}, indent=1) + "\n", encoding="utf-8")


def stamped(stamp: Path) -> list[str]:
    """Lists the files of a stamp; none if there is no stamp, or a damaged one."""
    return [*_noted(stamp)[1]]


def _noted(stamp: Path) -> tuple[str, dict[str, str]]:
    """Returns a stamp's inputs, and the ids of its files; nothing without a stamp, or of a damaged one."""
    try:
        noted = json.loads(stamp.read_text(encoding="utf-8"))
        return str(noted["inputs"]), dict(noted["files"])
    except (OSError, ValueError, LookupError, TypeError):
        return "", {}


def digest_of_inputs(*parts: str) -> str:
    """Returns the digest of inputs, together with this project's code and all installed packages."""
    return hashlib.sha256("\0".join((_code(), *parts)).encode()).hexdigest()


def _ids(folder: Path) -> dict[str, str]:
    """Returns git's ids of the contents of a folder's results by name."""
    return {path.name: _id(path) for path in folder.iterdir() if path.is_file() and _is_result(path.name)}


def _published_ids(name: str) -> dict[str, str]:
    listing = _git("ls-tree", f"HEAD:results/{name}") or b""
    entries = (line.split(maxsplit=3) for line in listing.decode().splitlines())
    return {file: blob for _, kind, blob, file in entries if kind == "blob" and _is_result(file)}


def _id(path: Path) -> str:
    """Returns git's id of a file's content."""
    content = path.read_bytes()
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _is_result(file: str) -> bool:
    return file != "index.html" and not file.startswith(".")


@cache
def _code() -> str:
    """Returns a digest of this project's sources, and of all installed packages."""
    packages = sorted({f"{package.name}=={package.version}" for package in distributions()})
    text = "\0".join((platform.python_version(), digest_of_code(), *packages))
    return hashlib.sha256(text.encode()).hexdigest()


def _distance(path: Path, content: bytes) -> str:
    """Says how far every number that has an interval is from its published value; "" without common keys."""
    published, made = pd.read_csv(io.BytesIO(content)), pd.read_csv(path)
    keys = [column for column in published if not pd.api.types.is_numeric_dtype(published[column])]
    if not keys or not {*keys} <= {*made}:
        return ""
    texts = dict.fromkeys(keys, str)
    merged = published.astype(texts).merge(made.astype(texts), on=keys, suffixes=("", "_made"))
    total = equal = within = 0
    for column in published:
        if {f"{column}_low", f"{column}_high", f"{column}_made"} <= {*merged}:
            rows = merged[merged[f"{column}_low"].notna()]
            value, low, high, new = (rows[f"{column}{end}"] for end in ("", "_low", "_high", "_made"))
            total += len(rows)
            equal += int((new == value).sum())
            within += int((new.between(low, high) & (new != value)).sum())
    return (
        f"{path.name}: of {total} numbers with a 95 % interval, equal to the published ones: {equal}; "
        f"different, but within the published interval: {within}; outside it: {total - equal - within}; "
        f"rows that are missing: {len(published) - len(merged)}."
    )


def _git(*arguments: str) -> bytes | None:
    """Returns what git prints about this checkout; None where there is none."""
    git = ["git", "-C", str(REPOSITORY)]
    try:
        top = subprocess.run([*git, "rev-parse", "--show-toplevel"], check=True, capture_output=True).stdout
        if Path(top.decode().strip()) != REPOSITORY.resolve():
            return None  # it lies inside somebody else's repository
        return subprocess.run([*git, *arguments], check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
