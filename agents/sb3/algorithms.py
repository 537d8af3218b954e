"""DQN and PPO of Stable-Baselines3, and classes like them by import path, as algorithms.

The settings of an imported class are this project's and the arguments in its signature, recorded
with their defaults, so that a version with other defaults makes other runs. Values are checked by
making an untrained agent.
"""

import inspect
import sys
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import packages_distributions
from pkgutil import resolve_name
from typing import Any, ClassVar, Self

from numpy.random import SeedSequence
from pydantic import ConfigDict, create_model, model_validator

from agents.contract import DeepTraining, Fields, Schedule, SequentialAlgorithm
from agents.sb3.settings import (
    OUR_SETTINGS,
    BufferSize,
    DqnSettings,
    PpoSettings,
    Sb3Settings,
    StepCount,
)
from envs import Model
from envs.inputs import Count, InputError, Share
from envs.observations import IMAGES, VECTORS
from envs.packages import needed_by
from envs.sources import imported

# What this project sets itself, and types of arguments that it understands.
_SET_HERE = {"policy", "env", "device", "seed", "verbose", "tensorboard_log", "stats_window_size"}
_KNOWN: dict[str, object] = {
    "gamma": Share,
    "n_steps": StepCount,
    "train_freq": Count,
    "buffer_size": BufferSize,
    "batch_size": Count | None,
    "policy_kwargs": dict[str, Any],
}


@dataclass(frozen=True)
class Sb3Algorithm(SequentialAlgorithm):
    """One of SB3's algorithms, or of any package with classes like SB3's."""

    path: str  # `module:class`
    settings: type[Sb3Settings]
    packages: tuple[str, ...] = ("stable_baselines3", "torch")
    policies: tuple[str, ...] = SequentialAlgorithm.policies

    version = 3
    family = "deep"
    observations = VECTORS + IMAGES
    training = DeepTraining

    def load(self) -> Any:
        """Imports the class."""
        return resolve_name(self.path)

    def train_agent(
        self, model: Model, settings: Any, observation: str, seed: SeedSequence, schedule: Schedule
    ) -> Fields:
        """Trains by `sb3.training.train_agent`; a missing package is a MissingPackageError."""
        with needed_by(self.path):
            cls = self.load()
            from agents.sb3.training import train_agent
        return train_agent(cls, model, settings, observation, seed, schedule)


DQN = Sb3Algorithm("stable_baselines3:DQN", DqnSettings, policies=("greedy",))
PPO = Sb3Algorithm("stable_baselines3:PPO", PpoSettings)


def is_sb3_class(value: object) -> bool:
    """Returns whether an object is a class of agents like those of SB3, without importing SB3."""
    module = sys.modules.get("stable_baselines3.common.base_class")
    return (
        module is not None and isinstance(value, type) and issubclass(value, module.BaseAlgorithm)
    )


class ImportedSettings(Sb3Settings):
    """What the settings of all imported classes have in common."""

    model_config = ConfigDict(protected_namespaces=(), validate_default=True)

    path: ClassVar[str]  # `module:class`

    @property
    def arguments(self) -> dict[str, object]:
        """The arguments that are set."""
        return self._fitted(
            self.model_dump(exclude=OUR_SETTINGS, exclude_unset=True, exclude_none=True)
        )

    @model_validator(mode="after")
    def _agents_can_be_made(self) -> Self:
        from agents.sb3.training import check_settings

        check_settings(resolve_name(self.path), self, self.path)
        return self

    def __reduce__(self) -> tuple[object, ...]:
        """Pickles the path, from which another process makes the class of the settings again."""
        return _unpickled, (self.path, self.model_dump_json(exclude_unset=True))


def _unpickled(path: str, settings: str) -> Sb3Settings:
    cls = imported(path, "settings", "algorithm")
    return algorithm_of(cls, path).settings.model_validate_json(settings)


@lru_cache
def algorithm_of(cls: Any, path: str) -> Sb3Algorithm:
    """Makes an algorithm of a class with the import path `module:class`, see `is_sb3_class`."""
    arguments = _arguments(cls)
    if "gamma" not in arguments or not arguments.keys() & {"train_freq", "n_steps"}:
        raise InputError(
            f"algorithm {path}: accepted: a class with an argument gamma, its discount, and an "
            "argument train_freq or n_steps, the steps from one round of updates to the next."
        )
    fields: dict[str, Any] = {
        name: (_KNOWN.get(name, Any), {} if name == "policy_kwargs" else default)
        for name, default in arguments.items()
        if name in _KNOWN or not (name in _SET_HERE or hasattr(ImportedSettings, name))
    }
    settings: Any = create_model(f"{cls.__name__}Settings", __base__=ImportedSettings, **fields)
    settings.path = path
    modules = {
        base.__module__.partition(".")[0] for base in cls.__mro__
    } & packages_distributions().keys()
    packages = tuple(sorted(modules | {"stable_baselines3", "torch"}))
    policy = getattr(cls, "policy_aliases", {}).get("MlpPolicy")
    learns_any = policy is None or hasattr(policy, "get_distribution")
    policies = Sb3Algorithm.policies if learns_any else ("greedy",)
    return Sb3Algorithm(path, settings, packages, policies)


def _arguments(cls: type) -> dict[str, object]:
    """Returns the named arguments of a class with their defaults: `...` for none, None for objects.

    A class that passes `**kwargs` on has the arguments of the class above it, too.
    """
    arguments: dict[str, object] = {}
    for base in cls.__mro__:
        if "__init__" not in vars(base):
            continue
        _, *parameters = inspect.signature(vars(base)["__init__"]).parameters.values()
        for parameter in parameters:
            is_named = parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
            if is_named and not parameter.name.startswith("_"):
                default = ... if parameter.default is parameter.empty else parameter.default
                is_plain = isinstance(default, bool | int | float | str | type(...))
                arguments.setdefault(parameter.name, default if is_plain else None)
        if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
            break
    return arguments
