"""Tabular Q-learning (Watkins & Dayan 1992) for a whole population of independent agents.

Each agent starts at Q = 0, acts epsilon-greedily, and after action a in observation o updates

    Q(o, a) += learning_rate * (r + discount * max_b Q(o', b) - Q(o, a)),

without the bootstrap term where the episode terminates, and with it where the time limit truncates.

Every agent has a random stream of its own (xoshiro256++, Blackman & Vigna 2021), seeded by the
caller, so that agents trained together equal the same agents trained one at a time, bit for bit, on
any number of threads. Each step takes one 64-bit draw: its upper half decides whether to explore,
its lower half which member of the set of candidate actions to take (all of them when exploring, the
greedy ones otherwise). A noisy issuer takes one draw more at each PING.
"""

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numba
import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray
from pydantic import Field, model_validator

from agents.contract import LearnerSettings, Schedule, Training
from agents.policy import ALL_ACTIONS, contains
from envs.model import ACTIONS, Model, draw_issuer_reward

VERSION: Final = 3  # part of every run's identity: raise it when a change alters what is learned

U = np.uint64
_draw_issuer_reward = numba.njit(draw_issuer_reward)

# Row m lists the actions of mask m, evenly over 60 places: 60 is divisible by every possible count,
# so one draw from 0..59, made before the mask is known, picks each member with equal probability.
_PLACES: Final = 60
_CHOICE: Final = np.zeros((ALL_ACTIONS + 1, _PLACES), dtype=np.uint8)
for _mask in range(1, ALL_ACTIONS + 1):
    _members = np.flatnonzero(contains(np.array(_mask, dtype=np.uint8)))
    _CHOICE[_mask] = _members[np.arange(_PLACES) * len(_members) // _PLACES]


class Settings(LearnerSettings):
    """What a Q-learner can be told; the defaults are the paper's."""

    learning_rate: Annotated[float, Field(gt=0, le=1)] = 0.6
    discount: Annotated[float, Field(ge=0, le=1)] = 0.9
    epsilon: Annotated[float, Field(ge=0, le=1)] = 0.6  # probability of a uniformly random action
    ties: Literal["uniform", "lowest"] = "uniform"  # which of several best actions is greedy
    budget_unit: Literal["steps", "episodes"] = "steps"
    record_every: Annotated[int, Field(ge=1, le=10**9)] = (
        1  # budget units from one record of max Q to the next
    )

    @property
    def discount_factor(self) -> float:
        """The discount of the table's values."""
        return self.discount

    @model_validator(mode="after")
    def _episodes_end(self) -> Self:
        if self.budget_unit == "episodes" and self.epsilon == 0 and self.time_limit is None:
            raise ValueError('budget_unit = "episodes" with epsilon = 0 may never end; set time_limit')
        return self


@dataclass(frozen=True, eq=False, kw_only=True)
class TabularTraining(Training):
    """What came of training N agents, beside what every algorithm tells; R records."""

    # (N, R) max_a Q(o_t, a) of the visited o_t before its update; with a budget of episodes, the
    # largest met in the episode.
    max_q: NDArray[np.float64]
    table_max_q: NDArray[np.float64]  # (N, R) the largest Q of the table then; R = 0 if not asked for
    steps_taken: NDArray[np.int64]  # (N,)
    episodes_ended: NDArray[np.int64]  # (N,)


def train(
    model: Model,
    settings: Settings,
    seeds: Sequence[SeedSequence],
    evaluation_steps: Sequence[int] = (),
    map_steps: Sequence[int] = (),
    *,
    record_table: bool = False,
    threads: int = 1,
) -> TabularTraining:
    """Trains one agent a seed.

    Args:
      model: Compiled scenario.
      settings: The learner's settings, the same for all.
      seeds: One an agent; agents of equal seeds are equal.
      evaluation_steps: When to keep the greedy policy: rising, in budget units, 0 to the budget.
      map_steps: When to keep the table: some of the evaluation steps, rising.
      record_table: Whether to record the whole table's maximum, too.
      threads: How many to use; no result depends on it.

    Raises:
      ValueError: No agents, no thread, evaluation steps that do not rise from 0 to the budget, or map steps
        that are none of them.
    """
    n_agents, n_cells = len(seeds), model.n_observations
    points = np.array([*evaluation_steps, settings.budget + 1], dtype=np.int64)
    if n_agents < 1 or threads < 1:
        raise ValueError(f"{n_agents} agents on {threads} threads; at least one of each.")
    if points[0] < 0 or np.any(np.diff(points) <= 0):
        raise ValueError(f"evaluation_steps: must rise, from at least 0 to at most {settings.budget}.")
    is_mapped = np.isin(points, map_steps)
    if list(points[is_mapped]) != list(map_steps):
        raise ValueError("map_steps: must be among the evaluation steps, and rise.")
    n_records = math.ceil(settings.budget / settings.record_every)
    shape = n_agents, len(points) - 1  # (N, T)
    result = TabularTraining(
        q=np.zeros((n_agents, n_cells, len(ACTIONS))),
        greedy=np.empty((*shape, n_cells), dtype=np.uint8),
        stochastic=np.empty((n_agents, 0, n_cells, len(ACTIONS))),
        values=np.empty((n_agents, len(map_steps), n_cells, len(ACTIONS)), dtype=np.float32),
        disagreements=np.empty(shape, dtype=np.int64),
        cpu_time_s=np.empty(shape),
        updates=np.empty(n_agents, dtype=np.int64),
        parameters=np.full(n_agents, n_cells * len(ACTIONS)),
        diverged_at=np.full(n_agents, -1),
        max_q=np.empty((n_agents, n_records)),
        table_max_q=np.empty((n_agents, n_records if record_table else 0)),
        steps_taken=np.empty(n_agents, dtype=np.int64),
        episodes_ended=np.empty(n_agents, dtype=np.int64),
    )
    streams = np.array([seed.generate_state(4, np.uint64) for seed in seeds])
    # Ended transitions go on at the start, and bootstrap from a place behind the table that holds 0.
    next_state = np.where(model.terminated, model.start, model.next_state)
    bootstrap = np.where(model.terminated, n_cells, model.observation[model.next_state])

    def work(first: int, last: int) -> None:
        started_s = time.thread_time()
        _train(
            next_state.astype(np.int64).ravel(),
            bootstrap.astype(np.int64).ravel(),
            (model.grid_reward + model.issuer_reward).ravel(),
            model.issuer_noise.ravel(),
            model.is_wrong_ping.ravel(),
            model.observation.astype(np.int64),
            model.start,
            settings.learning_rate,
            settings.discount,
            U(round(settings.epsilon * 2**32)),
            settings.ties == "lowest",
            settings.budget,
            settings.budget_unit == "episodes",
            settings.time_limit or 2**62,
            settings.record_every,
            points,
            is_mapped,
            _CHOICE,
            streams[first:last],
            result.q[first:last],
            result.greedy[first:last],
            result.values[first:last],
            result.disagreements[first:last],
            result.max_q[first:last],
            result.table_max_q[first:last],
            result.steps_taken[first:last],
            result.episodes_ended[first:last],
        )
        # Agents of a block take turns too short to be timed; each has its share, by its steps.
        seconds = (time.thread_time() - started_s) / max(last - first, 1)
        result.cpu_time_s[first:last] = seconds * points[:-1] / settings.budget

    work(0, 0)  # compile, or fetch what was compiled, before the clock runs
    # Small blocks, so that threads end together and an interrupt waits for one block at most.
    n_blocks = min(n_agents, threads * math.ceil(n_agents / (threads * 8)) if threads > 1 else 1)
    edges = np.linspace(0, n_agents, n_blocks + 1).astype(int)
    with ThreadPoolExecutor(threads) as pool:
        try:
            for future in [pool.submit(work, a, b) for a, b in pairwise(edges)]:
                future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    result.updates[:] = result.steps_taken
    return result


@dataclass(frozen=True)
class TabularAlgorithm:
    """A learner of a table, see `agents.contract.Algorithm`."""

    version: int = VERSION
    family: Literal["tabular", "deep"] = "tabular"
    settings: type[Settings] = Settings
    observations: tuple[str, ...] = ("index",)  # a table has a row per observation, in whatever form
    packages: tuple[str, ...] = ("numba",)
    batch_size: int = 25
    placement: Literal["thread", "process"] = "thread"
    depends_on_batch: bool = False
    writes_logs: bool = False

    def train(
        self,
        model: Model,
        settings: Settings,
        observation: str,  # noqa: ARG002
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),  # noqa: ARG002
    ) -> TabularTraining:
        """Trains one agent per seed and records everything; but a single record is not a curve."""
        return train(
            model,
            settings,
            seeds,
            schedule.evaluation_steps,
            schedule.map_steps,
            record_table=settings.record_every < settings.budget,
        )


