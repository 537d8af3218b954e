"""The compiled loop that trains tabular agents, one after the other, each from its random stream.

`compile_kernel` makes the loop for one update rule. Each agent starts at Q = 0 and acts epsilon-greedily.
Its stream is xoshiro256++ (Blackman & Vigna 2021), seeded by the caller, so agents that are trained together
equal the same agents trained one at a time, bit for bit.

A step takes one 64-bit word. Its upper half decides whether to explore; its lower half decides which of the
candidates to take: all actions when exploring, else the greedy ones. A noisy issuer takes another word at
each PING. An on-policy rule draws the next step's word before the update. That leaves the words in order,
but where the time limit truncates it takes one word more, for an action that is not taken.

Axis letters: N agents, S states, O observations, A actions, T evaluation steps, V map steps, R records.
"""

import hashlib
import inspect
import linecache
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from agents.policy import ALL_ACTIONS, contains
from agents.tabular.updates import Q_LEARNING, Successor, UpdateRule
from envs.model import ACTIONS, draw_issuer_reward

U = np.uint64
N_ACTIONS: Final = len(ACTIONS)
PLACES: Final = 60

# (32, 60). Row m lists the actions of mask m, evenly over 60 places: 60 is divisible by every possible count,
# so one draw from 0..59, made before the mask is known, picks each member with equal probability.
CHOICES: Final = np.zeros((ALL_ACTIONS + 1, PLACES), dtype=np.uint8)
for _mask in range(1, ALL_ACTIONS + 1):
    _members = np.flatnonzero(contains(np.array(_mask, dtype=np.uint8)))
    CHOICES[_mask] = _members[np.arange(PLACES) * len(_members) // PLACES]

Stream = tuple[np.uint64, np.uint64, np.uint64, np.uint64]


class Process(NamedTuple):
    """A compiled scenario; state and action are one index, `state * A + action`."""

    next_state: NDArray[np.int64]  # (S * A,) the start where the episode terminates
    next_observation: NDArray[np.int64]  # (S * A,) O where the episode terminates
    reward: NDArray[np.float64]  # (S * A,) mean
    noise: NDArray[np.float64]  # (S * A,) half-width of the uniform noise
    is_wrong_ping: NDArray[np.bool_]  # (S * A,)
    observation: NDArray[np.int64]  # (S,)
    start: int
    is_noisy: bool


class Constants(NamedTuple):
    """How agents act and learn."""

    learning_rate: float
    discount: float
    epsilon: float
    explore_below: np.uint64  # epsilon in units of 2**-32
    takes_lowest: bool  # whether the lowest of several best actions is the only greedy one
    choices: NDArray[np.uint8]  # CHOICES
    time_limit: int


class Plan(NamedTuple):
    """How long training goes on, and when to record and to take snapshots; in budget units."""

    budget: int
    by_episode: bool  # whether the unit is an episode; else it is a step
    record_every: int
    points: NDArray[np.int64]  # (T + 1,) evaluation steps, and another that is never reached
    map_index: NDArray[np.int64]  # (T,) place of each evaluation step among the map steps; -1 if it is none


class Results(NamedTuple):
    """Where the kernel writes; see `agents.tabular.learner.TabularTraining`."""

    q: NDArray[np.float64]  # (N, O, A) zeros at first
    greedy: NDArray[np.uint8]  # (N, T, O)
    values: NDArray[np.float32]  # (N, V, O, A)
    disagreements: NDArray[np.int64]  # (N, T)
    max_q: NDArray[np.float64]  # (N, R)
    table_max_q: NDArray[np.float64]  # (N, R), or (N, 0) if it is not recorded
    steps_taken: NDArray[np.int64]  # (N,)
    episodes_ended: NDArray[np.int64]  # (N,)


@numba.njit
def draw_word(stream: Stream) -> tuple[np.uint64, Stream]:
    """Draws 64 random bits from xoshiro256++; returns them and the stream that follows."""
    s0, s1, s2, s3 = stream
    word = s0 + s3
    word = ((word << U(23)) | (word >> U(41))) + s0
    shifted = s1 << U(17)
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= shifted
    s3 = (s3 << U(45)) | (s3 >> U(19))
    return word, (s0, s1, s2, s3)


@numba.njit
def choose_action(
    word: np.uint64, explore_below: np.uint64, greedy: int, choices: NDArray[np.uint8]
) -> np.uint64:
    """Chooses an action epsilon-greedily by one word, given the mask of the greedy actions."""
    place = ((word & U(0xFFFFFFFF)) * U(PLACES)) >> U(32)
    candidates = ALL_ACTIONS if (word >> U(32)) < explore_below else greedy
    return U(choices[U(candidates), place])


_draw_issuer_reward = numba.njit(draw_issuer_reward)


@numba.njit
def _draw_reward(mean: float, noise: float, stream: Stream) -> tuple[float, Stream]:
    """Returns a noisy reward and the stream that follows."""
    word, stream = draw_word(stream)
    return _draw_issuer_reward(mean, noise, (word >> U(11)) * 2.0**-53), stream


@numba.njit
def _update(
    q: NDArray[np.float64],
    o: np.uint64,
    a: np.uint64,
    target: float,
    learning_rate: float,
    takes_lowest: bool,
) -> tuple[float, int]:
    """Moves an action value; returns the observation's largest one, and the mask of its greedy actions."""
    q[o, a] += learning_rate * (target - q[o, a])
    q0, q1, q2, q3, q4 = q[o, 0], q[o, 1], q[o, 2], q[o, 3], q[o, 4]
    best = max(max(max(q0, q1), max(q2, q3)), q4)
    mask = (q0 == best) | ((q1 == best) << 1) | ((q2 == best) << 2)
    mask |= ((q3 == best) << 3) | ((q4 == best) << 4)
    return best, mask & -mask if takes_lowest else mask


@numba.njit
def _take_snapshot(
    results: Results,
    n: int,
    i: int,
    i_map: int,
    q: NDArray[np.float64],
    greedy: NDArray[np.int64],
    disagreements: int,
) -> None:
    """Keeps what agent n has come to at evaluation step i, which is map step i_map, or none if that is -1."""
    results.disagreements[n, i] = disagreements
    for o in range(len(greedy)):
        results.greedy[n, i, o] = greedy[o]
        if i_map >= 0:
            for a in range(N_ACTIONS):
                results.values[n, i_map, o, a] = q[o, a]


@numba.njit
def _new_tree(n_observations: int) -> NDArray[np.float64]:
    """Returns a tournament tree over observations whose largest values are all 0.

    Its leaves are these values, each inner node is the larger of its two children, and node 1 is the largest
    value of the table.
    """
    leaves = 1
    while leaves < n_observations:
        leaves *= 2
    tree = np.zeros(2 * leaves)
    for i in range(leaves + n_observations, 2 * leaves):
        tree[i] = -np.inf
    return tree


@numba.njit
def _update_tree(tree: NDArray[np.float64], o: np.uint64, best: float) -> None:
    """Sets the largest value of an observation and carries it up the tree."""
    node = len(tree) // 2 + int(o)
    tree[node] = best
    while node > 1:
        node >>= 1
        winner = max(tree[2 * node], tree[2 * node + 1])
        if tree[node] == winner:
            break
        tree[node] = winner


# `compile_kernel` sets these two to what an update rule says.
_bootstrap: Callable[[Successor], float] = numba.njit(Q_LEARNING.bootstrap)
_IS_ON_POLICY = Q_LEARNING.is_on_policy


def _train(
    process: Process, constants: Constants, plan: Plan, streams: NDArray[np.uint64], results: Results
) -> None:
    """Trains N agents from streams (N, 4).

    Indices are unsigned, which spares numba's test for negative ones: a fifth of the time.
    """
    # Arrays are taken out of their tuples before the loop: inside, numba would count references to them.
    next_state, next_observation, rewards, noise, is_wrong_ping, observation, start, is_noisy = process
    learning_rate, discount, epsilon, explore_below, takes_lowest, choices, time_limit = constants
    budget, by_episode, record_every, points, map_index = plan
    n_observations = results.q.shape[1]
    has_tree = results.table_max_q.shape[1] > 0
    for n in range(len(streams)):
        stream = (streams[n, 0], streams[n, 1], streams[n, 2], streams[n, 3])
        q = results.q[n]
        max_q = results.max_q[n]
        table_max_q = results.table_max_q[n]
        highest = np.zeros(n_observations)  # the largest action value of each observation
        greedy = np.full(n_observations, 1 if takes_lowest else ALL_ACTIONS)  # masks of the greedy actions
        tree = _new_tree(n_observations)
        state = U(start)
        o = U(observation[state])
        a = a_next = U(0)
        begins = True
        steps = episodes = episode_steps = disagreements = n_points = n_records = next_record = 0
        next_point = points[0]
        for unit in range(budget):
            if unit == next_point:
                _take_snapshot(results, n, n_points, map_index[n_points], q, greedy, disagreements)
                n_points += 1
                next_point = points[n_points]
            is_recorded = unit == next_record
            highest_met = table_highest = -np.inf
            while True:
                if is_recorded:
                    highest_met = max(highest_met, highest[o])
                    if has_tree:
                        table_highest = max(table_highest, tree[1])
                if begins or not _IS_ON_POLICY:
                    word, stream = draw_word(stream)
                    a = choose_action(word, explore_below, greedy[o], choices)
                taken = state * U(N_ACTIONS) + a
                reward = rewards[taken]
                disagreements += is_wrong_ping[taken]
                if is_noisy and noise[taken] > 0.0:
                    reward, stream = _draw_reward(reward, noise[taken], stream)
                o_next = U(next_observation[taken])
                terminates = o_next == U(n_observations)
                value = 0.0
                if not terminates:
                    if _IS_ON_POLICY:
                        word, stream = draw_word(stream)
                        a_next = choose_action(word, explore_below, greedy[o_next], choices)
                    value = _bootstrap(Successor(q, o_next, highest[o_next], greedy[o_next], epsilon, a_next))
                target = reward + discount * value
                highest[o], greedy[o] = _update(q, o, a, target, learning_rate, takes_lowest)
                if has_tree:
                    _update_tree(tree, o, highest[o])
                steps += 1
                episode_steps += 1
                state = U(next_state[taken])
                begins = terminates or episode_steps == time_limit
                if begins:
                    state = U(start)
                    episodes += 1
                    episode_steps = 0
                o = U(observation[state])
                a = a_next
                if begins or not by_episode:
                    break
            if is_recorded:
                max_q[n_records] = highest_met
                if has_tree:
                    table_max_q[n_records] = table_highest
                n_records += 1
                next_record += record_every
        if next_point == budget:
            _take_snapshot(results, n, n_points, map_index[n_points], q, greedy, disagreements)
        results.steps_taken[n] = steps
        results.episodes_ended[n] = episodes


@lru_cache
def compile_kernel(update: UpdateRule) -> Callable[[Process, Constants, Plan, Any, Results], None]:
    """Returns the kernel of an update rule, compiled when it is first called.

    The kernel is a copy of `_train` whose globals hold the rule. numba caches compiled code on disk by the
    name of the function, and compiles again when the function's file has changed. It does not look at what
    the function calls from other files: the rule and `draw_issuer_reward`. So the copy's name contains a
    digest of these.
    """
    rule = {"_bootstrap": numba.njit(update.bootstrap), "_IS_ON_POLICY": update.is_on_policy}
    kernel = FunctionType(_train.__code__, globals() | rule, _train.__name__)
    parts = [update.is_on_policy, *_identity(update.bootstrap), *_identity(draw_issuer_reward)]
    digest = hashlib.sha256(repr(parts).encode()).hexdigest()
    kernel.__qualname__ = f"{update.bootstrap.__name__}_{digest[:16]}"
    compiled: Callable[..., None] = numba.njit(nogil=True, cache=True)(kernel)
    return compiled


def _identity(function: Callable[..., Any]) -> list[object]:
    """Returns what a function's compiled code depends on: itself, and the text of its file."""
    code = function.__code__
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    text = linecache.getlines(inspect.getfile(function))
    return [function.__module__, code.co_code, code.co_consts, code.co_names, cells, text]
