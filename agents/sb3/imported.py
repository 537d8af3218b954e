"""Any class like those of Stable-Baselines3 as an algorithm of this project, by its import path.

Its settings are the arguments in its signature and those of this project. The class's own defaults are
recorded with them, so that a version with other defaults makes other runs.
"""

import inspect
import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import packages_distributions
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import create_model, model_validator

from agents.sb3.algorithms import Sb3Algorithm
from agents.sb3.method import Method
from agents.sb3.settings import OUR_SETTINGS, Count, Sb3Settings, Share
from agents.sb3.signatures import ArgumentTable, lenient, one_of, read_signature
from envs.inputs import InputError, Table, parse

_SET_HERE: Final = {
    "policy": "agents have the class's MlpPolicy",
    "env": "the experiment names the scenarios",
    "device": "agents train on the CPU, where results can be repeated",
    "seed": "every run derives its seed from the experiment",
    "verbose": "training prints nothing",
    "tensorboard_log": "run --tensorboard DIR writes logs",
    "stats_window_size": "it affects only logs",
}
_SET_BY_THE_CLASS: Final = dict.fromkeys(
    ("observation_space", "action_space", "lr_schedule", "use_sde"), "the class passes it to its policy"
)
_KNOWN: Final[Mapping[str, Any]] = {
    "gamma": Share,
    "n_steps": Count,
    "buffer_size": Count,
    "train_freq": Annotated[
        Count | lenient(tuple[Count, Literal["step"]]),
        one_of('a number of steps from 1, or [number, "step"]; episodes have no fixed number of steps'),
    ],
}
_SOUND: Final[set[tuple[type, str]]] = set()  # settings with which an agent could be made


def is_sb3_class(found: object) -> bool:
    """Returns whether an object is a class of agents like those of SB3, without importing SB3."""
    module = sys.modules.get("stable_baselines3.common.base_class")
    return module is not None and isinstance(found, type) and issubclass(found, module.BaseAlgorithm)


class ImportedSettings(ArgumentTable, Sb3Settings):
    """What the settings of all imported classes have in common."""

    path: ClassVar[str]  # `module:class`

    @property
    def rollout(self) -> int:
        """`train_freq` steps of every env, or `n_steps` if there is no `train_freq`."""
        return _steps(vars(self)) * self.n_envs

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that are set; a buffer larger than the budget would only take memory."""
        arguments = self.model_dump(exclude=OUR_SETTINGS, exclude_unset=True, exclude_none=True)
        if "buffer_size" in vars(self):
            arguments["buffer_size"] = min(vars(self)["buffer_size"], self.budget)
        return arguments

    @model_validator(mode="after")
    def _agents_can_be_made(self) -> Self:
        key = (type(self), self.model_dump_json())
        if key not in _SOUND:
            from agents.sb3.training import check_method

            check_method(Method(self.path, type(self), has_modes=True), self)
            _SOUND.add(key)
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the path, from which another process makes the class of the settings again."""
        return _restored, (self.path, self.model_dump_json(exclude_unset=True))


@lru_cache
def algorithm_of(cls: Any, path: str) -> Sb3Algorithm:
    """Makes an algorithm of a class.

    Args:
      cls: A class for which `is_sb3_class` is true.
      path: Its import path, `module:class`.

    Raises:
      InputError: The class cannot be trained here, for example because its actions are not discrete.
    """
    settings = _settings_of(cls, path)
    if not _needs_values(settings):  # else only the settings can show whether an agent can be made
        defaults = {name: field.default for name, field in settings.model_fields.items()}
        rollout = _steps(defaults)
        parse(settings, {"budget": -(-10_000 // rollout) * rollout}, f"algorithm {path}")
    distributions = packages_distributions()
    modules = {base.__module__.partition(".")[0] for base in cls.__mro__}
    packages = {distributions[module][0] for module in modules & distributions.keys()}
    log_interval = inspect.signature(cls.learn).parameters.get("log_interval")
    return Sb3Algorithm(
        Method(path, settings, log_interval.default if log_interval else 1, has_modes=True),
        packages=tuple(sorted(packages | {"stable_baselines3", "torch"})),
    )


def _settings_of(cls: Any, path: str) -> type[ImportedSettings]:
    """Makes the class of the settings of a class of agents."""
    fields, refused = read_signature(cls, ImportedSettings, _KNOWN, _SET_HERE)
    if "gamma" not in fields or not fields.keys() & {"train_freq", "n_steps"}:
        raise InputError(
            f"algorithm {path}: accepted: a class with an argument gamma, its discount, and an argument "
            "train_freq or n_steps, the steps from one round of updates to the next."
        )
    policy = getattr(cls, "policy_aliases", {}).get("MlpPolicy")
    if policy is None:
        raise InputError(f"algorithm {path}: accepted: a class that has a policy called MlpPolicy.")
    policy_fields, policy_refused = read_signature(policy, ArgumentTable, {}, _SET_BY_THE_CLASS)
    policy_table: Any = create_model(f"{policy.__name__}Arguments", __base__=ArgumentTable, **policy_fields)
    policy_table.refused = policy_refused
    table: Any = create_model(
        f"{cls.__name__}Settings",
        __base__=ImportedSettings,
        policy_kwargs=(policy_table, ... if _needs_values(policy_table) else policy_table()),
        **fields,
    )
    table.path, table.refused = path, refused
    return table


def _needs_values(table: type[Table]) -> bool:
    """Returns whether a table has keys without a default."""
    return any(field.is_required() for field in table.model_fields.values())


def _steps(settings: Mapping[str, Any]) -> int:
    """Returns the steps of every env from one round of updates to the next."""
    steps = settings["train_freq" if "train_freq" in settings else "n_steps"]
    return int(steps if isinstance(steps, int) else steps[0])


def _restored(path: str, settings: str) -> ImportedSettings:
    """Returns pickled settings."""
    from agents import load_algorithm

    restored: ImportedSettings = load_algorithm(path).settings.model_validate_json(settings)  # type: ignore[assignment]
    return restored
