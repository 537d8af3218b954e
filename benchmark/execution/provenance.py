"""What a record says about the code and the machine that made it, collected where the run is executed."""

import hashlib
import os
import platform
import subprocess
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from subprocess import DEVNULL
from typing import Any, Final

import llvmlite.binding
import numpy as np

from agents import load_algorithm
from envs.packages import missing_package
from envs.sources import digest_when_loaded

_PACKAGES: Final = ("gymnasium", "llvmlite", "matplotlib", "numba", "numpy", "pandas", "scipy", "seaborn")
_FEATURES: Final = ("avx", "avx2", "fma", "avx512f")
_SOURCES: Final = (".py", ".toml", ".html", ".css", ".js", ".md", ".jinja")
_SHOWN: Final = 12  # digits of a digest in a message


@cache
def provenance(algorithm: str) -> dict[str, object]:
    """Returns the commit of the code, the machine, and the versions that a run of an algorithm depends on."""
    where = {"commit": commit(Path(__file__)), "machine": machine(), "processor": processor()}
    return where | {"versions": versions(algorithm)}


def machine() -> str:
    """Returns what kind of machine this is."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


@cache
def processor() -> str:
    """Returns what the bits of some libraries depend on: processor, its instructions, and NumPy's BLAS."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        model = text.split("model name")[1].split("\n")[0].strip("\t :")
    except (OSError, IndexError):
        model = platform.processor()
    available, kind = llvmlite.binding.get_host_cpu_features(), llvmlite.binding.get_host_cpu_name()
    features = " ".join(name for name in _FEATURES if available.get(name))
    build: Any = np.show_config(mode="dicts")
    blas = build["Build Dependencies"]["blas"]
    return f"{model} ({kind}: {features}); BLAS {blas['name']} {blas.get('version', '')}"


def versions(algorithm: str) -> dict[str, str]:
    """Returns the versions of Python and of the packages that runs depend on; refuses a missing package."""
    installed = {"python": platform.python_version()}
    for package in (*_PACKAGES, *load_algorithm(algorithm).packages):
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            raise missing_package(algorithm, package) from None
    return installed


@cache
def environment(algorithm: str) -> dict[str, str]:
    """Returns what must be the same on every machine that runs an algorithm: versions and code."""
    same = versions(algorithm) | {"project code": digest_of_code()[:_SHOWN]}
    if ":" in algorithm:
        same[f"code of {algorithm}"] = digest_when_loaded(algorithm.partition(":")[0])[:_SHOWN]
    return same


@cache
def digest_of_code() -> str:
    """Returns the digest of this project's sources."""
    folders = [Path(__file__).parents[2] / name for name in ("agents", "benchmark", "envs")]
    paths = [path for folder in folders for path in sorted(folder.rglob("*")) if path.suffix in _SOURCES]
    named = (f"{path.name}\0{hashlib.sha256(path.read_bytes()).hexdigest()}" for path in paths)
    return hashlib.sha256("".join(named).encode()).hexdigest()


def commit(file: Path) -> str | None:
    """Returns the commit of the repository that tracks a file of this code, if one does.

    It ends in `-changed` if the code differs. A copy that is installed inside another repository has none.
    """
    root = str(file.parents[2])

    def git(*arguments: str) -> str:
        return subprocess.check_output(["git", "-C", root, *arguments], stderr=DEVNULL, text=True).strip()

    try:
        git("ls-files", "--error-unmatch", "--", str(file))
        head = git("rev-parse", "--short=12", "HEAD")
        changes = git("status", "--porcelain", "--", "envs", "agents", "benchmark")
    except (OSError, subprocess.CalledProcessError):
        return None
    return head + ("-changed" if changes else "")


def reset_peak_memory() -> None:
    """Starts measuring this process's peak memory anew, where the system can: Linux."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_memory_mb() -> float | None:
    """Returns the most memory, in MB, that this process has used since `reset_peak_memory`, if known.

    `ru_maxrss` would include the parent's peak: on Linux, it survives `fork` and `exec`.
    """
    with suppress(OSError):
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(status.split("VmHWM:")[1].split()[0]) / 1024
    return None
