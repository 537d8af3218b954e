"""An episode of the paper's scenario S1, as the page tells it: what the person feels, and the agent learns.

Events and rewards are those of the compiled scenario; the template `episode.html` draws it.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from envs import ACTIONS, EVENTS
from envs.model import PING, compile_scenario
from envs.scenario import load_scenario
from envs.scene import Scene, scene_of

SCENARIO: Final = "S1"
RATE, DISCOUNT = 0.6, 0.9  # the paper's learning rate and discount
_DOWN, _RIGHT, _UP = (ACTIONS.index(name) for name in ("DOWN", "RIGHT", "UP"))
# The agent asks too early, comes too near, asks again, steps back and asks a third time.
_TAKEN: Final = (*[_DOWN, _RIGHT] * 2, PING, *[_RIGHT, _DOWN] * 2, *[_RIGHT] * 4, _DOWN, PING, _UP, PING)
_FEELS: Final = {
    "outside": "At ease: the agent is too far away.",
    "uncomfortable": "Uncomfortable: this is too close.",
    "target": "Comfortable: close enough, and not too close.",
}


class Step(NamedTuple):
    """A step of the episode."""

    number: int  # from 1
    action: str
    before: int  # the agent's cell, and after the step
    after: int
    zone: str  # of the cell after the step
    event: str
    reward: float
    was: float  # the value of this action in this cell, and after the update
    value: float

    @property
    def feels(self) -> str:
        """What the person feels."""
        return _FEELS[self.zone]


def episode() -> tuple[Scene, list[Step]]:
    """Returns the map and the steps, with values of Q-learning from 0 (Sutton and Barto 2018, eq. 6.8)."""
    model = compile_scenario(load_scenario(SCENARIO))
    scene, q = scene_of(model), np.zeros((model.n_observations, len(ACTIONS)))
    steps: list[Step] = []
    state = int(model.start)
    for number, action in enumerate(_TAKEN, start=1):
        following = int(model.next_state[state, action, 0])
        is_end = bool(model.terminated[state, action])
        cell = int(model.cell[state])
        after = cell if is_end else int(model.cell[following])
        seen, reward = model.observation[state], float(model.grid_reward[state, action])
        was = float(q[seen, action])
        best = 0.0 if is_end else float(q[model.observation[following]].max())
        q[seen, action] += RATE * (reward + DISCOUNT * best - was)
        event, value = EVENTS[int(model.event[state, action])], float(q[seen, action])
        steps.append(Step(number, ACTIONS[action], cell, after, scene.zone[after], event, reward, was, value))
        state = following
    return scene, steps


def highlights(steps: Sequence[Step]) -> list[Step]:
    """Returns the steps that the page tells: the first of each kind of event and zone."""
    first = {(step.action == "PING", step.event, step.zone): step for step in reversed(steps)}
    return sorted(first.values(), key=lambda step: step.number)
