"""The Gymnasium env: samples a `Model`, and has no rules of its own."""

import operator
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envs import render
from envs.inputs import InputError
from envs.model import ACTIONS, EVENTS, Model, compile_scenario, draw_issuer_reward
from envs.observations import observation_space, observation_table
from envs.regions import ZONES
from envs.scenario import Scenario, load_scenario

Observation = int | NDArray[np.float32]


class ProxemicEnv(gymnasium.Env[Observation, int]):
    """A gridworld in which an agent learns from an issuer's disagreement how close is too close.

    ## Description
    An issuer stands on a grid. Around it lie the uncomfortable region and, around that, the target
    region. The agent does not see them: it walks, and asks by PING whether it is in the target region.

    ## Action Space
    `Discrete(5)`: 0 UP (row - 1), 1 DOWN (row + 1), 2 LEFT (column - 1), 3 RIGHT (column + 1), 4 PING.
    A move off the grid leaves the agent where it is.

    ## Observation Space
    The agent's cell alone, in one of three forms (`observation`): `"index"` `Discrete(rows * columns)`,
    row * columns + column; `"one_hot"` `Box(0, 1, (rows * columns,), float32)`; `"coordinates"`
    `Box(0, 1, (2,), float32)`, row and column, each divided by its largest value. The number of wrong
    PINGs so far is hidden.

    ## Starting State
    The scenario's start cell, (0, 0) in S1 to S3, with no wrong PING.

    ## Rewards
    The grid's reward for the event plus, on every PING, the issuer's. The values are in the scenario's
    TOML file; in S1 to S3: reaching the issuer -1.0, PING in the target region +1.0, the fifth wrong
    PING -1.0, an earlier one -0.4, a move into the uncomfortable region -0.8, any other move -0.1.

    ## Episode End
    Terminates when the agent reaches the issuer, PINGs in the target region, or PINGs wrongly for the
    fifth time (`ping_limit`). There is no time limit unless `max_episode_steps` is given to
    `gymnasium.make`.

    ## Information
    `event` (one of `envs.model.EVENTS`), `zone` (where the agent now stands, one of
    `envs.model.ZONES`), `wrong_pings` (so far in the episode), `grid_reward`, `issuer_reward`.

    ## Arguments
    `gymnasium.make("envs:Proxemic/S1-v0", observation="one_hot", overrides={"issuer.position": [8, 6]})`.
    `scenario` is a name, the path of a TOML file, or a `Scenario`; `overrides` replaces values of it.

    ## References
    Millan-Arias, Fernandes and Cruz (2021), Learning Proxemic Behavior Using Reinforcement Learning
    with Cognitive Agents, arXiv 2108.03730.

    ## Version History
    v0: first version.
    """

    metadata = {"render_modes": list(render.MODES), "render_fps": 8}  # noqa: RUF012, as declared by Env

    def __init__(
        self,
        scenario: str | Path | Scenario = "S1",
        observation: str = "index",
        overrides: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Compiles the scenario.

        Raises:
          InputError: A mistake in the scenario, an unknown observation or render mode.
        """
        if render_mode is not None and render_mode not in render.MODES:
            raise InputError(f"render_mode = {render_mode!r}; accepted: {', '.join(render.MODES)}.")
        self.model: Model = compile_scenario(load_scenario(scenario, overrides))
        self.render_mode = render_mode
        table = observation_table(self.model, observation)
        self.observation_space = observation_space(table)  # type: ignore[assignment]
        self.action_space = spaces.Discrete(len(ACTIONS))  # type: ignore[assignment]
        self._observations: list[Observation] = table.tolist() if table.ndim == 1 else list(table)
        self._window: render.Window | None = None
        self.s = self.model.start  # the hidden state, as toy-text names it; may be set, to try things
        self._event = EVENTS[0]

    @property
    def P(self) -> dict[int, dict[int, list[tuple[float, int, float, bool]]]]:  # noqa: N802
        """`P[s][a] = [(probability, next state, mean reward, terminated)]` over the hidden states."""
        return self.model.P

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Puts the agent at the start."""
        super().reset(seed=seed, options=options)
        self.s = self.model.start
        self._event = EVENTS[0]
        if self.render_mode == "human":
            self.render()
        zone = ZONES[self.model.zone[self.s]]
        return self._observe(), _info(EVENTS[0], zone, 0, 0.0, 0.0)

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Takes one action; see the class for what comes back.

        Raises:
          InputError: `action` is not one of 0 to 4.
        """
        try:
            index = operator.index(action)
        except TypeError:
            index = -1
        if not 0 <= index < len(ACTIONS):
            raise InputError(
                f"action = {action!r}; accepted: 0 to {len(ACTIONS) - 1} ({', '.join(ACTIONS)})."
            )
        t = self.model.transitions[self.s][index]
        uniform = self.np_random.random() if self.model.is_noisy else 0.5
        issuer_reward = draw_issuer_reward(t.issuer_reward, t.issuer_noise, uniform)
        self.s = t.next_state
        self._event = t.event
        if self.render_mode == "human":
            self.render()
        info = _info(t.event, t.zone, t.wrong_pings, t.grid_reward, issuer_reward)
        return self._observe(), t.grid_reward + issuer_reward, t.terminated, False, info

    def render(self) -> Any:
        """Draws the scene: a string (`ansi`), an (H, W, 3) uint8 image (`rgb_array`), or a window."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() without a render_mode: give one to gymnasium.make.")
            return None
        if self.render_mode == "ansi":
            return render.to_text(self.model, self.s, self._event)
        image = render.to_image(self.model, self.s)
        if self.render_mode == "rgb_array":
            return image
        if self._window is None:
            self._window = render.Window(image, f"Proxemic {self.model.scenario.name}")
        self._window.show(image, self.metadata["render_fps"])
        return None

    def close(self) -> None:
        """Closes the window, where there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _observe(self) -> Observation:
        """Returns the agent's observation, a copy."""
        observation = self._observations[self.s % len(self._observations)]
        return observation if isinstance(observation, int) else observation.copy()


def _info(
    event: str, zone: str, wrong_pings: int, grid_reward: float, issuer_reward: float
) -> dict[str, Any]:
    """Names what a step tells beside observation and reward."""
    return {
        "event": event,
        "zone": zone,
        "wrong_pings": wrong_pings,
        "grid_reward": grid_reward,
        "issuer_reward": issuer_reward,
    }
