"""What learns, plans and judges. `ALGORITHMS` is the one table from a name to an algorithm.

An algorithm is a module with `VERSION`, `Settings` (an `envs.inputs.Table`) and `train`. Modules are
imported when asked for, so that a table of Q-values does not wait for a deep-learning library.
"""

from importlib import import_module
from typing import Any, Final

from envs.inputs import unknown_name

ALGORITHMS: Final = {"q_learning": "agents.q_learning"}


def load_algorithm(name: str, source: str = "agents") -> Any:
    """Imports an algorithm's module.

    Args:
      name: A key of `ALGORITHMS`.
      source: The file that named it, for the message.

    Raises:
      InputError: Unknown name.
    """
    if name not in ALGORITHMS:
        unknown_name(source, "algorithm", name, ALGORITHMS)
    return import_module(ALGORITHMS[name])
