"""Users' own modules, which have no version: where they are, and what they depend on."""

import ast
import hashlib
import importlib
import os
import re
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, resolve_name
from itertools import product
from pathlib import Path
from typing import Any

# Folders of experiments and scenarios that were read, where Python also looks for modules.
SEARCHED: list[str] = []
_LIBRARY = Path(sysconfig.get_path("stdlib"))
_INSTALLED = {"site-packages", "dist-packages"}
_OURS = {"agents", "benchmark", "envs"}
# Environment variables that this project sets, in some processes only.
VARIABLES = {"MPLBACKEND": "agg", "MKL_CBWR": "AVX2", "ATEN_CPU_CAPABILITY": "avx2"}
_READING = re.compile(r"\b(?:environ|getenv)\b\W*(?:get\W+)?(\w+)")  # a variable


def find_modules_in(folder: str) -> None:
    """Has modules found in a folder, after all others, here and in workers that start later."""
    for folders in (SEARCHED, sys.path):
        if folder not in folders:
            folders.append(folder)


def digest_of_source(module: str) -> str:
    """Returns the digest of what a user's module depends on; empty if there is no such module.

    It is the same in every process, and counts:

    - the sources of the module and of all modules that they import, or name in a text
    - the content of files that a text in these sources names, relative to the folder of its module
      or to the current one, or by its absolute path
    - the values of environment variables that they read by name, but for those that this project
      sets

    Code with a version does not count: installed packages, Python's library and this project. Nor
    does what is imported or read under a name that is composed at run time.
    """
    importlib.invalidate_caches()
    specs: dict[str, Any] = {}
    counted: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        package = name.rpartition(".")[0]
        if package and package not in specs:  # which is imported first
            waiting += [name, package]
        elif name not in specs:
            spec = specs[name] = _user_spec(name, specs.get(package))
            with suppress(Exception):  # not found, no file or no Python
                source = spec.loader.get_data(spec.origin)
                counted.add(f"{name} {_digest(source)}")
                tree = ast.parse(source)
                texts = _texts(tree)
                inside = name if spec.submodule_search_locations else package
                waiting += [*texts, *_imports(tree, inside)]
                counted |= {*_data(tree, texts, Path(spec.origin).parent)}
    return _digest(repr(sorted(counted)).encode()) if counted else ""


# The digest when this process first asked for it, since modules stay as they were imported.
digest_when_loaded = cache(digest_of_source)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _user_spec(name: str, outer: Any) -> Any:
    """Finds a user's module, in its package if it has one; None if there is no such module."""
    package, _, last = name.rpartition(".")
    with suppress(Exception):  # whatever a finder raises
        folders = [*outer.submodule_search_locations] if package else None
        spec: Any = PathFinder.find_spec(last, folders) if package else find_spec(name)
        path = Path(spec.origin or "")
        is_installed = path.is_relative_to(_LIBRARY) or _INSTALLED & {*path.parts}
        return None if is_installed or name in _OURS else spec
    return None


def _texts(tree: ast.AST) -> set[str]:
    constants = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return {text for text in constants if isinstance(text, str)}


def _data(tree: ast.Module, texts: Iterable[str], folder: Path) -> Iterator[str]:
    """Yields the files and environment variables that a module names, and what they contain."""
    for root, text in product((folder, Path.cwd()), texts):
        with suppress(OSError, ValueError):  # no path, or a file that may not be read
            if (path := root / text).is_file():
                yield f"{text} {_digest(path.read_bytes())}"
    for name in _READING.findall(ast.unparse(tree)):
        if name not in VARIABLES:
            yield f"{name}={os.environ.get(name)}"


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Yields what a module of a package may import: modules, perhaps their attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            outer = resolve_name("." * node.level + (node.module or ""), package)
            yield from (f"{outer}.{alias.name}" for alias in node.names)
