"""Users' own modules, which have no version: where they are, and what they depend on."""

import ast
import hashlib
import importlib
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any

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


@cache
def digest_of_source(module: str) -> str:
    """Returns the digest of a user's module when this process first asked for it, or "".

    It counts the sources of the module and of the users' modules that they import, but no code with
    a version: installed packages, Python's library and this project. Files that functions read, and
    modules under names composed at run time, cannot be seen.
    """
    importlib.invalidate_caches()
    counted, names = list[str](), [module]
    for name in names:  # which grows
        with suppress(Exception):  # not found, not a user's, no file or no Python
            spec = _user_spec(name)
            source = Path(spec.origin).read_bytes()
            counted.append(f"{name} {hashlib.sha256(source).hexdigest()}")
            package = name if spec.submodule_search_locations else name.rpartition(".")[0]
            names += {package, *_imports(ast.parse(source), package)}.difference(names)
    return hashlib.sha256(repr(sorted(counted)).encode()).hexdigest() if counted else ""


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
