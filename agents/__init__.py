"""Learners and evaluation. `ALGORITHMS` maps a name to an algorithm.

An algorithm is imported when it is loaded. Those in `ALGORITHMS` import torch only when an agent of
Stable-Baselines3 is trained, so that other runs do not wait for it.
"""

from agents.contract import (
    Algorithm,
    DeepTraining,
    LearnerSettings,
    Schedule,
    SequentialAlgorithm,
    Training,
    check_training,
)
from agents.sb3.algorithms import algorithm_of, is_sb3_class
from envs.inputs import InputError, unknown_name
from envs.sources import imported

__all__ = [
    "ALGORITHMS",
    "Algorithm",
    "DeepTraining",
    "LearnerSettings",
    "Schedule",
    "SequentialAlgorithm",
    "Training",
    "check_training",
    "load_algorithm",
]

ALGORITHMS = {
    "compiled_dqn": "agents.nets.dqn:DQN",
    "compiled_ppo": "agents.nets.ppo:PPO",
    "double_q_learning": "agents.tabular.learner:DOUBLE_Q_LEARNING",
    "expected_sarsa": "agents.tabular.learner:EXPECTED_SARSA",
    "linear_q_lambda": "agents.linear.learner:Q_LAMBDA",
    "linear_sarsa_lambda": "agents.linear.learner:SARSA_LAMBDA",
    "q_learning": "agents.tabular.learner:Q_LEARNING",
    "sarsa": "agents.tabular.learner:SARSA",
    "sb3_dqn": "agents.sb3.algorithms:DQN",
    "sb3_ppo": "agents.sb3.algorithms:PPO",
    "watkins_q_lambda": "agents.tabular.learner:WATKINS_Q_LAMBDA",
}


def load_algorithm(name: str, source: str = "agents") -> Algorithm:
    """Imports an algorithm by its name in `ALGORITHMS` or by `module:attribute`.

    The attribute may be a class of agents like those of Stable-Baselines3, of which an algorithm is
    made. Anything but an algorithm raises an InputError, whose message begins with the source of
    the name.
    """
    if name not in ALGORITHMS and ":" not in name:
        unknown_name(source, "algorithm", name, ALGORITHMS, "module:attribute")
    algorithm = imported(ALGORITHMS.get(name, name), source, "algorithm")
    if is_sb3_class(algorithm):
        try:
            return algorithm_of(algorithm, name)
        except InputError as error:
            raise InputError(f"{source}: {error}") from error
    if not isinstance(algorithm, Algorithm):
        raise InputError(
            f"{source}: {name} is not an algorithm; accepted: an agents.contract.Algorithm, or a "
            "subclass of stable_baselines3.common.base_class.BaseAlgorithm."
        )
    return algorithm
