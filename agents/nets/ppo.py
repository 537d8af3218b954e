"""PPO (Schulman et al. 2017) as in Stable-Baselines3: the whole loop of an agent, compiled.

Observations are few and recur. So probabilities and values are kept during a rollout, and a
mini-batch computes each distinct observation once. Only the order of sums differs.

An agent draws where its first episodes start. Then each step of each env draws the action and what
`agents.nets.stepping.take` draws. Permutations of rollouts have a stream of their own.

Axis letters: E envs, L steps of a rollout, O observations, A actions, B rows of a mini-batch.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.compiled import compiled
from agents.nets import net
from agents.nets.arithmetic import Kind, Numbers, exp, inlined, like, log
from agents.nets.learner import Agent, NetAlgorithm, NetSettings
from agents.nets.net import Batch, Net, Parameters, Values, room_for_batch, room_for_values
from agents.nets.stepping import Envs, Steps, count, draw, room_for_steps, take
from agents.process import N_ACTIONS
from agents.sb3.settings import PpoSettings
from envs import Model
from envs.arrays import Bools, Ints, Words

_GAIN = math.sqrt(2)  # scales the first weights of hidden layers, as in Stable-Baselines3
_GAINS = 0.01, 1.0  # scale those of the last layers of actor and critic


class Constants(NamedTuple):
    """How an agent learns, see `agents.sb3.settings.PpoSettings`."""

    n_steps: int  # L
    batch_size: int
    n_epochs: int
    gamma: float
    gae_lambda: float
    clip_range: float
    clip_range_vf: float  # infinite: not clipped
    normalize_advantage: bool
    ent_coef: float
    vf_coef: float
    target_kl: float  # infinite: epochs are not cut short


class Ppo(NamedTuple):
    """All that the compiled loop reads and changes."""

    constants: Constants
    actor: Net
    critic: Net
    parameters: Parameters
    probability: Numbers  # (O, A) the actor's, as far as they are computed since the last update
    log_probability: Numbers  # (O, A)
    is_known: Bools  # (O,)
    values: Values  # the critic's since the last update
    steps: Steps  # (E * L,) of a rollout, as Stable-Baselines3 flattens it, env after env
    old_log_probability: Numbers  # (E * L,)
    advantage: Numbers  # (E * L,)
    value_target: Numbers  # (E * L,) Stable-Baselines3's `returns`
    order: Ints  # (E * L,) a permutation
    batch: Batch
    batch_probability: Numbers  # (B, A) of distinct observations
    batch_log_probability: Numbers  # (B, A)
    envs: Envs
    stream: Words  # (4,) of the permutations


@inlined
def _to_probabilities(
    logits: Numbers, at: int, log_probability: Numbers, probability: Numbers
) -> bool:
    """Writes the probabilities (A,) of logits from an index on; returns if they are finite."""
    largest = logits[at]
    for a in range(1, N_ACTIONS):
        largest = max(largest, logits[at + a])
    total = 0.0
    for a in range(N_ACTIONS):
        total += exp(logits[at + a] - largest)
    total = log(total)
    is_finite = True
    for a in range(N_ACTIONS):
        log_probability[a] = logits[at + a] - largest - total
        probability[a] = exp(log_probability[a])
        is_finite &= math.isfinite(probability[a])
    return is_finite


@compiled
def _softmax(logits: Numbers, room: Numbers) -> None:
    """Replaces logits (O, A) by probabilities, given room (A,) for their logarithms."""
    for o in range(len(logits)):
        _to_probabilities(logits[o], 0, room, logits[o])


@compiled
def _advance(agent: Ppo, until: int) -> None:
    while agent.envs.n_steps[0] < until:
        agent.is_known[:] = False
        agent.values.is_known[:] = False
        if not _roll_out(agent):
            return
        for observed in (agent.steps.observed, agent.steps.next_observed):
            net.compute_values(agent.critic, agent.parameters.values, observed, agent.values)
        _estimate_advantages(agent)
        _learn(agent)


@inlined
def _roll_out(agent: Ppo) -> bool:
    """Makes a rollout; returns whether all probabilities were finite. If not, it ends there."""
    envs = agent.envs
    n_steps = agent.constants.n_steps
    for t in range(n_steps):
        for e in range(len(envs.state)):
            o = envs.process.observation[envs.state[e]]
            i = e * n_steps + t
            probability = agent.probability[o]
            log_probability = agent.log_probability[o]
            if not agent.is_known[o]:
                agent.is_known[o], agent.actor.observed[0] = True, o
                at = net.forward(agent.actor, agent.parameters.values, agent.actor.observed, 1)
                if not _to_probabilities(agent.actor.hidden, at, log_probability, probability):
                    return False
            uniform = draw(envs.stream)
            action = 0
            cumulated = probability[0]
            while action < N_ACTIONS - 1 and uniform >= cumulated:
                action += 1
                cumulated += probability[action]
            agent.old_log_probability[i] = log_probability[action]
            take(envs, e, action, agent.steps, i)
        count(envs)
    return True


@inlined
def _estimate_advantages(agent: Ppo) -> None:
    """Estimates advantages by GAE (Schulman et al. 2016), as Stable-Baselines3 does."""
    steps = agent.steps
    value = agent.values.largest
    n_steps = agent.constants.n_steps
    zero = like(value, 0)
    gamma = like(value, agent.constants.gamma)
    decay = like(value, agent.constants.gamma * agent.constants.gae_lambda)
    for e in range(len(agent.envs.state)):
        last = (e + 1) * n_steps - 1
        advantage = following = zero
        for i in range(last, last - n_steps, -1):
            reward = like(value, steps.reward[i])
            o = steps.next_observed[i]
            if steps.truncated[i]:
                reward += gamma * value[o]
            if steps.truncated[i] or o == agent.envs.process.n_observations:
                following = advantage = zero
            elif i == last:
                following = value[o]
            old = value[steps.observed[i]]
            advantage = reward + gamma * following - old + decay * advantage
            agent.advantage[i] = advantage
            agent.value_target[i] = advantage + old
            following = old


@inlined
def _learn(agent: Ppo) -> None:
    constants = agent.constants
    order = agent.order
    for _ in range(constants.n_epochs):
        for i in range(len(order)):
            order[i] = i
        for i in range(len(order) - 1, 0, -1):
            j = int(draw(agent.stream) * (i + 1))
            order[i], order[j] = order[j], order[i]
        for start in range(0, len(order), constants.batch_size):
            chosen = order[start : start + constants.batch_size]
            for b in range(len(chosen)):
                agent.batch.observed[b] = agent.steps.observed[chosen[b]]
            n_distinct = net.list_distinct(agent.batch, len(chosen))
            if not _slope_of_actor(agent, chosen, n_distinct):
                return
            _slope_of_critic(agent, chosen, n_distinct)
            for mlp in (agent.actor, agent.critic):
                net.backward(mlp, agent.parameters, agent.batch.distinct, n_distinct)
            net.learn(agent.parameters)


@inlined
def _slope_of_actor(agent: Ppo, chosen: Ints, n_distinct: int) -> bool:
    """Computes slopes of clipped surrogate and entropy; returns whether learning goes on."""
    constants = agent.constants
    actor = agent.actor
    advantages = agent.advantage
    slopes = actor.slopes
    n_rows = len(chosen)
    at = net.forward(actor, agent.parameters.values, agent.batch.distinct, n_distinct)
    net.clear(slopes[at : at + n_distinct * actor.stride])
    for r in range(n_distinct):
        log_probability = agent.batch_log_probability[r]
        probability = agent.batch_probability[r]
        _to_probabilities(actor.hidden, at + r * actor.stride, log_probability, probability)
    mean = 0.0
    deviation = 1.0
    if constants.normalize_advantage and n_rows > 1:
        for i in chosen:
            mean += advantages[i] / n_rows
        square = 0.0
        for i in chosen:
            square += (advantages[i] - mean) ** 2
        deviation = math.sqrt(square / (n_rows - 1)) + 1e-8
    divergence = 0.0
    for i in chosen:
        r = agent.batch.row[agent.steps.observed[i]]
        action = agent.steps.action[i]
        log_probability = agent.batch_log_probability[r]
        probability = agent.batch_probability[r]
        log_ratio = float(log_probability[action] - agent.old_log_probability[i])
        ratio = exp(log_ratio)
        divergence += (ratio - 1.0 - log_ratio) / n_rows
        advantage = (advantages[i] - mean) / deviation
        clipped = min(max(ratio, 1.0 - constants.clip_range), 1.0 + constants.clip_range)
        slope = 0.0 if advantage * ratio > advantage * clipped else advantage * ratio
        entropy = 0.0
        for a in range(N_ACTIONS):
            entropy -= probability[a] * log_probability[a]
        for a in range(N_ACTIONS):
            p = float(probability[a])
            # Through the softmax, the action's log-probability depends on all logits.
            total = slope * (p - (1.0 if a == action else 0.0))
            total += constants.ent_coef * p * (log_probability[a] + entropy)
            slopes[at + r * actor.stride + a] += total / n_rows
    return not divergence > 1.5 * constants.target_kl


@inlined
def _slope_of_critic(agent: Ppo, chosen: Ints, n_distinct: int) -> None:
    """Computes the slopes of the squared error by the critic's outputs."""
    constants = agent.constants
    critic = agent.critic
    at = net.forward(critic, agent.parameters.values, agent.batch.distinct, n_distinct)
    net.clear(critic.slopes[at : at + n_distinct * critic.stride])
    for i in chosen:
        o = agent.steps.observed[i]
        row = at + agent.batch.row[o] * critic.stride
        value = critic.hidden[row]
        if not abs(value - agent.values.largest[o]) > constants.clip_range_vf:
            critic.slopes[row] += (
                2.0 * constants.vf_coef * (value - agent.value_target[i]) / len(chosen)
            )


