"""Trains independent agents whose action values are linear in the features of tile coding.

Watkins's Q(lambda) and Sarsa(lambda) with replacing traces (Sutton & Barto 2018, sections 12.7 and 12.10).
With one tiling of single cells, they are the table's: every observation has a weight for each action.
"""

import time
from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from numpy.random import SeedSequence
from pydantic import Field

from agents.contract import Algorithm, Schedule, Training
from agents.linear.kernel import Results, train
from agents.linear.tiles import tiles_of
from agents.policy import ALL_ACTIONS
from agents.process import process_of
from agents.tabular.learner import ValueSettings
from envs.model import ACTIONS, Model
from envs.observations import COORDINATES


class LinearSettings(ValueSettings):
    """The settings of a linear learner."""

    trace_decay: Annotated[float, Field(ge=0, le=1)] = 0.9
    """Lambda: the share of a trace that remains after a step, besides the discount."""
    n_tilings: Annotated[int, Field(ge=1, le=1024)] = 16
    """How many tilings; each learns with its share of the learning rate."""
    tile_width: Annotated[int, Field(ge=1, le=1000)] = 3
    """Cells along each side of a tile."""


class LinearAlgorithm(Algorithm):
    """Q(lambda) or Sarsa(lambda) over tile coding."""

    family = "linear"
    observations = COORDINATES
    settings = LinearSettings
    packages = ("numba",)
    placement = "thread"

    def __init__(self, *, is_on_policy: bool) -> None:
        self.is_on_policy = is_on_policy

    def train(
        self,
        model: Model,
        settings: LinearSettings,
        observation: str,  # noqa: ARG002
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
    ) -> Training:
        """Trains agents, see `Algorithm.train`; too many features are an InputError."""
        tiles = tiles_of(model, settings.n_tilings, settings.tile_width)
        n_agents, n_steps, n_maps = len(seeds), len(schedule.evaluation_steps), len(schedule.map_steps)
        table = model.n_observations, len(ACTIONS)
        result = Training(
            q=np.empty((n_agents, *table)),
            greedy=np.empty((n_agents, n_steps, table[0]), dtype=np.uint8),
            stochastic=np.empty((n_agents, 0, *table)),
            values=np.empty((n_agents, n_maps, *table), dtype=np.float32),
            disagreements=np.empty((n_agents, n_steps), dtype=np.int64),
            cpu_time_s=np.empty((n_agents, n_steps)),
            updates=np.full(n_agents, settings.budget),
            parameters=np.full(n_agents, (int(tiles.max()) + 1) * len(ACTIONS)),
            diverged_at=np.full(n_agents, -1),
        )
        loop = process_of(model), tiles, settings.constants, self.is_on_policy
        points = np.array([*schedule.evaluation_steps, settings.budget + 1], dtype=np.int64)
        map_index = np.where(schedule.is_mapped, schedule.is_mapped.cumsum() - 1, -1)
        streams = np.array([seed.generate_state(4, np.uint64) for seed in seeds])

        def train_one(block: slice) -> None:
            rows = Results(*(getattr(result, name)[block] for name in Results._fields))
            train(*loop, points, map_index, settings.budget, streams[block], rows)

        train_one(slice(0))  # compiles, or loads what was compiled, before the clock runs
        for i in range(n_agents):
            started_s = time.thread_time()
            train_one(slice(i, i + 1))
            result.cpu_time_s[i] = (time.thread_time() - started_s) * points[:-1] / settings.budget
        is_lost = (result.greedy == 0).any(axis=2)  # (N, T), where values are not finite
        result.greedy[is_lost] = ALL_ACTIONS
        for i in np.flatnonzero(is_lost.any(axis=1)).tolist():
            result.diverged_at[i], result.q[i] = points[is_lost[i].argmax()], np.nan
        return result


Q_LAMBDA: Final = LinearAlgorithm(is_on_policy=False)
SARSA_LAMBDA: Final = LinearAlgorithm(is_on_policy=True)
