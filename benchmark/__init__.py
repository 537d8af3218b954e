"""Runs experiments, stores their records and publishes reports; see `python -m benchmark --help`."""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

__version__ = "0.11.0"

# Others have packages of these names, too. Ours are known by a word in their `__init__.py`.
for _name, _word in (("agents", b"load_algorithm"), ("envs", b"Proxemic/")):
    _spec = find_spec(_name)
    _file = Path((_spec and _spec.origin) or "")  # a folder without `__init__.py` has none
    if _spec and not (_file.is_file() and _word in _file.read_bytes()):
        _found = (_spec.submodule_search_locations or [str(_file)])[0]
        _advice = "rename it, start Python elsewhere, or, if pip installed it, use another environment"
        _sentence = f"{_found} is found in place of this project's package {_name}; {_advice}."
        # -m is what Python sets until it has found the module of a command.
        if Path((sys.argv or [""])[0]).stem in ("-m", "proxemic-benchmark"):
            print(f"error: {_sentence}", file=sys.stderr)
            sys.exit(2)
        raise ImportError(_sentence)


def __getattr__(name: str) -> Any:
    """Imports `runs` and `curves`, which need pandas, when somebody asks for them."""
    if name in ("curves", "runs"):
        return getattr(import_module("benchmark.frames"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
