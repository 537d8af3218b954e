"""Tabular learning in plain Python: the words of a stream, what they decide, and the loops of textbooks."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents.tabular.kernel import MIN_TRACE
from envs import Model

WORD = 2**64


def xoshiro(state: Sequence[int]) -> Iterator[int]:
    """Yields the words of xoshiro256++ as its authors print it, in Python's integers."""
    s = list(state)

    def rotate(x: int, k: int) -> int:
        return (x << k | x >> (64 - k)) % WORD

    while True:
        yield (rotate((s[0] + s[3]) % WORD, 23) + s[0]) % WORD
        shifted = (s[1] << 17) % WORD
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= shifted
        s[3] = rotate(s[3], 45)


def words(seed: SeedSequence) -> Iterator[int]:
    """Yields the words of the agent of a seed."""
    return xoshiro([int(word) for word in seed.generate_state(4, np.uint64)])


def choose(word: int, epsilon: float, greedy: Sequence[int]) -> int:
    """Returns a random one of five actions with probability epsilon, else one of the greedy actions."""
    upper, lower = divmod(word, 2**32)
    candidates = range(5) if upper < round(epsilon * 2**32) else greedy
    # A draw from 0..59 picks one of one to five candidates, each equally often.
    return candidates[(lower * 60 >> 32) * len(candidates) // 60]


def uniform(word: int) -> float:
    """Returns a number from [0, 1)."""
    return (word >> 11) / 2**53


def start(model: Model, stream: Iterator[int]) -> int:
    """Returns a state to start in."""
    n = len(model.starts)
    return int(model.starts[int(uniform(next(stream)) * n)]) if n > 1 else model.start


def take(model: Model, state: int, action: int, stream: Iterator[int]) -> tuple[float, int]:
    """Returns the reward of an action and the next state."""
    at = state, action
    reward = model.grid_reward[at] + model.issuer_reward[at]
    if model.issuer_noise[at]:
        reward += model.issuer_noise[at] * (2 * uniform(next(stream)) - 1)
    outcome = 0
    if model.n_outcomes > 1:
        outcome = int((np.cumsum(model.probability[at])[:-1] <= uniform(next(stream))).sum())
    return float(reward), int(model.next_state[(*at, outcome)])


def best_of(row: NDArray[np.float64], ties: str) -> list[int]:
    """Returns the greedy actions, given action values (A,)."""
    best = [action for action in range(5) if row[action] == row.max()]
    return best[:1] if ties == "lowest" else best


def textbook(
    name: str, model: Model, settings: Any, seed: SeedSequence, points: Sequence[int] = ()
) -> dict[str, Any]:
    """Learns by the algorithm of the textbook, from the words of a seed; nothing is updated incrementally.

    Returns:
      What `TabularTraining` has of an agent.
    """
    record: dict[str, Any] = {"greedy": [], "max_q": [], "table_max_q": []}
    stream = words(seed)
    tables = np.full((2, model.n_observations, 5), settings.initial_value)  # the second for double Q-learning
    traces: dict[tuple[int, int], float] = {}  # weights
    n_tables = 2 if name == "double_q_learning" else 1

    def values(o: int) -> NDArray[np.float64]:
        return np.asarray(tables[:n_tables, o].mean(axis=0))

    def best_actions(row: NDArray[np.float64]) -> list[int]:
        return best_of(row, settings.ties)

    def take_snapshot(unit: int) -> None:
        if unit in points:
            rows = map(values, range(model.n_observations))
            record["greedy"].append([sum(2**action for action in best_actions(row)) for row in rows])

    state, episode_steps, following_action = start(model, stream), 0, -1
    unit = steps = episodes = 0
    visited: list[float] = []  # the largest values met in a unit of the budget, and those of the table then
    largest: list[float] = []
    while unit < settings.budget:
        if not visited:
            take_snapshot(unit)
        epsilon = settings.epsilon
        o = int(model.observation[state])
        visited.append(values(o).max())
        largest.append(tables[:n_tables].mean(axis=0).max())
        action = following_action
        if name != "sarsa" or episode_steps == 0:
            action = choose(next(stream), epsilon, best_actions(values(o)))
        is_greedy = action in best_actions(values(o))

        reward, next_state = take(model, state, action, stream)
        o_next = int(model.observation[next_state])
        word = next(stream) if name == "double_q_learning" else 0
        updated = word >> 63

        target = reward
        if not model.terminated[state, action]:
            row = values(o_next)
            match name:
                case "q_learning" | "watkins_q_lambda":
                    value = row.max()
                case "sarsa":
                    following_action = choose(next(stream), epsilon, best_actions(row))
                    value = row[following_action]
                case "expected_sarsa":
                    # In this order, for the last digit.
                    total = (row[0] + row[1]) + (row[2] + row[3]) + row[4]
                    value = epsilon / 5 * total + (1 - epsilon) * row.max()
                case "double_q_learning":
                    argmax = choose(word, 0.0, best_actions(tables[updated, o_next]))
                    value = tables[1 - updated, o_next, argmax]
            target += settings.discount * value
        rate = settings.learning_rate / (1 + steps / (settings.halved_after or np.inf))
        if name == "watkins_q_lambda":
            if episode_steps == 0 or not is_greedy:
                traces.clear()
            error = target - tables[0, o, action]
            faded = {pair: settings.discount * settings.trace_decay * traces[pair] for pair in traces}
            traces = {pair: weight for pair, weight in faded.items() if weight >= MIN_TRACE}
            traces[o, action] = 1.0
            for pair, weight in traces.items():
                tables[0, *pair] += rate * error * weight
        else:
            tables[updated, o, action] += rate * (target - tables[updated, o, action])

        terminates = model.terminated[state, action]
        state, episode_steps, steps = next_state, episode_steps + 1, steps + 1
        ends = terminates or episode_steps == settings.time_limit
        if ends:
            state, episode_steps, episodes = start(model, stream), 0, episodes + 1
        if ends or settings.budget_unit == "steps":
            if unit % settings.record_every == 0:
                record["max_q"].append(max(visited))
                record["table_max_q"].append(max(largest))
            visited, largest, unit = [], [], unit + 1
    take_snapshot(settings.budget)
    q = tables[:n_tables].mean(axis=0)
    return record | {"q": q, "steps_taken": steps, "episodes_ended": episodes}
