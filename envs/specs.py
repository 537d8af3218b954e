"""Env specs that Gymnasium can write as JSON, whatever the env was made with."""

import json
from enum import Enum
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from envs.scenario import Scenario


class JsonSpec:
    """An env's attribute `spec`, which Gymnasium assigns; a path becomes a string, a `Scenario` a mapping."""

    def __get__(self, env: object, _: type | None = None) -> EnvSpec | None:
        """Returns the spec; None if the env was not made by Gymnasium."""
        return getattr(env, "_spec", None)

    def __set__(self, env: Any, spec: EnvSpec | None) -> None:
        """Stores a spec."""
        if spec is not None:
            spec.kwargs = json.loads(json.dumps(spec.kwargs, default=_to_json))
        env._spec = spec


def _to_json(value: object) -> Any:
    if isinstance(value, Scenario):
        return value.model_dump(mode="json")
    if isinstance(value, Enum):
        return value.value
    return value.item() if isinstance(value, np.generic) else str(value)
