"""Packages that this project may need: their extras, and the error if one is missing."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from types import ModuleType

from envs.inputs import InputError, guess, shortened

# Modules whose names are not those of their packages.
_RENAMED = {"PIL": "pillow", "markdown_it": "markdown-it-py", "pygame": "pygame-ce"}


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


def imported(name: str, source: str, kind: str) -> object:
    """Imports the object that a source names as `module:attribute`, or raises an InputError."""
    module, _, attribute = name.partition(":")
    if not attribute:
        raise InputError(f"{source}: {kind} {shortened(name)}: accepted: module:attribute.")
    loaded: ModuleType | None = None
    try:
        loaded = import_module(module)
        return getattr(loaded, attribute)
    except Exception as error:  # a module can raise anything
        reason = str(error).removesuffix(".")
        hint = _installer(_missing(error)) if loaded is None else guess(attribute, dir(loaded))
        raise InputError(
            f"{source}: {kind} {shortened(name)} cannot be imported: {reason}{hint}."
        ) from error


@contextmanager
def needed_by(what: str) -> Iterator[None]:
    """Turns the failed import of a package of this project's extras into an InputError."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = _missing(error)
        if not _installer(missing):
            raise
        raise missing_package(what, missing) from error


def missing_package(what: str, module: str) -> InputError:
    """Returns the error that something needs a package, given as its missing module."""
    needed = f"{what} needs the package {package_of(module)}, which is not installed"
    return InputError(f"{needed}{_installer(module)}.")


def _missing(error: BaseException) -> str:
    """Returns the package whose import failed; empty if it is installed, but lacks a submodule."""
    name = error.name if isinstance(error, ModuleNotFoundError) else None
    module = (name or "").partition(".")[0]
    return module if module and find_spec(module) is None else ""


def _installer(module: str) -> str:
    for extra, packages in extras().items():
        if package_of(module) in packages:
            mark = ".venv/.base" if extra == "reproduce" else f".venv/.{extra}"
            return f"; in a checkout of this project, make {mark} installs it"
    return ""
