"""Code of users: where its modules are found, and the digest of their sources.

Only code that has no version counts: no installed packages, nor Python's library, nor this project.
"""

import ast
import hashlib
import importlib
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec, resolve_name
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, Final

# Folders of experiments and scenarios that were read, where Python also looks for modules.
SEARCHED: Final[list[str]] = []
_OURS: Final = ("agents", "benchmark", "envs")
_INSTALLED: Final = {"site-packages", "dist-packages"}
_LIBRARY: Final = Path(sysconfig.get_path("stdlib"))


def find_modules_in(folder: str) -> None:
    """Has modules found in a folder, after all others, here and in worker processes that start later."""
    if folder not in SEARCHED:
        SEARCHED.append(folder)
    if folder not in sys.path:
        sys.path.append(folder)


def digest_of_source(module: str) -> str:
    """Returns the digest of a user's module and of those that it imports; empty if there is no such module.

    Imports are read from the sources, wherever they stand in them; nothing is imported.
    """
    importlib.invalidate_caches()
    specs: dict[str, ModuleSpec | None] = {}
    sources: dict[str, bytes] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        package, _, last = name.rpartition(".")
        if package and package not in specs:  # which is imported first
            waiting += [name, package]
        elif last == "*":
            waiting += [f"{package}.{inner.name}" for inner in iter_modules(_folders(specs[package]))]
        elif name not in specs:
            specs[name] = spec = _spec(name, specs)
            loader: Any = spec and spec.loader
            with suppress(OSError, AttributeError):  # a folder that is a package has no source
                sources[name] = loader.get_data(spec.origin)
                package = name if _folders(spec) else package
                with suppress(SyntaxError, ValueError, RecursionError, MemoryError):  # no Python
                    waiting += _imports(ast.parse(sources[name]), package)
    digests = (f"{name}\0{hashlib.sha256(sources[name]).hexdigest()}\0" for name in sorted(sources))
    return hashlib.sha256("".join(digests).encode()).hexdigest() if sources else ""


@cache
def digest_when_loaded(module: str) -> str:
    """Returns the same as it was when this process first asked: what it has imported stays as it was."""
    return digest_of_source(module)


def _spec(name: str, specs: Mapping[str, ModuleSpec | None]) -> ModuleSpec | None:
    """Returns where a user's module is, given where its package is; None if there is no such module."""
    package, _, last = name.rpartition(".")
    spec = None
    with suppress(Exception):  # whatever a finder raises
        if package:
            spec = PathFinder.find_spec(last, _folders(specs[package]))
        elif name not in _OURS:
            spec = find_spec(name)
    path = Path(spec.origin if spec and spec.has_location and spec.origin else "")
    return None if _INSTALLED & {*path.parts} or path.is_relative_to(_LIBRARY) else spec


def _folders(package: ModuleSpec | None) -> list[str]:
    return [*(package and package.submodule_search_locations or ())]


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Yields the names that a module of a package imports; some may be no modules, but what is in them."""
    for node in ast.walk(tree):
        names: list[str] = []
        match node:
            case ast.Import(names=imported):
                names = [alias.name for alias in imported]
            case ast.ImportFrom(module=module, names=imported, level=level):
                outer = "." * level + (f"{module}." if module else "")
                names = [outer + alias.name for alias in imported]
            case ast.Call(
                func=ast.Name(id="import_module" | "__import__") | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                names = [name]
        for name in names:
            with suppress(ImportError):  # from outside of all packages
                yield resolve_name(name, package)
