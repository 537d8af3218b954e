"""A batch of envs, as `gymnasium.make_vec` makes it."""

from collections.abc import Mapping
from copy import copy

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit

from envs.inputs import InputError, shortened
from envs.proxemic_env import ProxemicEnv
from envs.scenario import ScenarioLike

MAX_ENVS = 4096


class ProxemicVectorEnv(SyncVectorEnv):
    """N envs that step together; `ProxemicEnv` describes them.

    `gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=8)` makes one. By default, when an episode
    has ended, the next step resets its env and ignores the action.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: ScenarioLike = "S1",
        observation: str = "index",
        overrides: Mapping[str, object] | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Compiles the scenario; the arguments are those of `ProxemicEnv`, N and a time limit.

        `max_episode_steps` is None or -1 for no limit, and `autoreset_mode` as in `SyncVectorEnv`.
        Raises an InputError for other values.
        """
        limit = None if max_episode_steps == -1 else max_episode_steps
        given = {"num_envs": (num_envs, MAX_ENVS)}
        if limit is not None:
            given["max_episode_steps"] = limit, 10**9
        for name, (number, most) in given.items():
            if not (isinstance(number, int | np.integer) and 1 <= number <= most):
                raise InputError(
                    f"{name} = {shortened(repr(number))}; accepted: a whole number from 1 to "
                    f"{most:,}."
                )
        first = ProxemicEnv(scenario, observation, overrides, render_mode)

        def made() -> ProxemicEnv | TimeLimit[object, int]:
            env = copy(first)  # with the same model and observations
            return TimeLimit(env, limit) if limit else env

        super().__init__([made] * int(num_envs), autoreset_mode=autoreset_mode)
