"""Runs experiments, publishes and reports their runs; see `python -m benchmark --help`."""

import sys

if sys.argv[:1] == ["-m"]:  # this process runs a command
    # Python looks for modules in the current folder first. What lies there must not run in place of
    # what is imported next.
    if __file__ != f"{sys.path[0]}/benchmark/__init__.py":
        del sys.path[: not sys.flags.safe_path]
    import signal

    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:  # it would print a traceback
        signal.signal(signal.SIGINT, signal.SIG_DFL)

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

__version__ = "0.11.0"

for _name in ("agents", "envs"):  # names that others use, too
    _spec = find_spec(_name)
    if _spec and Path(_spec.origin or "").parent.parent != Path(__file__).parent.parent:
        _found = _spec.origin or _spec.submodule_search_locations
        _ours = f"this project's package {_name}"
        raise ImportError(f"{_found} is found in place of {_ours}; rename it.")


def __getattr__(name: str) -> Any:
    """Imports `runs` and `curves`, which need pandas, when somebody asks for them."""
    if name in ("curves", "runs"):
        return getattr(import_module("benchmark.tables"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
