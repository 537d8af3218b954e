"""Expected SARSA: the mean value of the epsilon-greedy policy (Sutton & Barto 2018, section 6.6)."""

from typing import Final

from agents.tabular.learner import TabularAlgorithm
from agents.tabular.updates import Successor, UpdateRule


def expected_value(after: Successor) -> float:
    """Returns the mean value of the next action; greedy actions are equally good, so ties do not matter."""
    q, o = after.q, after.observation
    total = (q[o, 0] + q[o, 1]) + (q[o, 2] + q[o, 3]) + q[o, 4]  # few additions wait for others
    return float(after.epsilon / 5 * total + (1 - after.epsilon) * after.highest)


EXPECTED_SARSA: Final = TabularAlgorithm(UpdateRule(expected_value))
