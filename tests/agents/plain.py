"""Q-learning in plain Python: an algorithm from outside, which other tests name by its path."""

import random
import time
from typing import Final, Literal

import numpy as np
from numpy.random import SeedSequence

from agents.contract import Fields, Schedule, SequentialAlgorithm
from agents.policy import greedy_masks
from agents.tabular.learner import Settings
from envs.model import ACTIONS, Model


class PlainSettings(Settings):
    """The settings of the compiled learner, with a budget in steps and without a record of the maximum."""

    budget_unit: Literal["steps"] = "steps"
    """Unit of the budget."""


class PlainQLearning(SequentialAlgorithm):
    """Q-learning in plain Python."""

    settings = PlainSettings

    def train_agent(
        self,
        model: Model,
        settings: Settings,
        observation: str,  # noqa: ARG002
        seed: SeedSequence,
        schedule: Schedule,
    ) -> Fields:
        """Trains an agent, see `agents.contract.SequentialAlgorithm`."""
        rng = random.Random(int(seed.generate_state(1)[0]))
        draws_outcomes = model.n_outcomes > 1
        next_state = (model.next_state if draws_outcomes else model.next_state[:, :, 0]).tolist()
        probability, terminated = model.probability.tolist(), model.terminated.tolist()
        rewards = (model.grid_reward + model.issuer_reward).tolist()
        noise, is_wrong_ping = model.issuer_noise.tolist(), model.is_wrong_ping.tolist()
        cell = model.observation.tolist()
        q = [[settings.initial_value] * len(ACTIONS) for _ in range(model.n_observations)]
        starts = model.starts.tolist()
        has_starts = len(starts) > 1
        state = rng.choice(starts) if has_starts else starts[0]
        episode_steps, disagreements, trained = 0, 0, 0
        used_s = 0.0
        tables, counts, seconds = [], [], []
        for until in dict.fromkeys([*schedule.evaluation_steps, settings.budget]):
            started_s = time.thread_time()
            for _ in range(trained, until):
                row = q[cell[state]]
                if rng.random() < settings.epsilon:
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
                target = reward if ends else reward + settings.discount * max(q[cell[following]])
                row[action] += settings.learning_rate * (target - row[action])
                episode_steps += 1
                if ends or episode_steps == settings.time_limit:
                    state, episode_steps = rng.choice(starts) if has_starts else starts[0], 0
                else:
                    state = following
            trained = until
            used_s += time.thread_time() - started_s
            tables.append(np.array(q))
            counts.append(disagreements)
            seconds.append(used_s)
        n = len(schedule.evaluation_steps)  # beyond them, nothing is kept but the final values
        kept = np.array(tables)[:n]
        greedy = greedy_masks(kept)
        return {
            "greedy": greedy & -greedy if settings.ties == "lowest" else greedy,
            "q": tables[-1],
            "stochastic": kept[:0],
            "values": kept[schedule.is_mapped].astype(np.float32),
            "disagreements": np.array(counts[:n], dtype=np.int64),
            "cpu_time_s": np.array(seconds[:n]),
            "updates": settings.budget,
            "parameters": tables[-1].size,
            "diverged_at": -1,
        }


Q_LEARNING: Final = PlainQLearning()
