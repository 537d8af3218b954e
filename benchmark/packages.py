"""Installed packages that cannot be imported: which, why, and what repairs it. Imports no package itself."""

import errno
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from traceback import walk_tb
from types import ModuleType
from typing import Final

LIMIT_S: Final = 120.0  # of an import; the first one of torch reads hundreds of megabytes
_CORE: Final = ("gymnasium", "numpy", "pydantic")  # without which no message of `envs.inputs` can be made
_LAYERS: Final = ("agents", "benchmark", "envs")
_LONGEST: Final = 100  # characters of a reason
# In reasons for which no package can be blamed: memory, open files or disk space ran out.
_SCARCE: Final = (
    "MemoryError",
    "failed to map segment",  # the dynamic loader's, without memory
    *map(os.strerror, (errno.ENOMEM, errno.EMFILE, errno.ENFILE, errno.ENOSPC)),
)


def broken(error: BaseException) -> str:
    """Returns a sentence on the installed package whose import raised an error; empty if none did.

    Only packages that this project requires count: for those of users, the error itself names the file.
    """
    modules = [
        str(frame.f_globals.get("__name__")).partition(".")[0]
        for frame, _ in walk_tb(error.__traceback__)
        if frame.f_code.co_name == "<module>"
    ]
    name = next((module for module in reversed(modules) if module not in sys.stdlib_module_names), "")
    if name in _LAYERS:  # what it imports is installed only in part
        module = getattr(error, "obj", None)  # of an AttributeError
        missing = module.__name__ if isinstance(module, ModuleType) else getattr(error, "name", None)
        name = str(missing or "").partition(".")[0]
    return _sentence(name, f"{type(error).__name__}: {error}")


def _sentence(module: str, reason: str) -> str:
    """Returns why a module cannot be imported, and what repairs it; empty for modules of users."""
    package = next(iter(_required(module)), None) if module else None
    if package is None:
        installer = "pip install . installs it (in a checkout: make .venv/.base)"
        return f"the package {module} is not installed; {installer}." if module in _CORE else ""
    text = " ".join(reason.split()).removesuffix(":")
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    if any(scarce in reason for scarce in _SCARCE):
        return f"the package {package} cannot be imported now ({text})."
    wanted = f"{package}=={version(package).partition('+')[0]}"
    return f"the package {package} is broken ({text}); pip install --force-reinstall {wanted} repairs it."


def _required(module: str) -> list[str]:
    """Lists the packages that provide a module and that this project requires, directly or indirectly."""
    modules, packages = [*_CORE], packages_distributions()
    with suppress(Exception):  # of the core, which is enough then: it is imported first
        from envs.inputs import EXTRAS

        modules += [module for extra in EXTRAS.values() for module in extra]
    todo = [package for module in modules for package in packages.get(module, [])]
    required: set[str] = set()
    while todo:
        name = _normal(todo.pop())
        if name not in required:
            required.add(name)
            with suppress(PackageNotFoundError):  # it is for another system
                lines = [line for line in requires(name) or () if "extra" not in line.partition(";")[2]]
                todo += [re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in lines]
    return [package for package in packages.get(module, []) if _normal(package) in required]


def _normal(package: str) -> str:
    """Returns a package's normalized name, the same for all spellings."""
    return re.sub(r"[-_.]+", "-", package).lower()


def unusable(modules: Sequence[str], jobs: int, limit_s: float = LIMIT_S) -> dict[str, str]:
    """Imports each module in a process of its own; returns sentences on those that cannot be imported."""
    with ThreadPoolExecutor(jobs) as pool:
        sentences = pool.map(partial(_tried, limit_s=limit_s), modules)
        return {name: sentence for name, sentence in zip(modules, sentences, strict=True) if sentence}


def _tried(module: str, limit_s: float) -> str:
    code = f"import sys; sys.path[:] = {sys.path}; from benchmark.packages import main; main({module!r})"
    command = [sys.executable, "-c", code]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=limit_s)
    except subprocess.TimeoutExpired:
        reason = f"not imported within {limit_s:g} s"
    else:
        status, message = done.returncode, done.stderr.strip()
        if status == 0:
            return ""
        if status > 0 and message:
            return message.splitlines()[-1]
        reason = f"importing it ended {f'with exit code {status}' if status > 0 else f'by signal {-status}'}"
    return _sentence(module, reason) or f"{module} cannot be imported ({reason})."


def main(module: str) -> None:
    """Imports a module; exits with a sentence if that fails."""
    try:
        import_module(module)
    except Exception as error:  # a module can raise anything
        sys.exit(broken(error) or f"{module} cannot be imported ({type(error).__name__}: {error}).")
