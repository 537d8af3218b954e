"""DQN (Mnih et al. 2015) as in Stable-Baselines3: the whole loop of an agent, compiled.

Observations are few and recur. So the target net's values are kept until the next synchronisation,
and a mini-batch computes each distinct observation once. Only the order of sums differs.

An agent draws where its first episodes start. Then each step of its envs draws whether to explore,
and for each env a random action and what `agents.nets.stepping.take` draws. Mini-batches have a
stream of their own: they draw a row and, with several envs, an env.

Axis letters: E envs, O observations, A actions, P parameters, C rows of the replay buffer, B rows
of a mini-batch.
"""

from typing import NamedTuple

import numpy as np

from agents.compiled import compiled
from agents.nets import net
from agents.nets.arithmetic import Kind, Numbers, inlined, like
from agents.nets.learner import Agent, NetAlgorithm, NetSettings
from agents.nets.net import Batch, Net, Parameters, Values, room_for_batch, room_for_values
from agents.nets.stepping import Envs, Steps, count, draw, room_for_steps, take
from agents.people import PEOPLE_EXTRACTOR
from agents.process import N_ACTIONS
from agents.sb3.settings import DqnSettings
from envs import Model
from envs.arrays import Codes, Indices, Words


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


class Dqn(NamedTuple):
    """All that the compiled loop reads and changes."""

    constants: Constants
    net: Net
    parameters: Parameters
    target: Numbers  # (P,) the parameters of the target net
    target_values: Values  # its outputs since the last synchronisation
    replay: Steps  # (C * E,) as in Stable-Baselines3, a row per step of the envs
    batch: Batch
    action: Codes  # (B,)
    returns: Numbers  # (B,) up to the next observation
    discount: Numbers  # (B,) of the value of the next observation
    next_observed: Indices  # (B,)
    envs: Envs
    stream: Words  # (4,) of the mini-batches


@inlined
def exploration_rate(constants: Constants, n_steps: int) -> float:
    """Returns the probability of a random action after so many steps."""
    if n_steps < constants.learning_starts:
        return 1.0
    if n_steps == 0:  # as in Stable-Baselines3, which sets the rate after each step
        return 0.0
    progress = 1.0 - (1.0 - n_steps / constants.budget)  # rounded as in Stable-Baselines3
    first = constants.exploration_initial_eps
    last = constants.exploration_final_eps
    if progress > constants.exploration_fraction:
        return last
    return first + progress * (last - first) / constants.exploration_fraction


@compiled
def _advance(agent: Dqn, until: int) -> None:
    constants = agent.constants
    envs = agent.envs
    while envs.n_steps[0] < until:
        for _ in range(constants.train_freq):
            _act(agent)
            if envs.n_steps[0] // len(envs.state) % constants.synchronised_every == 0:
                _synchronise(agent)
        if envs.n_steps[0] > constants.learning_starts:
            for _ in range(constants.gradient_steps):
                _draw_batch(agent)
                _update(agent)


@inlined
def _act(agent: Dqn) -> None:
    """Takes an epsilon-greedy step in all envs, and keeps it in the replay buffer.

    As in Stable-Baselines3, one draw decides whether all envs explore, and the first of several
    best actions is greedy.
    """
    replay = agent.replay
    envs = agent.envs
    observed = agent.net.observed
    n_envs = len(envs.state)
    first = envs.n_steps[0] % len(replay.reward)
    explores = draw(envs.stream) < exploration_rate(agent.constants, envs.n_steps[0])
    for e in range(n_envs):
        observed[e] = envs.process.observation[envs.state[e]]
    at = 0
    if not explores:
        at = net.forward(agent.net, agent.parameters.values, observed, n_envs)
    for e in range(n_envs):
        action = int(draw(envs.stream) * N_ACTIONS)
        if not explores:
            action = net.best_output(agent.net, at + e * agent.net.stride)
        take(envs, e, action, replay, first + e)
    count(envs)


@inlined
def _synchronise(agent: Dqn) -> None:
    """Moves the target net towards the net by a share."""
    values = agent.parameters.values
    target = agent.target
    tau = agent.constants.tau
    kept = like(values, 1.0 - tau)
    share = like(values, tau)
    for i in range(len(values)):
        target[i] = kept * target[i] + share * values[i]
    agent.target_values.is_known[:] = False


