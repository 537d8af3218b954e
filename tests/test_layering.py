"""Imports go one way, load no more than is needed, and change nothing in the user's process."""

import ast
import os
import subprocess
import sys
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Final

import pytest

from envs.packages import extras, package_of
from tests.support import ROOT

LAYERS = ("envs", "agents", "benchmark", "tests")


@cache
def imported(path: Path) -> set[str]:
    """Returns the top-level names a file imports, wherever in it the import stands."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module).split(".")[0])
    return names


@pytest.mark.parametrize("layer", LAYERS)
def test_no_arrow_points_backwards(layer: str) -> None:
    above = set(LAYERS[LAYERS.index(layer) + 1 :])
    files = sorted((ROOT / layer).rglob("*.py"))
    assert files
    for path in files:
        assert not imported(path) & above, path


def test_only_the_deep_learners_load_torch() -> None:
    loading = {
        str(path.relative_to(ROOT))
        for layer in LAYERS[:3]
        for path in (ROOT / layer).rglob("*.py")
        if imported(path) & {"torch", "stable_baselines3"}
    }
    assert loading == {f"agents/sb3/{name}.py" for name in ("extractors", "tables", "training", "vec_env")}


@pytest.mark.parametrize(
    ("code", "not_loaded"),
    [
        ("import benchmark; assert not hasattr(benchmark, 'walks')", {"pandas"}),
        (
            """from benchmark.experiments import *
from benchmark.execution import driver
from benchmark.publish import draw
all_specifications(load_experiment('compare_deep'))""",
            {"torch", "stable_baselines3", "rliable"},
        ),
        ("from benchmark.__main__ import main; main(['list'])", {"torch", "pandas", "matplotlib"}),
    ],
)
def test_packages_are_loaded_only_when_they_are_needed(code: str, not_loaded: set[str]) -> None:
    code += f"\nimport sys; assert not {not_loaded} & {{*sys.modules}}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_only_the_store_knows_how_results_are_kept() -> None:
    for layer in LAYERS[:3]:
        for path in (ROOT / layer).rglob("*.py"):
            assert ("sqlite3" in imported(path)) == (path.name == "store.py"), path


# Packages that this project uses have settings of their own, so they are imported before.
CODE: Final = """
import importlib, locale, logging, multiprocessing, os, pkgutil, random, signal, sys, threading, warnings
import gymnasium, matplotlib, numpy, pandas, rich.console, scipy.optimize, scipy.signal, scipy.stats, torch
from matplotlib import pyplot

matplotlib.use("template")
for name in sys.argv[1:]:
    importlib.import_module(name)
loggers = [log for log in logging.root.manager.loggerDict.values() if isinstance(log, logging.Logger)]


def state():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options = {name: str(value) for name, value in pandas.options.d.items()}
    return {
        "matplotlib": ({**matplotlib.rcParams}, pyplot.get_backend(), pyplot.get_fignums()),
        "environment": {**os.environ},
        "warnings": ([*warnings.filters], warnings.showwarning),
        "numpy": (numpy.geterr(), numpy.get_printoptions(), str(numpy.random.get_state())),
        "random": random.getstate(),
        "torch": (torch.get_num_threads(), torch.get_default_dtype(), torch.get_rng_state().tolist()),
        "torch's numbers": (torch.tensor([1e-40]).mul(1).item(), torch.is_grad_enabled()),
        "pandas": options,
        "locale": locale.setlocale(locale.LC_ALL),
        "logging": (logging.root.level, [*logging.root.handlers], [log.level for log in loggers]),
        "modules": ([*sys.path], [*sys.meta_path], [*sys.path_hooks], sys.excepthook, sys.displayhook),
        "processes": (multiprocessing.get_start_method(allow_none=True), threading.active_count()),
        "signals": {number: signal.getsignal(number) for number in signal.valid_signals()},
        "process": (os.getcwd(), sys.getrecursionlimit(), sys.stdout, sys.stderr),
    }


before = state()
for package in ("envs", "agents", "benchmark"):
    folders = importlib.import_module(package).__path__
    for module in pkgutil.walk_packages(folders, f"{package}."):
        importlib.import_module(module.name)
after = state()
print([name for name in before if repr(before[name]) != repr(after[name])])
"""


@pytest.mark.slow
def test_imports_change_nothing_in_the_users_process() -> None:
    packages = {name for extra, names in extras().items() if extra != "dev" for name in names}
    names = [name for name in packages_distributions() if package_of(name) in packages]
    ours = ("MKL_CBWR", "ATEN_CPU_CAPABILITY")  # which these tests have set, see `tests/conftest.py`
    environment = {name: value for name, value in os.environ.items() if name not in ours}
    command = [sys.executable, "-c", CODE, *names]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")
