"""Compiled loops over agents: acting, stepping, replay and returns. They know indices and tables, not nets.

Every agent draws from streams of its own, xoshiro256++ as in `agents.tabular.kernel`.

Axis letters: N agents, E envs of an agent, S states, O observations, A actions, K outcomes, C rows of a
replay buffer, B rows of a mini-batch, L steps of a rollout.
"""

from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from agents.process import draw_word
from envs import Model
from envs.model import ACTIONS, draw_issuer_reward

Arrays = TypeVar("Arrays", bound=tuple[Any, ...])
_N_ACTIONS = len(ACTIONS)
_draw_issuer_reward = numba.njit(draw_issuer_reward)


class World(NamedTuple):
    """A compiled scenario; state and action are one index, `state * A + action`."""

    next_state: NDArray[np.int64]  # (S * A, K)
    cumulated: NDArray[np.float64]  # (S * A, K - 1) probabilities of the outcomes, summed up to each
    grid_reward: NDArray[np.float64]  # (S * A,)
    issuer_reward: NDArray[np.float64]  # (S * A,) mean
    issuer_noise: NDArray[np.float64]  # (S * A,) half-width
    terminated: NDArray[np.bool_]  # (S * A,)
    is_wrong_ping: NDArray[np.bool_]  # (S * A,)
    observation: NDArray[np.int64]  # (S,)
    starts: NDArray[np.int64]  # the states in which an episode starts, all equally likely
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


class Batches(NamedTuple):
    """The mini-batches of all agents, of B transitions each."""

    observed: NDArray[np.int64]  # (N, B) agent * O + observation
    action: NDArray[np.int64]  # (N, B)
    target: NDArray[np.float32]  # (N, B)
    next_observed: NDArray[np.int64]  # (N, B) agent * O + observation where the return ends
    discount: NDArray[np.float32]  # (N, B) of the value there
    terminated: NDArray[np.bool_]  # (N, B) whether the episode ends there, so that there is none


class Rollout(NamedTuple):
    """The rollouts of all agents, as Stable-Baselines3 flattens them, env after env: what updates read."""

    observed: NDArray[np.int64]  # (N, E * L) agent * O + observation
    action: NDArray[np.int64]  # (N, E * L)
    old_log_probability: NDArray[np.float32]  # (N, E * L)
    old_value: NDArray[np.float32]  # (N, E * L)
    advantage: NDArray[np.float32]  # (N, E * L)
    value_target: NDArray[np.float32]  # (N, E * L) Stable-Baselines3's `returns`


class Results(NamedTuple):
    """What the steps of the same rollouts brought."""

    reward: NDArray[np.float32]  # (N, E * L)
    next_observed: NDArray[np.int64]  # (N, E * L) agent * O + observation, before any reset
    terminated: NDArray[np.bool_]  # (N, E * L)
    truncated: NDArray[np.bool_]  # (N, E * L) by the time limit alone


def world_of(model: Model, time_limit: int | None) -> World:
    """Returns a model as the kernels read it."""
    n_pairs, n_outcomes = model.grid_reward.size, model.n_outcomes
    return World(
        next_state=model.next_state.astype(np.int64).reshape(n_pairs, n_outcomes),
        cumulated=model.probability[:, :, :-1].cumsum(axis=2).reshape(n_pairs, n_outcomes - 1),
        grid_reward=model.grid_reward.ravel(),
        issuer_reward=model.issuer_reward.ravel(),
        issuer_noise=model.issuer_noise.ravel(),
        terminated=model.terminated.ravel(),
        is_wrong_ping=model.is_wrong_ping.ravel(),
        observation=model.observation.astype(np.int64),
        starts=model.starts.astype(np.int64),
        is_noisy=model.is_noisy,
        time_limit=time_limit or 2**62,
    )


def none_of(arrays: Arrays) -> Arrays:
    """Returns the arrays of no agents, with which a kernel does nothing but get compiled."""
    return type(arrays)(*(array[:0] for array in arrays))


@compiled()
def _draw(streams: NDArray[np.uint64], n: int) -> float:
    """Draws a number from [0, 1) from an agent's stream."""
    word, (s0, s1, s2, s3) = draw_word((streams[n, 0], streams[n, 1], streams[n, 2], streams[n, 3]))
    streams[n, 0], streams[n, 1], streams[n, 2], streams[n, 3] = s0, s1, s2, s3
    return float((word >> np.uint64(11)) * 2.0**-53)


