"""Exact values: of a policy under a time limit, and of the optimal policy.

The process is finite and known, so nothing is sampled: no noise, no seed, no episodes. `evaluate` carries the
state distribution of a policy forward from the start (Sutton & Barto 2018, equation 3.4, gives the
transition probabilities) and adds up the expected rewards. `solve` iterates the Bellman optimality operator
(ibid., section 4.4) to its fixed point, or `horizon` times.

Returns are undiscounted unless a discount is given.
"""

from dataclasses import dataclass
from functools import reduce
from typing import Final, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from agents.policy import Policy
from envs.model import ACTIONS, TARGET_PING, Model
from envs.regions import ZONES

VERSION: Final = 2  # part of every run's identity: raise it when a change alters an evaluation

_N_SUMS = 5 + len(ZONES)

# What sweeps read of a model: next states, their probabilities, ends and observations.
Dynamics = tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Exact expectations over an episode; each field has the leading axes of the policies."""

    grid_return: NDArray[np.float64]  # without the issuer's rewards, so that scenarios can be compared
    scenario_return: NDArray[np.float64]  # with the issuer's rewards
    success: NDArray[np.float64]  # probability that the episode ends by PING in the target region
    steps: NDArray[np.float64]  # until the episode ends or is truncated
    wrong_pings: NDArray[np.float64]
    zone_steps: NDArray[np.float64]  # (..., 4) steps that end in each of ZONES


class Solution(NamedTuple):
    """The optimal values of a model."""

    q: NDArray[np.float64]  # (S, A) value of each action if the best actions follow
    value: NDArray[np.float64]  # (S,)


class Starts(NamedTuple):
    """Where episodes start, place by place: no episode leaves the n_block states of its place.

    Sweeps go through the places one by one, which keeps what they read in the caches.
    """

    state: NDArray[np.int64]  # those with a probability above 0, rising
    probability: NDArray[np.float64]  # the probability of each of them
    first: NDArray[np.int64]  # (places + 1,) index of the first start of each place
    n_block: int  # states of a place


def starts_of(model: Model, start: NDArray[np.float64]) -> Starts:
    """Returns the starts of a distribution over states, (S,)."""
    states, n_block = np.flatnonzero(start), len(start) // model.n_places
    first = np.searchsorted(states, n_block * np.arange(model.n_places + 1))
    return Starts(states, start[states], first, n_block)


def dynamics(model: Model) -> Dynamics:
    """Returns what sweeps read of a model."""
    return model.next_state, model.probability, model.terminated, model.observation


def from_starts(model: Model, start: str = "start") -> NDArray[np.float64]:
    """Returns the probabilities of states, (S,), to be an episode's first; they are all equal, or zero.

    `start` says which can be: "start", those of the model; "unseen", those with the issuer in an
    unseen place; "every_cell", all in which the agent may be before any PING.
    """
    fresh = model.fresh_state[~model.is_over[model.fresh_state]]
    possible = {"start": model.starts, "unseen": model.unseen_starts, "every_cell": fresh.astype(np.int32)}
    probability = np.zeros(len(model.observation))
    probability[possible[start]] = 1 / len(possible[start])
    return probability


def evaluate(model: Model, policy: Policy, horizon: int, start: str = "start") -> Evaluation:
    """Computes the expected return of a policy under a time limit, and other expectations.

    Leading axes of the policy, (..., O, A), are a batch. Episodes are truncated after `horizon` steps, at
    least 1, and start as in `from_starts`. A ValueError is raised if the policy does not fit the model.
    """
    shape = model.n_observations, len(ACTIONS)
    policy = np.asarray(policy, dtype=np.float64)
    if policy.shape[-2:] != shape:
        raise ValueError(f"policy: shape {policy.shape}; this model takes (..., {shape[0]}, {shape[1]}).")
    if policy.size and not (policy.min() >= 0 and abs(policy.sum(axis=-1) - 1.0).max() <= 1e-9):
        raise ValueError("policy: rows must be probabilities that sum to one.")
    batch = np.ascontiguousarray(policy.reshape(-1, *shape))
    sums = np.zeros((len(batch), _N_SUMS))
    is_success, starts = model.event == TARGET_PING, starts_of(model, from_starts(model, start))
    counted = model.grid_reward, model.issuer_reward, is_success, model.is_wrong_ping, model.zone
    _sweep(batch, dynamics(model), *counted, starts, horizon, sums)
    sums = sums.reshape(*policy.shape[:-2], _N_SUMS)
    grid, issuer, success, steps, wrong_pings = np.moveaxis(sums[..., :5], -1, 0)
    return Evaluation(grid, grid + issuer, success, steps, wrong_pings, sums[..., 5:])


@compiled
def _sweep(
    policies: NDArray[np.float64],
    dynamics: Dynamics,
    grid_reward: NDArray[np.float64],
    issuer_reward: NDArray[np.float64],
    is_success: NDArray[np.bool_],
    is_wrong_ping: NDArray[np.bool_],
    zone: NDArray[np.int8],
    starts: Starts,
    horizon: int,
    sums: NDArray[np.float64],
) -> None:
    """Carries the state distribution of each policy forward and writes its expectations into `sums`.

    It lists the transitions between the states that the policy can reach, ordered by target. Then every step
    is a pass over that list.
    """
    n_transitions = starts.n_block * grid_reward.shape[1] * dynamics[0].shape[2]
    index = np.full(len(grid_reward), -1, dtype=np.int32)  # where states are in `reached`, or -1
    reached = np.empty(starts.n_block, dtype=np.int64)  # the states reached, in the order of their discovery
    first = np.empty(starts.n_block + 1, dtype=np.int64)  # the first transition into each of them
    source = np.empty(n_transitions, dtype=np.int32)  # the index where each transition starts
    probability = np.empty(n_transitions)  # the probability of each transition
    for n in range(len(policies)):
        for g in range(len(starts.first) - 1):
            some = slice(starts.first[g], starts.first[g + 1])
            n_reached = _list_states(policies[n], dynamics, starts.state[some], index, reached, first)
            states = reached[:n_reached]
            _list_transitions(policies[n], dynamics, states, index, first, source, probability)
            visits = _count_visits(starts.probability[some], first[:n_reached], source, probability, horizon)
            for i in range(n_reached):
                s = states[i]
                index[s] = -1
                for a in range(grid_reward.shape[1]):
                    p = visits[i] * policies[n, dynamics[3][s], a]
                    sums[n, 0] += p * grid_reward[s, a]
                    sums[n, 1] += p * issuer_reward[s, a]
                    sums[n, 2] += p * is_success[s, a]
                    sums[n, 3] += p
                    sums[n, 4] += p * is_wrong_ping[s, a]
                    for k in range(dynamics[0].shape[2]):
                        sums[n, 5 + zone[dynamics[0][s, a, k]]] += p * dynamics[1][s, a, k]


@numba.njit
def _list_states(
    policy: NDArray[np.float64],
    dynamics: Dynamics,
    starts: NDArray[np.int64],
    index: NDArray[np.int32],
    reached: NDArray[np.int64],
    first: NDArray[np.int64],
) -> int:
    """Lists the states that a policy can reach; returns their number.

    `first` then has, for each of them, the number of transitions into those before.
    """
    next_state, outcome, terminated, observation = dynamics
    n_reached = len(starts)
    reached[:n_reached] = starts
    for i in range(n_reached):
        index[starts[i]] = i
    first[:] = 0
    i = 0
    while i < n_reached:
        s = reached[i]
        for a in range(policy.shape[1]):
            if policy[observation[s], a] > 0.0 and not terminated[s, a]:
                for k in range(next_state.shape[2]):
                    if outcome[s, a, k] > 0.0:
                        s_next = next_state[s, a, k]
                        if index[s_next] < 0:
                            index[s_next] = n_reached
                            reached[n_reached] = s_next
                            n_reached += 1
                        first[index[s_next] + 1] += 1
        i += 1
    for i in range(n_reached):
        first[i + 1] += first[i]
    return n_reached


@numba.njit
def _list_transitions(
    policy: NDArray[np.float64],
    dynamics: Dynamics,
    reached: NDArray[np.int64],
    index: NDArray[np.int32],
    first: NDArray[np.int64],
    source: NDArray[np.int32],
    probability: NDArray[np.float64],
) -> None:
    """Lists transitions ordered by target; `first` then has where those into each state end."""
    next_state, outcome, terminated, observation = dynamics
    for i in range(len(reached)):
        s = reached[i]
        for a in range(policy.shape[1]):
            if policy[observation[s], a] > 0.0 and not terminated[s, a]:
                for k in range(next_state.shape[2]):
                    if outcome[s, a, k] > 0.0:
                        j = index[next_state[s, a, k]]
                        source[first[j]] = i
                        probability[first[j]] = policy[observation[s], a] * outcome[s, a, k]
                        first[j] += 1


@numba.njit
def _count_visits(
    start_probability: NDArray[np.float64],
    end: NDArray[np.int64],
    source: NDArray[np.int32],
    probability: NDArray[np.float64],
    horizon: int,
) -> NDArray[np.float64]:
    """Returns the expected number of steps in each state, given where transitions into it end."""
    before, after, visits = np.zeros(len(end)), np.empty(len(end)), np.zeros(len(end))
    before[: len(start_probability)] = start_probability
    for _ in range(horizon):
        going = 0.0
        last = 0
        for i in range(len(end)):
            visits[i] += before[i]
            arriving = 0.0
            for transition in range(last, end[i]):
                arriving += before[source[transition]] * probability[transition]
            last = end[i]
            after[i] = arriving
            going += arriving
        before, after = after, before
        if going == 0.0:
            break
    return visits


def solve(
    model: Model, discount: float = 1.0, horizon: int | None = None, *, issuer_rewards: bool = True
) -> Solution:
    """Computes the optimal values of a model for an agent that knows its state, by value iteration.

    They are upper bounds for an agent from which something is hidden; see also `agents.memoryless`. Without
    `issuer_rewards`, the grid's rewards count alone. A horizon of None means no time limit; the discount must
    then be below 1, else a ValueError is raised.
    """
    if horizon is None and not 0 <= discount < 1:
        raise ValueError(f"discount = {discount}; without a horizon it must lie in [0, 1).")
    reward = model.grid_reward + model.issuer_reward if issuer_rewards else model.grid_reward
    return _iterate(model, reward, discount, horizon)


def largest_success(model: Model, horizon: int) -> float:
    """Returns how often an agent that knows the state succeeds, at most, in episodes from the model's starts.

    It is the optimal value if a correct PING alone has a reward, of 1.
    """
    is_success = (model.event == TARGET_PING).astype(np.float64)
    return float(from_starts(model) @ _iterate(model, is_success, 1.0, horizon).value)


def _iterate(model: Model, reward: NDArray[np.float64], discount: float, horizon: int | None) -> Solution:
    value = np.zeros(len(model.observation))
    q = np.zeros_like(reward)
    step = 0
    while horizon is None or step < horizon:
        q = expected(model, value)
        q[model.terminated] = 0.0
        q *= discount
        q += reward
        best = np.asarray(reduce(np.maximum, q.T))  # several times as fast as q.max(axis=1)
        # Rounding may make the last digit alternate for ever, so equality is not required.
        converged = np.abs(best - value).max() <= 1e-15 * max(1.0, np.abs(best).max())
        unchanged = converged and np.array_equal(best, value)  # as it will be from here on
        value = best
        step += 1
        if unchanged or (converged and discount < 1):
            break
    return Solution(q=q, value=value)


def expected(model: Model, value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the expected value of the next state, (S, A), from the values of all states, (S,)."""
    if model.n_outcomes == 1:
        return np.asarray(value[model.next_state[:, :, 0]])
    return np.asarray((value[model.next_state] * model.probability).sum(axis=2))
