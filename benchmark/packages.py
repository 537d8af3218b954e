"""Installed packages that cannot be imported: which, why, and what mends it. Imports no package itself."""

import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib import import_module
from importlib.metadata import packages_distributions, version
from traceback import walk_tb
from types import ModuleType
from typing import Final

LIMIT_S: Final = 120.0  # of an import; the first one of torch reads hundreds of megabytes
_CORE: Final = ("gymnasium", "numpy", "pydantic")  # without which no message of `envs.inputs` can be made
_LAYERS: Final = ("agents", "benchmark", "envs")
_LONGEST: Final = 100  # characters of a reason


def broken(error: BaseException) -> str:
    """Returns a sentence on the installed package whose import raised an error; empty if none did.

    Packages that came by pip are told by their metadata from modules of users. One that is there in part is
    imported by this project in vain.
    """
    modules = [
        str(frame.f_globals.get("__name__")).partition(".")[0]
        for frame, _ in walk_tb(error.__traceback__)
        if frame.f_code.co_name == "<module>"
    ]
    name = next((each for each in reversed(modules) if each not in sys.stdlib_module_names), "")
    if name in _LAYERS:
        found = getattr(error, "obj", None)  # of an AttributeError
        wanted = found.__name__ if isinstance(found, ModuleType) else getattr(error, "name", None)
        name = wanted.partition(".")[0] if isinstance(wanted, str) else ""
    return _sentence(name, f"{type(error).__name__}: {error}")


def _sentence(module: str, reason: str) -> str:
    """Returns that a module cannot be imported, and what mends its package; empty if it is of no package."""
    packages = packages_distributions().get(module) if module else None
    if not packages:
        installer = "pip install . installs it (in a checkout: make .venv/.base)"
        return f"the package {module} is not installed; {installer}." if module in _CORE else ""
    text = " ".join(reason.split())
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    wanted = f"{packages[0]}=={version(packages[0]).partition('+')[0]}"
    return f"the package {packages[0]} is broken ({text}); pip install --force-reinstall {wanted} mends it."


def unusable(modules: Iterable[str], jobs: int, limit_s: float = LIMIT_S) -> dict[str, str]:
    """Imports each module in a process of its own; returns sentences on those that cannot be imported."""
    with ThreadPoolExecutor(jobs) as pool:
        names = [*modules]
        found = pool.map(partial(_tried, limit_s=limit_s), names)
        return {name: sentence for name, sentence in zip(names, found, strict=True) if sentence}


def _tried(module: str, limit_s: float) -> str:
    """Returns that a module cannot be imported, and why, in a sentence; empty if it can be imported."""
    code = f"import sys; sys.path[:] = {sys.path}; from benchmark.packages import main; main({module!r})"
    command = [sys.executable, "-c", code]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=limit_s)
    except subprocess.TimeoutExpired:
        reason = f"not imported within {limit_s:g} s"
    else:
        if done.returncode == 0:
            return ""
        if done.returncode > 0:
            return "".join(done.stderr.splitlines()[-1:])
        reason = f"importing it ended by signal {-done.returncode}"
    return _sentence(module, reason) or f"{module} cannot be imported ({reason})."


def main(module: str) -> None:
    """Imports a module; exits with a sentence if that fails."""
    try:
        import_module(module)
    except Exception as error:  # a module can raise anything
        sys.exit(broken(error) or f"{module} cannot be imported ({type(error).__name__}: {error}).")
