"""Compiled loops over agents: acting, stepping, replay and returns. They know indices and tables, not nets.

Every agent draws from streams of its own, xoshiro256++ as in `agents.tabular.kernel`.

Axis letters: N agents, E envs of an agent, O observations, A actions, C rows of a replay buffer, B rows of a
mini-batch, L steps of a rollout.
"""

from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from agents.tabular.kernel import draw_word
from envs import Model
from envs.model import ACTIONS, draw_issuer_reward

Arrays = TypeVar("Arrays", bound=tuple[Any, ...])
_N_ACTIONS = len(ACTIONS)
_draw_issuer_reward = numba.njit(draw_issuer_reward)


class World(NamedTuple):
    """A compiled scenario; state and action are one index, `state * A + action`."""

    next_state: NDArray[np.int64]  # (S * A,)
    grid_reward: NDArray[np.float64]  # (S * A,)
    issuer_reward: NDArray[np.float64]  # (S * A,) mean
    issuer_noise: NDArray[np.float64]  # (S * A,) half-width
    terminated: NDArray[np.bool_]  # (S * A,)
    is_wrong_ping: NDArray[np.bool_]  # (S * A,)
    observation: NDArray[np.int64]  # (S,)
    start: int
    is_noisy: bool
    time_limit: int


class Agents(NamedTuple):
    """Where agents are, and what they have done; all arrays change."""

    streams: NDArray[np.uint64]  # (N, 4)
    state: NDArray[np.int64]  # (N, E)
    steps: NDArray[np.int64]  # (N, E) of the episode
    disagreements: NDArray[np.int64]  # (N,)


class Replay(NamedTuple):
    """The replay buffers, as Stable-Baselines3 has them: a row per step of the envs."""

    observation: NDArray[np.int32]  # (N, C, E)
    action: NDArray[np.int8]  # (N, C, E)
    reward: NDArray[np.float32]  # (N, C, E)
    next_observation: NDArray[np.int32]  # (N, C, E)
    terminated: NDArray[np.bool_]  # (N, C, E)
    truncated: NDArray[np.bool_]  # (N, C, E) by the time limit alone


class Rollout(NamedTuple):
    """The rollouts of all agents, as Stable-Baselines3 flattens them: env after env."""

    observed: NDArray[np.int64]  # (N, E * L) agent * O + observation
    action: NDArray[np.int64]  # (N, E * L)
    old_log_probability: NDArray[np.float32]  # (N, E * L)
    old_value: NDArray[np.float32]  # (N, E * L)
    advantage: NDArray[np.float32]  # (N, E * L)
    value_target: NDArray[np.float32]  # (N, E * L) Stable-Baselines3's `returns`


def world_of(model: Model, time_limit: int | None) -> World:
    """Returns a model as the kernels read it."""
    return World(
        next_state=model.next_state[:, :, 0].astype(np.int64).ravel(),
        grid_reward=model.grid_reward.ravel(),
        issuer_reward=model.issuer_reward.ravel(),
        issuer_noise=model.issuer_noise.ravel(),
        terminated=model.terminated.ravel(),
        is_wrong_ping=model.is_wrong_ping.ravel(),
        observation=model.observation.astype(np.int64),
        start=model.start,
        is_noisy=model.is_noisy,
        time_limit=time_limit or 2**62,
    )


def none_of(arrays: Arrays) -> Arrays:
    """Returns the arrays of no agents, with which a kernel does nothing but get compiled."""
    return type(arrays)(*(array[:0] for array in arrays))


@numba.njit(cache=True)
def _draw(streams: NDArray[np.uint64], n: int) -> float:
    """Draws a number from [0, 1) from an agent's stream."""
    word, (s0, s1, s2, s3) = draw_word((streams[n, 0], streams[n, 1], streams[n, 2], streams[n, 3]))
    streams[n, 0], streams[n, 1], streams[n, 2], streams[n, 3] = s0, s1, s2, s3
    return float((word >> np.uint64(11)) * 2.0**-53)


