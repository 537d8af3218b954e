"""How hard a scenario is for tables and for learners that generalize, computed exactly from its model.

Axis letters: S states, O observations, A actions, F fresh states (no wrong PING so far).
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from agents.dynamic_programming import expected, from_starts, solve
from envs.model import ACTIONS, Model
from envs.observations import ENCODINGS, observation_table

COVERED: Final = 0.9  # the share of pairs that counts as covered
REGULARISER: Final = 0.01  # smaller action gaps count as this, in units of reward
_TIE: Final = 1e-9
_NEIGHBOURS: Final = 16  # at most, that are equally near


class Hardness(NamedTuple):
    """Measures of a scenario in a form of observation."""

    # Steps in which the random policy has tried nine tenths of the (observation, action) pairs that it can
    # reach, as if its steps were independent draws of the visits of an episode.
    covering_steps: float
    # The smallest k for which the scenario is k-QVI-solvable: acting greedily (by the first of several best
    # actions) on the random policy's action values after k - 1 backups is optimal (Laidlaw, Russell and
    # Dragan 2023, whose effective horizon adds to k a logarithm of a sample size)
    solvable_k: float
    # The sum over fresh states and actions that are not optimal of 1 / (V* - Q*), at least `REGULARISER` each
    reciprocal_gaps: float
    # How often an action that is optimal for the nearest observation with the issuer in another place is not
    # optimal here; NaN with one place. Both errors are defined for coordinates only; in other forms, too many
    # observations are equally near.
    error_across_places: float
    error_nearby: float  # the same of the nearest observation in whatever place


def hardness(model: Model, observation: str, horizon: int) -> Hardness:
    """Measures a scenario in which only the start of an episode is random.

    Args:
      model: Compiled for the form of observation.
      observation: The form, see `envs.observations`.
      horizon: Steps until truncation, at least 1.

    Raises:
      ValueError: What follows an action is random.
    """
    if model.n_outcomes > 1:
        raise ValueError("model: what follows an action is random; accepted: one outcome.")
    optimum = solve(model, horizon=horizon).q
    visits = _visits(model, horizon)  # (S,)
    is_met = visits > 0
    fresh = model.fresh_state[is_met[model.fresh_state]]
    gaps = (optimum[fresh].max(axis=1)[:, None] - optimum[fresh]).ravel()
    return Hardness(
        covering_steps=_covering_steps(model, visits),
        solvable_k=_solvable_k(model, optimum, horizon),
        reciprocal_gaps=float((1 / np.maximum(gaps[gaps > _TIE], REGULARISER)).sum()),
        error_across_places=_error(model, observation, optimum, fresh, is_elsewhere=True),
        error_nearby=_error(model, observation, optimum, fresh, is_elsewhere=False),
    )


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


def _error(
    model: Model,
    observation: str,
    optimum: NDArray[np.float64],
    fresh: NDArray[np.int_],
    *,
    is_elsewhere: bool,
) -> float:
    """Returns how often the nearest other observation predicts an action that is not optimal.

    Of several that are equally near, and of several best actions, each counts alike.
    """
    place = model.context[fresh] // len(model.scenario.stages)
    if ENCODINGS[observation] != "coordinates" or (is_elsewhere and len(np.unique(place)) == 1):
        return float("nan")
    points = observation_table(model, observation)[model.observation[fresh]].astype(np.float64)
    is_best = optimum[fresh] >= optimum[fresh].max(axis=1, keepdims=True) - _TIE
    total = 0.0
    groups = [place == each for each in np.unique(place)] if is_elsewhere else [np.ones(len(place), np.bool_)]
    for group in groups:
        others = np.flatnonzero(~group) if is_elsewhere else np.arange(len(fresh))
        n = min(_NEIGHBOURS + 1, len(others))
        found = KDTree(points[others]).query(points[group], k=range(1, n + 1))
        here, distance, near = np.flatnonzero(group), np.asarray(found[0]), others[np.asarray(found[1])]
        distance = np.where(near == here[:, None], np.inf, distance)
        is_nearest = distance <= distance.min(axis=1, keepdims=True) + _TIE
        shared = (is_best[here][:, None] * is_best[near]).sum(axis=2) / is_best[near].sum(axis=2)
        total += float(((1 - shared) * is_nearest).sum(axis=1) @ (1 / is_nearest.sum(axis=1)))
    return total / len(fresh)
