"""A batch of envs over one `Model`: array look-ups instead of a Python object per env."""

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final, SupportsIndex

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from envs import render
from envs.inputs import InputError
from envs.model import ACTIONS, PING, draw_issuer_reward
from envs.observations import compile_seen, observation_space, observation_table
from envs.scenario import ScenarioLike, load_scenario
from envs.scene import scene_of
from envs.specs import JsonSpec

_INFO: Final = {
    "event": np.int64,
    "zone": np.int64,
    "wrong_pings": np.int64,
    "grid_reward": np.float64,
    "issuer_reward": np.float64,
}

Info = dict[str, Any]
Actions = NDArray[np.integer]
Observations = NDArray[Any]  # (N, ...)
Draw = Callable[[], NDArray[np.float64]]  # draws numbers from [0, 1)


class ProxemicVectorEnv(VectorEnv[Observations, Actions, Observations]):
    """N proxemic envs that step together; `ProxemicEnv` describes them.

    `gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=8)` makes one. It returns what
    `gymnasium.vector.SyncVectorEnv` returns for the same seeds and actions, in all three autoreset modes.
    """

    spec = JsonSpec()

    def __init__(
        self,
        num_envs: int = 1,
        scenario: ScenarioLike = "S1",
        observation: str = "index",
        overrides: Mapping[str, object] | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        """Compiles the scenario.

        Args:
          num_envs: N, at least 1.
          scenario: As for `ProxemicEnv`, like `observation` and `overrides`.
          observation: See there.
          overrides: See there.
          max_episode_steps: Steps until truncation; None or -1 for no limit.
          autoreset_mode: Gymnasium's `"NextStep"`, `"SameStep"` or `"Disabled"`.
          render_mode: `"rgb_array"` or None; others with `vectorization_mode="sync"`.

        Raises:
          InputError: An argument is not accepted.
        """
        self.num_envs = n = _positive("num_envs", num_envs, "a whole number, at least 1")
        self._limit: int = np.iinfo(np.int64).max
        if max_episode_steps not in (None, -1):
            accepted = "at least 1, or None or -1 for no limit"
            self._limit = _positive("max_episode_steps", max_episode_steps, accepted)
        if render_mode not in (None, "rgb_array"):
            accepted = 'rgb_array or None; others with vectorization_mode = "sync"'
            raise InputError(f"render_mode = {render_mode!r}; accepted for a batch: {accepted}.")
        self.render_mode = render_mode
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError:
            accepted = ", ".join(mode.value for mode in AutoresetMode)
            raise InputError(f"autoreset_mode = {autoreset_mode}; accepted: {accepted}.") from None
        self.model = compile_seen(load_scenario(scenario, overrides), observation)
        self.metadata = {
            "autoreset_mode": self._mode,
            "render_modes": ["rgb_array"],
            "render_fps": render.FRAMES_PER_SECOND,
        }
        self._table = observation_table(self.model, observation)
        self.single_observation_space = observation_space(self._table)
        self.single_action_space = spaces.Discrete(len(ACTIONS))
        self.observation_space = batch_space(self.single_observation_space, n)
        self.action_space = batch_space(self.single_action_space, n)

        model = self.model  # flat: the index state * A + action serves all tables over states and actions
        self._next_state = model.next_state.astype(np.intp).reshape(-1, model.n_outcomes)
        self._first_state = self._next_state[:, 0].copy()
        self._cumulated = model.probability.reshape(-1, model.n_outcomes)[:, :-1].cumsum(axis=1)
        self._grid_reward, self._issuer_reward = model.grid_reward.ravel(), model.issuer_reward.ravel()
        self._issuer_noise, self._terminated = model.issuer_noise.ravel(), model.terminated.ravel()
        self._event = model.event.astype(np.int64).ravel()
        self._wrong_pings = model.wrong_pings.astype(np.int64).ravel()
        self._observation = model.observation.astype(np.intp)
        self._zone = model.zone.astype(np.int64)

        self._state = np.full(n, model.start, dtype=np.intp)
        self._steps = np.zeros(n, dtype=np.int64)
        self._over = np.zeros(n, dtype=np.bool_)  # episodes that wait for a reset; none in SameStep

        self._starts = model.starts.astype(np.intp)
        self._generators = [seeding.np_random()[0] for _ in range(n)]

    def reset(
        self,
        *,
        seed: int | np.integer | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, Info]:
        """Starts episodes; returns observations, (N, ...), and the info of the envs that were reset.

        Args:
          seed: Seeds env i with `seed + i`, or with the item i of a sequence; with None it is not seeded.
          options: With `{"reset_mask": mask}`, (N,) bool, only these envs are reset and seeded.

        Raises:
          InputError: The mask or the number of seeds does not fit.
        """
        mask = self._checked_mask((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        envs = np.flatnonzero(mask)
        seeds = self._seeds(seed)
        for i in envs.tolist():
            if seeds[i] is not None:
                self._generators[i] = seeding.np_random(seeds[i])[0]
        self._over[envs] = False
        info: Info = {name: np.zeros(self.num_envs, dtype) for name, dtype in _INFO.items()}
        self._begin(envs, info)
        return self.observe(), _with_masks(info, mask)

    def step(
        self, actions: Actions
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Info]:
        """Takes an action in every env.

        Args:
          actions: (N,) integers, 0 to 4.

        Returns:
          Observations (N, ...), rewards (N,), terminated (N,), truncated (N,), and the info of
          `ProxemicEnv` as arrays (N,), each with a mask `_name` of the envs that it holds for. When an
          episode has ended, the next step resets its env and ignores the action (NextStep); or the same
          step resets it, and the info has `final_obs` and `final_info` (SameStep); or the env waits for
          `reset` with a `reset_mask` (Disabled).

        Raises:
          InputError: The actions have the wrong shape or type, one of them is not in 0 to 4, or an
            episode is over and autoreset is disabled.
        """
        actions = np.asarray(actions)
        n = self.num_envs
        if actions.shape != (n,) or actions.dtype.kind not in "iu":
            raise InputError(f"actions: {actions.dtype} {actions.shape}; accepted: ({n},) integers.")
        if actions.min() < 0 or actions.max() >= len(ACTIONS):
            raise InputError(f"actions: {actions.min()} to {actions.max()}; accepted: 0 to {PING}.")
        fresh = np.flatnonzero(self._over)
        if len(fresh) and self._mode is AutoresetMode.DISABLED:
            raise InputError(
                f"actions: the episodes of envs {fresh.tolist()} are over; accepted: a reset first."
            )
        going = np.flatnonzero(~self._over)  # an env that is about to be reset takes no draws for its step
        taken, grid_reward, issuer_reward, terminated, truncated = self.advance(
            actions.astype(np.intp), partial(self._draw, going)
        )
        info = {
            "event": self._event.take(taken),
            "zone": self._zone.take(self._state),
            "wrong_pings": self._wrong_pings.take(taken),
            "grid_reward": grid_reward,
            "issuer_reward": issuer_reward,
        }
        if len(fresh):  # NextStep: these envs are reset instead
            terminated[fresh] = truncated[fresh] = False
            self._begin(fresh, info)
        rewards = grid_reward + issuer_reward
        ended = terminated | truncated
        final: Info = {}
        if self._mode is not AutoresetMode.SAME_STEP:
            self._over = ended
        elif ended.any():
            final = self._final(info, ended)
            self._begin(np.flatnonzero(ended), info)
        info = _with_masks(info, np.ones(self.num_envs, dtype=np.bool_)) | final
        return self.observe(), rewards, terminated, truncated, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns an image of every env, (H, W, 3) uint8, as `SyncVectorEnv` does; None without a mode."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs a render_mode, which gymnasium.make_vec takes.")
            return None
        context, cell = self.model.context[self._state].tolist(), self.model.cell[self._state].tolist()
        states = zip(context, cell, strict=True)
        return tuple(render.to_image(scene_of(self.model, where), agent) for where, agent in states)

    def advance(
        self, actions: Actions, draw: Draw
    ) -> tuple[
        NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]
    ]:
        """Moves every env by one action: the core of `step`, without checks, resets and info.

        It draws (N,) numbers for noisy rewards, and then for outcomes if there are several. It returns (N,)
        `state * A + action` before the move, the grid's and the issuer's rewards, terminated, and truncated.
        """
        taken = self._state * len(ACTIONS) + actions
        issuer_reward = self._issuer_reward.take(taken)
        if self.model.is_noisy:
            issuer_reward = draw_issuer_reward(issuer_reward, self._issuer_noise.take(taken), draw())
        if self.model.n_outcomes > 1:
            chosen = (draw()[:, None] >= self._cumulated[taken]).sum(axis=1)
            self._state = self._next_state[taken, chosen]
        else:
            self._state = self._first_state.take(taken)
        self._steps += 1
        truncated = self._steps >= self._limit
        return taken, self._grid_reward.take(taken), issuer_reward, self._terminated.take(taken), truncated

    def restart(self, envs: NDArray[np.intp], draw: Draw) -> None:
        """Moves the agents of these envs, (n,), to a start, of several by draws from [0, 1), (n,)."""
        n = len(self._starts)
        self._state[envs] = self._starts[(draw() * n).astype(np.intp) if n > 1 else 0]
        self._steps[envs] = 0

    def observe(self) -> Observations:
        """Returns a copy of the observations, (N, ...)."""
        return self._table.take(self._observation.take(self._state), axis=0)

    def _draw(self, envs: NDArray[np.intp]) -> NDArray[np.float64]:
        """Returns a draw from the generator of each of these envs, and 0 for the others, (N,)."""
        uniform = np.zeros(self.num_envs)
        uniform[envs] = [self._generators[i].random() for i in envs.tolist()]
        return uniform

    def _final(self, info: Info, ended: NDArray[np.bool_]) -> Info:
        observations = self.observe()
        final_obs = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ended).tolist():
            # An index is a Python integer, as `ProxemicEnv` returns it.
            final_obs[i] = observations[i].copy() if observations.ndim > 1 else int(observations[i])
        final_info = {name: np.where(ended, values, np.zeros_like(values)) for name, values in info.items()}
        return _with_masks({"final_obs": final_obs, "final_info": _with_masks(final_info, ended)}, ended)

    def _begin(self, envs: NDArray[np.intp], info: Info) -> None:
        """Starts episodes in these envs, and replaces their info by that after a reset."""
        self.restart(envs, lambda: self._draw(envs)[envs])
        for name in _INFO:
            info[name][envs] = 0
        info["zone"][envs] = self._zone[self._state[envs]]

    def _checked_mask(self, mask: object) -> NDArray[np.bool_]:
        if not isinstance(mask, np.ndarray) or mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            given = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
            raise InputError(f"reset_mask: {given}; accepted: a bool array of shape ({self.num_envs},).")
        if not mask.any():
            raise InputError("reset_mask: no env is selected; accepted: at least one.")
        return mask

    def _seeds(self, seed: int | np.integer | Sequence[int | None] | None) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return range(int(seed), int(seed) + self.num_envs)
        if len(seed) != self.num_envs:
            raise InputError(f"seed: {len(seed)} seeds; accepted: {self.num_envs}, one per env.")
        return [None if item is None else operator.index(item) for item in seed]


def _positive(name: str, value: SupportsIndex | None, accepted: str) -> int:
    """Returns a whole number from 1 as a Python integer."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = 0
    if number < 1:
        raise InputError(f"{name} = {value!r}; accepted: {accepted}.")
    return number


def _with_masks(info: Info, mask: NDArray[np.bool_]) -> Info:
    """Returns an info with a mask of the envs that each entry holds for, as Gymnasium names them."""
    return info | {f"_{name}": mask.copy() for name in info}
