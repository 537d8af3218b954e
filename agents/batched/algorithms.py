"""The batched DQN and PPO as algorithms of this project."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Literal

from numpy.random import SeedSequence

from agents.batched.settings import BatchedDqnSettings, BatchedPpoSettings
from agents.contract import DeepTraining, Schedule
from agents.sb3.settings import Sb3Settings
from envs import Model
from envs.inputs import needed_by

VERSION: Final = 1  # part of every run's identity: raise it when a change alters what is learned


@dataclass(frozen=True)
class BatchedAlgorithm:
    """A batched algorithm, see `agents.contract.Algorithm`."""

    module: str  # whose `train` trains
    settings: type[Sb3Settings]
    version: int = VERSION
    family: Literal["tabular", "deep"] = "deep"
    observations: tuple[str, ...] = ("one_hot", "coordinates")
    packages: tuple[str, ...] = ("numba", "torch")
    batch_size: int = 25  # with more, weights and moments fall out of the caches
    placement: Literal["thread", "process"] = "process"
    depends_on_batch: bool = False
    writes_logs: bool = False

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),  # noqa: ARG002
    ) -> DeepTraining:
        """Trains by the module's `train`.

        Raises:
          MissingPackageError: A package is not installed.
          InputError: There is no such device.
        """
        # A product of single matrices may use another routine with other rounding, so a single agent is
        # trained together with a copy of itself.
        pair = [*seeds, *seeds] if len(seeds) == 1 else seeds
        with needed_by(self.module):
            module = import_module(self.module)
        trained: DeepTraining = module.train(model, settings, observation, pair, schedule)
        if len(seeds) == 1:
            rows = {field.name: getattr(trained, field.name)[:1] for field in fields(trained)}
            rows["cpu_time_s"] = trained.cpu_time_s.sum(axis=0, keepdims=True)
            return DeepTraining(**rows)
        return trained


DQN: Final = BatchedAlgorithm("agents.batched.dqn", BatchedDqnSettings)
PPO: Final = BatchedAlgorithm("agents.batched.ppo", BatchedPpoSettings)
