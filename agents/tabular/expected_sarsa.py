"""Expected SARSA: the mean value of the epsilon-greedy policy (Sutton & Barto 2018, section 6.6)."""

from typing import Final

from agents.tabular.learner import TabularAlgorithm
from agents.tabular.updates import Successor, UpdateRule


def expected_value(after: Successor) -> float:
    """Returns the mean value of the next action; greedy actions are equally good, so ties do not matter."""
    n_actions = after.q.shape[1]
    total = 0.0
    for action in range(n_actions):
        total += after.q[after.observation, action]
    return float(after.epsilon * total / n_actions + (1 - after.epsilon) * after.highest)


EXPECTED_SARSA: Final = TabularAlgorithm(UpdateRule(expected_value))
