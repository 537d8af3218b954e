"""A whole batch of envs over one `Model`: array look-ups, and no rules of its own."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from envs.inputs import InputError
from envs.model import ACTIONS, EVENTS, compile_scenario, draw_issuer_reward
from envs.observations import observation_space, observation_table
from envs.regions import ZONES
from envs.scenario import Scenario, load_scenario

_EVENT_NAMES = np.array(EVENTS, dtype=object)
_ZONE_NAMES = np.array(ZONES, dtype=object)


class ProxemicVectorEnv(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """N proxemic envs stepped at once; what they are is told by `ProxemicEnv`.

    `gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=8, vectorization_mode="vector_entry_point")`
    makes one. Noise comes from a single generator, one draw an env and step: with same-step autoreset
    a batch of one equals `ProxemicEnv` of the same seed, draw for draw.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Path | Scenario = "S1",
        observation: str = "index",
        overrides: Mapping[str, Any] | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
    ) -> None:
        """Compiles the scenario.

        Args:
          num_envs: N, at least 1.
          scenario: A name, the path of a TOML file, or a scenario already read.
          observation: `"index"`, `"one_hot"` or `"coordinates"`.
          overrides: Replaces values of the scenario's file.
          max_episode_steps: Steps until truncation; none by default.
          autoreset_mode: Gymnasium's next-step (default) or same-step.
          render_mode: None: a batch is not drawn.

        Raises:
          InputError: One of the arguments is not accepted.
        """
        if not isinstance(num_envs, int) or num_envs < 1:
            raise InputError(f"num_envs = {num_envs!r}; accepted: a whole number, at least 1.")
        limited = max_episode_steps is not None
        if limited and (not isinstance(max_episode_steps, int) or max_episode_steps < 1):
            raise InputError(f"max_episode_steps = {max_episode_steps!r}; accepted: at least 1, or None.")
        if render_mode is not None:
            raise InputError(f"render_mode = {render_mode!r}; accepted: None, a batch is not drawn.")
        modes = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP
        if autoreset_mode not in (*modes, *(mode.value for mode in modes)):
            raise InputError(f"autoreset_mode = {autoreset_mode}; accepted: NextStep, SameStep.")
        mode = AutoresetMode(autoreset_mode)
        self.model = compile_scenario(load_scenario(scenario, overrides))
        self.num_envs = num_envs
        self.metadata = {"autoreset_mode": mode, "render_modes": []}
        self._table = observation_table(self.model, observation)
        self.single_observation_space = observation_space(self._table)
        self.single_action_space = spaces.Discrete(len(ACTIONS))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._same_step = mode is AutoresetMode.SAME_STEP
        self._limit = np.iinfo(np.int64).max if max_episode_steps is None else max_episode_steps

        model = self.model  # flat views: one index, state * A + action, serves every table
        self._next_state = model.next_state.astype(np.intp).ravel()
        self._grid_reward = model.grid_reward.ravel()
        self._issuer_reward = model.issuer_reward.ravel()
        self._issuer_noise = model.issuer_noise.ravel()
        self._terminated = model.terminated.ravel()
        self._event = _EVENT_NAMES[model.event].ravel()
        self._wrong_pings = model.wrong_pings.ravel()
        self._observation = model.observation.astype(np.intp)
        self._zone = _ZONE_NAMES[model.zone]
        self._state = np.full(num_envs, model.start, dtype=np.intp)
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Puts every agent at the start. Observations: (N, ...)."""
        super().reset(seed=seed, options=options)
        self._state[:] = self.model.start
        self._steps[:] = 0
        self._over[:] = False
        return self.observe(), self._reset_info()

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Takes one action in every env.

        Args:
          actions: (N,) integers, 0 to 4.

        Returns:
          Observations (N, ...), rewards (N,), terminated (N,), truncated (N,), and the info of
          `ProxemicEnv` with arrays (N,). After an episode's end the next step resets that env, its
          action unread, or with same-step autoreset the same step does, and `final_obs` and
          `final_info` hold what the episode ended with, as in `gymnasium.vector.SyncVectorEnv`.

        Raises:
          InputError: Wrong shape, or an action that is not one of 0 to 4.
        """
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise InputError(
                f"actions: {actions.dtype} {actions.shape}; accepted: ({self.num_envs},) integers."
            )
        if actions.min() < 0 or actions.max() >= len(ACTIONS):
            raise InputError(
                f"actions: {actions.min()} to {actions.max()}; accepted: 0 to {len(ACTIONS) - 1}."
            )
        taken, grid_reward, issuer_reward, terminated, truncated = self.advance(actions.astype(np.intp))
        info = self._info(self._event.take(taken), self._wrong_pings.take(taken), grid_reward, issuer_reward)
        if self._over.any():  # next-step autoreset: these envs were not stepped, but begin anew
            over = np.flatnonzero(self._over)
            self.restart(over)
            terminated[over] = truncated[over] = False
            for name, values in self._reset_info(len(over)).items():
                info[name][over] = values
        rewards = grid_reward + issuer_reward
        ended = terminated | truncated
        if not self._same_step:
            self._over = ended
        elif ended.any():
            info = self._end(np.flatnonzero(ended), info)
        return self.observe(), rewards, terminated, truncated, info

    def advance(
        self, actions: NDArray[Any]
    ) -> tuple[
        NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]
    ]:
        """Moves every env by one action: the core of `step`, for loops that need no info.

        Actions are not checked, and no env is reset: see `observe` and `restart`.

        Args:
          actions: (N,) integers, 0 to 4.

        Returns:
          (N,) each: what was taken, as `state * A + action`; the grid's reward; the issuer's reward;
          terminated; truncated.
        """
        taken = self._state * len(ACTIONS) + actions
        self._state = self._next_state.take(taken)
        self._steps += 1
        issuer_reward = self._issuer_reward.take(taken)
        if self.model.is_noisy:
            uniform = self.np_random.random(self.num_envs)
            issuer_reward = draw_issuer_reward(issuer_reward, self._issuer_noise.take(taken), uniform)
        truncated = self._steps >= self._limit
        return taken, self._grid_reward.take(taken), issuer_reward, self._terminated.take(taken), truncated

    def restart(self, envs: NDArray[np.intp]) -> None:
        """Puts these envs at the start."""
        self._state[envs] = self.model.start
        self._steps[envs] = 0

    def observe(self) -> NDArray[Any]:
        """Returns the observations, (N, ...), a copy."""
        return self._table.take(self._observation.take(self._state), axis=0)

    def _end(self, ended: NDArray[np.intp], info: dict[str, Any]) -> dict[str, Any]:
        """Starts these envs anew within the step; returns the info with `final_obs` and `final_info`."""
        mask = np.zeros(self.num_envs, dtype=np.bool_)
        mask[ended] = True
        observations = self.observe()
        final_obs = np.full(self.num_envs, None, dtype=object)
        for i in ended:
            final_obs[i] = observations[i]
        final_info = {name: values.copy() for name, values in info.items()}
        self.restart(ended)
        for name, values in self._reset_info(len(ended)).items():
            info[name][ended] = values
        final_info |= {f"_{name}": mask for name in info}
        return info | {
            "final_obs": final_obs,
            "_final_obs": mask,
            "final_info": final_info,
            "_final_info": mask,
        }

    def _info(
        self,
        event: NDArray[Any],
        wrong_pings: NDArray[Any],
        grid_reward: NDArray[np.float64],
        issuer_reward: NDArray[np.float64],
    ) -> dict[str, Any]:
        """Names what a step tells beside observation and reward; arrays (N,)."""
        return {
            "event": event,
            "zone": self._zone.take(self._state),
            "wrong_pings": wrong_pings,
            "grid_reward": grid_reward,
            "issuer_reward": issuer_reward,
        }

    def _reset_info(self, n: int | None = None) -> dict[str, Any]:
        """Returns the info of `n` envs just reset (all by default)."""
        n = self.num_envs if n is None else n
        return {
            "event": np.full(n, EVENTS[0], dtype=object),
            "zone": np.full(n, self._zone[self.model.start], dtype=object),
            "wrong_pings": np.zeros(n, dtype=np.int32),
            "grid_reward": np.zeros(n),
            "issuer_reward": np.zeros(n),
        }