class PpoNetSettings(NetSettings, PpoSettings):
    """The settings of compiled PPO."""


class PpoAgent(Agent):
    """An agent that learns action probabilities."""

    is_value = False
    loop = staticmethod(_advance)
    outputs = (N_ACTIONS, 1)

    def begin(self, model: Model, settings: PpoSettings, kind: Kind) -> Ppo:
        """Draws orthogonal weights, and makes room for a rollout and a mini-batch."""
        n_observations = model.n_observations
        n_rows = min(settings.batch_size, settings.rollout)
        actor, critic = self.nets
        for mlp, gain in zip(self.nets, _GAINS, strict=True):
            net.draw_orthogonal(mlp, self.parameters.values, self.drawing, (_GAIN, gain))
        constants = {name: getattr(settings, name) for name in Constants._fields}
        endless = {name: constants[name] or math.inf for name in ("clip_range_vf", "target_kl")}
        probability, log_probability = np.zeros((2, n_observations, N_ACTIONS), kind)
        old_log_probability, advantage, value_target = np.zeros((3, settings.rollout), kind)
        batch_probability, batch_log_probability = np.zeros((2, n_rows, N_ACTIONS), kind)
        return Ppo(
            constants=Constants(**constants | endless),
            actor=actor,
            critic=critic,
            parameters=self.parameters,
            probability=probability,
            log_probability=log_probability,
            is_known=np.zeros(n_observations, np.bool_),
            values=room_for_values(n_observations, kind),
            steps=room_for_steps(settings.rollout),
            old_log_probability=old_log_probability,
            advantage=advantage,
            value_target=value_target,
            order=np.zeros(settings.rollout, np.int64),
            batch=room_for_batch(n_rows, n_observations),
            batch_probability=batch_probability,
            batch_log_probability=batch_log_probability,
            envs=self.envs,
            stream=self.learning,
        )

    def table(self) -> Numbers:
        """Returns the action probabilities for all observations, (O, A)."""
        table = super().table()
        _softmax(table, self.state.batch_log_probability[0])
        return table


PPO = NetAlgorithm(PpoAgent, PpoNetSettings)