@compiled()
def _draw_start(world: World, streams: NDArray[np.uint64], n: int) -> int:
    """Returns the state in which an agent's next episode starts."""
    n_starts = len(world.starts)
    return int(world.starts[int(_draw(streams, n) * n_starts) if n_starts > 1 else 0])


@compiled()
def start(world: World, agents: Agents) -> None:
    """Starts an episode in every env."""
    for n in range(agents.state.shape[0]):
        for e in range(agents.state.shape[1]):
            agents.state[n, e] = _draw_start(world, agents.streams, n)
            agents.steps[n, e] = 0


@compiled()
def _step(world: World, agents: Agents, n: int, e: int, action: int) -> tuple[float, int, bool, bool]:
    """Steps an env; returns reward, next observation before any reset, terminated, and truncated alone.

    Draws, in this order, what is random in the scenario: the issuer's reward, the outcome, and where the next
    episode starts if this one ends.
    """
    taken = agents.state[n, e] * _N_ACTIONS + action
    issuer_reward = world.issuer_reward[taken]
    if world.is_noisy:
        issuer_reward = _draw_issuer_reward(
            issuer_reward, world.issuer_noise[taken], _draw(agents.streams, n)
        )
    agents.disagreements[n] += world.is_wrong_ping[taken]
    outcome, n_outcomes = 0, world.next_state.shape[1]
    if n_outcomes > 1:
        draw = _draw(agents.streams, n)
        while outcome < n_outcomes - 1 and draw >= world.cumulated[taken, outcome]:
            outcome += 1
    state = world.next_state[taken, outcome]
    observation = world.observation[state]
    terminated = world.terminated[taken]
    truncated = not terminated and agents.steps[n, e] + 1 >= world.time_limit
    if terminated or truncated:
        agents.state[n, e] = _draw_start(world, agents.streams, n)
        agents.steps[n, e] = 0
    else:
        agents.state[n, e] = state
        agents.steps[n, e] += 1
    return world.grid_reward[taken] + issuer_reward, observation, terminated, truncated


@compiled()
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


@compiled()
def draw_batches(
    streams: NDArray[np.uint64], n_rows: int, n_envs: int, rows: NDArray[np.int64], envs: NDArray[np.int64]
) -> None:
    """Draws the transitions of a mini-batch, into rows (N, B) and envs (N, B) of the replay buffers."""
    for n in range(rows.shape[0]):
        for b in range(rows.shape[1]):
            rows[n, b] = int(_draw(streams, n) * n_rows)
            envs[n, b] = int(_draw(streams, n) * n_envs) if n_envs > 1 else 0


@compiled()
def read_batches(
    replay: Replay,
    rows: NDArray[np.int64],
    envs: NDArray[np.int64],
    last_row: int,
    n_steps: int,
    gamma: float,
    n_observations: int,
    batches: Batches,
) -> None:
    """Reads mini-batches, and computes returns of up to `n_steps` steps.

    A return ends where the episode ends, or at the row written last.

    Args:
      replay: The buffers.
      rows: (N, B) of the transitions.
      envs: (N, B) of the transitions.
      last_row: The row that was written last.
      n_steps: Steps of a return, at most.
      gamma: The discount.
      n_observations: O.
      batches: Where to write.
    """
    capacity = replay.reward.shape[1]
    for n in range(rows.shape[0]):
        for b in range(rows.shape[1]):
            row, e = rows[n, b], envs[n, b]
            batches.observed[n, b] = n * n_observations + replay.observation[n, row, e]
            batches.action[n, b] = replay.action[n, row, e]
            total = np.float32(0.0)
            discount = np.float32(1.0)
            for k in range(n_steps):
                total += replay.reward[n, row, e] * discount
                discount *= np.float32(gamma)
                if replay.terminated[n, row, e] or replay.truncated[n, row, e] or row == last_row:
                    break
                if k + 1 < n_steps:
                    row = (row + 1) % capacity
            batches.target[n, b] = total
            batches.next_observed[n, b] = n * n_observations + replay.next_observation[n, row, e]
            batches.discount[n, b] = discount
            batches.terminated[n, b] = replay.terminated[n, row, e]


