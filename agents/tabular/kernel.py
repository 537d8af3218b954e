"""The compiled loop that trains tabular agents, one after the other, each from its random stream.

`compile_kernel` makes the loop of an update rule. Each agent acts epsilon-greedily.

A step draws one 64-bit word. Its upper half decides whether to explore; its lower half picks one of
the candidates: all actions when exploring, else the greedy ones. Then it draws, each only if it is
needed: a word for the reward of a noisy issuer, at each PING; one for the outcome of the action;
one for the table that a rule with two tables updates; and, when the episode is over, one for the
next start. An on-policy rule draws the next step's word before the update, even if the time limit
then truncates the episode.

Axis letters: N agents, S states, O observations, A actions, K outcomes, B starts, T evaluation
steps, V map steps, R records.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numba import njit

from agents.compiled import compiled
from agents.policy import ALL_ACTIONS, contains
from agents.process import (
    N_ACTIONS,
    STEP,
    Process,
    Stream,
    U,
    draw_start,
    draw_step,
    draw_word,
    keep_step,
    stream_of,
)
from agents.tabular.updates import Successor, UpdateRule
from envs.arrays import Bytes, Floats, Ints, Records, Singles, Words

N_CHOICES = 60
inlined = njit(forceinline=True)
MIN_TRACE = 1e-3  # below this weight a trace is dropped

# (32, 60). Row m lists the actions of mask m, each equally often, since 60 is divisible by every
# count.
CHOICES = np.zeros((ALL_ACTIONS + 1, N_CHOICES), dtype=np.uint8)
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
    backward_passes: int  # over the steps of an episode, at its end


class Plan(NamedTuple):
    """How long training goes on, and when to record and to take snapshots; in budget units."""

    budget: int
    by_episode: bool  # whether the unit is an episode; else it is a step
    record_every: int
    points: Ints  # (T + 1,) evaluation steps, and another that is never reached
    map_index: Ints  # (T,) index of each evaluation step among the map steps; -1 if it is none


class Results(NamedTuple):
    """Where a loop writes, see `TabularTraining`; linear learners lack the last four fields."""

    q: Floats  # (N, O, A)
    greedy: Bytes  # (N, T, O)
    values: Singles  # (N, V, O, A)
    disagreements: Ints  # (N, T)
    max_q: Floats  # (N, R)
    table_max_q: Floats  # (N, R), or (N, 0) if it is not recorded
    steps_taken: Ints  # (N,)
    episodes_ended: Ints  # (N,)


@njit
def choose_action(word: U, explore_below: U, greedy: int) -> U:
    """Chooses an action epsilon-greedily by one word, given the mask of the greedy actions."""
    draw = word & U(0xFFFFFFFF)
    if (
        word >> U(32)
    ) < explore_below:  # what CHOICES has for all actions, without waiting for the mask
        return (draw * U(N_ACTIONS)) >> U(32)
    return U(CHOICES[U(greedy), (draw * U(N_CHOICES)) >> U(32)])


@njit
def find_best(q: Floats, o: U, takes_lowest: bool) -> tuple[float, int]:
    """Returns the largest action value of an observation, and the mask of its greedy actions."""
    q0 = q[o, 0]
    q1 = q[o, 1]
    q2 = q[o, 2]
    q3 = q[o, 3]
    q4 = q[o, 4]
    best = max(max(max(q0, q1), max(q2, q3)), q4)
    mask = (q0 == best) | ((q1 == best) << 1) | ((q2 == best) << 2)
    mask |= ((q3 == best) << 3) | ((q4 == best) << 4)
    return best, mask & -mask if takes_lowest else mask


@njit
def record(
    results: Results, n: int, i: int, i_map: int, q: Floats, greedy: Ints, disagreements: int
) -> None:
    """Writes what is recorded of an agent at an evaluation step, which may be a map step."""
    results.disagreements[n, i] = disagreements
    results.greedy[n, i] = greedy
    if i_map >= 0:
        results.values[n, i_map] = q


@njit
def _new_tree(n_observations: int, value: float) -> Floats:
    """Returns a tree whose inner nodes are the larger of their children, the largest at node 1."""
    leaves = 1
    while leaves < n_observations:
        leaves *= 2
    tree = np.full(2 * leaves, value)
    for i in range(leaves + n_observations, 2 * leaves):
        tree[i] = -np.inf
    return tree


@inlined
def _renew(
    q: Floats, highest: Floats, greedy: Ints, tree: Floats, o: U, takes_lowest: bool
) -> None:
    """Finds the best actions of an observation whose values have changed."""
    highest[o], greedy[o] = find_best(q, o, takes_lowest)
    if len(tree) > 2:
        node = len(tree) // 2 + int(o)
        tree[node] = highest[o]
        while node > 1:
            node >>= 1
            winner = max(tree[2 * node], tree[2 * node + 1])
            if tree[node] == winner:
                break
            tree[node] = winner


@njit
def _pass_back(
    q: Floats,
    highest: Floats,
    greedy: Ints,
    tree: Floats,
    steps: Records,
    constants: Constants,
    rate: float,
    o_last: U,
    terminates: bool,
) -> None:
    """Updates an episode's values backwards, by Q-learning; the last step led to `o_last`."""
    for _ in range(constants.backward_passes):
        value = 0.0 if terminates else highest[o_last]
        for step in steps[::-1]:
            q[step.o, step.a] += rate * (
                step.reward + constants.discount * value - q[step.o, step.a]
            )
            _renew(q, highest, greedy, tree, step.o, constants.takes_lowest)
            value = highest[step.o]


