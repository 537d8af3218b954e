"""Whether a folder of results is as published, except files that hold measured times."""

import gzip
import hashlib
import json
import subprocess
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from benchmark.folder import MANIFEST, README, Folder, digests
from envs import InputError

REPOSITORY: Final = Path(__file__).parents[2]


class Certificate(NamedTuple):
    """The result of comparing a folder with another."""

    is_identical: bool
    text: str


def compare(folder: Path, name: str, measured: Collection[str]) -> Certificate | None:
    """Compares an experiment's folder with that of the last commit; returns None if there is none.

    Manifests, which say who made the files and when, do not count, nor do files that hold measured times,
    whose names are given.
    """
    made, expected = digests(folder, but=(MANIFEST,)), _published(name)
    if not expected:
        return None
    aside = f" (measured times are not compared: {', '.join(measured)})" if measured else ""
    if other := [file for file in differing(made, expected) if file not in measured]:
        return Certificate(False, f"{name}: different from the published results: {', '.join(other)}{aside}.")
    return Certificate(True, f"{name}: identical to the published results{aside}.")


def differing(made: Mapping[str, object], expected: Mapping[str, object]) -> list[str]:
    """Lists the keys whose values differ between two mappings, or that only one of them has."""
    return sorted(name for name in made.keys() | expected.keys() if made.get(name) != expected.get(name))


def published_file(name: str, file: str) -> bytes | None:
    """Returns the content of a file of the last commit's results; None if there is no such file."""
    git = ["git", "-C", str(REPOSITORY), "show", f"HEAD:results/{name}/{file}"]
    try:
        return subprocess.run(git, check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None


def keep_published(folder: Path, name: str) -> None:
    """Takes the published bytes of packed files that have the same content, since versions of zlib differ."""
    for path in folder.glob("*.gz"):
        published = published_file(name, path.name)
        if published and gzip.decompress(published) == gzip.decompress(path.read_bytes()):
            path.write_bytes(published)


def listed(folder: Path) -> set[str]:
    """Returns the names of the files that were made for a folder, if it has a sound manifest."""
    with suppress(InputError):
        return {MANIFEST, README, *Folder(folder).manifest["files"]}
    return set()


def _published(name: str) -> dict[str, str]:
    """Returns the digests of an experiment's published files; none if the last commit has no such results."""
    manifest, readme = (published_file(name, file) for file in (MANIFEST, README))
    if manifest is None or readme is None:
        return {}
    return {**json.loads(manifest)["files"], README: hashlib.sha256(readme).hexdigest()}
