"""Users' own modules, which have no version: where they are found, and the digest of their sources."""

import ast
import hashlib
import importlib
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any, Final

# Folders of experiments and scenarios that were read, where Python also looks for modules.
SEARCHED: Final[list[str]] = []
_LIBRARY: Final = Path(sysconfig.get_path("stdlib"))
_INSTALLED: Final = {"site-packages", "dist-packages"}
_OURS: Final = {"agents", "benchmark", "envs"}


def find_modules_in(folder: str) -> None:
    """Has modules found in a folder, after all others, here and in worker processes that start later."""
    if folder not in SEARCHED:
        SEARCHED.append(folder)
    if folder not in sys.path:
        sys.path.append(folder)


def digest_of_source(module: str) -> str:
    """Returns the digest of a user's module and of all that it imports; empty if there is no such module.

    Import statements are read from the sources, wherever they stand; nothing is imported. Code with a
    version does not count: installed packages, Python's library and this project.
    """
    importlib.invalidate_caches()
    specs: dict[str, Any] = {}
    sources: dict[str, bytes] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        package, _, last = name.rpartition(".")
        if package and package not in specs:  # which is imported first
            waiting += [name, package]
        elif name not in specs:
            specs[name] = None
            with suppress(Exception):  # no such module, no file or no Python: whatever a finder raises
                folders = [*specs[package].submodule_search_locations] if package else None
                spec: Any = PathFinder.find_spec(last, folders) if package else find_spec(name)
                path = Path(spec.origin or "")
                if not (path.is_relative_to(_LIBRARY) or _INSTALLED & {*path.parts} or name in _OURS):
                    specs[name] = spec
                    sources[name] = spec.loader.get_data(spec.origin)
                    package = name if spec.submodule_search_locations else package
                    waiting += _imports(ast.parse(sources[name]), package)
    digests = (f"{name}\0{hashlib.sha256(sources[name]).hexdigest()}\0" for name in sorted(sources))
    return hashlib.sha256("".join(digests).encode()).hexdigest() if sources else ""


# The digest when this process first asked for it: modules stay as they were imported.
digest_when_loaded: Final = cache(digest_of_source)


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Yields the names that a module of a package imports: modules, and perhaps their attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            outer = resolve_name("." * node.level + (node.module or ""), package)
            yield from (f"{outer}.{alias.name}" for alias in node.names)
