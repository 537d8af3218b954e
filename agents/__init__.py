"""Learners, planners and evaluation. `ALGORITHMS` maps a name to an algorithm.

Algorithms are imported when they are asked for, and torch only when one that needs it trains, so that a table
of Q-values does not wait for a deep-learning library.
"""

from importlib import import_module
from typing import Final

from agents.contract import Algorithm, LearnerSettings, Schedule, Training, check_training
from envs.inputs import InputError, unknown_name

__all__ = [
    "ALGORITHMS",
    "Algorithm",
    "LearnerSettings",
    "Schedule",
    "Training",
    "check_training",
    "load_algorithm",
]

ALGORITHMS: Final = {
    "dqn": "agents.sb3.algorithms:DQN",
    "ppo": "agents.sb3.algorithms:PPO",
    "q_learning": "agents.tabular.learner:Q_LEARNING",
}


def load_algorithm(name: str, source: str = "agents") -> Algorithm:
    """Returns an algorithm.

    Args:
      name: A key of `ALGORITHMS`, or `module:attribute` of an algorithm that lives elsewhere.
      source: The file that named it, for the message.

    Raises:
      InputError: Unknown name, a module that cannot be imported, or an object that is not an algorithm.
    """
    if name not in ALGORITHMS and ":" not in name:
        unknown_name(source, "algorithm", name, [*ALGORITHMS, "module:attribute"])
    module, _, attribute = ALGORITHMS.get(name, name).partition(":")
    try:
        algorithm: object = getattr(import_module(module), attribute)
    except (ModuleNotFoundError, AttributeError) as error:
        raise InputError(f"{source}: algorithm {name} cannot be imported: {error}.") from error
    if not isinstance(algorithm, Algorithm):
        raise InputError(f"{source}: {name} is not an algorithm; accepted: an agents.contract.Algorithm.")
    return algorithm
