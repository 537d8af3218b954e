"""Compares a folder of results with a published one: files of the last commit in `results/`, or a folder.

Files are compared byte for byte. Those that hold measured times are set apart, since they differ each time.
Nets differ between types of processor: if a summary differs, the certificate also says how far its numbers
are from the published ones, relative to the published 95 % intervals.
"""

import hashlib
import io
import math
import subprocess
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

import pandas as pd

from benchmark.reports.published import MANIFEST

SUMMARY: Final = "summary.csv"
_LISTED: Final = 6  # differing files that a sentence names
REPOSITORY: Final = Path(__file__).parents[2]


@dataclass(frozen=True)
class Distance:
    """How far a table's numbers are from the published ones, of those that have an interval."""

    table: str
    equal: int
    within: int  # other than published, but inside the published interval
    outside: int
    farthest: str  # the number that lies farthest out, in half-widths of its interval; empty if none does
    missing: int = 0  # published rows that were not made

    def __str__(self) -> str:
        """The distance in words."""
        n = self.equal + self.within + self.outside
        farthest = f" (the farthest: {self.farthest})" if self.farthest else ""
        return (
            f"{self.table}: of {n} numbers with a 95 % interval, equal to the published ones: {self.equal}; "
            f"different, but within the published interval: {self.within}; outside it: "
            f"{self.outside}{farthest}{f'; rows that are missing: {self.missing}' if self.missing else ''}."
        )


@dataclass(frozen=True)
class Certificate:
    """What comparing a folder with the published one gave."""

    name: str
    identical: tuple[str, ...]
    differing: tuple[str, ...]  # other bytes, missing, or not published
    measured: tuple[str, ...]  # hold measured times; not compared
    distance: Distance | None = None  # of the summary, if it differs
    other: str = "the published results"  # what was compared with, in words

    @property
    def is_identical(self) -> bool:
        """Whether every compared file is identical."""
        return not self.differing

    def __str__(self) -> str:
        """The certificate in words."""
        n = len(self.identical) + len(self.differing)
        apart = f"; files with measured times, not compared: {len(self.measured)}" if self.measured else ""
        if self.is_identical:
            return f"{self.name}: identical to {self.other} ({n} of {n} files{apart})."
        names = ", ".join(self.differing[:_LISTED])
        more = f" and {len(self.differing) - _LISTED} more" if len(self.differing) > _LISTED else ""
        verb = "differs" if len(self.differing) == 1 else "differ"
        differ = f"{len(self.differing)} of {n} files {verb} from {self.other}"
        text = f"{self.name}: {differ}: {names}{more}{apart}."
        return text if self.distance is None else f"{text}\n{self.name}: {self.distance}"


def compare(
    folder: Path, name: str, measured: Collection[str], repository: Path = REPOSITORY
) -> Certificate | None:
    """Compares a folder with the published results of an experiment.

    Args:
      folder: What was made.
      name: The experiment's name.
      measured: Names of files that hold measured times, as patterns.
      repository: The checkout whose last commit is compared with.

    Returns:
      The certificate; None if nothing is published under this name, or this is not a git checkout.
    """
    return _compare(
        folder,
        name,
        measured,
        _published(name, repository),
        lambda file: published_file(name, file, repository),
    )


def compare_folders(
    folder: Path, published: Path, name: str, measured: Collection[str], was_made: Callable[[str], bool]
) -> Certificate | None:
    """Compares a folder with another one, which counts as published; see `compare`.

    Args:
      folder: What was made.
      published: The other one.
      name: The experiment's name.
      measured: Names of files that hold measured times, as patterns.
      was_made: Whether a file of this name in the other folder is one of the results.
    """
    ids = {file: blob for file, blob in _ids(published).items() if (folder / file).exists() or was_made(file)}
    found = _compare(folder, name, measured, ids, lambda file: (published / file).read_bytes())
    return found and replace(found, other=f"the files in {published}")


