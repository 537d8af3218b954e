"""DQN (Mnih et al. 2015) as in Stable-Baselines3: the whole loop of an agent, compiled.

There are few observations, and they recur. So the target net's values are kept until the next
synchronisation, and a mini-batch computes each distinct observation once. Only the order of sums differs.

An agent draws where its first episodes start. Then each step of its envs takes a number that decides whether
to explore, and for each env one for a random action, what `agents.process.step` draws, and one for the next
start if an episode ends. Mini-batches take numbers of another stream: row and, with several envs, env.

Axis letters: E envs, O observations, A actions, C rows of the replay buffer, B rows of a mini-batch, T
evaluation steps.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from agents.nets import net
from agents.nets.arithmetic import Numbers, inlined, like
from agents.nets.learner import Agent, NetAlgorithm
from agents.nets.net import Memo, Merged, Net, Parameters
from agents.nets.walk import Walk, count, draw, take
from agents.process import N_ACTIONS
from agents.sb3.settings import DqnSettings
from envs import Model

_EPSILON = 1e-8  # Adam's: PyTorch's, which Stable-Baselines3 leaves


class Constants(NamedTuple):
    """How an agent acts and learns, see `agents.sb3.settings.DqnSettings`."""

    budget: int
    train_freq: int
    gradient_steps: int
    learning_starts: int
    exploration_initial_eps: float
    exploration_final_eps: float
    exploration_fraction: float
    n_steps: int
    gamma: float
    synchronised_every: int  # steps of the envs
    tau: float
    learning_rate: float
    max_grad_norm: float


class Replay(NamedTuple):
    """The replay buffer, as Stable-Baselines3 has it: a row per step of the envs."""

    observation: NDArray[np.int32]  # (C, E)
    action: NDArray[np.int8]  # (C, E)
    reward: NDArray[np.float32]  # (C, E)
    next_observation: NDArray[np.int32]  # (C, E); O where the episode terminates
    truncated: NDArray[np.bool_]  # (C, E) by the time limit alone


class Target(NamedTuple):
    """The target net, and what is known of its values."""

    values: Numbers  # (P,) parameters
    next_value: Numbers  # (O,) the largest action value
    known: Memo  # of which it is computed since the last synchronisation


class Batch(NamedTuple):
    """Room for a mini-batch."""

    observed: NDArray[np.int32]  # (B,)
    action: NDArray[np.int8]  # (B,)
    target: Numbers  # (B,)
    discount: Numbers  # (B,) of the value of the next observation
    next_observed: NDArray[np.int32]  # (B,)
    merged: Merged


class Dqn(NamedTuple):
    """All that the compiled loop reads and changes."""

    constants: Constants
    net: Net
    parameters: Parameters
    target: Target
    replay: Replay
    batch: Batch
    walk: Walk
    stream: NDArray[np.uint64]  # (4,) of the mini-batches


class DqnAgent(Agent):
    """An agent that learns action values."""

    is_value = True
    outputs = (N_ACTIONS,)

    def begin(self, model: Model, settings: DqnSettings, kind: type[np.floating[Any]]) -> Dqn:
        """Draws uniform weights, and makes room for the replay buffer and a mini-batch."""
        n_envs, n_updates, n_observations = settings.n_envs, settings.gradient_steps, model.n_observations
        (q_net,) = self.nets
        net.draw_uniform(q_net, self.parameters.values, self.drawing)
        rows = max(settings.arguments["buffer_size"] // n_envs, 1), n_envs
        same = {name: getattr(settings, name) for name in Constants._fields if hasattr(settings, name)}
        changed = {
            "gradient_steps": settings.rollout if n_updates < 0 else n_updates,
            "synchronised_every": max(settings.target_update_interval // n_envs, 1),
        }
        batch = (np.zeros(settings.batch_size, dtype) for dtype in ("i4", "i1", kind, kind, "i4"))
        return Dqn(
            constants=Constants(**same | changed),
            net=q_net,
            parameters=self.parameters,
            target=Target(
                values=self.parameters.values.copy(),
                next_value=np.zeros(n_observations, kind),
                known=net.memo_of(n_observations),
            ),
            replay=Replay(*(np.zeros(rows, dtype) for dtype in ("i4", "i1", "f4", "i4", "?"))),
            batch=Batch(*batch, merged=net.merged_of(n_observations, q_net.n_rows)),  # type: ignore[arg-type,misc]
            walk=self.walk,
            stream=self.learning,
        )

    def advance(self, until: int) -> None:
        """Trains until so many steps are done, a whole number of rollouts."""
        _advance(self.state, until)


@inlined
def exploration_rate(constants: Constants, taken: int) -> float:
    """Returns the probability of a random action after so many steps."""
    if taken < constants.learning_starts:
        return 1.0
    if taken == 0:  # as in Stable-Baselines3, which sets the rate after each step
        return 0.0
    progress = 1.0 - (1.0 - taken / constants.budget)  # rounded as in Stable-Baselines3
    first, last = constants.exploration_initial_eps, constants.exploration_final_eps
    if progress > constants.exploration_fraction:
        return last
    return first + progress * (last - first) / constants.exploration_fraction


@compiled(nogil=True)
def _advance(agent: Dqn, until: int) -> None:
    """Trains an agent until so many steps are done."""
    constants, walk = agent.constants, agent.walk
    while walk.taken[0] < until:
        for _ in range(constants.train_freq):
            _act(agent)
            if walk.taken[0] // len(walk.state) % constants.synchronised_every == 0:
                _synchronise(agent.parameters.values, agent.target, constants.tau)
        if walk.taken[0] > constants.learning_starts:
            for _ in range(constants.gradient_steps):
                _draw_batch(agent)
                _add_next_values(agent)
                _update(agent)


@inlined
def _act(agent: Dqn) -> None:
    """Takes an epsilon-greedy step in all envs, and keeps it in the replay buffer.

    As in Stable-Baselines3, one draw decides whether all envs explore, and the first of several best actions
    is greedy.
    """
    replay, walk, observed = agent.replay, agent.walk, agent.net.observed
    n_envs = len(walk.state)
    row = walk.taken[0] // n_envs % len(replay.reward)
    explores = draw(walk.stream) < exploration_rate(agent.constants, walk.taken[0])
    for e in range(n_envs):
        replay.observation[row, e] = observed[e] = walk.process.observation[walk.state[e]]
    at = 0
    if not explores:
        at = net.forward(agent.net, agent.parameters.values, observed, n_envs)
    for e in range(n_envs):
        action = int(draw(walk.stream) * N_ACTIONS)
        if not explores:
            action = _best(agent.net.hidden, at + e * agent.net.stride)
        reward, following, truncates = take(walk, e, action)
        replay.action[row, e] = action
        replay.reward[row, e] = reward
        replay.next_observation[row, e] = following
        replay.truncated[row, e] = truncates
    count(walk)


@inlined
def _best(values: Numbers, at: int) -> int:
    """Returns the first of the best actions, whose values begin at a place."""
    best = 0
    for a in range(1, N_ACTIONS):
        if values[at + a] > values[at + best]:
            best = a
    return best


@inlined
def _synchronise(values: Numbers, target: Target, tau: float) -> None:
    """Moves the target net towards the net by a share."""
    kept, share = like(values, 1.0 - tau), like(values, tau)
    for i in range(len(values)):
        target.values[i] = kept * target.values[i] + share * values[i]
    net.forget(target.known)


@inlined
def _draw_batch(agent: Dqn) -> None:
    """Draws a mini-batch, and computes returns of up to `n_steps` steps.

    A return ends where the episode ends, or at the row written last.
    """
    replay, batch, n_steps = agent.replay, agent.batch, agent.constants.n_steps
    n_rows, n_envs = replay.reward.shape
    n_written = agent.walk.taken[0] // n_envs
    last_row, n_filled = (n_written - 1) % n_rows, min(n_written, n_rows)
    gamma = like(batch.target, agent.constants.gamma)
    for b in range(len(batch.observed)):
        row = int(draw(agent.stream) * n_filled)
        e = int(draw(agent.stream) * n_envs) if n_envs > 1 else 0
        batch.observed[b] = replay.observation[row, e]
        batch.action[b] = replay.action[row, e]
        total, discount = like(batch.target, 0), like(batch.target, 1)
        for k in range(n_steps):
            total += replay.reward[row, e] * discount
            discount *= gamma
            ends = (
                replay.next_observation[row, e] == agent.walk.process.n_observations
                or replay.truncated[row, e]
            )
            if ends or row == last_row or k + 1 == n_steps:
                break
            row = (row + 1) % n_rows
        batch.target[b] = total
        batch.discount[b] = discount
        batch.next_observed[b] = replay.next_observation[row, e]


@inlined
def _add_next_values(agent: Dqn) -> None:
    """Adds what follows on the returns, by the target net, which is read for what is not known of it."""
    target, batch, q_net, n_unknown = agent.target, agent.batch, agent.net, 0
    unknown, terminal = q_net.observed, agent.walk.process.n_observations
    for o in batch.next_observed:
        if o != terminal and net.is_new(target.known, o):
            unknown[n_unknown] = o
            n_unknown += 1
    if n_unknown:
        at = net.forward(q_net, target.values, unknown, n_unknown)
        for i in range(n_unknown):
            row = at + i * q_net.stride
            target.next_value[unknown[i]] = q_net.hidden[row + _best(q_net.hidden, row)]
    for b in range(len(batch.target)):
        if batch.next_observed[b] != terminal:
            batch.target[b] += batch.discount[b] * target.next_value[batch.next_observed[b]]


@inlined
def _update(agent: Dqn) -> None:
    """Makes a gradient step by the Huber loss."""
    q_net, parameters, batch, merged = agent.net, agent.parameters, agent.batch, agent.batch.merged
    n_distinct = net.merge(batch.observed, merged)
    at = net.forward(q_net, parameters.values, merged.distinct, n_distinct)
    one, share = like(batch.target, 1), like(batch.target, 1.0 / len(batch.observed))
    net.clear(q_net.slopes[at : at + n_distinct * q_net.stride])
    for b in range(len(batch.observed)):
        i = at + merged.place[batch.observed[b]] * q_net.stride + batch.action[b]
        error = q_net.hidden[i] - batch.target[b]
        q_net.slopes[i] += share * (one if error > one else -one if error < -one else error)
    net.backward(q_net, parameters, merged.distinct, n_distinct)
    net.learn(parameters, agent.constants.learning_rate, _EPSILON, agent.constants.max_grad_norm)


DQN: Final = NetAlgorithm(DqnAgent, DqnSettings)
