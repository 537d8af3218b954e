"""Notes of what files were made from, so that what is up to date need not be made again.

A stamp lies beside the files, and is not published. It holds a digest of everything that the files depend on
and a digest of each file: they are up to date if neither has changed.
"""

import hashlib
import json
import os
import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
from typing import Final

_ROOT: Final = Path(__file__).parents[2]
_PACKAGES: Final = ("agents", "benchmark", "envs")
_SOURCES: Final = (".py", ".toml", ".html", ".css", ".js", ".md", ".jinja")


def digest_of(*parts: str) -> str:
    """Returns the digest of inputs, together with this project's code and all installed packages."""
    return hashlib.sha256("\0".join((_code(), *parts)).encode()).hexdigest()


def is_up_to_date(stamp: Path, inputs: str) -> bool:
    """Returns whether the files of a stamp were made from these inputs and are as they were made."""
    try:
        noted = json.loads(stamp.read_text(encoding="utf-8"))
        return bool(noted["inputs"] == inputs) and all(
            digest_of_file(stamp.parent / name) == digest for name, digest in noted["files"].items()
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return False  # no stamp, or a damaged one; or a file is missing


def write(stamp: Path, inputs: str, files: Iterable[Path]) -> None:
    """Notes what files were made from.

    Args:
      stamp: Where; files are named relative to its folder.
      inputs: See `digest_of`.
      files: As made.
    """
    noted = {
        "inputs": inputs,
        "files": {os.path.relpath(path, stamp.parent): digest_of_file(path) for path in sorted(files)},
    }
    stamp.write_text(json.dumps(noted, indent=1) + "\n", encoding="utf-8")


def files(stamp: Path) -> list[str]:
    """Lists the files of a stamp; none if there is no stamp, or a damaged one."""
    try:
        return [str(name) for name in json.loads(stamp.read_text(encoding="utf-8"))["files"]]
    except (OSError, ValueError, LookupError, TypeError):
        return []


def digest_of_source(module: str) -> str:
    """Returns the digest of a module that lives elsewhere, and of the package that it belongs to."""
    found = find_spec(module.partition(".")[0])
    if found is None:
        return ""
    folders = [Path(folder) for folder in found.submodule_search_locations or ()]
    paths = [path for folder in folders for path in sorted(folder.rglob("*")) if path.suffix in _SOURCES]
    paths += [Path(found.origin)] if found.origin and not folders else []
    return hashlib.sha256("".join(map(digest_of_file, paths)).encode()).hexdigest()


def digest_of_file(path: Path) -> str:
    """Returns the digest of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def _code() -> str:
    """Returns a digest of this project's sources, and of all installed packages."""
    digest = hashlib.sha256(platform.python_version().encode())
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*")):
            if path.suffix in _SOURCES:
                digest.update(f"{path.relative_to(_ROOT)}\0".encode() + path.read_bytes())
    for name, version in sorted({(each.name, each.version) for each in distributions()}):
        digest.update(f"{name}=={version}\0".encode())
    return digest.hexdigest()
