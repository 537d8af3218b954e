"""Steps an agent's envs, in compiled code; DQN and PPO share it.

Axis letters: E envs of the agent, O observations, T evaluation steps.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from agents.nets.arithmetic import inlined
from agents.process import Process, Stream, U, draw_number, draw_start, draw_step, process_of
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
    counts: NDArray[np.int64]  # (T,) wrong PINGs up to each of them, once it is over


class Steps(NamedTuple):
    """Steps from which an agent learns."""

    observed: NDArray[np.int32]
    action: NDArray[np.int8]
    reward: NDArray[np.float32]
    next_observed: NDArray[np.int32]  # O where the episode terminates
    truncated: NDArray[np.bool_]  # by the time limit alone


@inlined
def draw(stream: NDArray[np.uint64]) -> float:
    """Draws a number from [0, 1) from a stream (4,), which changes."""
    number, after = draw_number(_words(stream))
    stream[0], stream[1], stream[2], stream[3] = after
    return float(number)


def walk_of(
    model: Model, settings: Sb3Settings, stream: NDArray[np.uint64], points: NDArray[np.int64]
) -> Walk:
    """Returns the walk of an agent that has drawn where its first episodes start."""
    n_envs = settings.n_envs
    state, steps, taken, disagreements, counts = (
        np.zeros(n, np.int64) for n in (n_envs, n_envs, 1, 1, len(points))
    )
    limit = settings.time_limit or 2**62
    walk = Walk(process_of(model), limit, stream, state, steps, taken, disagreements, points, counts)
    _start(walk)
    return walk


def room_for_steps(n: int) -> Steps:
    """Returns room for n steps."""
    return Steps(*(np.zeros(n, dtype) for dtype in ("i4", "i1", "f4", "i4", "?")))


@compiled
def _start(walk: Walk) -> None:
    for e in range(len(walk.state)):
        _restart(walk, e)


@inlined
def _words(stream: NDArray[np.uint64]) -> Stream:
    return stream[0], stream[1], stream[2], stream[3]


@inlined
def _restart(walk: Walk, e: int) -> None:
    walk.state[e], stream = draw_start(walk.process.starts, _words(walk.stream))
    walk.stream[0], walk.stream[1], walk.stream[2], walk.stream[3] = stream
    walk.steps[e] = 0


@inlined
def take(walk: Walk, e: int, action: int, steps: Steps, at: int) -> None:
    """Takes a step in an env, keeps it at an index of `steps`, and starts an episode if one ends.

    It draws, in this order and only if needed, the noise of the reward, the outcome and the next start.
    """
    process, state, stream = walk.process, U(walk.state[e]), _words(walk.stream)
    first, outcomes, n_outcomes = process.first, process.outcomes, process.n_outcomes
    reward, i, stream = draw_step(first, outcomes, n_outcomes, process.is_noisy, state, U(action), stream)
    walk.stream[0], walk.stream[1], walk.stream[2], walk.stream[3] = stream
    walk.disagreements[0] += outcomes[i].is_wrong_ping
    following, terminates = state + U(outcomes[i].state_change), outcomes[i].terminates
    walk.state[e] = following
    walk.steps[e] += 1
    truncates = not terminates and walk.steps[e] >= walk.time_limit
    steps.observed[at] = process.observation[state]
    steps.action[at] = action
    steps.reward[at] = reward
    steps.next_observed[at] = process.n_observations if terminates else process.observation[following]
    steps.truncated[at] = truncates
    if terminates or truncates:
        _restart(walk, e)


@inlined
def count(walk: Walk) -> None:
    """Counts a step in every env, and keeps the wrong PINGs if an evaluation step is over."""
    before = walk.taken[0]
    walk.taken[0] += len(walk.state)
    for i in range(np.searchsorted(walk.points, before, side="right"), len(walk.points)):
        if walk.points[i] > walk.taken[0]:
            break
        walk.counts[i] = walk.disagreements[0]
