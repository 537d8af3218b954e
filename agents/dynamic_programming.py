"""Exact values: of a policy under a time limit, and of the optimal policy.

The process is finite and known, so nothing is sampled: no noise, no seed, no episodes. `evaluate`
carries the state distribution of a policy forward from the start (Sutton & Barto 2018, equation
3.4, gives the transition probabilities) and adds up the expected rewards. `solve` iterates the
Bellman optimality operator (ibid., section 4.4) to its fixed point, or `horizon` times.

Returns are undiscounted unless a discount is given.
"""

from dataclasses import dataclass, replace
from functools import reduce
from itertools import count
from typing import NamedTuple

import numpy as np
from numba import njit

from agents.compiled import compiled
from agents.policy import Policy
from envs.arrays import Bools, Codes, Floats, Indices, Ints
from envs.model import ACTIONS, TARGET_PING, Model
from envs.regions import ZONES

VERSION = 2  # part of every run's identity: raise it when a change alters an evaluation

_N_SUMS = 5 + len(ZONES)

# What sweeps read of a model: next states, their probabilities, ends and observations.
Dynamics = tuple[Indices, Floats, Bools, Indices]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Exact expectations over an episode; each field has the leading axes of the policies."""

    grid_return: Floats  # without the issuer's rewards, so that scenarios can be compared
    scenario_return: Floats  # with the issuer's rewards
    success: Floats  # probability that the episode ends by PING in the target region
    steps: Floats  # until the episode ends or is truncated
    wrong_pings: Floats
    zone_steps: Floats  # (..., 4) steps that end in each of ZONES


class Solution(NamedTuple):
    """The optimal values of a model."""

    q: Floats  # (S, A) value of each action if the best actions follow
    value: Floats  # (S,)


def from_starts(model: Model, start: str = "start") -> Floats:
    """Returns the probabilities of states, (S,), to be an episode's first, equal or zero.

    `start` says which can be: "start", those of the model; "unseen" and "new_way", those with the
    issuer in an unseen place, and with onlookers in a new way.
    """
    possible = {
        "start": model.starts,
        "unseen": model.unseen_starts,
        "new_way": model.new_way_starts,
    }[start]
    probability = np.zeros(len(model.observation))
    probability[possible] = 1 / len(possible)
    return probability


def evaluate(model: Model, policy: Policy, horizon: int, start: str = "start") -> Evaluation:
    """Computes the expected return of a policy under a time limit, and other expectations.

    Leading axes of the policy, (..., O, A), are a batch. Episodes are truncated after `horizon`
    steps, at least 1, and start as in `from_starts`. A ValueError is raised if the policy does not
    fit the model.
    """
    shape = model.n_observations, len(ACTIONS)
    policy = np.asarray(policy, dtype=np.float64)
    if policy.shape[-2:] != shape:
        raise ValueError(
            f"policy: shape {policy.shape}; this model takes (..., {shape[0]}, {shape[1]})."
        )
    if policy.size and not (policy.min() >= 0 and abs(policy.sum(axis=-1) - 1.0).max() <= 1e-9):
        raise ValueError("policy: rows must be probabilities that sum to one.")
    # If some were read-only, `_sweep` would be compiled again.
    batch = np.require(policy.reshape(-1, *shape), requirements=("C", "W"))
    sums = np.zeros((len(batch), _N_SUMS))
    dynamics = model.next_state, model.probability, model.terminated, model.observation
    is_success = model.event == TARGET_PING
    counted = model.grid_reward, model.issuer_reward, is_success, model.is_wrong_ping, model.zone
    # No episode leaves the states of its place. Going place by place keeps what is read in the
    # caches.
    probability = from_starts(model, start)
    n_block = len(model.observation) // model.n_places
    states = np.flatnonzero(probability)
    first = np.searchsorted(states, n_block * np.arange(model.n_places + 1))
    starts = states, probability[states], first, n_block
    _sweep(batch, dynamics, counted, starts, horizon, sums)
    sums = sums.reshape(*policy.shape[:-2], _N_SUMS)
    grid, issuer, success, steps, wrong_pings = np.moveaxis(sums[..., :5], -1, 0)
    return Evaluation(grid, grid + issuer, success, steps, wrong_pings, sums[..., 5:])


@compiled
def _sweep(
    policies: Floats,
    dynamics: Dynamics,
    counted: tuple[Floats, Floats, Bools, Bools, Codes],
    starts: tuple[Ints, Floats, Ints, int],
    horizon: int,
    sums: Floats,
) -> None:
    """Carries each policy's state distribution forward, and writes its expectations into `sums`.

    `starts` holds the states in which episodes start, rising, their probabilities, the index of the
    first of each place, and how many states a place has.
    """
    states, start_probability, first, n_block = starts
    grid_reward, issuer_reward, is_success, is_wrong_ping, zone = counted
    next_state, outcome, _, observation = dynamics
    n_transitions = n_block * grid_reward.shape[1] * next_state.shape[2]
    index = np.full(len(grid_reward), -1, dtype=np.int32)  # where states are in `reached`, or -1
    # the states reached, in the order of their discovery
    reached = np.empty(n_block, dtype=np.int64)
    # where each transition begins and ends in `reached`
    ends = np.empty((n_transitions, 2), dtype=np.int32)
    probability = np.empty(n_transitions)  # of each transition
    for n in range(len(policies)):
        for g in range(len(first) - 1):
            some = slice(first[g], first[g + 1])
            n_reached, n_listed = _list_transitions(
                policies[n], dynamics, states[some], index, reached, ends, probability
            )
            visits = np.zeros(n_reached)  # expected number of steps in each state
            before = np.zeros_like(visits)
            after = np.empty_like(visits)
            before[: some.stop - some.start] = start_probability[some]
            for _ in range(horizon):
                visits += before
                after[:] = 0.0
                for i in range(n_listed):
                    after[ends[i, 1]] += before[ends[i, 0]] * probability[i]
                if not after.any():
                    break
                before, after = after, before
            for i in range(n_reached):
                s = reached[i]
                index[s] = -1
                for a in range(grid_reward.shape[1]):
                    p = visits[i] * policies[n, observation[s], a]
                    sums[n, 0] += p * grid_reward[s, a]
                    sums[n, 1] += p * issuer_reward[s, a]
                    sums[n, 2] += p * is_success[s, a]
                    sums[n, 3] += p
                    sums[n, 4] += p * is_wrong_ping[s, a]
                    for k in range(next_state.shape[2]):
                        sums[n, 5 + zone[next_state[s, a, k]]] += p * outcome[s, a, k]


@njit
def _list_transitions(
    policy: Floats,
    dynamics: Dynamics,
    starts: Ints,
    index: Indices,
    reached: Ints,
    ends: Indices,
    probability: Floats,
) -> tuple[int, int]:
    """Lists the states that a policy can reach, and its transitions; returns how many there are."""
    next_state, outcome, terminated, observation = dynamics
    n_reached = len(starts)
    n_transitions = 0
    reached[:n_reached] = starts
    index[starts] = np.arange(n_reached)
    i = 0
    while i < n_reached:
        s = reached[i]
        for a in range(policy.shape[1]):
            if policy[observation[s], a] > 0.0 and not terminated[s, a]:
                for k in range(next_state.shape[2]):
                    if outcome[s, a, k] > 0.0:
                        s_next = next_state[s, a, k]
                        if index[s_next] < 0:
                            index[s_next], reached[n_reached] = n_reached, s_next
                            n_reached += 1
                        ends[n_transitions, 0], ends[n_transitions, 1] = i, index[s_next]
                        probability[n_transitions] = policy[observation[s], a] * outcome[s, a, k]
                        n_transitions += 1
        i += 1
    return n_reached, n_transitions


def solve(
    model: Model, discount: float = 1.0, horizon: int | None = None, *, issuer_rewards: bool = True
) -> Solution:
    """Computes the optimal values of a model for an agent that knows its state, by value iteration.

    They are upper bounds for an agent from which something is hidden. Without `issuer_rewards`, the
    grid's rewards count alone. A horizon of None means no time limit; the discount must
    then be below 1, else a ValueError is raised.
    """
    if horizon is None and not 0 <= discount < 1:
        raise ValueError(f"discount = {discount}; without a horizon it must lie in [0, 1).")
    reward = model.grid_reward + model.issuer_reward if issuer_rewards else model.grid_reward
    value = np.zeros(len(model.observation))
    q = np.zeros_like(reward)
    for _ in count() if horizon is None else range(horizon):
        if model.n_outcomes == 1:
            q = value[model.next_state[:, :, 0]]
        else:
            q = (value[model.next_state] * model.probability).sum(axis=2)
        q[model.terminated] = 0.0
        q *= discount
        q += reward
        best = reduce(np.maximum, q.T)  # several times as fast as q.max(axis=1)
        # Rounding may make the last digit alternate for ever, so equality is not required.
        converged = np.abs(best - value).max() <= 1e-15 * max(1.0, np.abs(best).max())
        unchanged = converged and np.array_equal(best, value)  # as it will be from here on
        value = best
        if unchanged or (converged and discount < 1):
            break
    return Solution(q=q, value=value)


def largest_success(model: Model, horizon: int) -> float:
    """Returns the largest success of an agent that knows the state, from the model's starts.

    It is the optimal value if only a correct PING is rewarded, by 1.
    """
    reward = (model.event == TARGET_PING).astype(np.float64)
    solution = solve(replace(model, grid_reward=reward), 1.0, horizon, issuer_rewards=False)
    return float(from_starts(model) @ solution.value)
