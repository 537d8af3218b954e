"""Installed packages that cannot be imported: which, why, and what repairs it. Imports no package itself."""

from contextlib import suppress
from itertools import chain
from traceback import walk_tb
from typing import Final

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
    package = next(filter(None, map(_package, reversed(modules))), None)
    if package is None:
        return ""
    reason = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    reason = reason if len(reason) <= _LONGEST else f"{reason[:_LONGEST]}..."
    advice = f"if it is broken, pip install --force-reinstall {package} repairs it"
    constraints = "(in a checkout: with -c constraints.txt)"
    return f"the package {package} cannot be imported ({reason}); {advice} {constraints}."


def _package(module: str) -> str:
    """Returns which of this project's packages brings a module; empty if none does."""
    with suppress(Exception):  # of the core, which is enough then: it is imported first
        from envs.packages import extras, package_of

        if package_of(module) in chain(*extras().values()):
            return package_of(module)
    return module if module in _CORE else ""
