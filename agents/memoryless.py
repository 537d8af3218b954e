"""The best memoryless policy found: a search where part of the state is hidden.

Without memory, finding the best policy is NP-hard (Littman 1994, "Memoryless policies: theoretical
limitations and practical results"), and it may have to be stochastic (Singh, Jaakkola and Jordan 1994). The
search starts from two policies that follow the optimal values, averaged over the states of an observation,
one loosely and one closely, plus noise. From each it makes steps of natural policy gradient (Kakade 2001),
which for a table adds advantages to logits, with the exact gradient (Sutton & Barto 2018, equation 13.5). A
step that does not improve the return is tried again at 0.3 of its length. The better of the two policies is
the result: a lower bound of what is possible.

The search knows the model. Its budget counts steps, half of them from each of the two policies.
"""

import math
import time
from typing import Annotated, Final

import numba
import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray
from pydantic import Field

from agents.compiled import compiled
from agents.contract import Fields, LearnerSettings, Schedule, SequentialAlgorithm, snapshots
from agents.dynamic_programming import Dynamics, Starts, dynamics, from_starts, solve, starts_of
from agents.policy import Policy
from envs.model import Model

_FIRST_RATE: Final = 1.0  # the length of a step per unit of advantage
_FASTER, _SLOWER, _MIN_RATE, _MAX_RATE = 1.5, 0.3, 1e-6, 1e6
_MAX_GUIDANCE: Final = 100.0  # with it, a policy nearly always takes the best action
_MIN_PROBABILITY: Final = 1e-12  # of an episode's going on; below it, a sweep ends


class MemorylessSettings(LearnerSettings):
    """The settings of the search."""

    budget: Annotated[int, Field(ge=1, le=10**6)] = 100
    """Steps of the search."""
    time_limit: Annotated[int, Field(ge=1, le=1000)] = 200
    """Steps until the episodes whose return is improved are truncated."""
    guidance: Annotated[float, Field(ge=0, le=1000)] = 1.0
    """How much the first policy follows the optimal values."""
    noise: Annotated[float, Field(ge=0, le=1000)] = 1.0
    """Standard deviation of what is added to these values."""

    @property
    def discount_factor(self) -> float:
        """1: returns are undiscounted."""
        return 1.0


class Memoryless(SequentialAlgorithm):
    """The search as an algorithm."""

    family = "planner"
    settings = MemorylessSettings
    version = 2
    packages = ("numba",)
    placement = "thread"

    def train_agent(
        self,
        model: Model,
        settings: MemorylessSettings,
        observation: str,  # noqa: ARG002
        seed: SeedSequence,
        schedule: Schedule,
    ) -> Fields:
        """Searches from two policies, see the module."""
        guide = _guide(model, settings.time_limit)
        started_s = time.thread_time()
        first = settings.noise * np.random.default_rng(seed).standard_normal(guide.shape)
        weights = settings.guidance, _MAX_GUIDANCE
        searches = [Search(model, weight * guide + first, settings.time_limit) for weight in weights]
        policies = np.empty((len(schedule.evaluation_steps), *guide.shape))
        cpu_time_s = np.empty(len(policies))
        for t, until in enumerate(schedule.evaluation_steps):
            for search in searches:
                search.climb(math.ceil(until / len(searches)))
            policies[t] = max(searches, key=lambda search: search.expected_return).policy
            cpu_time_s[t] = time.thread_time() - started_s
        return {
            **snapshots(policies, guide, schedule, is_value=False),
            "disagreements": np.zeros(len(policies), dtype=np.int64),
            "cpu_time_s": cpu_time_s,
            "updates": settings.budget,
            "parameters": guide.size,
        }


class Search:
    """A climb of the expected return, from a policy's logits (O, A)."""

    def __init__(self, model: Model, logits: NDArray[np.float64], horizon: int) -> None:
        self._model = model
        self._horizon = horizon
        self._logits = logits - logits.max(axis=1, keepdims=True)
        self._rate = _FIRST_RATE
        self._n_steps = 0
        self.expected_return, self._advantage = gradient(model, self.policy, horizon)

    @property
    def policy(self) -> Policy:
        """The best policy so far, (O, A)."""
        return _softmax(self._logits)

    def climb(self, until: int) -> None:
        """Makes steps until there are so many; a step that does not improve the return changes nothing."""
        while self._n_steps < until:
            self._n_steps += 1
            if self._rate < _MIN_RATE:
                continue
            logits = self._logits + self._rate * self._advantage
            logits = np.maximum(logits - logits.max(axis=1, keepdims=True), -700.0)  # so that none overflows
            value, advantage = gradient(self._model, _softmax(logits), self._horizon)
            if value > self.expected_return:
                self._logits, self.expected_return, self._advantage = logits, value, advantage
                self._rate = min(self._rate * _FASTER, _MAX_RATE)
            else:
                self._rate *= _SLOWER


