"""Stable-Baselines3's `VecEnv` over the native vector env, in place of one Python env a member."""

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from envs import ProxemicVectorEnv


class SB3VecEnv(VecEnv):
    """A `ProxemicVectorEnv` as Stable-Baselines3 wants it.

    An `info` holds what SB3 reads and no more: `terminal_observation` and `TimeLimit.truncated` where an
    episode ended, nothing elsewhere; to write five values an env costs more than the step. All arrays
    are copies. One generator serves the batch, each env taking a draw of its own at every step, so that
    no two envs of a run share draws; `seed(s)` seeds that generator, and no env with `s + i`.

    Attributes:
      disagreements: Wrong PINGs of all envs since the last reset.
    """

    def __init__(self, env: ProxemicVectorEnv) -> None:
        """Wraps an env made with `autoreset_mode="SameStep"`.

        Raises:
          ValueError: It resets at the next step, which SB3 would take for a step of its own.
        """
        if env.metadata["autoreset_mode"] is not AutoresetMode.SAME_STEP:
            raise ValueError("env: accepted: a ProxemicVectorEnv with autoreset_mode = SameStep.")
        self.env = env
        self.disagreements = 0
        self._is_disagreement = env.model.is_wrong_ping.ravel()
        self._seed: int | None = None
        self._generator = np.random.default_rng()
        self._actions: NDArray[Any] = np.zeros(env.num_envs, dtype=np.int64)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds the generator of the whole batch at the next reset; any whole number from 0 on."""
        self._seed = seed
        return [seed] * self.num_envs

    def reset(self) -> NDArray[Any]:
        """Puts every agent at the start; observations (N, ...)."""
        if self._seed is not None:
            self._generator, self._seed = np.random.default_rng(self._seed), None
        observations, _ = self.env.reset()
        self.disagreements = 0
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the actions of the next step, (N,)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Steps; returns observations (N, ...), rewards (N,) float32, dones (N,) and N infos."""
        uniform = self._generator.random(self.num_envs) if self.env.model.is_noisy else None
        taken, grid_reward, issuer_reward, terminated, truncated = self.env.advance(self._actions, uniform)
        observations = self.env.observe()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        dones = terminated | truncated
        if dones.any():
            ended = np.flatnonzero(dones)
            for i in ended:
                infos[i]["terminal_observation"] = observations[i].copy()
                infos[i]["TimeLimit.truncated"] = not terminated[i]
            self.env.restart(ended)
            observations = self.env.observe()
        self.disagreements += int(np.count_nonzero(self._is_disagreement.take(taken)))
        return observations, (grid_reward + issuer_reward).astype(np.float32), dones, infos

    def close(self) -> None:
        """Closes the env."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Returns an attribute of the batch once for every env asked for."""
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:  # noqa: ARG002
        """Returns that no env is wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> NoReturn:
        """Refuses: the batch is one env."""
        raise NotImplementedError(f"set_attr({attr_name!r}): the envs of a batch have no attributes apart.")

    def env_method(self, method_name: str, *_: Any, **__: Any) -> NoReturn:
        """Refuses: the batch is one env."""
        raise NotImplementedError(f"env_method({method_name!r}): the envs of a batch have no methods apart.")
