"""Packages that this project may need: their extras, and the error if one is missing."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec

from envs.inputs import InputError, shortened

# Modules whose names are not those of their packages.
_RENAMED = {"PIL": "pillow", "markdown_it": "markdown-it-py", "pygame": "pygame-ce"}


class MissingPackageError(ModuleNotFoundError, InputError):
    """A package is not installed. The message says what installs it."""


@cache
def extras() -> dict[str, list[str]]:
    """Returns the names of the packages that each extra of this project adds."""
    found: dict[str, list[str]] = {}
    try:
        lines = requires("proxemic-benchmark") or []
    except PackageNotFoundError:
        return found
    for line in lines:
        if match := re.fullmatch(
            r"([a-z0-9-]+)[^\[]*extra == .(.+).", line
        ):  # no other extras, in brackets
            found.setdefault(match[2], []).append(match[1])
    return found


def package_of(module: str) -> str:
    """Returns the name of the package that brings a module.

    >>> package_of("sb3_contrib"), package_of("PIL")
    ('sb3-contrib', 'pillow')
    """
    return _RENAMED.get(module, module.replace("_", "-"))


@contextmanager
def contained() -> Iterator[None]:
    """Turns what would end the process in users' code, but not Ctrl-C, into an InputError."""
    try:
        yield
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise InputError(f"{shortened(repr(error))} would end this process.") from error


@contextmanager
def needed_by(what: str) -> Iterator[None]:
    """Turns the failed import of a package of this project's extras into a MissingPackageError."""
    try:
        yield
    except ModuleNotFoundError as error:
        module = missing(error)
        if isinstance(error, MissingPackageError) or not installer(module):
            raise
        raise missing_package(what, module) from error


def missing_package(what: str, module: str) -> MissingPackageError:
    """Returns the error that something needs a package, given as its missing module."""
    needed = f"{what} needs the package {package_of(module)}, which is not installed"
    return MissingPackageError(f"{needed}{installer(module)}.", name=module)


def missing(error: BaseException) -> str:
    """Returns the package whose import failed; empty if it is installed, but lacks a submodule."""
    name = error.name if isinstance(error, ModuleNotFoundError) else None
    module = (name or "").partition(".")[0]
    return module if module and find_spec(module) is None else ""


def installer(module: str) -> str:
    """Returns how to install the package of a module; empty if no extra has it."""
    for extra, packages in extras().items():
        if package_of(module) in packages:
            mark = ".venv/.base" if extra == "reproduce" else f".venv/.{extra}"
            elsewhere = f"pip install 'CHECKOUT[{extra}]' elsewhere, where CHECKOUT is its path"
            return f"; in a checkout of this project, make {mark} installs it, and {elsewhere}"
    return ""
