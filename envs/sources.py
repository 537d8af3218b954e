"""Users' own modules, which have no version: where they are, and what they depend on."""

import ast
import hashlib
import importlib
import json
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.util import find_spec, resolve_name
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


def find_modules_in(folder: str) -> None:
    """Has modules found in a folder, after all others, here and in workers that start later."""
    for folders in (SEARCHED, sys.path):
        if folder not in folders:
            folders.append(folder)


def digest_of_source(module: str) -> str:
    """Returns the digest of what a user's module depends on; empty if there is no such module.

    It is the same in every process, and counts:

    - the sources of the module and of the users' modules that they import
    - once the module has been imported, its global variables that are numbers, arrays or tuples of
      these, wherever the values are from, and those of the users' modules that it has objects of

    Variables that a function declares `global` do not count, since they may change, nor does code
    with a version: installed packages, Python's library and this project. What a function reads
    when it is called, such as a file, and modules under names composed at run time, cannot be seen.
    """
    importlib.invalidate_caches()
    trees: dict[str, ast.Module] = {}
    counted, names = list[str](), [module]
    for name in names:  # which grows
        with suppress(Exception):  # not found, not a user's, no file or no Python
            spec = _user_spec(name)
            source = Path(spec.origin).read_bytes()
            counted.append(f"{name} {hashlib.sha256(source).hexdigest()}")
            tree = trees[name] = ast.parse(source)
            package = name if spec.submodule_search_locations else name.rpartition(".")[0]
            names += {package, *_imports(tree, package)}.difference(names)
    counted += _numbers(module, trees)
    return hashlib.sha256(repr(sorted(counted)).encode()).hexdigest() if counted else ""


@cache
def digest_when_loaded(module: str) -> str:
    """Returns the digest when this process first asked for it: modules stay as they were imported.

    Imports the module if it is a user's. Ask when it has been imported, not while.
    """
    if digest_of_source(module):
        with suppress(Exception), contained():  # who uses the module says what is wrong with it
            importlib.import_module(module)
    return digest_of_source(module)


def _user_spec(name: str) -> Any:
    """Finds a user's module; None if there is no such module."""
    spec: Any = None if name.partition(".")[0] in _OURS else find_spec(name)
    path = Path(spec.origin)
    return None if path.is_relative_to(_LIBRARY) or _INSTALLED & {*path.parts} else spec


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Yields what a module may import: modules, and perhaps their attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            outer = resolve_name("." * node.level + (node.module or ""), package)
            yield from (outer, *(f"{outer}.{alias.name}" for alias in node.names))


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
