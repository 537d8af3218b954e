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
from pathlib import Path

from benchmark.execution.provenance import digest_of_code, digest_of_file


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


@cache
def _code() -> str:
    """Returns a digest of this project's sources, and of all installed packages."""
    digest = hashlib.sha256(f"{platform.python_version()}\0{digest_of_code()}\0".encode())
    for name, version in sorted({(each.name, each.version) for each in distributions()}):
        digest.update(f"{name}=={version}\0".encode())
    return digest.hexdigest()
