"""Learning in plain Python: the words of a stream, what they decide, and the loop of textbooks."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from agents import Schedule, load_algorithm
from agents.tabular.kernel import MIN_TRACE
from envs import Model
from envs.arrays import Floats, Indices
from tests.agents import Changes

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


def choose(word: int, epsilon: float, greedy: Sequence[int]) -> int:
    """Returns one of five actions at random with probability epsilon, else a greedy one."""
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


class Textbook:
    """An agent of the textbook's algorithm: nothing is updated incrementally.

    A value is the sum of a weight for each feature of the observation; in a table, each has one of
    its own.
    """

    def __init__(
        self, name: str, model: Model, settings: Any, seed: SeedSequence, tiles: Indices | None
    ) -> None:
        self.name, self.model, self.settings = name, model, settings
        self.stream = xoshiro(seed.generate_state(4, np.uint64).tolist())
        self.tiles = (np.arange(model.n_observations)[:, None] if tiles is None else tiles).tolist()
        self.n_tables, self.n_tilings = 2 if name == "double_q_learning" else 1, len(self.tiles[0])
        shape = self.n_tables, 1 + max(map(max, self.tiles)), 5
        self.weights = np.full(shape, settings.initial_value / self.n_tilings)
        self.traces: list[tuple[tuple[int, int], float]] = []
        self.state, self.following, self.episode_steps = start(model, self.stream), -1, 0
        self.episode: list[tuple[int, int, float, int, int, bool]] = []
        self.steps = self.episodes = self.wrong = 0

    def values_of(self, table: int, o: int) -> Any:
        return sum(self.weights[table, tile] for tile in self.tiles[o])

    def values(self, o: int) -> Floats:
        return np.asarray(
            sum(self.values_of(table, o) for table in range(self.n_tables)) / self.n_tables
        )

    def table(self) -> Floats:
        return np.array([self.values(o) for o in range(self.model.n_observations)])

    def best(self, row: Floats) -> list[int]:
        best = [action for action in range(5) if row[action] == row.max()]
        return best[:1] if self.settings.ties == "lowest" else best

    def choose(self, row: Floats) -> int:
        return choose(next(self.stream), self.settings.epsilon, self.best(row))

    def value_of_next(self, o: int, word: int) -> float:
        """Returns what the rule says of the next observation."""
        row, epsilon = self.values(o), self.settings.epsilon
        if "sarsa" in self.name and "expected" not in self.name:
            self.following = self.choose(row)
            return float(row[self.following])
        if self.name == "expected_sarsa":  # in this order, for the last digit
            total = (row[0] + row[1]) + (row[2] + row[3]) + row[4]
            return float(epsilon / 5 * total + (1 - epsilon) * row.max())
        if self.name == "double_q_learning":
            half = word >> 63
            return float(
                self.values_of(1 - half, o)[choose(word, 0.0, self.best(self.values_of(half, o)))]
            )
        return float(row.max())

    def pass_back(self, rate: float) -> None:
        """Goes through an episode backwards: one-step Sarsa or Q-learning (Lin 1992)."""
        for _ in range(getattr(self.settings, "backward_passes", 0)):
            for o, action, reward, after, following, terminates in reversed(self.episode):
                row = self.values(after)
                value = row[following] if self.name == "linear_sarsa_lambda" else row.max()
                target = reward + (0.0 if terminates else self.settings.discount * value)
                error = target - self.values(o)[action]
                for tile in self.tiles[o]:
                    self.weights[0, tile, action] += rate * error
        self.episode = []

    def step(self) -> bool:
        """Takes a step and learns from it; returns whether the episode is over."""
        model, settings = self.model, self.settings
        is_sarsa = self.following >= 0
        o = int(model.observation[self.state])
        best = self.best(self.values(o))
        begins = self.episode_steps == 0
        action = self.following if is_sarsa and not begins else self.choose(self.values(o))
        reward, state = take(model, self.state, action, self.stream)
        self.wrong += int(model.is_wrong_ping[self.state, action])
        word = next(self.stream) if self.n_tables > 1 else 0
        terminates = bool(model.terminated[self.state, action])
        value = 0.0 if terminates else self.value_of_next(int(model.observation[state]), word)
        error = reward + settings.discount * value - self.values_of(word >> 63, o)[action]
        if begins or not ("sarsa" in self.name or action in best):
            self.traces = []
        fading = settings.discount * getattr(settings, "trace_decay", 0.0)
        faded, active = (
            [(pair, fading * trace) for pair, trace in self.traces],
            [(tile, action) for tile in self.tiles[o]],
        )
        self.traces = [
            (pair, trace) for pair, trace in faded if trace >= MIN_TRACE and pair not in active
        ]
        self.traces += [(pair, 1.0) for pair in active]  # twice for a tile with two people
        rate = (
            settings.learning_rate
            / (1 + self.steps / (settings.halved_after or np.inf))
            / self.n_tilings
        )
        for pair, trace in self.traces:
            self.weights[word >> 63, *pair] += rate * error * trace
        after = int(model.observation[state])
        self.episode.append((o, action, reward, after, self.following, terminates))
        self.state, self.steps, self.episode_steps = state, self.steps + 1, self.episode_steps + 1
        is_over = terminates or self.episode_steps == settings.time_limit
        if is_over:
            self.pass_back(rate)
            self.state, self.episode_steps = start(model, self.stream), 0
            self.episodes += 1
        return is_over


def textbook(
    name: str,
    model: Model,
    settings: Any,
    seed: SeedSequence,
    points: Sequence[int],
    tiles: Indices | None = None,
) -> Changes:
    """Learns by the algorithm of the textbook, from the words of a seed.

    Returns:
      What `Training`, or without tiles `TabularTraining`, has of an agent.
    """
    agent = Textbook(name, model, settings, seed, tiles)
    record = defaultdict[str, list[Any]](list)
    for unit in range(settings.budget + 1):
        if unit in points:
            table = agent.table()
            record["greedy"].append([sum(2**a for a in agent.best(row)) for row in table])
            record["disagreements"].append(agent.wrong)
            record["values"].append(table.astype(np.float32))
        # largest values met in a unit of the budget, and those of the table then
        visited, largest = [], []
        is_over = unit == settings.budget
        while not is_over:
            visited.append(agent.values(int(model.observation[agent.state])).max())
            largest.append(agent.weights.mean(axis=0).max())
            is_over = agent.step() or getattr(settings, "budget_unit", "steps") == "steps"
        if tiles is None and visited and unit % settings.record_every == 0:
            record["max_q"].append(max(visited))
            record["table_max_q"].append(max(largest))
    found = record | {"q": agent.table(), "values": record["values"][::2]}
    counts = {"steps_taken": agent.steps, "episodes_ended": agent.episodes}
    return found | counts if tiles is None else found


def equal_to_textbook(
    name: str,
    model: Model,
    settings: Any,
    observation: str,
    points: tuple[int, ...],
    tiles: Indices | None = None,
) -> Any:
    """Trains two agents together, compares the second with the textbook's, and returns both."""
    seeds = [SeedSequence([11, i]) for i in range(2)]
    schedule = Schedule(settings.budget, points, points[::2])
    training = load_algorithm(name).train(model, settings, observation, seeds, schedule)
    for key, expected in textbook(name, model, settings, seeds[1], points, tiles).items():
        assert np.array_equal(getattr(training, key)[1], np.asarray(expected)), key
    return training
