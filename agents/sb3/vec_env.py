"""A batch of envs with the interface of Stable-Baselines3: array look-ups in one `Model`."""

from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from envs.arrays import Ints
from envs.model import ACTIONS, TARGET_PING, Model, draw_issuer_reward
from envs.observations import observation_space, observation_table

Observations = NDArray[Any]  # (N, ...)


class SB3VecEnv(VecEnv):
    """N envs that step together, as `stable_baselines3.common.vec_env.DummyVecEnv` does.

    An `info` has only what SB3 reads: `terminal_observation`, `TimeLimit.truncated` and
    `is_success` where an episode ended. A single generator serves the batch; `seed(s)` seeds it
    with `s`, where SB3's envs would seed env i with `s + i`.
    """

    render_mode = None

    def __init__(
        self, model: Model, observation: str, n_envs: int = 1, time_limit: int | None = None
    ) -> None:
        """Makes envs of a model, compiled for a form of observation."""
        self.model = model
        self.disagreements = 0  # wrong PINGs of all envs since the last reset
        self._table = observation_table(model, observation)
        self._limit = time_limit or 2**62
        self._state = np.full(n_envs, model.start, dtype=np.intp)
        self._steps = np.zeros(n_envs, dtype=np.int64)  # in the episode
        self._is_disagreement = model.is_wrong_ping.ravel()
        self._is_success = model.event.ravel() == TARGET_PING
        self._generator = np.random.default_rng()
        self._actions: Ints = np.zeros(n_envs, dtype=np.int64)
        space = observation_space(self._table, observation)
        super().__init__(n_envs, space, spaces.Discrete(len(ACTIONS)))

    def reset(self) -> Observations:
        """Resets every env; returns observations (N, ...)."""
        if self._seeds[0] is not None:
            self._generator = np.random.default_rng(self._seeds[0])
            self._reset_seeds()
        self._restart(np.arange(self.num_envs))
        self.disagreements = 0
        return self._observe()

    def step_async(self, actions: Ints) -> None:
        """Sets the actions of the next step, (N,)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Steps; returns observations (N, ...), rewards (N,) float32, dones (N,) and N infos.

        It draws (N,) numbers for noisy rewards, and then for outcomes if there are several.
        """
        model = self.model
        k = self.model.n_outcomes
        taken = self._state * len(ACTIONS) + self._actions  # (N,)
        rewards = model.issuer_reward.take(taken)
        if model.is_noisy:
            drawn = self._generator.random(self.num_envs)
            rewards = draw_issuer_reward(rewards, model.issuer_noise.take(taken), drawn)
        rewards = model.grid_reward.take(taken) + rewards
        outcome = taken * k
        if k > 1:
            chances = model.probability.reshape(-1, k)[taken, :-1].cumsum(axis=1)
            outcome += (self._generator.random(self.num_envs)[:, None] >= chances).sum(axis=1)
        self._state = model.next_state.take(outcome).astype(np.intp)
        self._steps += 1
        terminated = model.terminated.take(taken)
        dones = terminated | (self._steps >= self._limit)
        observations = self._observe()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            ended = np.flatnonzero(dones)
            for i in ended:
                infos[i]["terminal_observation"] = observations[i].copy()
                infos[i]["TimeLimit.truncated"] = not terminated[i]
                infos[i]["is_success"] = self._is_success.item(taken[i])
            self._restart(ended)
            observations = self._observe()
        self.disagreements += int(np.count_nonzero(self._is_disagreement.take(taken)))
        return observations, rewards.astype(np.float32), dones, infos

    def _restart(self, envs: Ints) -> None:
        """Moves agents of some envs to a start; several starts need draws."""
        starts = self.model.starts
        n = len(self.model.starts)
        drawn = self._generator.random(len(envs)) if n > 1 else np.zeros(len(envs))
        self._state[envs] = starts[(drawn * n).astype(np.intp)]
        self._steps[envs] = 0

    def _observe(self) -> Observations:
        return self._table.take(self.model.observation.take(self._state), axis=0)

    def close(self) -> None:
        """Does nothing."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[object]:
        """Returns an attribute of the batch, repeated for every requested env."""
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