@inlined
def _draw_batch(agent: Dqn) -> None:
    """Draws a mini-batch, and computes returns of up to `n_steps` steps.

    A return ends where the episode ends, or at the row written last.
    """
    replay = agent.replay
    n_steps = agent.constants.n_steps
    n_envs = len(agent.envs.state)
    n_made = agent.envs.n_steps[0]
    n_kept = len(replay.reward)
    last_row = (n_made - n_envs) % n_kept
    n_filled = min(n_made, n_kept) // n_envs
    gamma = like(agent.returns, agent.constants.gamma)
    for b in range(len(agent.action)):
        row = int(draw(agent.stream) * n_filled)
        e = int(draw(agent.stream) * n_envs) if n_envs > 1 else 0
        i = row * n_envs + e
        agent.batch.observed[b] = replay.observed[i]
        agent.action[b] = replay.action[i]
        total = like(agent.returns, 0)
        discount = like(agent.returns, 1)
        for k in range(n_steps):
            total += replay.reward[i] * discount
            discount *= gamma
            ends = (
                replay.next_observed[i] == agent.envs.process.n_observations or replay.truncated[i]
            )
            if ends or i == last_row + e or k + 1 == n_steps:
                break
            i = (i + n_envs) % n_kept
        agent.returns[b] = total
        agent.discount[b] = discount
        agent.next_observed[b] = replay.next_observed[i]


@inlined
def _update(agent: Dqn) -> None:
    """Adds the target net's estimates to the returns; takes a gradient step on the Huber loss."""
    q_net = agent.net
    parameters = agent.parameters
    batch = agent.batch
    n_rows = len(agent.action)
    net.compute_values(q_net, agent.target, agent.next_observed, agent.target_values)
    n_distinct = net.list_distinct(batch, n_rows)
    at = net.forward(q_net, parameters.values, batch.distinct, n_distinct)
    one = like(agent.returns, 1)
    share = like(agent.returns, 1.0 / n_rows)
    net.clear(q_net.slopes[at : at + n_distinct * q_net.stride])
    for b in range(n_rows):
        target = agent.returns[b]
        o_next = agent.next_observed[b]
        if o_next != agent.envs.process.n_observations:
            target += agent.discount[b] * agent.target_values.largest[o_next]
        i = at + batch.row[batch.observed[b]] * q_net.stride + agent.action[b]
        error = q_net.hidden[i] - target
        q_net.slopes[i] += share * (one if error > one else -one if error < -one else error)
    net.backward(q_net, parameters, batch.distinct, n_distinct)
    net.learn(parameters)


class DqnNetSettings(NetSettings, DqnSettings):
    """The settings of compiled DQN."""

    extractors = (PEOPLE_EXTRACTOR,)


class DqnAgent(Agent):
    """An agent that learns action values."""

    is_value = True
    loop = staticmethod(_advance)
    outputs = (N_ACTIONS,)

    def begin(self, model: Model, settings: DqnSettings, kind: Kind) -> Dqn:
        """Draws uniform weights, and makes room for the replay buffer and a mini-batch."""
        n_envs = settings.n_envs
        n_updates = settings.gradient_steps
        n_rows = settings.batch_size
        (q_net,) = self.nets
        net.draw_uniform(q_net, self.parameters.values, self.drawing)
        n_kept = max(settings.arguments["buffer_size"] // n_envs, 1)
        same = {name: getattr(settings, name, 0) for name in Constants._fields}
        changed = {
            "gradient_steps": settings.rollout if n_updates < 0 else n_updates,
            "synchronised_every": max(settings.target_update_interval // n_envs, 1),
        }
        returns, discount = np.zeros((2, n_rows), kind)
        return Dqn(
            constants=Constants(**same | changed),
            net=q_net,
            parameters=self.parameters,
            target=self.parameters.values.copy(),
            target_values=room_for_values(model.n_observations, kind),
            replay=room_for_steps(n_kept * n_envs),
            batch=room_for_batch(n_rows, model.n_observations),
            action=np.zeros(n_rows, np.int8),
            returns=returns,
            discount=discount,
            next_observed=np.zeros(n_rows, np.int32),
            envs=self.envs,
            stream=self.learning,
        )


DQN = NetAlgorithm(DqnAgent, DqnNetSettings, ("greedy",))
