"""Users' own modules, which have no version: where they are, and what they depend on."""

import ast
import hashlib
import importlib
import json
import os
import re
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, resolve_name
from itertools import product
from pathlib import Path
from typing import Any

from envs.packages import contained

# Folders of experiments and scenarios that were read, where Python also looks for modules.
SEARCHED: list[str] = []
_LIBRARY = Path(sysconfig.get_path("stdlib"))
_INSTALLED = {"site-packages", "dist-packages"}
_OURS = {"agents", "benchmark", "envs"}
# Environment variables that this project sets, in some processes only.
VARIABLES = {"MPLBACKEND": "agg", "MKL_CBWR": "AVX2", "ATEN_CPU_CAPABILITY": "avx2"}
_READING = ast.Call, ast.Subscript, ast.Compare  # of the environment
_LONGEST = 200  # characters of a name in a text


def find_modules_in(folder: str) -> None:
    """Has modules found in a folder, after all others, here and in workers that start later."""
    for folders in (SEARCHED, sys.path):
        if folder not in folders:
            folders.append(folder)


def digest_of_source(module: str) -> str:
    """Returns the digest of what a user's module depends on; empty if there is no such module.

    It is the same in every process, and counts:

    - the sources of the module and of the modules that they import, or name in a text, as dynamic
      imports do
    - the content of files that a text in these sources names, relative to the folder of its module
      or to the current one, or by its absolute path
    - the values of environment variables that they name where they read the environment, but for
      those that this project sets
    - once the module has been imported, its global variables that are numbers, arrays or tuples of
      these, wherever the values are from, and those of the users' modules that it has objects of:
      compiled code has them as constants

    Variables that a function declares `global` do not count, since they may change, nor does code
    with a version: installed packages, Python's library and this project. What a function reads
    when it is called, under a name composed at run time, cannot be seen. A number that differs in
    every process, such as the time, makes runs unrepeatable anyway.
    """
    importlib.invalidate_caches()
    specs: dict[str, Any] = {}
    trees: dict[str, ast.Module] = {}
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
                tree = trees[name] = ast.parse(source)
                waiting += _imports(tree, name if spec.submodule_search_locations else package)
                counted |= {*_data(tree, Path(spec.origin).parent)}
    counted |= {*_numbers(module, trees)}
    return _digest(repr(sorted(counted)).encode()) if counted else ""


@cache
def digest_when_loaded(module: str) -> str:
    """Returns the digest when this process first asked for it: modules stay as they were imported.

    Imports the module if it is a user's. Ask when it has been imported, not while.
    """
    if digest_of_source(module):
        with suppress(Exception), contained():  # who uses the module says what is wrong with it
            importlib.import_module(module)
    return digest_of_source(module)


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
    values = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return {text for text in values if isinstance(text, str) and len(text) < _LONGEST}


def _data(tree: ast.Module, folder: Path) -> Iterator[str]:
    """Yields files and environment variables that a module names, and digests of their contents."""
    for root, text in product((folder, Path.cwd()), _texts(tree)):
        with suppress(OSError, ValueError):  # no path, or a file that may not be read
            if (path := root / text).is_file():
                yield f"{text} {_digest(path.read_bytes())}"
    for node in ast.walk(tree):
        if isinstance(node, _READING) and re.search(r"\b(environ|getenv)\b", ast.unparse(node)):
            names = _texts(node) & os.environ.keys() - VARIABLES.keys()
            yield from (f"{name}={os.environ[name]}" for name in names)


def _numbers(module: str, trees: Mapping[str, ast.Module]) -> Iterator[str]:
    """Yields the global numbers of a loaded module, and of users' modules whose objects it has."""
    waiting = [*({module} & trees.keys())]
    for name in waiting:  # which grows
        nodes = [node for node in ast.walk(trees[name]) if isinstance(node, ast.Global)]
        changing = {each for node in nodes for each in node.names}
        for key, value in [*getattr(sys.modules.get(name), "__dict__", {}).items()]:
            with suppress(Exception):  # no number, or an object that does not say where it is from
                origin = getattr(value, "__module__", "") or getattr(value, "__name__", "")
                if origin in trees and origin not in waiting:
                    waiting.append(origin)
                if not isinstance(value, (str, list, dict)) and key not in changing:
                    numbers = json.dumps(value, default=_array)
                    yield f"{name}.{key}={numbers}"


def _array(array: Any) -> list[Any]:
    return [str(array.dtype), array.tolist()]


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Yields what a module may import: modules, perhaps their attributes, and texts."""
    yield from (package * text.startswith(".") + text for text in _texts(tree))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            outer = resolve_name("." * node.level + (node.module or ""), package)
            yield from (f"{outer}.{alias.name}" for alias in node.names)
