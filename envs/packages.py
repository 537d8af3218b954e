"""Packages that this project may need: which extra installs each, and the error if one is missing."""

import os
import posix
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Final

from envs.inputs import InputError, guess, shortened

# Modules whose names are not those of their packages.
_RENAMED: Final = {"PIL": "pillow", "markdown_it": "markdown-it-py", "pygame": "pygame-ce"}


class MissingPackageError(ModuleNotFoundError, InputError):
    """A package is not installed. The message says what installs it."""


@cache
def extras() -> dict[str, list[str]]:
    """Returns the names of the packages that each extra of this project adds."""
    try:
        lines = requires("proxemic-benchmark") or []
    except PackageNotFoundError:  # a checkout need not be installed
        pyproject = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
        tables = pyproject["project"]["optional-dependencies"]
        lines = [f"{line}; extra == '{extra}'" for extra in tables for line in tables[extra]]
    found: dict[str, list[str]] = {}
    for line in lines:
        if match := re.fullmatch(r"([a-z0-9-]+)[^\[]*extra == .(.+).", line):  # no other extras, in brackets
            found.setdefault(match[2], []).append(match[1])
    return found


def package_of(module: str) -> str:
    """Returns the name of the package that brings a module.

    >>> package_of("sb3_contrib"), package_of("PIL")
    ('sb3-contrib', 'pillow')
    """
    return _RENAMED.get(module, module.replace("_", "-"))


def imported(name: str, source: str, kind: str) -> object:
    """Imports the object that a source names as `module:attribute`, or raises an InputError.

    The message recommends only packages of this project's extras: a misspelt name could be any other's.
    """
    module, _, attribute = name.partition(":")
    if not attribute:
        raise InputError(f"{source}: {kind} {shortened(name)}: accepted: module:attribute.")
    loaded: ModuleType | None = None
    try:
        with contained():
            loaded = import_module(module)
            return getattr(loaded, attribute)
    except Exception as error:  # a module can raise anything
        reason, hint, missing = str(error).removesuffix("."), "", _missing(error)
        if loaded is not None:
            hint = guess(attribute, dir(loaded))
        elif missing is not None and _installer(missing):
            hint = _installer(missing)
        elif missing == module.partition(".")[0]:
            accepted = "a module of the current folder, of that of the file, or of an installed package"
            modules = (package.replace("-", "_") for package in chain(*extras().values()))
            hint = f"{guess(missing, modules)}; accepted: {accepted}"
        raise InputError(f"{source}: {kind} {shortened(name)} cannot be imported: {reason}{hint}.") from error


@contextmanager
def contained() -> Iterator[None]:
    """Turns an exception of users' code that would end the process, but not Ctrl-C, into an InputError."""
    try:
        yield
    except BaseException as error:
        if isinstance(error, Exception) or type(error) is KeyboardInterrupt:
            raise
        places = [f"{frame.filename}, line {frame.lineno}" for frame in extract_tb(error.__traceback__)]
        where = [place for place in places if not place.startswith(("<", __file__))][-1:]
        what = f"{shortened(repr(error))} would end this process"
        raise InputError(f"{': '.join([*where, what])}.") from error


def keep_running() -> None:
    """Makes functions such as `os._exit` raise SystemExit in this process, though not in its children."""
    for name in ("_exit", "abort", "execv", "execve"):
        replacement = partial(_end, os.getpid(), name, getattr(os, name))
        setattr(os, name, replacement)
        setattr(posix, name, replacement)


def _end(process: int, name: str, function: Callable[..., object], *arguments: object) -> None:
    if os.getpid() == process:
        raise SystemExit(f"os.{name}")
    function(*arguments)


@contextmanager
def needed_by(what: str) -> Iterator[None]:
    """Turns the failed import of a package of this project's extras into a MissingPackageError."""
    try:
        yield
    except MissingPackageError:
        raise
    except ModuleNotFoundError as error:
        missing = _missing(error)
        if missing is None or not _installer(missing):
            raise
        raise missing_package(what, missing) from error


def missing_package(what: str, module: str) -> MissingPackageError:
    """Returns the error that something needs a package, given as the module that is not installed."""
    needed = f"{what} needs the package {package_of(module)}, which is not installed"
    return MissingPackageError(f"{needed}{_installer(module)}.", name=module)


def _missing(error: BaseException) -> str | None:
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return None
    module = error.name.partition(".")[0]
    # If the package is installed, only this version of it lacks the submodule.
    return module if find_spec(module) is None else None


def _installer(module: str) -> str:
    for extra, packages in extras().items():
        if package_of(module) in packages:
            mark = ".venv/.base" if extra == "reproduce" else f".venv/.{extra}"
            elsewhere = f"pip install 'CHECKOUT[{extra}]' elsewhere, where CHECKOUT is its path"
            return f"; in a checkout of this project, make {mark} installs it, and {elsewhere}"
    return ""
