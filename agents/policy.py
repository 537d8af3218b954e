"""Memoryless policies: tables of action probabilities, one row per observation.

A set of actions is represented by a mask, the sum of 2**action over its members: `0b10001` is UP or
PING.
"""

import numpy as np

from envs import ACTIONS, Model
from envs.arrays import Bools, Bytes, Floats

Policy = Floats  # (..., O, A), rows summing to one
ALL_ACTIONS = 2 ** len(ACTIONS) - 1


def uniform_policy(model: Model) -> Policy:
    """Returns the policy that draws every action with equal probability, (O, A)."""
    return np.full((model.n_observations, len(ACTIONS)), 1 / len(ACTIONS))


def contains(masks: Bytes) -> Bools:
    """Returns whether each mask contains each action, (..., A)."""
    return np.asarray(masks[..., None] >> np.arange(len(ACTIONS)) & 1, dtype=np.bool_)


def mask_policy(masks: Bytes) -> Policy:
    """Returns the policy that draws uniformly from the actions of each mask, (..., A).

    >>> mask_policy(np.array([17], dtype=np.uint8))
    array([[0.5, 0. , 0. , 0. , 0.5]])
    """
    return np.asarray(_POLICY_OF_MASK[masks])


_MEMBERS = contains(np.arange(ALL_ACTIONS + 1, dtype=np.uint8))
_POLICY_OF_MASK = _MEMBERS / np.maximum(_MEMBERS.sum(axis=-1, keepdims=True), 1)  # (32, A)
