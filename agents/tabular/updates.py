"""Update rules: what the next observation is worth to an agent that learns a table of action values.

After action a in observation o, with reward r and next observation o', every rule moves

    Q(o, a) += learning_rate * (r + discount * bootstrap(o') - Q(o, a)),

and rules differ in `bootstrap` alone. The bootstrap is left out where the episode terminates, and kept where
the time limit truncates. See Sutton & Barto (2018), sections 6.4 to 6.6.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Successor(NamedTuple):
    """What an update rule may read: the next observation, and the table before the update."""

    q: NDArray[np.float64]  # (O, A) action values
    observation: np.uint64
    highest: float  # the largest action value of the observation
    greedy: int  # mask of its greedy actions, see `agents.policy`
    epsilon: float  # probability of a uniformly random action
    action: np.uint64  # the next action if the rule is on-policy; else meaningless


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
    version: int = 0  # raise it when a change alters what is learned


def greatest_value(after: Successor) -> float:
    """Returns the value of the best action, as in Q-learning (Watkins & Dayan 1992)."""
    return after.highest


Q_LEARNING: Final = UpdateRule(greatest_value)