def gradient(model: Model, policy: Policy, horizon: int) -> tuple[float, NDArray[np.float64]]:
    """Computes the expected sum of the grid's rewards of a policy, (O, A), and every action's advantage.

    The advantage, (O, A), is what the action gains on the policy, averaged over the visits of the
    observation; 0 where there are none.
    """
    gains, visits = np.zeros(policy.shape), np.zeros(len(policy))
    starts = starts_of(model, from_starts(model))
    expected_return = _sweep(policy, dynamics(model), model.grid_reward, starts, horizon, gains, visits)
    gains -= (policy * gains).sum(axis=1, keepdims=True)
    return expected_return, gains / np.where(visits > 0, visits, 1.0)[:, None]


@compiled
def _sweep(
    policy: NDArray[np.float64],
    dynamics: Dynamics,
    reward: NDArray[np.float64],
    starts: Starts,
    horizon: int,
    gains: NDArray[np.float64],
    visits: NDArray[np.float64],
) -> float:
    """Carries the state distribution forward and values back; adds up sum_t d_t(s) Q_t(s, a), and visits."""
    start_states, start_probability, first, n_block = starts
    distribution = np.zeros((horizon + 1, n_block))  # probability of each state before each step
    total = 0.0
    for g in range(len(first) - 1):
        offset = g * n_block
        distribution[0] = 0.0
        for i in range(first[g], first[g + 1]):
            distribution[0, start_states[i] - offset] = start_probability[i]
        n_steps = _carry_forward(policy, dynamics, offset, distribution, visits)
        value = _carry_back(policy, dynamics, reward, offset, distribution[:n_steps], gains)
        for i in range(first[g], first[g + 1]):
            total += start_probability[i] * value[start_states[i] - offset]
    return total


@numba.njit
def _carry_forward(
    policy: NDArray[np.float64],
    dynamics: Dynamics,
    offset: int,
    distribution: NDArray[np.float64],
    visits: NDArray[np.float64],
) -> int:
    """Fills the distributions after the first; returns how many steps an episode can have."""
    next_state, outcome, terminated, observation = dynamics
    for t in range(len(distribution) - 1):
        distribution[t + 1] = 0.0
        going = 0.0
        for i in range(distribution.shape[1]):
            d, s = distribution[t, i], offset + i
            if d > 0.0:
                o = observation[s]
                visits[o] += d
                for a in range(policy.shape[1]):
                    p = d * policy[o, a]
                    if not terminated[s, a]:
                        going += p
                        for k in range(next_state.shape[2]):
                            distribution[t + 1, next_state[s, a, k] - offset] += p * outcome[s, a, k]
        if going < _MIN_PROBABILITY:
            return t + 1
    return len(distribution) - 1


@numba.njit
def _carry_back(
    policy: NDArray[np.float64],
    dynamics: Dynamics,
    reward: NDArray[np.float64],
    offset: int,
    distribution: NDArray[np.float64],
    gains: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Returns the values of states at first, and adds up what actions gain in all steps."""
    next_state, outcome, terminated, observation = dynamics
    n_steps, n_block = distribution.shape
    value, next_value = np.zeros(n_block), np.zeros(n_block)
    for t in range(n_steps - 1, -1, -1):
        for i in range(n_block):
            s = offset + i
            o = observation[s]
            mean = 0.0
            for a in range(policy.shape[1]):
                q = reward[s, a]
                if not terminated[s, a]:
                    for k in range(next_state.shape[2]):
                        q += outcome[s, a, k] * next_value[next_state[s, a, k] - offset]
                mean += policy[o, a] * q
                if distribution[t, i] > 0.0:
                    gains[o, a] += distribution[t, i] * q
            value[i] = mean
        value, next_value = next_value, value
    return next_value


def _softmax(logits: NDArray[np.float64]) -> Policy:
    weights = np.exp(logits)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _guide(model: Model, horizon: int) -> NDArray[np.float64]:
    """Returns the optimal values, averaged over the fresh states of each observation, (O, A)."""
    q = solve(model, 1.0, horizon, issuer_rewards=False).q
    fresh = model.fresh_state[~model.is_over[model.fresh_state]]
    sums, counts = np.zeros((model.n_observations, q.shape[1])), np.zeros(model.n_observations)
    np.add.at(sums, model.observation[fresh], q[fresh])
    np.add.at(counts, model.observation[fresh], 1)
    return sums / np.maximum(counts, 1)[:, None]


SEARCH: Final = Memoryless()
