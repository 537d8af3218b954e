"""The compiled loop that trains linear learners, one after the other, each from its random stream.

An action value is the sum of a weight for each feature of the observation. Words are drawn as for
tables, see `agents.tabular.kernel`, so with one tiling of single cells the agents are those of the
table. A feature that an observation has twice, with shared tiles, counts and is traced twice.

Axis letters: N agents, O observations, A actions, T evaluation steps, V map steps.
"""

import numpy as np
from numba import njit

from agents.compiled import compiled
from agents.process import (
    N_ACTIONS,
    STEP,
    Process,
    U,
    draw_start,
    draw_step,
    draw_word,
    keep_step,
    stream_of,
)
from agents.tabular.kernel import (
    MIN_TRACE,
    Constants,
    Plan,
    Results,
    choose_action,
    find_best,
    record,
)
from envs.arrays import Floats, Ints, Records, Words
from envs.tiles import Tiles


@njit
def _add_up(weights: Floats, features: Tiles, o: U, q: Floats, row: int) -> None:
    """Writes an observation's action values into a row of q, summed in the order of features."""
    q[row] = 0.0
    for i in features.rows[o]:
        for feature in features.tiles[U(i)]:
            for a in range(N_ACTIONS):
                q[row, a] += weights[U(feature), a]


@njit
def _tabulate(
    weights: Floats, features: Tiles, takes_lowest: bool, q: Floats, greedy: Ints
) -> None:
    """Writes action values (O, A) and greedy masks (O,), 0 where values are not finite."""
    for o in range(len(features.rows)):
        _add_up(weights, features, U(o), q, o)
        _, mask = find_best(q, U(o), takes_lowest)
        greedy[o] = mask if np.isfinite(q[o]).all() else 0


@njit
def _learn(
    weights: Floats,
    features: Tiles,
    traced: Ints,
    strengths: Floats,
    renewed: Ints,
    n_traces: int,
    step: int,
    decay: float,
    change: float,
    o: U,
    a: U,
) -> int:
    """Fades the traces, sets a pair's to 1, and changes all traced weights; returns how many.

    `renewed` holds the latest step at which the trace of each weight was set to 1.
    """
    flat = weights.reshape(-1)
    for row in features.rows[o]:
        for feature in features.tiles[U(row)]:
            renewed[U(feature) * U(N_ACTIONS) + a] = step
    n_kept = 0
    for i in range(n_traces):
        strength = decay * strengths[i]
        weight = U(traced[i])
        if strength >= MIN_TRACE and renewed[weight] != step:
            traced[n_kept], strengths[n_kept] = weight, strength
            flat[weight] += change * strength
            n_kept += 1
    for row in features.rows[o]:
        for feature in features.tiles[U(row)]:
            weight = U(feature) * U(N_ACTIONS) + a
            traced[n_kept], strengths[n_kept] = weight, 1.0
            flat[weight] += change
            n_kept += 1
    return n_kept


@njit
def _pass_back(
    weights: Floats,
    features: Tiles,
    steps: Records,
    constants: Constants,
    is_on_policy: bool,
    learning_rate: float,
    last: tuple[U, U, bool],  # o and a after the last step, and whether it terminated
) -> None:
    """Updates an episode's values backwards, by Sarsa if on-policy, else by Q-learning."""
    q = np.empty((1, N_ACTIONS))
    for _ in range(constants.backward_passes):
        o, a, terminates = last
        for step in steps[::-1]:
            _add_up(weights, features, o, q, 0)
            value = 0.0
            if not terminates:
                value = q[0, a] if is_on_policy else q.max()
            o = step.o
            a = step.a
            terminates = False
            _add_up(weights, features, o, q, 0)
            change = learning_rate * (step.reward + constants.discount * value - q[0, a])
            for row in features.rows[o]:
                for feature in features.tiles[U(row)]:
                    weights[U(feature), a] += change


