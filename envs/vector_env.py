"""A batch of envs over one `Model`: array look-ups instead of a Python object per env."""

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Literal

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from envs.arrays import Bools, Floats, Ints
from envs.inputs import InputError, shortened
from envs.model import ACTIONS, PING, TARGET_PING, draw_issuer_reward
from envs.observations import observation_table
from envs.proxemic_env import ProxemicEnv
from envs.scenario import ScenarioLike

_INFO = {
    "event": np.int64,
    "zone": np.int64,
    "wrong_pings": np.int64,
    "grid_reward": np.float64,
    "issuer_reward": np.float64,
    "is_success": np.bool_,
}

Info = dict[str, Any]
Actions = NDArray[np.integer]
Observations = NDArray[Any]  # (N, ...)
Draw = Callable[[], Floats]  # draws numbers from [0, 1)


class ProxemicVectorEnv(VectorEnv[Observations, Actions, Observations]):
    """N proxemic envs that step together; `ProxemicEnv` describes them.

    `gymnasium.make_vec("envs:Proxemic/S1-v0", num_envs=8)` makes one. It returns what
    `gymnasium.vector.SyncVectorEnv` returns for the same seeds and actions: when an episode has
    ended, the next step resets its env and ignores the action. For windows and other modes of
    autoreset, `vectorization_mode="sync"` makes that env.
    """

    autoreset_mode = AutoresetMode.NEXT_STEP
    metadata: dict[str, Any] = {  # noqa: RUF012
        **ProxemicEnv.metadata,
        "autoreset_mode": autoreset_mode,
    }

    def __init__(
        self,
        num_envs: int = 1,
        scenario: ScenarioLike = "S1",
        observation: str = "index",
        overrides: Mapping[str, object] | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Compiles the scenario; the arguments are those of `ProxemicEnv`, N and a time limit.

        `max_episode_steps` is None or -1 for no limit. What is not accepted is an InputError.
        """
        self.render_mode = render_mode
        self.metadata = dict(self.metadata)  # which wrappers change
        self._limit: int = np.iinfo(np.int64).max
        if max_episode_steps not in (None, -1):
            self._limit = max_episode_steps
        for name, number in (("num_envs", num_envs), ("max_episode_steps", self._limit)):
            if not isinstance(number, int | np.integer) or number < 1:
                raise InputError(
                    f"{name} = {shortened(repr(number))}; accepted: a whole number, at least 1."
                )
        self.num_envs = n = int(num_envs)
        # draws what is rendered
        self._single = ProxemicEnv(scenario, observation, overrides, render_mode)
        self.model = self._single.model
        self._table = observation_table(self.model, observation)
        self.single_observation_space = self._single.observation_space
        self.single_action_space = self._single.action_space
        self.observation_space = batch_space(self.single_observation_space, n)
        self.action_space = batch_space(self.single_action_space, n)

        self._state = np.full(n, self.model.start, dtype=np.intp)
        self._last_event = np.zeros(n, dtype=np.int64)
        # steps in the episode; -1 before the first reset
        self._steps = np.full(n, -1, dtype=np.int64)
        self._over = np.zeros(n, dtype=np.bool_)  # episodes that the next step resets
        self._seeded = [seeding.np_random() for _ in range(n)]  # generators and their seeds

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each env."""
        return tuple(generator for generator, _ in self._seeded)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each env, a random one if none was given."""
        return tuple(seed for _, seed in self._seeded)

    def reset(
        self,
        *,
        seed: int | np.integer | Sequence[int | None] | NDArray[np.integer] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, Info]:
        """Starts an episode in every env; returns observations, (N, ...), and the info.

        A number seeds env i with `seed + i`, a sequence of N with its item i; None leaves it as it
        is. `options["reset_mask"]`, (N,) booleans, says which envs are reset, at least one; the
        others go on, and the masks in the info are False for them. Other options are ignored.
        """
        n, given = self.num_envs, seed
        seeds: list[int | None] = []  # none if what is given are no seeds
        with suppress(TypeError):
            if not isinstance(given, Iterable):
                given = [None if given is None else operator.index(given) + i for i in range(n)]
            seeds = [None if its_seed is None else operator.index(its_seed) for its_seed in given]
        if len(seeds) != n or any(its_seed is not None and its_seed < 0 for its_seed in seeds):
            accepted = f"None, a whole number from 0, or {n} of these, one per env"
            raise InputError(f"seed = {shortened(repr(seed))}; accepted: {accepted}.")
        mask = (options or {}).get("reset_mask", np.ones(n, dtype=np.bool_))
        is_mask = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (n,)
        if not (is_mask and mask.any()):
            accepted = f"an array of ({n},) booleans, not all of them False"
            raise InputError(
                f"options: reset_mask = {shortened(repr(mask))}; accepted: {accepted}."
            )
        chosen = np.flatnonzero(mask)
        for i in chosen.tolist():
            if seeds[i] is not None:
                self._seeded[i] = seeding.np_random(seeds[i])
        self._over[chosen] = False
        info: Info = {name: np.zeros(self.num_envs, dtype) for name, dtype in _INFO.items()}
        self._begin(chosen, info)
        return self.observe(), _with_masks(info, mask)

    def step(self, actions: Actions) -> tuple[Observations, Floats, Bools, Bools, Info]:
        """Takes an action in every env, (N,) integers from 0 to 4; others raise an InputError.

        Returns:
          Observations (N, ...), rewards (N,), terminated (N,), truncated (N,), and the info of
          `ProxemicEnv` as arrays (N,), each with a mask `_name` of the envs that it holds for: all.
        """
        n = self.num_envs
        if self._steps.min() < 0:
            raise ResetNeeded("Cannot call env.step() before calling env.reset()")
        actions = np.asarray(actions)
        is_right = actions.shape == (n,) and actions.dtype.kind in "iu"
        if not is_right or actions.min() < 0 or actions.max() >= len(ACTIONS):
            accepted = f"({n},) integers from 0 to {PING}"
            raise InputError(f"actions = {shortened(repr(actions))}; accepted: {accepted}.")
        fresh = np.flatnonzero(self._over)
        # an env that is about to be reset takes no draws for its step
        going = np.flatnonzero(~self._over)
        draw = partial(self._draw, going)
        taken, grid_reward, issuer_reward, terminated, truncated = self.advance(
            actions.astype(np.intp), draw
        )
        self._last_event = self.model.event.take(taken).astype(np.int64)
        info = {
            "event": self._last_event.copy(),
            "zone": self.model.zone.take(self._state).astype(np.int64),
            "wrong_pings": self.model.wrong_pings.take(taken).astype(np.int64),
            "grid_reward": grid_reward,
            "issuer_reward": issuer_reward,
            "is_success": self._last_event == TARGET_PING,
        }
        if len(fresh):  # these envs are reset instead
            terminated[fresh] = truncated[fresh] = False
            self._begin(fresh, info)
        rewards = grid_reward + issuer_reward
        self._over = terminated | truncated
        return self.observe(), rewards, terminated, truncated, _with_masks(info, True)

    def render(self) -> tuple[Any, ...]:
        """Returns what `ProxemicEnv.render` returns, of each env."""
        frames = []
        for state, event in zip(self._state.tolist(), self._last_event.tolist(), strict=True):
            self._single.s, self._single._event = state, event
            frames.append(self._single.render())
        return tuple(frames)

    def advance(self, actions: Actions, draw: Draw) -> tuple[Ints, Floats, Floats, Bools, Bools]:
        """Moves every env by one action: the core of `step`, without checks, resets and info.

        It draws (N,) numbers for noisy rewards, and then for outcomes if there are several. It
        returns (N,) `state * A + action` before the move, the grid's and the issuer's rewards,
        terminated, and truncated.
        """
        model, k = self.model, self.model.n_outcomes
        # serves all flat tables over states and actions
        taken = self._state * len(ACTIONS) + actions
        issuer_reward = model.issuer_reward.take(taken)
        if model.is_noisy:
            issuer_reward = draw_issuer_reward(
                issuer_reward, model.issuer_noise.take(taken), draw()
            )
        outcome = taken * k
        if k > 1:
            chances = model.probability.reshape(-1, k)[taken, :-1].cumsum(axis=1)
            outcome += (draw()[:, None] >= chances).sum(axis=1)
        self._state = model.next_state.take(outcome).astype(np.intp)
        self._steps += 1
        truncated = self._steps >= self._limit
        return (
            taken,
            model.grid_reward.take(taken),
            issuer_reward,
            model.terminated.take(taken),
            truncated,
        )

    def restart(self, envs: Ints, draw: Draw) -> None:
        """Moves agents of some envs, (n,), to a start; several starts need draws from [0, 1)."""
        starts, n = self.model.starts, len(self.model.starts)
        self._state[envs] = starts[(draw() * n).astype(np.intp) if n > 1 else 0]
        self._steps[envs] = 0

    def observe(self) -> Observations:
        """Returns a copy of the observations, (N, ...)."""
        return self._table.take(self.model.observation.take(self._state), axis=0)

    def _draw(self, envs: Ints) -> Floats:
        """Returns a draw from the generator of each of these envs, and 0 for the others, (N,)."""
        uniform = np.zeros(self.num_envs)
        uniform[envs] = [self._seeded[i][0].random() for i in envs.tolist()]
        return uniform

    def _begin(self, envs: Ints, info: Info) -> None:
        self.restart(envs, lambda: self._draw(envs)[envs])
        self._last_event[envs] = 0
        for name in _INFO:
            info[name][envs] = 0
        info["zone"][envs] = self.model.zone[self._state[envs]]


def _with_masks(info: Info, mask: Bools | Literal[True]) -> Info:
    """Returns an info with masks of the envs that entries hold for, as Gymnasium names them."""
    return info | {f"_{name}": np.full(len(values), mask) for name, values in info.items()}
