"""Update rules: what the next observation is worth to an agent that learns action values.

After action a in observation o, with reward r and next observation o', every rule moves

    Q(o, a) += learning_rate * (r + discount * bootstrap(o') - Q(o, a)),

and rules differ in `bootstrap` and in which values they move. The bootstrap is left out where the
episode terminates, and kept where the time limit truncates. See Sutton & Barto (2018), sections 6.4
to 6.7.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from envs.arrays import Floats


class Successor(NamedTuple):
    """What an update rule may read: the next observation, and the values before the update."""

    q: Floats  # (O, A) action values, by which the agent acts
    observation: np.uint64
    highest: float  # the largest action value of the observation
    greedy: int  # mask of its greedy actions, see `agents.policy`
    epsilon: float  # probability of a uniformly random action
    action: np.uint64  # the next action if the rule is on-policy; else meaningless
    # The last three are meaningless unless the rule has two tables.
    tables: Floats  # (O, 2, A) their action values; q is their mean
    learned: np.uint64  # which of them is updated, 0 or 1
    best: np.uint64  # a best action of the observation by that table


@dataclass(frozen=True)
class UpdateRule:
    """A way to update a table of action values.

    `bootstrap` is a plain function that numba can compile.
    """

    bootstrap: Callable[[Successor], float]
    is_on_policy: bool = (
        False  # whether it needs the next action, which is then drawn before the update
    )
    # Whether it learns two tables, of which each update moves one at random. The agent acts by
    # their mean.
    has_two_tables: bool = False
    # Whether it also moves the values of earlier actions of the episode, as far as every later
    # action was greedy. It then needs the settings of
    # `agents.tabular.learner.TabularTraceSettings`.
    has_traces: bool = False
    version: int = 0  # raise it when a change alters what is learned

    def __post_init__(self) -> None:
        """Refuses, by a ValueError, traces with two tables or with the next action."""
        if self.has_traces and (self.has_two_tables or self.is_on_policy):
            raise ValueError("has_traces: not with is_on_policy or has_two_tables.")


def greatest_value(after: Successor) -> float:
    """Returns the value of the best action, as in Q-learning (Watkins & Dayan 1992)."""
    return after.highest


def next_value(after: Successor) -> float:
    """Returns the value of the next action that the agent takes."""
    return float(after.q[after.observation, after.action])


def expected_value(after: Successor) -> float:
    """Returns the next action's mean value; greedy actions are equal, so ties do not matter."""
    q = after.q
    o = after.observation
    # Independent sums, so that the processor can overlap them.
    total = (q[o, 0] + q[o, 1]) + (q[o, 2] + q[o, 3]) + q[o, 4]
    return float(after.epsilon / 5 * total + (1 - after.epsilon) * after.highest)


def other_value(after: Successor) -> float:
    """Returns the value, by the other table, of the best action by the table that is updated."""
    return float(after.tables[after.observation, 1 - after.learned, after.best])


Q_LEARNING = UpdateRule(greatest_value)
# Sutton & Barto (2018), section 6.4
SARSA = UpdateRule(next_value, is_on_policy=True)
# Ibid., section 6.6
EXPECTED_SARSA = UpdateRule(expected_value)
# van Hasselt (2010): the maximum of noisy estimates is too high; two tables have independent
# errors.
DOUBLE_Q_LEARNING = UpdateRule(other_value, has_two_tables=True)
# Watkins (1989); Sutton & Barto (2018), section 12.10; with replacing traces (Singh & Sutton 1996),
# which are 1 when an action is taken, fade by discount * lambda in every step, and end at
# `kernel.MIN_TRACE`, or at an action that is not greedy.
WATKINS_Q_LAMBDA = UpdateRule(greatest_value, has_traces=True)