Q_LEARNING: Final = TabularAlgorithm()


@numba.njit
def _xoshiro(
    s0: np.uint64, s1: np.uint64, s2: np.uint64, s3: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64, np.uint64]:
    """Draws from xoshiro256++: 64 random bits, and the state that follows."""
    draw = s0 + s3
    draw = ((draw << U(23)) | (draw >> U(41))) + s0
    shifted = s1 << U(17)
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= shifted
    s3 = (s3 << U(45)) | (s3 >> U(19))
    return draw, s0, s1, s2, s3


@numba.njit(nogil=True, cache=True)
def _train(
    next_state: NDArray[np.int64],  # (S * A,) the start where the episode terminates
    bootstrap: NDArray[np.int64],  # (S * A,) the observation to bootstrap from; O where it terminates
    reward: NDArray[np.float64],  # (S * A,) mean
    noise: NDArray[np.float64],  # (S * A,)
    is_wrong_ping: NDArray[np.bool_],  # (S * A,)
    observation: NDArray[np.int64],  # (S,)
    start: int,
    learning_rate: float,
    discount: float,
    explore_below: np.uint64,  # of 2**32
    lowest: bool,
    budget: int,
    by_episode: bool,
    time_limit: int,
    record_every: int,
    points: NDArray[np.int64],  # (T + 1,) the last one is never reached
    is_mapped: NDArray[np.bool_],  # (T + 1,)
    choice: NDArray[np.uint8],  # (32, 60)
    streams: NDArray[np.uint64],  # (N, 4)
    q_out: NDArray[np.float64],  # (N, O, A)
    greedy_out: NDArray[np.uint8],  # (N, T, O)
    values_out: NDArray[np.float32],  # (N, V, O, A)
    disagreements_out: NDArray[np.int64],  # (N, T)
    max_out: NDArray[np.float64],  # (N, R)
    table_max_out: NDArray[np.float64],  # (N, R) or (N, 0)
    steps_out: NDArray[np.int64],  # (N,)
    episodes_out: NDArray[np.int64],  # (N,)
) -> None:
    """Trains agents one after the other, each from its own stream.

    Indices are unsigned, which spares numba's test for negative ones: a fifth of the time.
    """
    n_cells = q_out.shape[1]
    nowhere = U(n_cells)
    every_action = choice.shape[0] - 1  # the mask that holds them all
    places = U(choice.shape[1])
    noisy = noise.any()
    record_table = table_max_out.shape[1] > 0
    # A tournament tree: leaves are the rows' maxima, each inner node the larger of its two children.
    leaves = 1
    while leaves < n_cells:
        leaves *= 2
    for n in range(q_out.shape[0]):
        s0, s1, s2, s3 = streams[n, 0], streams[n, 1], streams[n, 2], streams[n, 3]
        q = q_out[n]
        row_max = np.zeros(n_cells + 1)  # the place behind the table is what a terminal state is worth
        greedy = np.full(
            n_cells, 1 if lowest else every_action, dtype=np.int64
        )  # masks of the greedy actions
        tree = np.zeros(2 * leaves)
        for i in range(n_cells, leaves):
            tree[leaves + i] = -np.inf
        state = U(start)
        o = U(observation[start])
        steps = 0
        episodes = 0
        episode_steps = 0
        disagreements = 0
        n_points = 0
        n_maps = 0
        next_point = points[0]
        next_record = 0
        n_records = 0
        for unit in range(budget):
            if unit == next_point:
                for i in range(n_cells):
                    greedy_out[n, n_points, i] = greedy[i]
                disagreements_out[n, n_points] = disagreements
                if is_mapped[n_points]:
                    values_out[n, n_maps] = q
                    n_maps += 1
                n_points += 1
                next_point = points[n_points]
            recorded = unit == next_record
            highest = -np.inf
            table_highest = -np.inf
            while True:
                if recorded:
                    highest = max(highest, row_max[o])
                    if record_table:
                        table_highest = max(table_highest, tree[1])
                draw, s0, s1, s2, s3 = _xoshiro(s0, s1, s2, s3)
                place = ((draw & U(0xFFFFFFFF)) * places) >> U(32)
                candidates = every_action if (draw >> U(32)) < explore_below else greedy[o]
                a = U(choice[U(candidates), place])
                taken = state * U(5) + a
                r = reward[taken]
                disagreements += is_wrong_ping[taken]
                if noisy and noise[taken] > 0.0:
                    draw, s0, s1, s2, s3 = _xoshiro(s0, s1, s2, s3)
                    r = _draw_issuer_reward(r, noise[taken], (draw >> U(11)) * 2.0**-53)
                source = U(bootstrap[taken])
                target = r + discount * row_max[source]
                q[o, a] += learning_rate * (target - q[o, a])
                q0, q1, q2, q3, q4 = q[o, 0], q[o, 1], q[o, 2], q[o, 3], q[o, 4]
                best = max(max(max(q0, q1), max(q2, q3)), q4)
                mask = (q0 == best) | ((q1 == best) << 1) | ((q2 == best) << 2)
                mask |= ((q3 == best) << 3) | ((q4 == best) << 4)
                greedy[o] = mask & -mask if lowest else mask
                row_max[o] = best
                if record_table:
                    node = leaves + int(o)
                    tree[node] = best
                    while node > 1:
                        node >>= 1
                        winner = max(tree[2 * node], tree[2 * node + 1])
                        if tree[node] == winner:
                            break
                        tree[node] = winner
                steps += 1
                episode_steps += 1
                ended = source == nowhere or episode_steps == time_limit
                state = U(next_state[taken])
                if ended:
                    state = U(start)
                    episodes += 1
                    episode_steps = 0
                o = U(observation[state])
                if ended or not by_episode:
                    break
            if recorded:
                max_out[n, n_records] = highest
                if record_table:
                    table_max_out[n, n_records] = table_highest
                n_records += 1
                next_record += record_every
        if next_point == budget:
            for i in range(n_cells):
                greedy_out[n, n_points, i] = greedy[i]
            disagreements_out[n, n_points] = disagreements
            if is_mapped[n_points]:
                values_out[n, n_maps] = q
        steps_out[n] = steps
        episodes_out[n] = episodes
