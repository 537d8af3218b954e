"""The compiled loop that trains tabular agents, one after the other, each from its random stream.

`compile_kernel` makes the loop for one update rule. Each agent acts epsilon-greedily.

A step takes one 64-bit word. Its upper half decides whether to explore; its lower half decides which of the
candidates to take: all actions when exploring, else the greedy ones. Then follow, each only where there is
something to draw: a word for the reward of a noisy issuer, at each PING; one for the outcome of the action;
one for the table that a rule with two tables updates; and, when the episode is over, one for the next start.
An on-policy rule draws the next step's word before the update, also where the time limit then truncates.

Axis letters: N agents, S states, O observations, A actions, K outcomes, B starts, T evaluation steps, V map
steps, R records.
"""

import hashlib
import inspect
import linecache
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Final, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from agents.policy import ALL_ACTIONS, contains
from agents.process import N_ACTIONS, Process, U, draw_start, draw_step, draw_word
from agents.tabular.updates import Q_LEARNING, Successor, UpdateRule
from envs.sources import digest_when_loaded

N_CHOICES: Final = 60
LEAST_TRACE: Final = 1e-3  # below this weight a trace is dropped

# (32, 60). Row m lists the actions of mask m, each equally often, since 60 is divisible by every count.
CHOICES: Final = np.zeros((ALL_ACTIONS + 1, N_CHOICES), dtype=np.uint8)
for _mask in range(1, ALL_ACTIONS + 1):
    _members = np.flatnonzero(contains(np.array(_mask, dtype=np.uint8)))
    CHOICES[_mask] = _members[np.arange(N_CHOICES) * len(_members) // N_CHOICES]


class Constants(NamedTuple):
    """How agents act and learn."""

    learning_rate: float
    halved_after: float  # steps after which the learning rate is half as large
    discount: float
    epsilon: float
    initial_value: float
    trace_decay: float  # the weight of a trace is multiplied by discount * trace_decay per step
    takes_lowest: bool  # whether the lowest of several best actions is the only greedy one
    time_limit: int


class Plan(NamedTuple):
    """How long training goes on, and when to record and to take snapshots; in budget units."""

    budget: int
    by_episode: bool  # whether the unit is an episode; else it is a step
    record_every: int
    points: NDArray[np.int64]  # (T + 1,) evaluation steps, and another that is never reached
    map_index: NDArray[np.int64]  # (T,) index of each evaluation step among the map steps; -1 if it is none


class Results(NamedTuple):
    """Where a loop writes, see `TabularTraining`; that of linear learners leaves the last four."""

    q: NDArray[np.float64]  # (N, O, A)
    greedy: NDArray[np.uint8]  # (N, T, O)
    values: NDArray[np.float32]  # (N, V, O, A)
    disagreements: NDArray[np.int64]  # (N, T)
    max_q: NDArray[np.float64]  # (N, R)
    table_max_q: NDArray[np.float64]  # (N, R), or (N, 0) if it is not recorded
    steps_taken: NDArray[np.int64]  # (N,)
    episodes_ended: NDArray[np.int64]  # (N,)


Kernel = Callable[[Process, Constants, Plan, NDArray[np.uint64], Results], None]


@numba.njit
def choose_action(word: np.uint64, explore_below: np.uint64, greedy: int) -> np.uint64:
    """Chooses an action epsilon-greedily by one word, given the mask of the greedy actions."""
    draw = word & U(0xFFFFFFFF)
    if (word >> U(32)) < explore_below:  # what CHOICES has for all actions, without waiting for the mask
        return (draw * U(N_ACTIONS)) >> U(32)
    return U(CHOICES[U(greedy), (draw * U(N_CHOICES)) >> U(32)])


@numba.njit
def find_best(q: NDArray[np.float64], o: np.uint64, takes_lowest: bool) -> tuple[float, int]:
    """Returns the largest action value of an observation, and the mask of its greedy actions."""
    q0, q1, q2, q3, q4 = q[o, 0], q[o, 1], q[o, 2], q[o, 3], q[o, 4]
    best = max(max(max(q0, q1), max(q2, q3)), q4)
    mask = (q0 == best) | ((q1 == best) << 1) | ((q2 == best) << 2)
    mask |= ((q3 == best) << 3) | ((q4 == best) << 4)
    return best, mask & -mask if takes_lowest else mask


@numba.njit
def record(
    results: Results,
    n: int,
    i: int,
    i_map: int,
    q: NDArray[np.float64],
    greedy: NDArray[np.int64],
    disagreements: int,
) -> None:
    """Writes what is recorded of an agent at an evaluation step, which may be a map step."""
    results.disagreements[n, i] = disagreements
    results.greedy[n, i] = greedy
    if i_map >= 0:
        results.values[n, i_map] = q


@numba.njit
def _new_tree(n_observations: int, value: float) -> NDArray[np.float64]:
    """Returns a tree in which each inner node is the larger of its two children, the largest at node 1."""
    leaves = 1
    while leaves < n_observations:
        leaves *= 2
    tree = np.full(2 * leaves, value)
    for i in range(leaves + n_observations, 2 * leaves):
        tree[i] = -np.inf
    return tree


@numba.njit
def _update_tree(tree: NDArray[np.float64], o: np.uint64, best: float) -> None:
    node = len(tree) // 2 + int(o)
    tree[node] = best
    while node > 1:
        node >>= 1
        winner = max(tree[2 * node], tree[2 * node + 1])
        if tree[node] == winner:
            break
        tree[node] = winner


@numba.njit
def _trace(
    traced: NDArray[np.int64], weights: NDArray[np.float64], n_traces: int, decay: float, pair: np.uint64
) -> int:
    """Decays the traces, drops the least, and sets that of a pair to 1; returns how many there are."""
    n_kept = 0
    for i in range(n_traces):
        weight = decay * weights[i]
        if weight >= LEAST_TRACE and U(traced[i]) != pair:
            traced[n_kept], weights[n_kept] = traced[i], weight
            n_kept += 1
    traced[n_kept], weights[n_kept] = pair, 1.0
    return n_kept + 1


# `compile_kernel` replaces these in its copy of `_train`. They are constants when that is compiled, so what a
# rule does not need is left out of the compiled code instead of being skipped in each step.
_bootstrap: Callable[[Successor], float] = numba.njit(Q_LEARNING.bootstrap)
_IS_ON_POLICY = Q_LEARNING.is_on_policy
_HAS_TWO_TABLES = Q_LEARNING.has_two_tables
_HAS_TRACES = Q_LEARNING.has_traces


def _train(
    process: Process, constants: Constants, plan: Plan, streams: NDArray[np.uint64], results: Results
) -> None:
    """Trains N agents from streams (N, 4); unsigned indices spare numba's test for negative ones."""
    # Arrays are taken out of their tuples before the loop: inside, numba would count references to them.
    first, outcomes, n_outcomes, n_observations, observation, starts, is_noisy = process
    first_rate, halved_after, discount, epsilon, initial_value, decay, takes_lowest, time_limit = constants
    budget, by_episode, record_every, points, map_index = plan
    explore_below = U(round(epsilon * 2**32))
    has_tree = results.table_max_q.shape[1] > 0
    for n in range(len(streams)):
        stream = (streams[n, 0], streams[n, 1], streams[n, 2], streams[n, 3])
        q = results.q[n]
        q[:] = initial_value
        max_q, table_max_q = results.max_q[n], results.table_max_q[n]
        highest = np.full(n_observations, initial_value)  # the largest action value of each observation
        greedy = np.full(n_observations, 1 if takes_lowest else ALL_ACTIONS)  # masks
        tree = _new_tree(n_observations, initial_value)
        tables = np.full((n_observations if _HAS_TWO_TABLES else 0, 2, N_ACTIONS), initial_value)
        table_rows = tables.reshape(-1, N_ACTIONS)
        traced = np.empty(n_observations * N_ACTIONS if _HAS_TRACES else 0, np.int64)  # pairs, o * A + a
        weights = np.empty(len(traced))  # of the traces, the latest last
        state, stream = draw_start(starts, stream)
        o = U(observation[state])
        a = a_next = learned = best = U(0)
        begins = True
        steps = episodes = episode_steps = disagreements = n_points = n_records = next_record = n_traces = 0
        next_point = points[0]
        for unit in range(budget):
            if unit == next_point:
                record(results, n, n_points, map_index[n_points], q, greedy, disagreements)
                n_points += 1
                next_point = points[n_points]
            is_recorded = unit == next_record
            highest_met = table_highest = -np.inf
            while True:
                if is_recorded:
                    highest_met = max(highest_met, highest[o])
                    if has_tree:
                        table_highest = max(table_highest, tree[1])

                # Act
                if begins or not _IS_ON_POLICY:
                    word, stream = draw_word(stream)
                    a = choose_action(word, explore_below, greedy[o])
                reward, i, stream = draw_step(first, outcomes, n_outcomes, is_noisy, state, a, stream)
                outcome = outcomes[i]
                disagreements += outcome.is_wrong_ping
                o_next = o + U(outcome.observation_change)

                # Compute the target
                if _HAS_TWO_TABLES:
                    word, stream = draw_word(stream)
                    learned = word >> U(63)
                value = 0.0
                if not outcome.terminates:
                    if _HAS_TWO_TABLES:  # the lower half of the word chooses among several best actions
                        _, mask = find_best(table_rows, U(2) * o_next + learned, takes_lowest)
                        best = choose_action(word, U(0), mask)
                    if _IS_ON_POLICY:
                        word, stream = draw_word(stream)
                        a_next = choose_action(word, explore_below, greedy[o_next])
                    best_value, best_actions = highest[o_next], greedy[o_next]
                    value = _bootstrap(
                        Successor(q, o_next, best_value, best_actions, epsilon, a_next, tables, learned, best)
                    )
                target = reward + discount * value

                # Learn
                learning_rate = first_rate / (1.0 + steps / halved_after)
                if _HAS_TRACES:
                    if begins or not (greedy[o] >> a) & U(1):
                        n_traces = 0
                    n_traces = _trace(traced, weights, n_traces, discount * decay, o * U(N_ACTIONS) + a)
                    error = target - q[o, a]
                    for j in range(n_traces):
                        o_traced, a_traced = divmod(U(traced[j]), U(N_ACTIONS))
                        q[o_traced, a_traced] += learning_rate * error * weights[j]
                        highest[o_traced], greedy[o_traced] = find_best(q, o_traced, takes_lowest)
                        if has_tree:
                            _update_tree(tree, o_traced, highest[o_traced])
                else:
                    if _HAS_TWO_TABLES:
                        tables[o, learned, a] += learning_rate * (target - tables[o, learned, a])
                        q[o, a] = (tables[o, 0, a] + tables[o, 1, a]) / 2
                    else:
                        q[o, a] += learning_rate * (target - q[o, a])
                    highest[o], greedy[o] = find_best(q, o, takes_lowest)
                    if has_tree:
                        _update_tree(tree, o, highest[o])

                # Go on, or start the next episode
                steps += 1
                episode_steps += 1
                begins = outcome.terminates or episode_steps == time_limit
                if begins:
                    state, stream = draw_start(starts, stream)
                    o = U(observation[state])
                    episodes += 1
                    episode_steps = 0
                else:
                    state, o = state + U(outcome.state_change), o_next
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
            record(results, n, n_points, map_index[n_points], q, greedy, disagreements)
        results.steps_taken[n] = steps
        results.episodes_ended[n] = episodes


@lru_cache
def compile_kernel(update: UpdateRule) -> Kernel:
    """Returns the kernel of an update rule, compiled when it is first called.

    The kernel is a copy of `_train` whose globals hold the rule. Since compiled code is kept on disk by the
    function's name, that contains a digest of the rule and of the text of its file and of what that imports.
    """
    flags = {
        "_IS_ON_POLICY": update.is_on_policy,
        "_HAS_TWO_TABLES": update.has_two_tables,
        "_HAS_TRACES": update.has_traces,
    }
    rule = flags | {"_bootstrap": numba.njit(update.bootstrap)}
    kernel = FunctionType(_train.__code__, globals() | rule, _train.__name__)
    code = update.bootstrap.__code__
    cells = [cell.cell_contents for cell in update.bootstrap.__closure__ or ()]
    text = linecache.getlines(inspect.getfile(update.bootstrap))
    imported = digest_when_loaded(update.bootstrap.__module__)
    parts = flags, code.co_code, code.co_consts, code.co_names, cells, text, imported
    digest = hashlib.sha256(repr(parts).encode()).hexdigest()
    kernel.__qualname__ = f"{update.bootstrap.__name__}_{digest[:16]}"
    return compiled(kernel)