@inlined
def _draw_if(is_needed: bool, stream: Stream) -> tuple[U, Stream]:
    return draw_word(stream) if is_needed else (U(0), stream)


def _compile_learn(update: UpdateRule) -> Callable[..., int]:
    has_two_tables = update.has_two_tables
    has_traces = update.has_traces

    @inlined
    def learn(
        q: Floats,
        highest: Floats,
        greedy: Ints,
        tree: Floats,
        halves: Floats,
        traced: Ints,
        weights: Floats,
        n_traces: int,
        decay: float,
        takes_lowest: bool,
        o: U,
        a: U,
        half: U,
        rate: float,
        target: float,
    ) -> int:
        """Moves an action's value, and earlier ones by traces; returns the number of traces.

        Traces fade; those below `MIN_TRACE` are dropped, and the pair's is set to 1.
        """
        if has_traces:
            pair = o * U(N_ACTIONS) + a
            n_kept = 0
            for i in range(n_traces):
                weight = decay * weights[i]
                if weight >= MIN_TRACE and U(traced[i]) != pair:
                    traced[n_kept], weights[n_kept] = traced[i], weight
                    n_kept += 1
            traced[n_kept], weights[n_kept] = pair, 1.0
            error = target - q[o, a]
            for j in range(n_kept + 1):
                o_traced, a_traced = divmod(U(traced[j]), U(N_ACTIONS))
                q[o_traced, a_traced] += rate * error * weights[j]
                _renew(q, highest, greedy, tree, o_traced, takes_lowest)
            return n_kept + 1
        if has_two_tables:
            halves[o, half, a] += rate * (target - halves[o, half, a])
            q[o, a] = (halves[o, 0, a] + halves[o, 1, a]) / 2
        else:
            q[o, a] += rate * (target - q[o, a])
        _renew(q, highest, greedy, tree, o, takes_lowest)
        return 0

    return learn  # type: ignore[no-any-return]


