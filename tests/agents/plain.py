"""Q-learning as an algorithm from outside, which other tests name by its path."""

import time
from dataclasses import fields
from typing import Any, Final

from numpy.random import SeedSequence

from agents.contract import Fields, Schedule, SequentialAlgorithm, Training
from agents.tabular import learner
from envs.model import Model


class PlainQLearning(SequentialAlgorithm):
    """Trains in a process of its own, as slowly as in plain Python."""

    settings = learner.Settings

    def train_agent(
        self, model: Model, settings: Any, observation: str, seed: SeedSequence, schedule: Schedule
    ) -> Fields:
        """Trains an agent, see `agents.contract.SequentialAlgorithm`."""
        time.sleep(settings.budget / 300_000)
        training = learner.Q_LEARNING.train(model, settings, observation, [seed], schedule)
        return {field.name: getattr(training, field.name)[0] for field in fields(Training)}


Q_LEARNING: Final = PlainQLearning()
