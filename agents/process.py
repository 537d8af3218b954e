"""What tables and nets learn from: a compiled scenario as flat arrays, and random numbers, in compiled code.

Every agent draws from a stream of its own, xoshiro256++ (Blackman & Vigna 2021), seeded by the caller, so
agents that are trained together equal the same agents trained one at a time, bit for bit.

Axis letters: S states, O observations, A actions, K outcomes, B starts.
"""

from typing import Final, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from envs.model import ACTIONS, Model, draw_issuer_reward

U = np.uint64
N_ACTIONS: Final = len(ACTIONS)

Stream = tuple[np.uint64, np.uint64, np.uint64, np.uint64]

# What follows an action, side by side in memory: with large tables, cache misses take most of the time.
OUTCOME: Final = np.dtype(
    [
        ("reward", np.float64),  # mean
        ("next_state", np.uint32),
        ("next_observation", np.uint32),  # O where the episode terminates
    ]
)


class Process(NamedTuple):
    """A compiled scenario; state and action are one index, `state * A + action`."""

    outcomes: NDArray[np.void]  # (S * A * K,) of type OUTCOME
    probability_up_to: NDArray[
        np.float64
    ]  # (S * A * K,) sums over the outcomes up to each; infinite at the last
    n_outcomes: int  # K
    noise: NDArray[np.float64]  # (S * A,) half-width of the uniform noise of the reward
    is_wrong_ping: NDArray[np.bool_]  # (S * A,)
    observation: NDArray[np.uint32]  # (S,)
    starts: NDArray[np.uint32]  # (B,) states
    is_noisy: bool


def process_of(model: Model) -> Process:
    """Returns a model as compiled code reads it."""
    following = np.where(
        model.terminated[..., None], model.n_observations, model.observation[model.next_state]
    )
    outcomes = np.empty(model.next_state.shape, dtype=OUTCOME)
    outcomes["reward"] = (model.grid_reward + model.issuer_reward)[..., None]
    outcomes["next_state"] = model.next_state
    outcomes["next_observation"] = following
    probability_up_to = model.probability.cumsum(axis=-1)
    probability_up_to[..., -1] = np.inf  # whatever rounding does to the sum
    return Process(
        outcomes=outcomes.ravel(),
        probability_up_to=probability_up_to.ravel(),
        n_outcomes=model.n_outcomes,
        noise=model.issuer_noise.ravel(),
        is_wrong_ping=model.is_wrong_ping.ravel(),
        observation=model.observation.astype(np.uint32),
        starts=model.starts.astype(np.uint32),
        is_noisy=model.is_noisy,
    )


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
def uniform(word: np.uint64) -> float:
    """Returns a word as a number from [0, 1)."""
    return (word >> U(11)) * 2.0**-53


_draw_issuer_reward = numba.njit(draw_issuer_reward)


@numba.njit
def draw_reward(mean: float, noise: float, stream: Stream) -> tuple[float, Stream]:
    """Returns a noisy reward and the stream that follows."""
    word, stream = draw_word(stream)
    return _draw_issuer_reward(mean, noise, uniform(word)), stream


@numba.njit
def draw_outcome(
    first: np.uint64, probability_up_to: NDArray[np.float64], stream: Stream
) -> tuple[np.uint64, Stream]:
    """Returns the index of an outcome, given that of the action's first, and the stream that follows."""
    word, stream = draw_word(stream)
    draw = uniform(word)
    i = first
    while draw >= probability_up_to[i]:
        i += U(1)
    return i, stream


@numba.njit
def draw_start(starts: NDArray[np.uint32], stream: Stream) -> tuple[np.uint64, Stream]:
    """Returns a state to start in and the stream that follows."""
    place = U(0)
    if len(starts) > 1:
        word, stream = draw_word(stream)
        place = U(uniform(word) * len(starts))
    return U(starts[place]), stream


@numba.njit
def step(
    process: Process, state: np.uint64, action: int, stream: Stream
) -> tuple[float, np.uint64, np.uint64, Stream]:
    """Returns reward, next state and next observation of an action, and the stream that follows.

    The next observation is O where the episode terminates. Drawn are, in this order and only where there is
    something to draw, the noise of the reward and the outcome.
    """
    taken = state * U(N_ACTIONS) + U(action)
    i = taken * U(process.n_outcomes)
    reward = process.outcomes[i].reward
    if process.is_noisy and process.noise[taken] > 0.0:
        reward, stream = draw_reward(reward, process.noise[taken], stream)
    if process.n_outcomes > 1:
        i, stream = draw_outcome(i, process.probability_up_to, stream)
    outcome = process.outcomes[i]
    return reward, U(outcome.next_state), U(outcome.next_observation), stream
