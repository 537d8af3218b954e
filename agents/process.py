"""What tables and nets learn from: a scenario as flat arrays, and compiled random numbers.

Every agent draws from a stream of its own, xoshiro256++ (Blackman & Vigna 2021), seeded by the
caller, so agents that are trained together equal the same agents trained one at a time, bit for
bit.

Axis letters: S states, O observations, A actions, K outcomes, B starts.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from envs.arrays import Records, Unsigned, Words
from envs.model import ACTIONS, Model, draw_issuer_reward, kept_with_model

U = np.uint64
N_ACTIONS = len(ACTIONS)
Stream = tuple[U, U, U, U]

# What follows an action. Outcomes hold changes of state and observation, which many states share.
# So their table is small and stays in the nearest cache; with a row per state, the loop would wait
# for memory.
OUTCOME = np.dtype(
    [
        *{
            "reward": np.float64,  # mean
            "state_change": np.int32,
            "observation_change": np.int32,
            "terminates": np.bool_,
            "is_wrong_ping": np.bool_,
            "noise": np.float64,  # half-width of the uniform noise of the reward
            "probability_up_to": np.float64,  # sum of outcomes up to this one; infinite at the last
        }.items()
    ],
    align=True,
)
STEP = np.dtype([("o", np.uint64), ("a", np.uint64), ("reward", np.float64)])  # kept for a replay
_STATES_AT_ONCE = 200_000  # whose outcomes are written out together


class Process(NamedTuple):
    """A compiled scenario; `first[state] + action * K` is the index of its first outcome."""

    first: Unsigned  # (S,) the same for all states of a kind
    outcomes: Records  # (kinds * A * K,) of type OUTCOME
    n_outcomes: int  # K
    n_observations: int  # O
    observation: Unsigned  # (S,)
    starts: Unsigned  # (B,) states
    is_noisy: bool


@kept_with_model
def process_of(model: Model) -> Process:
    """Flattens a model for numba."""
    n_states, n_actions, n_outcomes = model.next_state.shape
    row = n_actions * n_outcomes * OUTCOME.itemsize  # bytes of a state
    kinds = np.zeros(0, dtype=f"V{row}")
    kind = np.empty(n_states, dtype=np.int64)
    for first in range(0, n_states, _STATES_AT_ONCE):
        some = slice(first, first + _STATES_AT_ONCE)
        rows = np.concatenate([kinds, _outcomes(model, some).reshape(-1).view(kinds.dtype)])
        n_before = len(kinds)
        kinds, found = np.unique(rows, return_inverse=True)
        kind[:first] = found[kind[:first]]  # kinds have been numbered anew
        kind[some] = found[n_before:]
    return Process(
        first=(kind * n_actions * n_outcomes).astype(np.uint32),
        outcomes=kinds.view(OUTCOME),
        n_outcomes=model.n_outcomes,
        n_observations=model.n_observations,
        observation=model.observation.astype(np.uint32),
        starts=model.starts.astype(np.uint32),
        is_noisy=model.is_noisy,
    )


def _outcomes(model: Model, some: slice) -> Records:
    """Returns the outcomes of some states, (states, A, K)."""
    state = np.arange(len(model.observation))[some, None, None]
    # zeros between fields, too: bytes count
    outcomes = np.zeros(model.next_state[some].shape, dtype=OUTCOME)
    outcomes["reward"] = (model.grid_reward[some] + model.issuer_reward[some])[..., None]
    outcomes["state_change"] = model.next_state[some] - state
    outcomes["observation_change"] = (
        model.observation[model.next_state[some]] - model.observation[state]
    )
    outcomes["terminates"] = model.terminated[some, :, None]
    outcomes["is_wrong_ping"] = model.is_wrong_ping[some, :, None]
    outcomes["noise"] = model.issuer_noise[some, :, None]
    outcomes["probability_up_to"] = model.probability[some].cumsum(axis=-1)
    outcomes["probability_up_to"][..., -1] = np.inf  # whatever rounding does to the sum
    return outcomes


@njit(forceinline=True)
def keep_step(kept: Records, i: U, o: U, a: U, reward: float) -> None:
    """Keeps step i of an episode, if there is room for steps."""
    if len(kept) > 0:
        step = kept[i]
        step.o = o
        step.a = a
        step.reward = reward


@njit(forceinline=True)
def stream_of(words: Words) -> Stream:
    """Returns the stream that is kept in an array, (4,)."""
    return words[0], words[1], words[2], words[3]


@njit
def draw_word(stream: Stream) -> tuple[U, Stream]:
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


@njit
def draw_number(stream: Stream) -> tuple[float, Stream]:
    """Draws a number from [0, 1); returns it and the stream that follows."""
    word, stream = draw_word(stream)
    return (word >> U(11)) * 2.0**-53, stream


_draw_issuer_reward = njit(draw_issuer_reward)


@njit
def draw_step(
    first: Unsigned,
    outcomes: Records,
    n_outcomes: int,
    is_noisy: bool,
    state: U,
    action: U,
    stream: Stream,
) -> tuple[float, U, Stream]:
    """Returns the reward of an action, the index of its outcome, and the stream that follows."""
    i = U(first[state]) + action * U(n_outcomes)
    reward = outcomes[i].reward
    if is_noisy and outcomes[i].noise > 0.0:
        number, stream = draw_number(stream)
        reward = _draw_issuer_reward(reward, outcomes[i].noise, number)
    if n_outcomes > 1:
        number, stream = draw_number(stream)
        while number >= outcomes[i].probability_up_to:
            i += U(1)
    return reward, i, stream


@njit
def draw_start(starts: Unsigned, stream: Stream) -> tuple[U, Stream]:
    """Returns a state to start in and the stream that follows."""
    i = U(0)
    if len(starts) > 1:
        number, stream = draw_number(stream)
        i = U(number * len(starts))
    return U(starts[i]), stream
