"""Users' own modules, which have no version: where they are, and what they depend on.

A module that a file names is looked for where Python does, then beside the file, then in the
current folder; what it imports, in its own folder, too. `sys.path` stays as it is, so nothing else
that lies there can be imported.
"""

import ast
import hashlib
import importlib
import inspect
import json
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import PathFinder
from importlib.util import find_spec, resolve_name
from pathlib import Path
from types import FrameType, FunctionType, ModuleType
from typing import Any

import numpy as np

from envs.inputs import InputError, guess, shortened
from envs.packages import contained, installer, missing

# Folders of experiments and scenarios that were read, the last one first.
_SEARCHED: list[str] = []
# Users' modules, without those inside packages, and the folder of each.
FOUND: dict[str, str] = {}
_LIBRARY = Path(sysconfig.get_path("stdlib"))
_INSTALLED = {"site-packages", "dist-packages"}
_OURS = {"agents", "benchmark", "envs"}


class _Finder(MetaPathFinder):
    """Finds modules in `FOUND`, and those that they import from the same folder."""

    def find_spec(self, name: str, path: object = None, _: object = None) -> Any:
        """Returns where a module is; None if it is part of a package, or not a user's."""
        folder = None if path else FOUND.get(name) or FOUND.get(_importer(inspect.currentframe()))
        spec = PathFinder.find_spec(name, [folder]) if folder else None
        if spec and folder:
            FOUND[name] = folder
        return spec


_FINDER = _Finder()


def _importer(frame: FrameType | None) -> str:
    """Returns the module, or the package that has it, whose code imports another one."""
    name = "importlib"
    while frame and name in ("importlib", "pkgutil"):
        frame = frame.f_back
        name = str(frame.f_globals.get("__name__")).partition(".")[0] if frame else ""
    return name


def search_beside(path: Path) -> None:
    """Adds a file's folder to those where `find_module` looks."""
    folder = str(path.resolve().parent)
    _SEARCHED[:] = [folder, *(each for each in _SEARCHED if each != folder)]


def find_module(name: str) -> bool:
    """Has a module found that a file names; returns whether there is one.

    It is looked for where Python does, then beside the files that were read, then in the current
    folder. An InputError says that another one of this name has been found before.
    """
    whole, _, _ = name.partition(".")
    found = _found(whole, [*_SEARCHED, str(Path.cwd())])
    return found or whole in sys.modules or find_spec(whole) is not None


def _found(name: str, folders: Sequence[str]) -> bool:
    """Returns whether a module is in one of some folders, and not where Python looks for it."""
    if name not in FOUND and (name in sys.modules or find_spec(name)):
        return False
    for folder in folders:
        if PathFinder.find_spec(name, [folder]):
            use_modules({name: folder})
            return True
    return False


def use_modules(found: Mapping[str, str]) -> None:
    """Has users' modules found, given the folder of each; refuses those known from elsewhere."""
    if _FINDER not in sys.meta_path:
        sys.meta_path.append(_FINDER)  # last, so that users' modules hide no others
    for name, folder in found.items():
        if FOUND.setdefault(name, folder) != folder:
            what = f"module {name} in {folder}: one of this name is in use from {FOUND[name]}"
            raise InputError(f"{what}; accepted: another name, or a new process.")


def imported(name: str, source: str, kind: str) -> object:
    """Imports the object that a source names as `module:attribute`, or raises an InputError."""
    module, _, attribute = name.partition(":")
    if not attribute:
        raise InputError(f"{source}: {kind} {shortened(name)}: accepted: module:attribute.")
    loaded: ModuleType | None = None
    try:
        with contained():
            find_module(module)
            loaded = importlib.import_module(module)
            return getattr(loaded, attribute)
    except Exception as error:  # a module can raise anything
        reason = str(error).removesuffix(".")
        hint = installer(missing(error)) if loaded is None else guess(attribute, dir(loaded))
        raise InputError(
            f"{source}: {kind} {shortened(name)} cannot be imported: {reason}{hint}."
        ) from error


