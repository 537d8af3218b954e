"""Stable-Baselines3's `VecEnv` over a compiled scenario: look-ups in arrays, no env per member."""

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from envs import ACTIONS, Model
from envs.arrays import Floats, Ints
from envs.model import TARGET_PING, draw_issuer_reward
from envs.observations import observation_space, observation_table

_NO_LIMIT = 2**62  # steps


class SB3VecEnv(VecEnv):
    """N envs of a model that step together, with the rules of `envs.ProxemicEnv`.

    An `info` has only what SB3 reads: `terminal_observation`, `TimeLimit.truncated`, `is_success`
    where an episode ended. A single generator serves all envs; `seed(s)` seeds it, where SB3's envs
    would seed env i with `s + i`.
    """

    def __init__(self, model: Model, n: int, form: str, time_limit: int | None = None) -> None:
        """Makes envs, each of which is reset in the step that ends its episode."""
        self.model, self.render_mode = model, None
        self.disagreements = 0  # wrong PINGs of all envs since the last reset
        self._limit = time_limit or _NO_LIMIT
        self._table = observation_table(model, form)
        self._state = np.full(n, model.start, dtype=np.intp)
        self._steps = np.zeros(n, dtype=np.int64)  # of the episode
        self._generator = np.random.default_rng()
        self._seed: int | None = None
        self._actions: NDArray[np.integer] = np.zeros(n, dtype=np.int64)
        space = observation_space(self._table, form)
        super().__init__(n, space, spaces.Discrete(len(ACTIONS)))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds the generator at the next reset; accepts any integer from 0."""
        self._seed = seed
        return [seed] * self.num_envs

    def reset(self) -> NDArray[Any]:
        """Resets every env; returns observations (N, ...)."""
        if self._seed is not None:
            self._generator, self._seed = np.random.default_rng(self._seed), None
        self._restart(np.arange(self.num_envs))
        self.disagreements = 0
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self._observe()

    def step_async(self, actions: NDArray[np.integer]) -> None:
        """Sets the actions of the next step, (N,)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Steps; returns observations (N, ...), rewards (N,) float32, dones (N,) and N infos."""
        model, k = self.model, self.model.n_outcomes
        pairs = self._state * len(ACTIONS) + self._actions  # serve all flat tables over (S, A)
        reward = model.issuer_reward.take(pairs)
        if model.is_noisy:
            noise = model.issuer_noise.take(pairs)
            reward = draw_issuer_reward(reward, noise, self._draw(self.num_envs))
        reward = model.grid_reward.take(pairs) + reward
        outcome = pairs * k
        if k > 1:
            chances = model.probability.reshape(-1, k)[pairs, :-1].cumsum(axis=1)
            outcome += (self._draw(self.num_envs)[:, None] >= chances).sum(axis=1)
        self._state = model.next_state.take(outcome).astype(np.intp)
        self._steps += 1
        self.disagreements += int(np.count_nonzero(model.is_wrong_ping.take(pairs)))
        terminated = model.terminated.take(pairs)
        dones = terminated | (self._steps >= self._limit)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(dones)
        for i, observation in zip(ended.tolist(), self._observe()[ended], strict=True):
            infos[i]["terminal_observation"] = observation
            infos[i]["TimeLimit.truncated"] = not terminated[i]
            infos[i]["is_success"] = model.event.item(pairs[i]) == TARGET_PING
        if len(ended):
            self._restart(ended)
        return self._observe(), reward.astype(np.float32), dones, infos

    def close(self) -> None:
        """Has nothing to close."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[object]:
        """Returns an attribute of all envs, repeated for every requested one."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

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

    def _draw(self, n: int) -> Floats:
        return self._generator.random(n)

    def _restart(self, envs: Ints) -> None:
        starts, n = self.model.starts, len(self.model.starts)
        drawn = (self._draw(len(envs)) * n).astype(np.intp) if n > 1 else 0
        self._state[envs], self._steps[envs] = starts[drawn], 0

    def _observe(self) -> NDArray[Any]:
        return self._table.take(self.model.observation.take(self._state), axis=0)
