"""Stable-Baselines3's `VecEnv` over the native vector env, instead of one Python env per member."""

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from envs import ProxemicVectorEnv
from envs.model import TARGET_PING
from envs.vector_env import Actions, Observations


class SB3VecEnv(VecEnv):
    """A `ProxemicVectorEnv` with the interface that Stable-Baselines3 expects.

    An `info` has only what SB3 reads: `terminal_observation`, `TimeLimit.truncated` and
    `is_success` where an episode ended. A single generator serves the batch; `seed(s)` seeds it,
    where SB3's envs would seed env i with `s + i`.
    """

    def __init__(self, env: ProxemicVectorEnv) -> None:
        """Wraps a batch of envs, in which an env is reset in the step that ends its episode."""
        self.env = env
        self.disagreements = 0  # wrong PINGs of all envs since the last reset
        self._is_disagreement = env.model.is_wrong_ping.ravel()
        self._is_success = env.model.event.ravel() == TARGET_PING
        self._seed: int | None = None
        self._generator = np.random.default_rng()
        self._actions: Actions = np.zeros(env.num_envs, dtype=np.int64)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds the generator of the batch at the next reset; accepts any integer from 0."""
        self._seed = seed
        return [seed] * self.num_envs

    def reset(self) -> Observations:
        """Resets every env; returns observations (N, ...)."""
        if self._seed is not None:
            self._generator, self._seed = np.random.default_rng(self._seed), None
        self.env.restart(np.arange(self.num_envs), lambda: self._generator.random(self.num_envs))
        self.disagreements = 0
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self.env.observe()

    def step_async(self, actions: Actions) -> None:
        """Sets the actions of the next step, (N,)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Steps; returns observations (N, ...), rewards (N,) float32, dones (N,) and N infos."""
        step = self.env.advance(self._actions, lambda: self._generator.random(self.num_envs))
        pairs, grid_reward, issuer_reward, terminated, truncated = step
        observations = self.env.observe()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        dones = terminated | truncated
        if dones.any():
            ended = np.flatnonzero(dones)
            for i in ended:
                infos[i]["terminal_observation"] = observations[i].copy()
                infos[i]["TimeLimit.truncated"] = not terminated[i]
                infos[i]["is_success"] = self._is_success.item(pairs[i])
            self.env.restart(ended, lambda: self._generator.random(len(ended)))
            observations = self.env.observe()
        self.disagreements += int(np.count_nonzero(self._is_disagreement.take(pairs)))
        return observations, (grid_reward + issuer_reward).astype(np.float32), dones, infos

    def close(self) -> None:
        """Closes the env."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[object]:
        """Returns an attribute of the batch, repeated for every requested env."""
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(
        self,
        wrapper_class: type[object],  # noqa: ARG002
        indices: VecEnvIndices = None,
    ) -> list[bool]:
        """Returns False for every requested env."""
        return [False] * len(list(self._get_indices(indices)))

    def env_method(self, method_name: str, *_: object, **__: object) -> NoReturn:
        """Refuses what would be for single envs, as does `set_attr`."""
        raise NotImplementedError(f"{method_name}: accepted: nothing; envs share all they have.")

    set_attr = env_method  # type: ignore[assignment]