def digest_of_source(module: str) -> str:
    """Returns the digest of what a user's module depends on; empty if there is no such module.

    It is the same in every process, and counts:

    - the sources of the module and of the users' modules that they import, also by `import_module`
    - once the module has been imported, its global variables that are numbers, texts without a
      slash (others may be paths), bytes, arrays or tuples of these, wherever the values are from;
      what its functions have of these as defaults and in closures; and the same for users' modules
      whose objects it holds

    Variables that a function declares `global`, lists, dicts and attributes of users' objects do
    not count, since they may change, nor does code with a version: installed packages, Python's
    library and this project. What a function reads when it is called, such as a file, and modules
    under names composed at run time, cannot be seen.
    """
    importlib.invalidate_caches()
    trees: dict[str, ast.Module] = {}
    counted, names = list[str](), [module]
    for name in names:  # which grows
        with suppress(Exception):  # not found, not a user's, no file or no Python
            spec = _user_spec(name, FOUND.get(module.partition(".")[0], ""))
            source = Path(spec.origin).read_bytes()
            counted.append(f"{name} {hashlib.sha256(source).hexdigest()}")
            tree = trees[name] = ast.parse(source)
            package = name if spec.submodule_search_locations else name.rpartition(".")[0]
            loaded = getattr(sys.modules.get(name), "__dict__", {}).values()
            modules = {each.__name__ for each in loaded if isinstance(each, ModuleType)}
            # Which of a package's own modules are loaded differs between processes.
            others = {each for each in modules if not each.startswith(f"{name}.")}
            names += {package, *_imports(tree, package), *others}.difference(names)
    counted += _constants(module, trees)
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


def _user_spec(name: str, folder: str) -> Any:
    """Finds a user's module, perhaps in a folder; None if there is no such module."""
    whole, _, _ = name.partition(".")
    if whole not in _OURS and folder:
        _found(whole, [folder])
    spec: Any = None if whole in _OURS else find_spec(whole)
    path = Path(spec.origin or next(iter(spec.submodule_search_locations)))
    if path.is_relative_to(_LIBRARY) or _INSTALLED & {*path.parts}:
        return None
    return find_spec(name)  # which imports the packages that it is in


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Yields what a module may import: modules, and perhaps their attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            outer = resolve_name("." * node.level + (node.module or ""), package)
            yield from (outer, *(f"{outer}.{alias.name}" for alias in node.names))
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            is_import = ast.unparse(node.func).endswith(("import_module", "__import__"))
            yield str(node.args[0].value) if is_import else package


def _constants(module: str, trees: Mapping[str, ast.Module]) -> Iterator[str]:
    """Yields the constants of a loaded module, and of users' modules whose objects it has."""
    waiting = [*({module} & trees.keys())]
    for name in waiting:  # which grows
        nodes = [node for node in ast.walk(trees[name]) if isinstance(node, ast.Global)]
        changing = {each for node in nodes for each in node.names}
        for key, value in [*getattr(sys.modules.get(name), "__dict__", {}).items()]:
            with suppress(Exception):  # an object that does not say what it is, or where from
                origin = getattr(value, "__module__", "") or getattr(value, "__name__", "")
                if origin in trees and origin not in waiting:
                    waiting.append(origin)
                constant = json.dumps(_constant(value), default=_constant)
                if constant != "null" and key not in changing:
                    yield f"{name}.{key}={constant}"


def _constant(value: Any) -> Any:
    """Returns what counts of a value, see `digest_of_source`; None if that is nothing."""
    value = getattr(value, "py_func", value)  # of a function that numba compiles
    match value:
        case bool() | int() | float() | tuple():
            return value
        case str():
            return None if "/" in value else value
        case complex() | bytes():
            return repr(value)
        case np.ndarray() | np.generic():
            return [str(value.dtype), value.tolist()]
        case FunctionType():
            held = [cell.cell_contents for cell in value.__closure__ or ()]
            held += [*(value.__defaults__ or ()), *(value.__kwdefaults__ or {}).values()]
            return [_constant(each) for each in held]
        case _ if type(value).__module__.startswith("agents."):  # it has a user's functions
            return [*map(_constant, vars(value).values())]
    return None