@numba.njit(cache=True)
def _step(world: World, agents: Agents, n: int, e: int, action: int) -> tuple[float, int, bool, bool]:
    """Steps an env; returns reward, next observation before any reset, terminated, and truncated alone."""
    taken = agents.state[n, e] * _N_ACTIONS + action
    issuer_reward = world.issuer_reward[taken]
    if world.is_noisy:
        issuer_reward = _draw_issuer_reward(
            issuer_reward, world.issuer_noise[taken], _draw(agents.streams, n)
        )
    agents.disagreements[n] += world.is_wrong_ping[taken]
    state = world.next_state[taken]
    observation = world.observation[state]
    terminated = world.terminated[taken]
    truncated = not terminated and agents.steps[n, e] + 1 >= world.time_limit
    if terminated or truncated:
        agents.state[n, e] = world.start
        agents.steps[n, e] = 0
    else:
        agents.state[n, e] = state
        agents.steps[n, e] += 1
    return world.grid_reward[taken] + issuer_reward, observation, terminated, truncated


@numba.njit(cache=True)
def act(
    world: World,
    agents: Agents,
    q: NDArray[np.float32],
    epsilon: float,
    replay: Replay,
    row: int,
) -> None:
    """Takes an epsilon-greedy step in all envs, and keeps it in a row of the replay buffers.

    As in Stable-Baselines3, one draw decides whether all envs of an agent explore, and the first of several
    best actions is greedy.

    Args:
      world: The scenario.
      agents: Who acts.
      q: (N, E, A) action values of the present observations.
      epsilon: Probability of random actions.
      replay: The buffers.
      row: Where to write.
    """
    for n in range(agents.state.shape[0]):
        explores = _draw(agents.streams, n) < epsilon
        for e in range(agents.state.shape[1]):
            random = int(_draw(agents.streams, n) * _N_ACTIONS)
            best = 0
            for a in range(1, _N_ACTIONS):
                if q[n, e, a] > q[n, e, best]:
                    best = a
            action = random if explores else best
            replay.observation[n, row, e] = world.observation[agents.state[n, e]]
            replay.action[n, row, e] = action
            reward, observation, terminated, truncated = _step(world, agents, n, e, action)
            replay.reward[n, row, e] = reward
            replay.next_observation[n, row, e] = observation
            replay.terminated[n, row, e] = terminated
            replay.truncated[n, row, e] = truncated


@numba.njit(cache=True)
def draw_batches(
    streams: NDArray[np.uint64], n_rows: int, n_envs: int, rows: NDArray[np.int64], envs: NDArray[np.int64]
) -> None:
    """Draws the transitions of a mini-batch, into rows (N, B) and envs (N, B) of the replay buffers."""
    for n in range(rows.shape[0]):
        for b in range(rows.shape[1]):
            rows[n, b] = int(_draw(streams, n) * n_rows)
            envs[n, b] = int(_draw(streams, n) * n_envs) if n_envs > 1 else 0


@numba.njit(cache=True)
def read_batches(
    replay: Replay,
    rows: NDArray[np.int64],
    envs: NDArray[np.int64],
    last_row: int,
    n_steps: int,
    gamma: float,
    next_value: NDArray[np.float32],
    observed: NDArray[np.int64],
    actions: NDArray[np.int64],
    targets: NDArray[np.float32],
) -> None:
    """Reads mini-batches and computes their targets: returns of up to `n_steps` steps, and what follows.

    A return ends where the episode ends, or at the row written last.

    Args:
      replay: The buffers.
      rows: (N, B) of the transitions.
      envs: (N, B) of the transitions.
      last_row: The row that was written last.
      n_steps: Steps of a return, at most.
      gamma: The discount.
      next_value: (N, O) the target nets' largest action value of each observation.
      observed: Where to write agent * O + observation, (N, B).
      actions: Where to write actions, (N, B).
      targets: Where to write targets, (N, B).
    """
    n_observations = next_value.shape[1]
    capacity = replay.reward.shape[1]
    for n in range(rows.shape[0]):
        for b in range(rows.shape[1]):
            row, e = rows[n, b], envs[n, b]
            observed[n, b] = n * n_observations + replay.observation[n, row, e]
            actions[n, b] = replay.action[n, row, e]
            total = np.float32(0.0)
            discount = np.float32(1.0)
            for k in range(n_steps):
                total += replay.reward[n, row, e] * discount
                discount *= np.float32(gamma)
                if replay.terminated[n, row, e] or replay.truncated[n, row, e] or row == last_row:
                    break
                if k + 1 < n_steps:
                    row = (row + 1) % capacity
            if not replay.terminated[n, row, e]:
                total += discount * next_value[n, replay.next_observation[n, row, e]]
            targets[n, b] = total


