"""An episode of the paper's scenario S1, as the page tells it: what the person feels, and the agent learns.

Events and rewards are those of the compiled scenario. Its pictures are SVG, which style sheets move.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from markupsafe import Markup

from envs import ACTIONS, EVENTS
from envs.model import PING, compile_scenario
from envs.scenario import load_scenario
from envs.scene import Scene, scene_of

SCENARIO: Final = "S1"
RATE, DISCOUNT = 0.6, 0.9  # the paper's learning rate and discount
_DOWN, _RIGHT, _UP = (ACTIONS.index(name) for name in ("DOWN", "RIGHT", "UP"))
# The agent asks too early, comes too near, asks again, steps back and asks a third time.
_TAKEN: Final = (*[_DOWN, _RIGHT] * 2, PING, *[_RIGHT, _DOWN] * 2, *[_RIGHT] * 4, _DOWN, PING, _UP, PING)
_UNIT, _SECONDS = 20, 0.55  # pixels of a cell, seconds of a step
_SIGNS: Final = {"wrong_ping": ("✗", "no"), "target_ping": ("✓", "yes")}
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
        cell, after = int(model.cell[state]), int(model.cell[following])
        seen, reward = model.observation[state], float(model.grid_reward[state, action])
        is_end = bool(model.terminated[state, action])
        was = float(q[seen, action])
        best = 0.0 if is_end else float(q[model.observation[following]].max())
        q[seen, action] += RATE * (reward + DISCOUNT * best - was)
        event = EVENTS[int(model.event[state, action])]
        step = Step(number, ACTIONS[action], cell, cell if is_end else after, "", event, reward, was, 0.0)
        steps.append(step._replace(zone=scene.zone[step.after], value=float(q[seen, action])))
        state = following
    return scene, steps


def highlights(steps: Sequence[Step]) -> list[Step]:
    """Returns the steps that the page tells: the first of each kind of event and zone."""
    first = {(step.action == "PING", step.event, step.zone): step for step in reversed(steps)}
    return sorted(first.values(), key=lambda step: step.number)


def moving(scene: Scene, steps: Sequence[Step]) -> Markup:
    """Returns the episode as a moving picture: an agent that walks and asks, and a person who answers."""
    n = len(steps) + 3  # the end stays for a while
    stops = [
        (0, steps[0].before),
        *((step.number, step.after) for step in steps),
        (n, steps[-1].after),
    ]
    frames = "".join(f"{100 * at / n:.2f}%{{transform:translate({_at(scene, cell)})}}" for at, cell in stops)
    signs, rules = (
        [],
        [f"@keyframes agent{{{frames}}}", f".walker,.sign{{animation-duration:{n * _SECONDS}s}}"],
    )
    for step in steps:
        if step.event in _SIGNS:
            shown = f"0%{{opacity:0}}{100 * step.number / n:.2f}%{{opacity:1}}"
            gone = "" if step is steps[-1] else f"{100 * (step.number + 1) / n:.2f}%{{opacity:0}}"
            rules.append(f"@keyframes sign{step.number}{{{shown}{gone}}}")
            signs.append(_sign(scene, step, f' style="animation-name:sign{step.number}"'))
    walker = f'<g class="walker" style="transform:translate({_at(scene, steps[-1].after)})">{_AGENT}</g>'
    return _svg(scene, f"<style>{''.join(rules)}</style>{walker}{''.join(signs)}", _title(steps))


def still(scene: Scene, steps: Sequence[Step], step: Step) -> Markup:
    """Returns the picture after a step, with the path so far."""
    path = [steps[0].before, *(each.after for each in steps[: step.number])]
    points = " ".join(_at(scene, cell, "") for cell in path)
    walker = f'<g transform="translate({_at(scene, step.after, "")})">{_AGENT}</g>'
    sign = _sign(scene, step, "") if step.event in _SIGNS else ""
    return _svg(scene, f'<polyline class="path" points="{points}"/>{walker}{sign}', "")


_AGENT: Final = f'<circle class="agent" r="{0.34 * _UNIT}"/>'


def _title(steps: Sequence[Step]) -> str:
    n_wrong = sum(step.event == "wrong_ping" for step in steps)
    return f"An agent walks to a person, asks {n_wrong} times at a wrong distance, and then at the right one."


def _at(scene: Scene, cell: int, unit: str = "px") -> str:
    row, column = scene.centre(cell)
    return f"{column * _UNIT:g}{unit},{row * _UNIT:g}{unit}"


def _sign(scene: Scene, step: Step, attributes: str) -> str:
    """Returns the person's answer to a PING, in a bubble above the person."""
    sign, kind = _SIGNS[step.event]
    row, column = scene.centre(scene.cells_of("issuer")[0])
    x, y = (column + 1.1) * _UNIT, (row - 1.1) * _UNIT
    bubble = (
        f'<circle cx="{x:g}" cy="{y:g}" r="{0.75 * _UNIT:g}"/><text x="{x:g}" y="{y + 6:g}">{sign}</text>'
    )
    return f'<g class="sign {kind}"{attributes}>{bubble}</g>'


def _svg(scene: Scene, content: str, title: str) -> Markup:
    """Returns a picture of the room and its person, and of what is given."""
    cells = []
    for cell, zone in enumerate(scene.zone):
        row, column = divmod(cell, scene.columns)
        shape = f'x="{column * _UNIT}" y="{row * _UNIT}" width="{_UNIT}" height="{_UNIT}"'
        cells.append(f'<rect class="{zone}" {shape}/>' if zone != "outside" else "")
    width, height = scene.columns * _UNIT, scene.rows * _UNIT
    lines = [f"M0,{row * _UNIT}H{width}" for row in range(scene.rows + 1)]
    lines += [f"M{column * _UNIT},0V{height}" for column in range(scene.columns + 1)]
    x, y = (float(part) for part in _at(scene, scene.cells_of("issuer")[0], "").split(","))
    person = (
        f'<g class="person" transform="translate({x:g},{y:g})"><circle cy="-3.5" r="4"/>'
        '<path d="M-7,9A7,8 0 0 1 7,9Z"/></g>'
    )
    label = f'role="img" aria-label="{title}"' if title else 'aria-hidden="true"'
    body = f'{"".join(cells)}<path class="lines" d="{"".join(lines)}"/>{person}{content}'
    return Markup(f'<svg class="episode" viewBox="-1 -1 {width + 2} {height + 2}" {label}>{body}</svg>')