def _compare(
    folder: Path,
    name: str,
    measured: Collection[str],
    ids: Mapping[str, str],
    read: Callable[[str], bytes | None],
) -> Certificate | None:
    """Compares a folder with published files, given by their ids and contents."""
    published = {file: blob for file, blob in ids.items() if _is_compared(file)}

    def is_measured(file: str) -> bool:
        return any(fnmatchcase(file, pattern) for pattern in measured)

    if not published:
        return None
    made = {file: blob for file, blob in _ids(folder).items() if _is_compared(file)}
    names = sorted(published.keys() | made.keys())
    compared = [file for file in names if not is_measured(file)]
    differing = tuple(file for file in compared if made.get(file) != published.get(file))
    is_apart = SUMMARY in differing and SUMMARY in made and SUMMARY in published
    return Certificate(
        name=name,
        identical=tuple(file for file in compared if file not in differing),
        differing=differing,
        measured=tuple(file for file in names if is_measured(file)),
        distance=_distance(folder / SUMMARY, read(SUMMARY)) if is_apart else None,
    )


def published_file(name: str, file: str, repository: Path = REPOSITORY) -> bytes | None:
    """Returns a published file's content; None if there is no such file."""
    return _git(repository, "show", f"HEAD:results/{name}/{file}")


def is_as_published(results: Path, repository: Path = REPOSITORY) -> bool:
    """Returns whether a folder is that of the published results, and it and the code are as committed."""
    changes = _git(repository, "status", "--porcelain", "--", "envs", "agents", "benchmark", "results")
    return changes == b"" and results.resolve() == repository.resolve() / "results"


def _is_compared(file: str) -> bool:
    """Returns whether a file of the folder is a result; the manifest says who made them, and when."""
    return file not in (MANIFEST, "index.html") and not file.startswith(".")


def _published(name: str, repository: Path) -> dict[str, str]:
    """Returns the ids of the published files' contents by name."""
    listing = _git(repository, "ls-tree", f"HEAD:results/{name}")
    if listing is None:
        return {}
    entries = (line.split(maxsplit=3) for line in listing.decode().splitlines())
    return {file: blob for _, kind, blob, file in entries if kind == "blob"}


def _ids(folder: Path) -> dict[str, str]:
    """Returns the ids of the contents of a folder's files by name."""
    return {path.name: _blob_id(path) for path in folder.iterdir() if path.is_file()}


def _blob_id(path: Path) -> str:
    """Returns git's id of a file's content."""
    content = path.read_bytes()
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _distance(path: Path, content: bytes | None) -> Distance | None:
    """Compares every number that has an interval with its published value; None without common keys."""
    assert content is not None
    published, made = pd.read_csv(io.BytesIO(content)), pd.read_csv(path)
    keys = [column for column in published if not pd.api.types.is_numeric_dtype(published[column])]
    if not keys or not {*keys} <= {*made}:
        return None
    made = made.astype(dict.fromkeys(keys, str))
    merged = published.astype(dict.fromkeys(keys, str)).merge(made, on=keys, suffixes=("", "_made"))
    equal = within = outside = 0
    farthest, text = 0.0, ""
    for column in map(str, published):
        if not {f"{column}_low", f"{column}_high", f"{column}_made"} <= set(map(str, merged)):
            continue
        for row in merged.to_dict("records"):
            value, new, low, high = (float(row[f"{column}{end}"]) for end in ("", "_made", "_low", "_high"))
            if math.isnan(low) or math.isnan(high):
                continue
            equal += value == new
            within += value != new and low <= new <= high
            if value == new or low <= new <= high:
                continue
            outside += 1
            half_width = (high - low) / 2
            apart = abs(new - value) / half_width if half_width else math.inf
            if apart > farthest or (apart == farthest == math.inf and not text):
                farthest = apart
                where = ", ".join(str(row[key]) for key in keys)
                text = f"{column} of {where}: {new:.3g}, published {value:.3g} [{low:.3g}, {high:.3g}]"
    return Distance(path.name, equal, within, outside, text, len(published) - len(merged))


def _git(repository: Path, *arguments: str) -> bytes | None:
    """Returns what git prints about a checkout; None where there is none."""
    git = ["git", "-C", str(repository)]
    try:
        top = subprocess.run([*git, "rev-parse", "--show-toplevel"], check=True, capture_output=True).stdout
        if Path(top.decode().strip()) != repository.resolve():
            return None  # it lies inside somebody else's repository
        return subprocess.run([*git, *arguments], check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