@numba.njit(cache=True)
def roll_out(
    world: World,
    agents: Agents,
    probability: NDArray[np.float32],
    log_probability: NDArray[np.float32],
    value: NDArray[np.float32],
    gamma: float,
    gae_lambda: float,
    rollout: Rollout,
    disagreements: NDArray[np.int64],
) -> None:
    """Lets all agents act by their probabilities, and estimates advantages by GAE (Schulman et al. 2016).

    Args:
      world: The scenario.
      agents: Who acts.
      probability: (N, O, A) of the actions.
      log_probability: (N, O, A) of the same.
      value: (N, O) of the critics.
      gamma: The discount.
      gae_lambda: GAE's lambda.
      rollout: Where to write.
      disagreements: Where to write the counts after each step of the envs, (N, L).
    """
    n_observations = probability.shape[1]
    n_envs, n_steps = agents.state.shape[1], disagreements.shape[1]
    reward = np.empty((n_envs, n_steps), np.float32)
    ended = np.empty((n_envs, n_steps), np.bool_)
    for n in range(agents.state.shape[0]):
        for t in range(n_steps):
            for e in range(n_envs):
                i = e * n_steps + t
                o = world.observation[agents.state[n, e]]
                draw = _draw(agents.streams, n)
                action, cumulated = 0, probability[n, o, 0]
                while action < _N_ACTIONS - 1 and not draw < cumulated:
                    action += 1
                    cumulated += probability[n, o, action]
                rollout.observed[n, i] = n * n_observations + o
                rollout.action[n, i] = action
                rollout.old_log_probability[n, i] = log_probability[n, o, action]
                rollout.old_value[n, i] = value[n, o]
                received, following, terminated, truncated = _step(world, agents, n, e, action)
                reward[e, t] = received
                if truncated:
                    reward[e, t] += np.float32(gamma) * value[n, following]
                ended[e, t] = terminated or truncated
            disagreements[n, t] = agents.disagreements[n]
        for e in range(n_envs):
            next_value = value[n, world.observation[agents.state[n, e]]]
            advantage = np.float32(0.0)
            for t in range(n_steps - 1, -1, -1):
                i = e * n_steps + t
                if ended[e, t]:
                    next_value = advantage = np.float32(0.0)
                delta = reward[e, t] + np.float32(gamma) * next_value - rollout.old_value[n, i]
                advantage = delta + np.float32(gamma * gae_lambda) * advantage
                rollout.advantage[n, i] = advantage
                rollout.value_target[n, i] = advantage + rollout.old_value[n, i]
                next_value = rollout.old_value[n, i]


@numba.njit(cache=True)
def shuffle(streams: NDArray[np.uint64], order: NDArray[np.int64]) -> None:
    """Draws a permutation for every agent, (N, E * L)."""
    for n in range(order.shape[0]):
        for i in range(order.shape[1]):
            order[n, i] = i
        for i in range(order.shape[1] - 1, 0, -1):
            j = int(_draw(streams, n) * (i + 1))
            order[n, i], order[n, j] = order[n, j], order[n, i]
