"""Trains independent agents whose action values are linear in the features of tile coding.

Watkins's Q(lambda) and Sarsa(lambda) with replacing traces (Sutton & Barto 2018, sections 12.7 and
12.10). With one tiling of single cells, they are the table's: every observation has a weight for
each action.
"""

from collections.abc import Callable
from functools import partial
from typing import Annotated

import numpy as np
from pydantic import Field

from agents.contract import Training
from agents.linear.kernel import train
from agents.process import process_of
from agents.tabular.learner import TraceSettings, ValueAlgorithm
from envs import ACTIONS, Model
from envs.observations import ENCODINGS, N_TILINGS, TILE_WIDTH, observation_ones
from envs.tiles import Parts, Tiles, tiles_of

_FEATURES = ("coordinates", "factored", "tiles")  # coordinates are tiled by the learner


class LinearSettings(TraceSettings):
    """The settings of a linear learner."""

    n_tilings: Annotated[int, Field(ge=1, le=1024)] = N_TILINGS
    """How many tilings; each learns with its share of the learning rate."""
    tile_width: Annotated[int, Field(ge=1, le=1000)] = TILE_WIDTH
    """Cells along each side of a tile."""
    parts: Parts = "joint"
    """Which positions are tiled together: all ("joint"), or the agent's with each person's, with
    weights for each person ("agent_pairs") or the same for all ("shared_pairs"). Each pair's
    tiles encode only its own person's badge."""


class LinearAlgorithm(ValueAlgorithm):
    """Q(lambda) or Sarsa(lambda) over tile coding, or over the features of a sparse form."""

    family = "linear"
    observations = tuple(form for form, kind in ENCODINGS.items() if kind in _FEATURES)
    settings = LinearSettings
    training = Training

    def __init__(self, *, is_on_policy: bool) -> None:
        self.is_on_policy = is_on_policy

    def loop(
        self, model: Model, settings: LinearSettings, observation: str
    ) -> tuple[Callable[..., None], int]:
        """Returns the loop over features, and the number of weights."""
        if ENCODINGS[observation] == "coordinates":
            features = tiles_of(model, settings.n_tilings, settings.tile_width, settings.parts)
        else:
            ones = observation_ones(model, observation)[0].astype(np.int32)
            features = Tiles(np.arange(len(ones), dtype=np.int32)[:, None], ones)
        loop = partial(train, process_of(model), features, settings.constants, self.is_on_policy)
        return loop, (int(features.tiles.max()) + 1) * len(ACTIONS)


Q_LAMBDA = LinearAlgorithm(is_on_policy=False)
SARSA_LAMBDA = LinearAlgorithm(is_on_policy=True)