@compiled()
def add_next_values(batches: Batches, next_value: NDArray[np.float32]) -> None:
    """Adds what follows on the returns to the targets of mini-batches.

    Args:
      batches: As `read_batches` left them.
      next_value: (N, B) the target nets' largest action value of each next observation.
    """
    for n in range(next_value.shape[0]):
        for b in range(next_value.shape[1]):
            if not batches.terminated[n, b]:
                batches.target[n, b] += batches.discount[n, b] * next_value[n, b]


@compiled()
def roll_out(
    world: World,
    agents: Agents,
    probability: NDArray[np.float32],
    log_probability: NDArray[np.float32],
    is_of_envs: bool,
    first: int,
    after: int,
    n_observations: int,
    rollout: Rollout,
    results: Results,
    disagreements: NDArray[np.int64],
) -> None:
    """Lets all agents act by their probabilities, in some steps of a rollout.

    Args:
      world: The scenario.
      agents: Who acts.
      probability: (N, O, A) of the actions, or (N, E, A) for the present observation of each env.
      log_probability: Their logarithms.
      is_of_envs: Whether they are for the present observations, which are those of a single step.
      first: The first of these steps, 0 to L - 1.
      after: The step after the last of them.
      n_observations: O.
      rollout: Where to write observations, actions and their log-probabilities.
      results: Where to write results.
      disagreements: Where to write the counts after each step of the envs, (N, L).
    """
    n_envs, n_steps = agents.state.shape[1], disagreements.shape[1]
    for n in range(agents.state.shape[0]):
        for t in range(first, after):
            for e in range(n_envs):
                i = e * n_steps + t
                o = world.observation[agents.state[n, e]]
                row = e if is_of_envs else o
                draw = _draw(agents.streams, n)
                action, cumulated = 0, probability[n, row, 0]
                while action < _N_ACTIONS - 1 and not draw < cumulated:
                    action += 1
                    cumulated += probability[n, row, action]
                rollout.observed[n, i] = n * n_observations + o
                rollout.action[n, i] = action
                rollout.old_log_probability[n, i] = log_probability[n, row, action]
                reward, following, terminated, truncated = _step(world, agents, n, e, action)
                results.reward[n, i] = reward
                results.next_observed[n, i] = n * n_observations + following
                results.terminated[n, i] = terminated
                results.truncated[n, i] = truncated
            disagreements[n, t] = agents.disagreements[n]


@compiled()
def estimate_advantages(
    rollout: Rollout,
    results: Results,
    next_value: NDArray[np.float32],
    n_envs: int,
    gamma: float,
    gae_lambda: float,
) -> None:
    """Estimates advantages by GAE (Schulman et al. 2016), as Stable-Baselines3 does.

    Args:
      rollout: Has the critics' values of the observations, and gets advantages and targets.
      results: Of the same steps.
      next_value: (N, E * L) the critics' values of the next observations.
      n_envs: E.
      gamma: The discount.
      gae_lambda: GAE's lambda.
    """
    n_steps = next_value.shape[1] // n_envs
    for n in range(next_value.shape[0]):
        for e in range(n_envs):
            last = (e + 1) * n_steps - 1
            following = next_value[n, last]
            advantage = np.float32(0.0)
            for i in range(last, last - n_steps, -1):
                reward = results.reward[n, i]
                if results.truncated[n, i]:
                    reward += np.float32(gamma) * next_value[n, i]
                if results.terminated[n, i] or results.truncated[n, i]:
                    following = advantage = np.float32(0.0)
                delta = reward + np.float32(gamma) * following - rollout.old_value[n, i]
                advantage = delta + np.float32(gamma * gae_lambda) * advantage
                rollout.advantage[n, i] = advantage
                rollout.value_target[n, i] = advantage + rollout.old_value[n, i]
                following = rollout.old_value[n, i]


@compiled()
def shuffle(streams: NDArray[np.uint64], order: NDArray[np.int64]) -> None:
    """Draws a permutation for every agent, (N, E * L)."""
    for n in range(order.shape[0]):
        for i in range(order.shape[1]):
            order[n, i] = i
        for i in range(order.shape[1] - 1, 0, -1):
            j = int(_draw(streams, n) * (i + 1))
            order[n, i], order[n, j] = order[n, j], order[n, i]
