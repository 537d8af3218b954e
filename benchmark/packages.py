"""Installed packages that cannot be imported: which, why, and what repairs it. Imports no package itself."""

import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from itertools import chain
from traceback import walk_tb
from typing import Final

LIMIT_S: Final = 120.0  # of an import; the first one of torch reads hundreds of megabytes
_CORE: Final = ("gymnasium", "numpy", "pydantic")  # without which no message of `envs.inputs` can be made
_LONGEST: Final = 100  # characters of a reason


def broken(error: BaseException) -> str:
    """Returns a sentence on the package whose import raised an error; empty if none of ours did.

    Of those that this project names it is the innermost: a reinstallation covers what it requires, and for
    modules of users the error itself names the file.
    """
    if isinstance(error, ModuleNotFoundError) and error.name in _CORE:
        installer = f"pip install {error.name} installs it (in a checkout: make .venv/.base)"
        return f"the package {error.name} is not installed; {installer}."
    modules = [
        str(frame.f_globals.get("__name__")).partition(".")[0]
        for frame, _ in walk_tb(error.__traceback__)
        if frame.f_code.co_name == "<module>"
    ]
    package = next(filter(None, map(_packages().get, reversed(modules))), None)
    return _sentence(package, f"{type(error).__name__}: {error}") if package else ""


def _sentence(package: str, reason: str) -> str:
    text = " ".join(reason.split()).removesuffix(":")
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    advice = f"if it is broken, pip install --force-reinstall {package} repairs it"
    constraints = "(in a checkout: with -c constraints.txt)"
    return f"the package {package} cannot be imported ({text}); {advice} {constraints}."


def _packages() -> dict[str, str]:
    """Returns the packages that this project names, by module."""
    with suppress(Exception):  # of the core, which is enough then: it is imported first
        from envs.packages import EXTRAS, PACKAGES

        return {name: PACKAGES.get(name, name) for name in (*_CORE, *chain(*EXTRAS.values()))}
    return {name: name for name in _CORE}


def unusable(modules: Iterable[str], jobs: int, limit_s: float = LIMIT_S) -> dict[str, str]:
    """Imports each installed module in a process of its own; returns sentences on those that fail."""
    installed = [module for module in modules if find_spec(module) is not None]
    with ThreadPoolExecutor(jobs) as pool:
        reasons = pool.map(partial(_reason, limit_s=limit_s), installed)
        named = zip(installed, reasons, strict=True)
        return {name: _sentence(_packages()[name], reason) for name, reason in named if reason}


def _reason(module: str, limit_s: float) -> str:
    """Returns why a module cannot be imported; empty if it can."""
    command = [sys.executable, "-c", f"import {module}"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=limit_s)
    except subprocess.TimeoutExpired:
        return f"not imported within {limit_s:g} s"
    if done.returncode == 0:
        return ""
    *_, last = ["", *done.stderr.splitlines()]
    return last or f"importing it ended with exit code {done.returncode}"
