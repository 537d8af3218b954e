"""The Gymnasium env: steps through a compiled `Model` and adds no rules."""

import operator
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from envs import render
from envs.arrays import Bytes, Singles
from envs.inputs import InputError, shortened
from envs.model import ACTIONS, EVENTS, TARGET_PING, Model, draw_issuer_reward
from envs.observations import compile_seen, observation_space, observation_table
from envs.scenario import ScenarioLike, load_scenario
from envs.scene import scene_of

Observation = int | Singles | Bytes
_PASSED_ON = "minari_"  # options that Minari's collector reads, and passes on
_INFO = ("event", "zone", "wrong_pings", "grid_reward", "issuer_reward", "is_success")


class ProxemicEnv(gymnasium.Env[Observation, int]):
    """A gridworld in which an agent learns how close to a person it may come.

    ## Description
    A person stands on a grid, surrounded by an uncomfortable region and, beyond it, a target
    region. The agent does not see the regions. It walks, and by a PING asks whether it is in the
    target region; a PING anywhere else meets the person's disagreement.

    S1 to S3 are the scenarios of the paper, which differ in the person's feedback. Comments in the
    files of `envs/scenarios` describe all scenarios, and `envs/scenarios/README.md` the order of
    events in a step.

    ## Action Space
    `Discrete(5)`: 0 UP (row - 1), 1 DOWN (row + 1), 2 LEFT (column - 1), 3 RIGHT (column + 1), 4
    PING. A move off the grid or into a wall leaves the agent where it is.

    ## Observation Space
    The components that the scenario names (`observe`): the agent's cell, and in some scenarios the
    person's cell, the phase or the number of wrong PINGs. Components with n1, n2, ... values are
    combined in this order, in one of these forms (`observation`):

    - `"index"`: `Discrete(n1 * n2 * ...)`, v1 + n1 * (v2 + n2 * ...) for values v1, v2, ... from 0.
    For the
      agent's cell alone, it is row * columns + column
    - `"one_hot"`: `Box(0, 1, (n1 + n2 + ...,), float32)`, one block per component, with a 1 at its
    value
    - `"coordinates"`: `Box(0, 1, (D,), float32)`, row and column of a cell, and a number per other
    component,
      each divided by its maximum
    - `"centred"`: `Box(-2, 2, (D,), float32)`, the coordinates scaled so that 0 is in the middle
    - `"factored"`: `Box(0, 1, (N,), float32)`, one block per coordinate, with a 1 at its value: of
    a cell, a
      block for its row and one for its column
    - `"tiles"`: `Box(0, 1, (N,), float32)`, a number per tile of 16 tilings, with a 1 for the tile
    of each
      tiling in which the observation lies, see `envs.tiles`
    - `"offset"`, `"offset_one_hot"` and so on: the same, with the person's cell relative to the
    agent's in
      place of both cells, wherever both are seen; it has (2 * rows - 1) * (2 * columns - 1) values
    - `"relative_coordinates"`, `"relative_centred"`: the same for everybody, onlookers included
    - `"planes"`: `Box(0, 255, (planes, rows, columns), uint8)`, an image with a plane each for the
    agent,
      people, onlookers, walls and each further component, for convolutional nets that take small
      images

    The person's cell has a value for each cell in which the person may be. A group has a value for
    each way in which it may stand; as offsets, for each combination that occurs, the nearest person
    first. Its one-hot form has a 1 for each person, and its coordinates are those of all people.
    With onlookers, the cells of all people are one component, with a value for each way in which
    they stand. The observed number of wrong PINGs is at most `ping_limit - 1`.

    ## Starting State
    One of the scenario's starts, all equally likely, with no wrong PING so far: a cell of the agent
    outside every region, a place of the person and a tick of a phase. In S1 to S3 the only start is
    cell (0, 0).

    ## Rewards
    The grid's reward for the event plus, for every PING, the feedback of the nearest person, which
    may come with the next action. The values are in the scenario's TOML file. In all shipped
    scenarios, the grid's rewards are +1.0 for a PING in the target region, -1.0 for reaching a
    person and for the fifth wrong PING, -0.4 for an earlier wrong PING, -0.8 for a move that ends
    in the uncomfortable region and -0.1 for any other move.

    The person moves, turns or changes mood after the agent's action, see
    `envs/scenarios/README.md`. Event and rewards follow from the state before that, `info["zone"]`
    and the observation from the state after it.

    ## Episode End
    Terminates when the agent reaches a person, PINGs in the target region, or makes its fifth wrong
    PING (`ping_limit`). The registered ids truncate an episode after 200 steps; if it
    terminates at step 200, both are true. `max_episode_steps=-1` lifts the limit, in
    `gymnasium.make` and in `gymnasium.make_vec`. `ProxemicEnv(...)` has no limit.

    ## Information
    `event`, what the action led to, an index into `envs.EVENTS`; `zone`, where the agent is, an
    index into `envs.ZONES`; `wrong_pings` so far in the episode; the components `grid_reward`,
    `issuer_reward`; and `is_success`, whether the action was a PING in the target region, which
    Stable-Baselines3 reads at the end of an episode.

    ## Arguments
    `gymnasium.make("envs:Proxemic/S1-v0", observation="one_hot", overrides={"issuer.position": [8,
    6]})`.

    - `scenario`: a name, the path of a TOML file, a `Scenario`, or a mapping of a scenario's
    values; so every
      id makes an env of any scenario
    - `observation`: see Observation Space
    - `overrides`: new values for keys of the scenario
    - `render_mode`: `"ansi"` (text) or `"rgb_array"` (image). `gymnasium.make` also takes
    `"human"`, for a
      window, which needs pygame

    ## References
    Millan-Arias, Fernandes and Cruz (2021), Learning Proxemic Behavior Using Reinforcement Learning
    with Cognitive Agents, arXiv 2108.03730.
    """

    metadata = {  # noqa: RUF012
        "render_modes": list(render.MODES),
        "render_fps": render.FRAMES_PER_SECOND,
    }

    def __init__(
        self,
        scenario: ScenarioLike = "S1",
        observation: str = "index",
        overrides: Mapping[str, object] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Compiles the scenario; an InputError says what is wrong with an argument."""
        if render_mode is not None and render_mode not in render.MODES:
            accepted = f"{', '.join(render.MODES)}; human with gymnasium.make"
            raise InputError(f"render_mode = {render_mode!r}; accepted: {accepted}.")
        self.model: Model = compile_seen(load_scenario(scenario, overrides), observation)
        self.render_mode = render_mode
        table = observation_table(self.model, observation)
        self.observation_space = observation_space(table, observation)  # type: ignore[assignment]
        self.action_space = spaces.Discrete(len(ACTIONS))  # type: ignore[assignment]
        self._table = table  # (O, ...)
        self._s, self._needs_reset = self.model.start, True
        self._event = 0

    @property
    def s(self) -> int:
        """The hidden state; setting it continues, or begins, an episode there."""
        return self._s

    @s.setter
    def s(self, state: int) -> None:
        self._s, self._needs_reset = state, False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Moves the agent to the start, one of several starts; takes no options."""
        if any(not str(name).startswith(_PASSED_ON) for name in options or ()):
            raise InputError(f"options = {shortened(repr(options))}; accepted: none.")
        super().reset(seed=seed, options=options)
        starts = self.model.starts
        self.s = int(starts[int(self.np_random.random() * len(starts)) if len(starts) > 1 else 0])
        self._event = 0
        return self._observe(), _info(self._event, self.model.zone.item(self.s), 0, 0.0, 0.0, False)

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Takes an action from 0 to 4, else an InputError; the class describes the result.

        Raises a ResetNeeded before the first reset, and after an episode has terminated.
        """
        if self._needs_reset:
            raise ResetNeeded("The episode has not begun or has terminated: call reset() first.")
        try:
            if getattr(action, "shape", ()) != ():
                raise TypeError("it is no single number")
            index = range(len(ACTIONS)).index(operator.index(action))
        except (TypeError, ValueError) as error:
            accepted = f"0 to {len(ACTIONS) - 1}"
            raise InputError(
                f"action = {shortened(repr(action))}; accepted: {accepted}."
            ) from error
        model, at = self.model, (self.s, index)
        grid_reward, issuer_reward = model.grid_reward.item(at), model.issuer_reward.item(at)
        if model.is_noisy:
            noise = model.issuer_noise.item(at)
            issuer_reward = draw_issuer_reward(issuer_reward, noise, self.np_random.random())
        outcome = 0
        if model.n_outcomes > 1:
            chances = model.probability[at][:-1].cumsum()
            outcome = int(np.searchsorted(chances, self.np_random.random(), side="right"))
        self._s, terminated = model.next_state.item(*at, outcome), model.terminated.item(at)
        self._needs_reset = terminated
        self._event = model.event.item(at)
        zone, wrong_pings = model.zone.item(self.s), model.wrong_pings.item(at)
        is_success = self._event == TARGET_PING
        info = _info(self._event, zone, wrong_pings, grid_reward, issuer_reward, is_success)
        return self._observe(), grid_reward + issuer_reward, terminated, False, info

    def render(self) -> Any:
        """Returns the scene as a string (`ansi`) or an (H, W, 3) uint8 image (`rgb_array`)."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs a render_mode, which gymnasium.make takes.")
            return None
        scene, agent = (
            scene_of(self.model, int(self.model.context[self.s])),
            int(self.model.cell[self.s]),
        )
        if self.render_mode == "ansi":
            return render.to_text(scene, agent, EVENTS[self._event])
        return render.to_image(scene, agent)

    def _observe(self) -> Observation:
        observation = self._table[self.model.observation[self.s]]
        return observation.copy() if observation.ndim else int(observation)


def _info(*values: float) -> dict[str, Any]:
    return dict(zip(_INFO, values, strict=True))
