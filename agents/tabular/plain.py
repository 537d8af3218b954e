"""Q-learning in plain Python: a second implementation, which checks the compiled one and shows what it saves.

Tables are lists of lists, random numbers are Python's own, and no array is touched between two evaluations.
"""

import random
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.random import SeedSequence

from agents.contract import Schedule, Training, check_request
from agents.policy import greedy_masks
from agents.tabular.kernel import Decay
from agents.tabular.learner import Settings
from envs.model import ACTIONS, Model

VERSION: Final = 1  # part of every run's identity: raise it when a change alters what is learned


class PlainSettings(Settings):
    """The settings of the compiled learner, with a budget in steps and without a record of the maximum."""

    budget_unit: Literal["steps"] = "steps"


@dataclass(frozen=True)
class PlainQLearning:
    """Q-learning in plain Python, see `agents.contract.Algorithm`."""

    version: int = VERSION
    family: Literal["tabular", "deep"] = "tabular"
    settings: type[Settings] = PlainSettings
    observations: tuple[str, ...] = ("index",)
    packages: tuple[str, ...] = ()
    batch_size: int = 1
    placement: Literal["thread", "process"] = "process"
    writes_logs: bool = False

    def train(
        self,
        model: Model,
        settings: Settings,
        observation: str,  # noqa: ARG002
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),  # noqa: ARG002
    ) -> Training:
        """Trains one agent after another.

        Raises:
          ValueError: There are no seeds, or the schedule is for another budget.
        """
        check_request(settings, seeds, schedule)
        n, n_steps, size = len(seeds), len(schedule.evaluation_steps), model.n_observations
        result = Training(
            greedy=np.empty((n, n_steps, size), dtype=np.uint8),
            q=np.empty((n, size, len(ACTIONS))),
            stochastic=np.empty((n, 0, size, len(ACTIONS))),
            values=np.empty((n, len(schedule.map_steps), size, len(ACTIONS)), dtype=np.float32),
            disagreements=np.empty((n, n_steps), dtype=np.int64),
            cpu_time_s=np.empty((n, n_steps)),
            updates=np.full(n, settings.budget),
            parameters=np.full(n, size * len(ACTIONS)),
            diverged_at=np.full(n, -1),
        )
        for agent, seed in enumerate(seeds):
            _train(model, settings, random.Random(int(seed.generate_state(1)[0])), schedule, result, agent)
        return result


def _train(
    model: Model,
    settings: Settings,
    rng: random.Random,
    schedule: Schedule,
    result: Training,
    agent: int,
) -> None:
    """Trains one agent, and keeps what it comes to."""
    draws_outcomes = model.n_outcomes > 1
    next_state = (model.next_state if draws_outcomes else model.next_state[:, :, 0]).tolist()
    probability, terminated = model.probability.tolist(), model.terminated.tolist()
    rewards = (model.grid_reward + model.issuer_reward).tolist()
    noise, is_wrong_ping = model.issuer_noise.tolist(), model.is_wrong_ping.tolist()
    cell = model.observation.tolist()
    q = [[settings.initial_value] * len(ACTIONS) for _ in range(model.n_observations)]
    visits = [[0] * len(ACTIONS) for _ in range(model.n_observations)]
    exponent = settings.visit_exponent
    rates, epsilons = settings.learning_rates, settings.epsilons
    rate, epsilon, changes_until = rates.first, epsilons.first, max(rates.until, epsilons.until)
    starts = model.starts.tolist()
    has_starts = len(starts) > 1
    state = rng.choice(starts) if has_starts else starts[0]
    episode_steps, disagreements, trained = 0, 0, 0
    used_s, i_map = 0.0, 0
    for place, until in enumerate(dict.fromkeys([*schedule.evaluation_steps, settings.budget])):
        started_s = time.thread_time()
        for step in range(trained, until):
            if step <= changes_until:
                rate, epsilon = _at(rates, step), _at(epsilons, step)
            row = q[cell[state]]
            if rng.random() < epsilon:
                action = rng.randrange(len(ACTIONS))
            else:
                best = max(row)
                if settings.ties == "lowest" or row.count(best) == 1:
                    action = row.index(best)
                else:
                    action = rng.choice([a for a, value in enumerate(row) if value == best])
            reward = rewards[state][action]
            if noise[state][action]:
                reward += noise[state][action] * rng.uniform(-1.0, 1.0)
            disagreements += is_wrong_ping[state][action]
            following, ends = next_state[state][action], terminated[state][action]
            if draws_outcomes:
                (following,) = rng.choices(following, probability[state][action])
            if exponent is not None:
                visits[cell[state]][action] += 1
                rate = settings.learning_rate / visits[cell[state]][action] ** exponent
            target = reward if ends else reward + settings.discount * max(q[cell[following]])
            row[action] += rate * (target - row[action])
            episode_steps += 1
            if ends or episode_steps == settings.time_limit:
                state, episode_steps = rng.choice(starts) if has_starts else starts[0], 0
            else:
                state = following
        trained = until
        used_s += time.thread_time() - started_s
        if place == len(schedule.evaluation_steps):
            break  # nothing is kept at the end of the budget
        table = np.array(q)
        result.greedy[agent, place] = greedy_masks(table, 0.0)
        if settings.ties == "lowest":
            result.greedy[agent, place] &= -result.greedy[agent, place]
        if schedule.is_mapped[place]:
            result.values[agent, i_map] = table
            i_map += 1
        result.disagreements[agent, place] = disagreements
        result.cpu_time_s[agent, place] = used_s
    result.q[agent] = q


def _at(decay: Decay, step: int) -> float:
    """Returns a decaying number at a step."""
    if step >= decay.until:
        return decay.last
    return decay.first + (decay.last - decay.first) * step / decay.until


Q_LEARNING: Final = PlainQLearning()
