"""Env specs that Gymnasium can write as JSON, whatever the env was made with."""

from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from envs.scenario import Scenario


class JsonSpec:
    """An env's attribute `spec`, its arguments stored as values that JSON has.

    Gymnasium assigns `spec` after it has made an env. `EnvSpec.to_json` would fail if a path or a `Scenario`
    were among the arguments, so a path becomes a string and a `Scenario` a mapping. The envs accept both.
    """

    def __get__(self, env: Any, _: type | None = None) -> EnvSpec | None:
        """Returns the spec; None if the env was not made by Gymnasium."""
        return getattr(env, "_spec", None)

    def __set__(self, env: Any, spec: EnvSpec | None) -> None:
        """Stores a spec."""
        if spec is not None:
            spec.kwargs = {name: _to_json(value) for name, value in spec.kwargs.items()}
        env._spec = spec


def _to_json(value: Any) -> Any:
    """Returns an argument of an env as a value that JSON has."""
    if isinstance(value, Scenario):
        return value.model_dump(mode="json")
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, Enum):
        return value.value
    return value.item() if isinstance(value, np.generic) else value
