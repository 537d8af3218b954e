"""Update rules: what the next observation is worth to an agent that learns a table of action values.

After action a in observation o, with reward r and next observation o', every rule moves

    Q(o, a) += learning_rate * (r + discount * bootstrap(o') - Q(o, a)),

and rules differ in `bootstrap` and in which values they move. The bootstrap is left out where the episode
terminates, and kept where the time limit truncates. See Sutton & Barto (2018), sections 6.4 to 6.7.

This module has the interface and Q-learning; each other rule has a module of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Successor(NamedTuple):
    """What an update rule may read: the next observation, and the values before the update."""

    q: NDArray[np.float64]  # (O, A) action values, by which the agent acts
    observation: np.uint64
    highest: float  # the largest action value of the observation
    greedy: int  # mask of its greedy actions, see `agents.policy`
    epsilon: float  # probability of a uniformly random action
    action: np.uint64  # the next action if the rule is on-policy; else meaningless
    # The last three are meaningless unless the rule has two tables.
    tables: NDArray[np.float64]  # (O, 2, A) their action values; q is their mean
    learned: np.uint64  # which of them is updated, 0 or 1
    best: np.uint64  # a best action of the observation by that table


@dataclass(frozen=True)
class UpdateRule:
    """A way to update a table of action values.

    `bootstrap` is a plain function that numba can compile. The functions and constants that it refers to
    belong in its module: cached code is compiled again when that file has changed, but not when another has.
    """

    bootstrap: Callable[[Successor], float]
    # Whether it needs the next action. That action is then drawn before the update, and taken after it
    # unless the time limit has ended the episode.
    is_on_policy: bool = False
    # Whether it learns two tables, of which each update moves one at random. The agent acts by their mean.
    has_two_tables: bool = False
    # Whether it also moves the values of earlier actions of the episode, as far as every later action was
    # greedy. It then needs the settings of `agents.tabular.learner.TraceSettings`.
    has_traces: bool = False
    version: int = 0  # raise it when a change alters what is learned

    def __post_init__(self) -> None:
        """Checks the parts against each other.

        Raises:
          ValueError: The rule combines traces with two tables or with the next action.
        """
        if self.has_traces and (self.has_two_tables or self.is_on_policy):
            raise ValueError("has_traces: not with is_on_policy or has_two_tables.")


def greatest_value(after: Successor) -> float:
    """Returns the value of the best action, as in Q-learning (Watkins & Dayan 1992)."""
    return after.highest


Q_LEARNING: Final = UpdateRule(greatest_value)
