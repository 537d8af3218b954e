"""Imports go one way, load no more than is needed, and change nothing in the user's process."""

import ast
import os
import subprocess
import sys
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from envs.packages import extras, package_of
from tests.support import ROOT

LAYERS = ("envs", "agents", "benchmark", "tests")
MAX_FLOORS = 8  # of modules in `benchmark`, each of which imports from floors below alone
MAX_FILES = 33  # of Python, but in `experiments` and `page`
NETS = {"torch", "stable_baselines3"}


@cache
def imports(path: Path) -> frozenset[str]:
    """Returns the modules that a file imports, or of which it imports names, wherever it does."""
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def imported(path: Path) -> set[str]:
    """Returns the top-level names that a file imports."""
    return {name.partition(".")[0] for name in imports(path)}


@pytest.mark.parametrize("layer", LAYERS)
def test_no_arrow_points_backwards(layer: str) -> None:
    above = {*LAYERS[LAYERS.index(layer) + 1 :]}
    files = sorted((ROOT / layer).rglob("*.py"))
    assert files
    assert [path for path in files if imported(path) & above] == []


def test_the_benchmark_has_few_files_on_few_floors() -> None:
    house = ROOT / "benchmark"
    files = [p for p in house.rglob("*.py") if {"experiments", "page"}.isdisjoint(p.parts)]
    assert len(files) <= MAX_FILES
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path
        for path in house.rglob("*.py")
        if path.name != "__main__.py"  # which imports commands by name
    }
    below = {
        name: {other for other in modules if any(f"{i}.".startswith(f"{other}.") for i in found)}
        for name, found in ((name, imports(path)) for name, path in modules.items())
    }
    floors = 0
    while below:
        free = {name for name, others in below.items() if not others - {name}}
        assert free, f"imports go round in circles: {below}"
        below = {name: others - free for name, others in below.items() if name not in free}
        floors += 1
    assert floors <= MAX_FLOORS


def test_only_some_modules_know_torch_and_the_store() -> None:
    sources = [path for layer in LAYERS[:3] for path in (ROOT / layer).rglob("*.py")]
    loading = {str(path.relative_to(ROOT)) for path in sources if imported(path) & NETS}
    tools = ("extractors", "tables", "training", "vec_env")
    assert loading <= {"benchmark/callback.py", *(f"agents/sb3/{name}.py" for name in tools)}
    storing = [path.name for path in sources if "sqlite3" in imported(path)]
    assert storing == ["store.py"]


@pytest.mark.parametrize(
    ("code", "not_loaded"),
    [
        ("import benchmark; assert not hasattr(benchmark, 'walks')", {"pandas"}),
        (
            """from benchmark import experiment, run, report
experiment.load_experiment('reproduce').populations[0].runs()""",
            NETS,
        ),
        ("from benchmark.__main__ import main; main(['list'])", NETS | {"matplotlib"}),
    ],
)
def test_packages_are_loaded_only_when_they_are_needed(code: str, not_loaded: set[str]) -> None:
    code += f"\nimport sys; assert not {not_loaded} & {{*sys.modules}}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# Packages that this project uses have settings of their own, so they are imported before.
CODE = """
import importlib, locale, logging, multiprocessing, os, pkgutil, random, signal, sys, threading
import warnings
import gymnasium, matplotlib, numpy, pandas, rich.console, scipy.optimize, scipy.signal, scipy.stats
import torch
from matplotlib import pyplot

matplotlib.use("template")
for name in sys.argv[1:]:
    importlib.import_module(name)


def state():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options = {name: str(value) for name, value in pandas.options.d.items()}
    numbers = torch.get_num_threads(), torch.get_default_dtype(), torch.get_rng_state().tolist()
    return {
        "matplotlib": ({**matplotlib.rcParams}, pyplot.get_backend(), pyplot.get_fignums()),
        "environment": {**os.environ},
        "warnings": ([*warnings.filters], warnings.showwarning),
        "numpy": (numpy.geterr(), numpy.get_printoptions(), str(numpy.random.get_state())),
        "random": random.getstate(),
        "torch": (*numbers, torch.tensor([1e-40]).mul(1).item(), torch.is_grad_enabled()),
        "pandas": options,
        "locale": locale.setlocale(locale.LC_ALL),
        "logging": (logging.root.level, [*logging.root.handlers]),
        "modules": ([*sys.path], [*sys.meta_path], sys.excepthook, sys.displayhook),
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
    ours = ("MKL_CBWR", "ATEN_CPU_CAPABILITY")  # which these tests have set
    environment = {name: value for name, value in os.environ.items() if name not in ours}
    command = [sys.executable, "-c", CODE, *names]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")
