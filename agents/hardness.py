"""How hard a scenario is, computed exactly from its model.

Axis letters: S states, O observations, A actions.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from agents.dynamic_programming import expected, from_starts, solve
from envs.model import ACTIONS, Model

COVERED: Final = 0.9  # the share of pairs that counts as covered
_TIE: Final = 1e-9


class Hardness(NamedTuple):
    """Measures of a scenario in a form of observation."""

    # Steps after which the random policy has tried nine tenths of the (observation, action) pairs that it can
    # reach, if its steps were independent draws of the visits of an episode.
    covering_steps: float
    # The smallest k for which the scenario is k-QVI-solvable: acting greedily (by the first of several best
    # actions) on the random policy's action values after k - 1 backups is optimal (Laidlaw, Russell and
    # Dragan 2023, whose effective horizon adds to k a logarithm of a sample size)
    solvable_k: float


def hardness(model: Model, horizon: int) -> Hardness:
    """Measures a scenario, compiled for a form of observation, under a time limit.

    Raises:
      ValueError: What follows an action is random.
    """
    if model.n_outcomes > 1:
        raise ValueError("model: what follows an action is random; accepted: one outcome.")
    optimum = solve(model, horizon=horizon).q
    visits = _visits(model, horizon)  # (S,)
    return Hardness(_covering_steps(model, visits), _solvable_k(model, optimum, horizon))


def _visits(model: Model, horizon: int) -> NDArray[np.float64]:
    """Returns how often the random policy acts in each state of an episode, (S,)."""
    n_states = len(model.observation)
    source, action = np.nonzero(~model.terminated)
    target = model.next_state[source, action, 0]
    share = np.full(len(source), 1 / len(ACTIONS))
    step = sparse.csr_array((share, (target, source)), shape=(n_states, n_states))
    here, visits = from_starts(model), np.zeros(n_states)
    for _ in range(horizon):
        visits += here
        here = step @ here
    return visits


def _covering_steps(model: Model, visits: NDArray[np.float64]) -> float:
    """Returns the steps until nine tenths of the pairs are expected to be tried."""
    of_observation = np.bincount(model.observation, visits, minlength=model.n_observations)
    rate = of_observation[of_observation > 0] / visits.sum() / len(ACTIONS)  # of each pair, per step
    low, high = 1.0, 1.0
    while _tried(rate, high) < COVERED:
        high *= 2
    while high - low > 0.5:
        middle = (low + high) / 2
        low, high = (low, middle) if _tried(rate, middle) >= COVERED else (middle, high)
    return float(round(high))


def _tried(rate: NDArray[np.float64], steps: float) -> float:
    return float(-np.expm1(steps * np.log1p(-rate)).mean())


def _solvable_k(model: Model, optimum: NDArray[np.float64], horizon: int) -> float:
    """Returns the smallest k; infinite if no k up to the horizon is enough."""
    reward = model.grid_reward + model.issuer_reward
    value = np.zeros(len(model.observation))
    for _ in range(horizon):
        q = reward + np.where(model.terminated, 0.0, expected(model, value))
        value = q.mean(axis=1)
    best = optimum.max(axis=1)
    for k in range(1, horizon + 1):
        if _is_optimal(model, q.argmax(axis=1), optimum, best, horizon):
            return float(k)
        q = reward + np.where(model.terminated, 0.0, expected(model, q.max(axis=1)))
    return float("inf")


def _is_optimal(
    model: Model,
    action: NDArray[np.int_],
    optimum: NDArray[np.float64],
    best: NDArray[np.float64],
    horizon: int,
) -> bool:
    """Returns whether a greedy policy, (S,), takes optimal actions only, and ends every episode."""
    state = model.starts.astype(np.int64)
    for _ in range(horizon):
        chosen = action[state]
        if (optimum[state, chosen] < best[state] - _TIE).any():
            return False
        state = model.next_state[state, chosen, 0][~model.terminated[state, chosen]]
        if not len(state):
            return True
    return False
