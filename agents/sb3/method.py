"""What this project has to know about one of Stable-Baselines3's algorithms, without importing it."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from agents.sb3.settings import Sb3Settings


@dataclass(frozen=True)
class Output:
    """What an agent's net says about actions, and how to ask it."""

    read: Callable[[Any, Any], Any]  # (agent, observations (O, ...) as a tensor) -> tensor (O, A)
    is_value: bool  # whether these are action values; else they are probabilities
    net: str  # the agent's attribute that holds all learned parameters, and each once


def _q_values(agent: Any, observations: Any) -> Any:
    return agent.q_net(observations)


def _probabilities(agent: Any, observations: Any) -> Any:
    return agent.policy.get_distribution(observations).distribution.probs


Q_NET: Final = Output(_q_values, is_value=True, net="q_net")  # the target net is a copy and does not count
ACTOR: Final = Output(_probabilities, is_value=False, net="policy")


@dataclass(frozen=True)
class Method:
    """One of SB3's algorithms."""

    path: str  # `module:class`
    settings: type[Sb3Settings]
    output: Output
    # From one line of a log to the next: episodes for an off-policy algorithm, else rollouts.
    log_interval: int = 1

    def load(self) -> Any:
        """Imports SB3's class.

        Raises:
          ModuleNotFoundError: A package is not installed.
        """
        module, _, name = self.path.partition(":")
        return getattr(import_module(module), name)
