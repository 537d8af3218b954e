"""What a record says about the code and the machine that made it, collected where it is made."""

import hashlib
import os
import platform
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np

from agents import load_algorithm
from benchmark.folder import git
from envs.packages import missing_package

_PACKAGES = (
    "gymnasium", "llvmlite", "matplotlib", "numba", "numpy", "pandas", "scipy", "seaborn",
)  # fmt: skip
_FEATURES = ("avx", "avx2", "fma", "avx512f")
_ROOT = Path(__file__).parents[1]
_FOLDERS = ("agents", "benchmark", "envs")
_SHOWN = 12  # digits of a digest in a message


@cache
def provenance(algorithm: str) -> dict[str, object]:
    """Returns the commit, the machine, and the versions that a run of an algorithm depends on."""
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    where = {"commit": commit(_ROOT), "machine": machine, "processor": processor()}
    return where | {"versions": versions(algorithm)}


@cache
def processor() -> str:
    """Returns what the bits of some libraries depend on: processor, instructions, and BLAS."""
    model = platform.processor()
    with suppress(OSError, IndexError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        model = text.split("model name")[1].split("\n")[0].strip("\t :")
    available = llvmlite.binding.get_host_cpu_features()
    features = " ".join(name for name in _FEATURES if available.get(name))
    build: Any = np.show_config(mode="dicts")
    blas = build["Build Dependencies"]["blas"]
    kind = f"{llvmlite.binding.get_host_cpu_name()}: {features}"
    return f"{model} ({kind}); BLAS {blas['name']} {blas.get('version', '')}"


def versions(algorithm: str) -> dict[str, str]:
    """Returns the versions of Python and of packages that runs depend on.

    Raises an InputError if a package is missing.
    """
    installed = {"python": platform.python_version()}
    for package in (*_PACKAGES, *load_algorithm(algorithm).packages):
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            raise missing_package(algorithm, package) from None
    return installed


@cache
def environment(algorithm: str) -> dict[str, str]:
    """Returns what must be the same on all machines that run an algorithm: versions and code."""
    digest = hashlib.sha256()
    for path in _sources(_ROOT):
        digest.update(path.read_bytes())
    return versions(algorithm) | {"project code": digest.hexdigest()[:_SHOWN]}


def _sources(root: Path) -> list[Path]:
    return sorted(path for name in _FOLDERS for path in (root / name).rglob("*.py"))


def commit(root: Path) -> str | None:
    """Returns the commit of the repository that tracks this code, if one does.

    It ends in `-changed` if the code differs. A copy that is installed inside another repository
    has none. Files are compared with git's digests, since `git status` runs what a repository's
    settings say.
    """
    head = (git(root, "rev-parse", "--short=12", "HEAD") or b"").decode().strip()
    listed = (git(root, "ls-tree", "-r", "HEAD", "--", *_FOLDERS) or b"").decode().splitlines()
    digests = {path: about.split()[2] for about, path in (line.split("\t") for line in listed)}
    if "benchmark/__init__.py" not in digests:
        return None
    own = {path.relative_to(root).as_posix() for path in _sources(root)}
    is_same = all(_blob(root / path) == digest for path, digest in digests.items())
    return head if is_same and own <= digests.keys() else f"{head}-changed"


def _blob(path: Path) -> str:
    """Returns the digest that git gives a file; empty if there is no such file."""
    content = path.read_bytes() if path.is_file() else b""
    kind = b"blob %d\0" % len(content)
    return hashlib.sha1(kind + content, usedforsecurity=False).hexdigest() if path.is_file() else ""


def reset_peak_memory() -> None:
    """Starts measuring this process's peak memory anew, where the system can: Linux."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_memory_mb() -> float | None:
    """Returns the most memory, in MB, that this process has used since `reset_peak_memory`.

    None if the system does not say. `ru_maxrss` would include the parent's peak: on Linux, it
    survives `fork` and `exec`.
    """
    with suppress(OSError):
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(status.split("VmHWM:")[1].split()[0]) / 1024
    return None
