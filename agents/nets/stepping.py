"""Steps an agent's envs, in compiled code; DQN and PPO share it.

Axis letters: E envs of the agent, O observations, T evaluation steps.
"""

from typing import NamedTuple

import numpy as np

from agents.compiled import compiled
from agents.nets.arithmetic import inlined
from agents.process import Process, U, draw_number, draw_start, draw_step, process_of, stream_of
from agents.sb3.settings import Sb3Settings
from envs import Model
from envs.arrays import Bools, Codes, Indices, Ints, Singles, Words


class Envs(NamedTuple):
    """The envs of an agent, and what it has done in them; all arrays but `points` change."""

    process: Process
    time_limit: int
    stream: Words  # (4,)
    state: Ints  # (E,)
    steps: Ints  # (E,) of the episode
    n_steps: Ints  # (1,) of all envs and episodes
    disagreements: Ints  # (1,) wrong PINGs
    points: Ints  # (T,) evaluation steps
    counts: Ints  # (T,) wrong PINGs up to each of them, once it is over


class Steps(NamedTuple):
    """Steps from which an agent learns."""

    observed: Indices
    action: Codes
    reward: Singles
    next_observed: Indices  # O where the episode terminates
    truncated: Bools  # by the time limit alone


@inlined
def draw(stream: Words) -> float:
    """Draws a number from [0, 1) from a stream (4,), which changes."""
    number, after = draw_number(stream_of(stream))
    stream[:] = after
    return float(number)


def envs_of(model: Model, settings: Sb3Settings, stream: Words, points: Ints) -> Envs:
    """Returns the envs of an agent that has drawn where its first episodes start."""
    n_envs = settings.n_envs
    sizes = n_envs, n_envs, 1, 1, len(points)
    state, steps, n_steps, disagreements, counts = (np.zeros(n, np.int64) for n in sizes)
    limit = settings.time_limit or 2**62
    envs = Envs(
        process_of(model), limit, stream, state, steps, n_steps, disagreements, points, counts
    )
    _start(envs)
    return envs


def room_for_steps(n: int) -> Steps:
    """Returns room for n steps."""
    return Steps(*(np.zeros(n, dtype) for dtype in ("i4", "i1", "f4", "i4", "?")))


@compiled
def _start(envs: Envs) -> None:
    for e in range(len(envs.state)):
        _restart(envs, e)


@inlined
def _restart(envs: Envs, e: int) -> None:
    envs.state[e], after = draw_start(envs.process.starts, stream_of(envs.stream))
    envs.stream[:] = after
    envs.steps[e] = 0


@inlined
def take(envs: Envs, e: int, action: int, steps: Steps, at: int) -> None:
    """Takes a step in an env, keeps it at an index of `steps`, and starts an episode if one ends.

    It draws, in this order and only if needed, the noise of the reward, the outcome and the next
    start.
    """
    process = envs.process
    state = U(envs.state[e])
    reward, i, after = draw_step(
        process.first,
        process.outcomes,
        process.n_outcomes,
        process.is_noisy,
        state,
        U(action),
        stream_of(envs.stream),
    )
    envs.stream[:] = after
    outcome = process.outcomes[i]
    envs.disagreements[0] += outcome.is_wrong_ping
    following = state + U(outcome.state_change)
    terminates = outcome.terminates
    envs.state[e] = following
    envs.steps[e] += 1
    truncates = not terminates and envs.steps[e] >= envs.time_limit
    steps.observed[at] = process.observation[state]
    steps.action[at] = action
    steps.reward[at] = reward
    steps.next_observed[at] = (
        process.n_observations if terminates else process.observation[following]
    )
    steps.truncated[at] = truncates
    if terminates or truncates:
        _restart(envs, e)


@inlined
def count(envs: Envs) -> None:
    """Counts a step in every env, and keeps the wrong PINGs if an evaluation step is over."""
    before = envs.n_steps[0]
    envs.n_steps[0] += len(envs.state)
    for i in range(np.searchsorted(envs.points, before, side="right"), len(envs.points)):
        if envs.points[i] > envs.n_steps[0]:
            break
        envs.counts[i] = envs.disagreements[0]