def _compile_agent(update: UpdateRule) -> Callable[..., None]:
    """Compiles the loop of one agent.

    Variables around a function are constants when it is compiled, so what the rule does not need is
    left out of the compiled code instead of being skipped in each step.
    """
    bootstrap = njit(update.bootstrap)
    learn = _compile_learn(update)
    is_on_policy = update.is_on_policy
    has_two_tables = update.has_two_tables
    has_traces = update.has_traces

    @njit
    def train_agent(
        process: Process, constants: Constants, plan: Plan, stream: Stream, results: Results, n: int
    ) -> None:
        # Arrays are taken out of their tuples before the loop: inside, numba would count references
        # to them.
        first, outcomes, n_outcomes, n_observations, observation, starts, is_noisy = process
        (
            first_rate,
            halved_after,
            discount,
            epsilon,
            initial,
            trace_decay,
            takes_lowest,
            limit,
            _,
        ) = constants
        budget, by_episode, record_every, points, map_index = plan
        explore_below = U(round(epsilon * 2**32))
        decay = discount * trace_decay
        has_tree = results.table_max_q.shape[1] > 0
        q = results.q[n]
        max_q = results.max_q[n]
        table_max_q = results.table_max_q[n] if has_tree else np.empty_like(max_q)
        q[:] = initial
        highest = np.full(n_observations, initial)  # action value of each observation
        greedy = np.full(n_observations, 1 if takes_lowest else ALL_ACTIONS)  # masks
        # no inner nodes if the largest value of the table is not recorded
        tree = _new_tree(n_observations, initial) if has_tree else np.empty(2)
        # the two tables whose mean is q
        halves = np.full((n_observations if has_two_tables else 0, 2, N_ACTIONS), initial)
        rows = halves.reshape(-1, N_ACTIONS)
        # pairs o * A + a with traces, the latest last, and the weights of these traces
        n_pairs = n_observations * N_ACTIONS if has_traces else 0
        traced = np.empty(n_pairs, np.int64)
        weights = np.empty(n_pairs)
        n_traces = 0
        kept = np.empty(limit if constants.backward_passes else 0, STEP)  # of the episode
        state, stream = draw_start(starts, stream)
        o = U(observation[state])
        a = U(0)
        a_next = U(0)
        begins = True
        steps = episode_steps = episodes = disagreements = n_points = n_records = 0
        for unit in range(budget + 1):
            if unit == points[n_points]:
                record(results, n, n_points, map_index[n_points], q, greedy, disagreements)
                n_points += 1
            if unit == budget:
                break
            is_recorded = unit == n_records * record_every
            highest_met = table_highest = -np.inf
            goes_on = True
            while goes_on:
                if is_recorded:
                    highest_met = max(highest_met, highest[o])
                    table_highest = max(table_highest, tree[1])

                # Act
                is_chosen = begins or not is_on_policy
                word, stream = _draw_if(is_chosen, stream)
                a = choose_action(word, explore_below, greedy[o]) if is_chosen else a_next
                reward, i, stream = draw_step(
                    first, outcomes, n_outcomes, is_noisy, state, a, stream
                )
                outcome = outcomes[i]
                disagreements += outcome.is_wrong_ping
                o_next = o + U(outcome.observation_change)

                # Learn
                word, stream = _draw_if(has_two_tables, stream)
                half = word >> U(63)
                value = 0.0
                if not outcome.terminates:
                    row = U(2) * o_next + half
                    best = (  # by the word's lower half
                        U(choose_action(word, U(0), find_best(rows, row, takes_lowest)[1]))
                        if has_two_tables
                        else U(0)
                    )
                    word, stream = _draw_if(is_on_policy, stream)
                    a_next = choose_action(word, explore_below, greedy[o_next])
                    most = highest[o_next]
                    mask = greedy[o_next]
                    value = bootstrap(
                        Successor(q, o_next, most, mask, epsilon, a_next, halves, half, best)
                    )
                rate = first_rate / (1.0 + steps / halved_after)
                target = reward + discount * value
                n_traces = learn(
                    q, highest, greedy, tree, halves, traced, weights,
                    0 if begins or not (greedy[o] >> a) & U(1) else n_traces,
                    decay, takes_lowest, o, a, half, rate, target,
                )  # fmt: skip
                keep_step(kept, U(episode_steps), o, a, reward)

                # Go on, or start the next episode
                steps += 1
                episode_steps += 1
                begins = outcome.terminates or episode_steps == limit
                if begins:
                    episode = kept[:episode_steps]
                    ends = outcome.terminates
                    _pass_back(q, highest, greedy, tree, episode, constants, rate, o_next, ends)
                    state, stream = draw_start(starts, stream)
                    o = U(observation[state])
                    episodes += 1
                    episode_steps = 0
                else:
                    state = state + U(outcome.state_change)
                    o = o_next
                goes_on = by_episode and not begins
            if is_recorded:
                max_q[n_records] = highest_met
                table_max_q[n_records] = table_highest
                n_records += 1
        results.steps_taken[n] = steps
        results.episodes_ended[n] = episodes

    return train_agent  # type: ignore[no-any-return]


@lru_cache
def compile_kernel(update: UpdateRule) -> Callable[..., None]:
    """Returns the kernel of an update rule, compiled when it is first called.

    Kernels of users' rules are not kept on disk: what is in them could have changed.
    """
    train_agent = _compile_agent(update)

    def train(
        process: Process, constants: Constants, plan: Plan, streams: Words, results: Results
    ) -> None:
        """Trains N agents from streams (N, 4); unsigned indices spare tests for negative ones."""
        for n in range(len(streams)):
            train_agent(process, constants, plan, stream_of(streams[n]), results, n)

    if update.bootstrap.__module__ != Successor.__module__:
        return numba.njit(nogil=True)(train)  # type: ignore[no-any-return]
    flags = update.is_on_policy, update.has_traces
    return compiled(train, f"{update.bootstrap.__name__} {flags}")
