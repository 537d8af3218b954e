"""Algorithms of Stable-Baselines3 and of its contributions as algorithms of this project."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from numpy.random import SeedSequence

from agents.contract import Schedule, Training
from agents.sb3.method import Method
from agents.sb3.settings import A2cSettings, DqnSettings, PpoSettings, QrdqnSettings, Sb3Settings
from envs import Model
from envs.inputs import needed_by

VERSION: Final = 3  # part of every run's identity: raise it when a change alters what is learned


@dataclass(frozen=True)
class Sb3Algorithm:
    """One of SB3's algorithms, see `agents.contract.Algorithm`."""

    method: Method
    version: int = VERSION
    family: Literal["tabular", "deep"] = "deep"
    observations: tuple[str, ...] = ("one_hot", "coordinates")
    packages: tuple[str, ...] = ("stable_baselines3", "torch")
    batch_size: int = 1
    placement: Literal["thread", "process"] = "process"
    writes_logs: bool = True

    @property
    def settings(self) -> type[Sb3Settings]:
        """The method's settings."""
        return self.method.settings

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),
    ) -> Training:
        """Trains by `agents.sb3.training.train`.

        Raises:
          MissingPackageError: A package is not installed.
        """
        with needed_by(self.method.path):
            self.method.load()
            from agents.sb3 import training
        return training.train(self.method, model, settings, observation, seeds, schedule, logs)


DQN: Final = Sb3Algorithm(Method("stable_baselines3:DQN", DqnSettings, log_interval=10))
PPO: Final = Sb3Algorithm(Method("stable_baselines3:PPO", PpoSettings))
A2C: Final = Sb3Algorithm(Method("stable_baselines3:A2C", A2cSettings, log_interval=100))
QRDQN: Final = Sb3Algorithm(
    Method("sb3_contrib:QRDQN", QrdqnSettings, log_interval=10),
    packages=("sb3_contrib", "stable_baselines3", "torch"),
)
