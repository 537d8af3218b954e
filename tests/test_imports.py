"""What imports leave alone: the settings of the user's process and of other packages."""

import os
import subprocess
import sys
from importlib.metadata import packages_distributions
from typing import Final

from envs.packages import extras, package_of
from tests.support import ROOT

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


def test_imports_change_nothing_in_the_users_process() -> None:
    packages = {name for extra, names in extras().items() if extra != "dev" for name in names}
    names = [name for name in packages_distributions() if package_of(name) in packages]
    ours = ("MKL_CBWR", "ATEN_CPU_CAPABILITY")  # which these tests have set, see `tests/conftest.py`
    environment = {name: value for name, value in os.environ.items() if name not in ours}
    command = [sys.executable, "-c", CODE, *names]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")
