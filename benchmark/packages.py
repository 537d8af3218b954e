"""Installed packages that cannot be imported: which, why, and what repairs it. Imports no package itself."""

from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from traceback import walk_tb
from types import ModuleType
from typing import Final

_CORE: Final = ("gymnasium", "numpy", "pydantic")  # without which no message of `envs.inputs` can be made
_LAYERS: Final = ("agents", "benchmark", "envs")
_LONGEST: Final = 100  # characters of a reason


def broken(error: BaseException) -> str:
    """Returns a sentence on the package whose import raised an error; empty if none of ours did.

    Of those that this project names it is the innermost: a reinstallation covers what it requires, and for
    modules of users the error itself names the file.
    """
    modules = [
        str(frame.f_globals.get("__name__")).partition(".")[0]
        for frame, _ in walk_tb(error.__traceback__)
        if frame.f_code.co_name == "<module>"
    ]
    named = (*_LAYERS, *_packages())
    name = next((module for module in reversed(modules) if module in named), "")
    if name in _LAYERS:  # what it imports is installed only in part
        module = getattr(error, "obj", None)  # of an AttributeError
        missing = module.__name__ if isinstance(module, ModuleType) else getattr(error, "name", None)
        name = str(missing or "").partition(".")[0]
    package = _packages().get(name, "")
    try:
        wanted = f"{package}=={version(package).partition('+')[0]}" if package else ""
    except PackageNotFoundError:
        wanted = ""
    if not wanted:
        installer = "pip install . installs it (in a checkout: make .venv/.base)"
        return f"the package {name} is not installed; {installer}." if name in _CORE else ""
    text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    advice = f"if it is broken, pip install --force-reinstall {wanted} repairs it"
    return f"the package {package} cannot be imported ({text}); {advice}."


def _packages() -> dict[str, str]:
    """Returns the packages that this project names, by module."""
    with suppress(Exception):  # of the core, which is enough then: it is imported first
        from envs.packages import EXTRAS, PACKAGES

        return {name: PACKAGES.get(name, name) for name in (*_CORE, *chain(*EXTRAS.values()))}
    return {name: name for name in _CORE}
