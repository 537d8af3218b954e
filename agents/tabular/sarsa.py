"""SARSA: the value of the next action that the agent takes (Sutton & Barto 2018, section 6.4)."""

from typing import Final

from agents.tabular.learner import TabularAlgorithm
from agents.tabular.updates import Successor, UpdateRule


def next_value(after: Successor) -> float:
    """Returns the value of the next action."""
    return float(after.q[after.observation, after.action])


SARSA: Final = TabularAlgorithm(UpdateRule(next_value, is_on_policy=True))
