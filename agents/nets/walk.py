"""Steps an agent's envs, in compiled code; DQN and PPO share it.

Axis letters: E envs of the agent, O observations, T evaluation steps.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from agents.nets.arithmetic import inlined
from agents.process import Process, Stream, U, draw_start, draw_word, process_of, step, uniform
from agents.sb3.settings import Sb3Settings
from envs import Model


class Walk(NamedTuple):
    """Where an agent is, and what it has done; all arrays but `points` change."""

    process: Process
    time_limit: int
    stream: NDArray[np.uint64]  # (4,)
    state: NDArray[np.int64]  # (E,)
    steps: NDArray[np.int64]  # (E,) of the episode
    taken: NDArray[np.int64]  # (1,) steps
    disagreements: NDArray[np.int64]  # (1,) wrong PINGs
    points: NDArray[np.int64]  # (T,) evaluation steps
    counts: NDArray[np.int64]  # (T,) wrong PINGs up to each of them that is over


@inlined
def draw(stream: NDArray[np.uint64]) -> float:
    """Draws a number from [0, 1) from a stream (4,), which changes."""
    word, after = draw_word(_words(stream))
    stream[0], stream[1], stream[2], stream[3] = after
    return float(uniform(word))


def walk_of(
    model: Model, settings: Sb3Settings, stream: NDArray[np.uint64], points: NDArray[np.int64]
) -> Walk:
    """Returns the walk of an agent that has drawn where its first episodes start."""
    n_envs = settings.n_envs
    walk = Walk(
        process=process_of(model),
        time_limit=settings.time_limit or 2**62,
        stream=stream,
        state=np.zeros(n_envs, np.int64),
        steps=np.zeros(n_envs, np.int64),
        taken=np.zeros(1, np.int64),
        disagreements=np.zeros(1, np.int64),
        points=points,
        counts=np.zeros(len(points), np.int64),
    )
    _start(walk)
    return walk


@compiled()
def _start(walk: Walk) -> None:
    for e in range(len(walk.state)):
        _restart(walk, e)


@inlined
def _words(stream: NDArray[np.uint64]) -> Stream:
    return stream[0], stream[1], stream[2], stream[3]


@inlined
def _restart(walk: Walk, e: int) -> None:
    """Starts an episode."""
    walk.state[e], stream = draw_start(walk.process.starts, _words(walk.stream))
    walk.stream[0], walk.stream[1], walk.stream[2], walk.stream[3] = stream
    walk.steps[e] = 0


@inlined
def take(walk: Walk, e: int, action: int) -> tuple[float, int, bool]:
    """Takes a step in an env, and starts an episode if one ends.

    Returns reward, next observation before that start (O where the episode terminates), and whether the time
    limit alone truncates it.
    """
    process, state = walk.process, U(walk.state[e])
    first = U(process.first[state]) + U(action) * U(process.n_outcomes)
    walk.disagreements[0] += process.outcomes[first].is_wrong_ping
    reward, state, following, stream = step(process, state, action, _words(walk.stream))
    walk.stream[0], walk.stream[1], walk.stream[2], walk.stream[3] = stream
    walk.state[e] = state
    walk.steps[e] += 1
    terminates = following == process.n_observations
    truncates = not terminates and walk.steps[e] >= walk.time_limit
    if terminates or truncates:
        _restart(walk, e)
    return reward, following, truncates


@inlined
def count(walk: Walk) -> None:
    """Counts a step in every env, and keeps the wrong PINGs if an evaluation step is over."""
    before = walk.taken[0]
    walk.taken[0] += len(walk.state)
    for i in range(np.searchsorted(walk.points, before, side="right"), len(walk.points)):
        if walk.points[i] > walk.taken[0]:
            break
        walk.counts[i] = walk.disagreements[0]
