"""Learners, planners and evaluation. `ALGORITHMS` maps a name to an algorithm.

An algorithm is imported when it is loaded, and torch only when a deep algorithm trains, so that a tabular run
does not wait for a deep-learning library.
"""

from typing import Final

from agents.contract import (
    Algorithm,
    DeepTraining,
    LearnerSettings,
    Schedule,
    Training,
    check_request,
    check_training,
)
from envs.inputs import InputError, imported, unknown_name

__all__ = [
    "ALGORITHMS",
    "Algorithm",
    "DeepTraining",
    "LearnerSettings",
    "Schedule",
    "Training",
    "check_request",
    "check_training",
    "load_algorithm",
]

ALGORITHMS: Final = {
    "batched_dqn": "agents.batched.algorithms:DQN",
    "batched_ppo": "agents.batched.algorithms:PPO",
    "dqn": "agents.sb3.algorithms:DQN",
    "memoryless": "agents.memoryless:SEARCH",
    "ppo": "agents.sb3.algorithms:PPO",
    "q_learning": "agents.tabular.learner:Q_LEARNING",
    "q_learning_plain": "agents.tabular.plain:Q_LEARNING",
}


def load_algorithm(name: str, source: str = "agents") -> Algorithm:
    """Imports an algorithm.

    Args:
      name: A key of `ALGORITHMS`, or `module:attribute` of any other algorithm.
      source: The file that has the name, for the message.

    Raises:
      InputError: The name is unknown, the module cannot be imported, or the object is not an algorithm.
    """
    if name not in ALGORITHMS and ":" not in name:
        unknown_name(source, "algorithm", name, [*ALGORITHMS, "module:attribute"])
    algorithm = imported(ALGORITHMS.get(name, name), source, "algorithm")
    if not isinstance(algorithm, Algorithm):
        raise InputError(f"{source}: {name} is not an algorithm; accepted: an agents.contract.Algorithm.")
    return algorithm