@compiled
def train(
    process: Process,
    features: Tiles,
    constants: Constants,
    is_on_policy: bool,
    plan: Plan,
    streams: Words,
    results: Results,
) -> None:
    """Trains N agents from streams (N, 4), by Sarsa(lambda) or Watkins's Q(lambda)."""
    first, outcomes, n_outcomes, n_observations, observation, starts, is_noisy = process
    (
        first_rate,
        halved_after,
        discount,
        epsilon,
        initial_value,
        decay,
        takes_lowest,
        time_limit,
        _,
    ) = constants
    budget, _, _, points, map_index = plan
    explore_below = U(round(epsilon * 2**32))
    tiles = features.tiles
    fading = discount * decay
    n_active = features.rows.shape[1] * tiles.shape[1]
    n_features = tiles.max() + 1
    # Traces last for an episode, and a weight has at most one for each set of positions.
    n_most = n_active * min(time_limit, n_features * N_ACTIONS // tiles.shape[1] + 1)
    for n in range(len(streams)):
        stream = stream_of(streams[n])
        weights = np.full((n_features, N_ACTIONS), initial_value / n_active)
        traced = np.empty(n_most, np.int64)
        strengths = np.empty(n_most)
        renewed = np.full(n_features * N_ACTIONS, -1)
        kept = np.empty(time_limit if constants.backward_passes else 0, STEP)
        masks = np.empty(n_observations, np.int64)  # masks of greedy actions
        q = np.empty((2, N_ACTIONS))  # values of this observation and, before the update, the next
        state, stream = draw_start(starts, stream)
        o = U(observation[state])
        _add_up(weights, features, o, q, 0)
        a = a_next = U(0)
        begins = True
        episode_steps = disagreements = n_points = n_traces = 0
        for step in range(budget + 1):
            if step == points[n_points]:
                _tabulate(weights, features, takes_lowest, results.q[n], masks)
                record(
                    results, n, n_points, map_index[n_points], results.q[n], masks, disagreements
                )
                n_points += 1
            if step == budget:
                break

            # Act
            _, greedy = find_best(q, U(0), takes_lowest)
            if begins or not is_on_policy:
                word, stream = draw_word(stream)
                a = choose_action(word, explore_below, greedy)
            reward, i, stream = draw_step(first, outcomes, n_outcomes, is_noisy, state, a, stream)
            outcome = outcomes[i]
            disagreements += outcome.is_wrong_ping
            o_next = o + U(outcome.observation_change)

            # Compute the target
            value = 0.0
            if not outcome.terminates:
                _add_up(weights, features, o_next, q, 1)
                value, greedy_next = find_best(q, U(1), takes_lowest)
                if is_on_policy:
                    word, stream = draw_word(stream)
                    a_next = choose_action(word, explore_below, greedy_next)
                    value = q[1, a_next]

            # Learn
            if begins or not (is_on_policy or (greedy >> a) & U(1)):
                n_traces = 0
            learning_rate = first_rate / (1.0 + step / halved_after) / n_active
            change = learning_rate * (reward + discount * value - q[0, a])
            n_traces = _learn(
                weights, features, traced, strengths, renewed, n_traces, step, fading, change, o, a
            )
            keep_step(kept, U(episode_steps), o, a, reward)

            # Go on, or start the next episode
            episode_steps += 1
            begins = outcome.terminates or episode_steps == time_limit
            if begins:
                steps = kept[:episode_steps]
                last = (o_next, a_next, outcome.terminates)
                _pass_back(weights, features, steps, constants, is_on_policy, learning_rate, last)
                state, stream = draw_start(starts, stream)
                o = U(observation[state])
                episode_steps = 0
            else:
                state = state + U(outcome.state_change)
                o = o_next
            a = a_next
            _add_up(weights, features, o, q, 0)
        _tabulate(weights, features, takes_lowest, results.q[n], masks)
