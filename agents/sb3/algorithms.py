"""DQN and PPO of Stable-Baselines3 as algorithms of this project."""

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any, Final

from numpy.random import SeedSequence

from agents.contract import DeepTraining, Fields, Schedule, SequentialAlgorithm
from agents.sb3.settings import DqnSettings, PpoSettings, Sb3Settings
from envs import Model
from envs.observations import VECTORS
from envs.packages import needed_by


@dataclass(frozen=True)
class Sb3Algorithm(SequentialAlgorithm):
    """One of SB3's algorithms, or of any package with classes like SB3's."""

    path: str  # `module:class`
    settings: type[Sb3Settings]
    packages: tuple[str, ...] = ("stable_baselines3", "torch")

    version = 3
    family = "deep"
    observations = VECTORS
    training = DeepTraining

    def load(self) -> Any:
        """Imports the class."""
        return resolve_name(self.path)

    def train_agent(
        self, model: Model, settings: Any, observation: str, seed: SeedSequence, schedule: Schedule
    ) -> Fields:
        """Trains by `agents.sb3.training.train_agent`; a missing package is a MissingPackageError."""
        with needed_by(self.path):
            cls = self.load()
            from agents.sb3.training import train_agent
        return train_agent(cls, model, settings, observation, seed, schedule)


DQN: Final = Sb3Algorithm("stable_baselines3:DQN", DqnSettings)
PPO: Final = Sb3Algorithm("stable_baselines3:PPO", PpoSettings)
