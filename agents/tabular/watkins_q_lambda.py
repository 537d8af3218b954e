"""Watkins's Q(lambda) (Watkins 1989; Sutton & Barto 2018, section 12.10), with replacing traces.

Q-learning whose error also moves the values of earlier actions of the episode, weighted by traces. An action
has a trace of 1 when it is taken, even if it had one already (Singh & Sutton 1996); every step multiplies it
by discount * lambda, and drops it below `agents.tabular.kernel.LEAST_TRACE`. An action that is not greedy
drops all traces of earlier ones, because the values of greedy actions do not depend on what follows it.
"""

from typing import Final

from agents.tabular.learner import TabularAlgorithm, TraceSettings
from agents.tabular.updates import Successor, UpdateRule


def greatest_value(after: Successor) -> float:
    """Returns the value of the best action, as in Q-learning."""
    return after.highest


WATKINS_Q_LAMBDA: Final = TabularAlgorithm(
    UpdateRule(greatest_value, has_traces=True), settings=TraceSettings
)
