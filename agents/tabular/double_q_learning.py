"""Double Q-learning (van Hasselt 2010): one table chooses the best next action, the other values it.

The maximum of noisy estimates is on average too high. With two tables that learn from different steps, the
errors of choice and value are independent, and this bias disappears.
"""

from typing import Final

from agents.tabular.learner import TabularAlgorithm
from agents.tabular.updates import Successor, UpdateRule


def other_value(after: Successor) -> float:
    """Returns the value, by the other table, of the best action by the table that is updated."""
    return float(after.tables[after.observation, 1 - after.learned, after.best])


DOUBLE_Q_LEARNING: Final = TabularAlgorithm(UpdateRule(other_value, has_two_tables=True))
