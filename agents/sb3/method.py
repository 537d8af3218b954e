"""What this project has to know about one of Stable-Baselines3's algorithms, without importing it."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from agents.sb3.settings import Sb3Settings


@dataclass(frozen=True)
class Method:
    """One of SB3's algorithms, or of any package with classes like SB3's."""

    path: str  # `module:class`
    settings: type[Sb3Settings]
    # From one line of a log to the next: episodes for an off-policy algorithm, else rollouts.
    log_interval: int = 1
    # Whether its nets may have modules that differ between training and acting, as dropout does.
    has_modes: bool = False

    def load(self) -> Any:
        """Imports the class.

        Raises:
          ModuleNotFoundError: A package is not installed.
        """
        module, _, name = self.path.partition(":")
        return getattr(import_module(module), name)
