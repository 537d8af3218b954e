"""Draws how an agent learns: what it values and does, and where it walks, one frame per moment of training.

A cell's colour is the value of its best action, which is marked, and the line is the greedy policy's walk
from the start. Where the agent has learned nothing, no action is marked.

The walk starts in the model's first start state. At every step one number is drawn from the generator below,
even if there is a single greedy action: the walk takes greedy action number
`floor(draw * number of greedy actions)`. If the model has several outcomes, another number chooses the
outcome. The walk ends with the first of these that is true after a step:

1. the episode has ended;
2. the policy goes in circles: the walk has been in this state before, and had no choice between several
   greedy actions or outcomes since, so it would repeat itself forever;
3. it has made as many steps as the horizon allows.

The generator is mulberry32 with seed 2021, so equal policies walk alike. The page's script follows this rule.
"""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from agents.policy import contains
from benchmark.analysis.records import Records
from benchmark.drawing.maps import RGB, Style, colour_bar, heat, mark
from benchmark.drawing.style import figure_of, settings
from envs import EVENTS, Model
from envs.scene import colour_limits, scene_of

CIRCLE: Final = "circle"
HORIZON: Final = "horizon"
ENDINGS: Final = {
    "target_ping": "success",
    "issuer_reached": "ran into the person",
    "last_wrong_ping": "too many wrong PINGs",
    CIRCLE: "goes in circles",
    HORIZON: "step limit reached",
}
ANIMATIONS: Final = (".webp", ".gif")  # endings of files
_SEED: Final = 2021
_WORD: Final = 2**32
_DPI: Final = 100
_CELL: Final = 0.34  # inches
_MAX_SIDE: Final = 20  # inches, of a map
_FRAME_MS, _LAST_MS = 350, 2500  # for which a frame is shown, and the last
_OUTLINED: Final = [patheffects.withStroke(linewidth=2.8, foreground="white")]
_PATH: Final[Style] = {"color": RGB["path"], "lw": 1.5, "path_effects": _OUTLINED, "zorder": 1.6}
_AGENT: Final[Style] = {"color": RGB["path"], "marker": "o", "ms": 8, "mec": "white", "mew": 1, "zorder": 1.7}


@dataclass(frozen=True)
class Walk:
    """A walk of L steps."""

    states: tuple[int, ...]  # (L + 1,) the start first
    cells: tuple[int, ...]  # (L + 1,) the agent's cell in each state
    actions: tuple[int, ...]  # (L,)
    ending: str  # the event that ended the episode, or CIRCLE, or HORIZON


@dataclass(frozen=True, eq=False)
class Film:
    """One agent over its training: V maps of O observations."""

    title: str
    model: Model
    steps: Sequence[int]  # (V,)
    values: NDArray[np.float64]  # (V, O, A) action values, or probabilities; NaN of an agent that diverged
    greedy: NDArray[np.uint8]  # (V, O) masks
    scores: NDArray[np.float64]  # (V,)
    walks: Sequence[Walk]  # (V,) of the greedy policy


def walk(model: Model, greedy: NDArray[np.uint8], horizon: int) -> Walk:
    """Walks by a greedy policy, (O,) masks of `agents.policy`, for at most `horizon` steps, at least 1."""
    choices = [np.flatnonzero(row).tolist() for row in contains(greedy)]
    draws = mulberry32(_SEED)
    states, actions = [model.start], list[int]()
    since_choice: set[int] = set()
    while True:
        state = states[-1]
        choice = choices[model.observation[state]]
        action = choice[next(draws) * len(choice) // _WORD]
        chance = model.probability[state, action]
        if len(choice) > 1 or chance[0] < 1:
            since_choice.clear()
        else:
            since_choice.add(state)
        outcome = 0
        if model.n_outcomes > 1:
            outcome = int(np.searchsorted(chance[:-1].cumsum(), next(draws) / _WORD, side="right"))
        actions.append(action)
        states.append(int(model.next_state[state, action, outcome]))
        if model.terminated[state, action]:
            ending = EVENTS[model.event[state, action]]
        elif states[-1] in since_choice:
            ending = CIRCLE
        elif len(actions) == horizon:
            ending = HORIZON
        else:
            continue
        return Walk(tuple(states), tuple(model.cell[states].tolist()), tuple(actions), ending)


def mulberry32(seed: int) -> Iterator[int]:
    """Yields 32-bit numbers, the same as the page's script draws.

    By Tommy Ettinger, public domain: https://gist.github.com/tommyettinger/46a874533244883189143505d203312c
    """
    state = seed
    while True:
        state = (state + 0x6D2B79F5) % _WORD
        bits = (state ^ state >> 15) * (state | 1) % _WORD
        bits ^= (bits + (bits ^ bits >> 7) * (bits | 61)) % _WORD
        yield bits ^ bits >> 14


def film_of(title: str, records: Records) -> Film:
    """Returns the film of the first of these agents."""
    model, indices, arrays = records.model, records.map_indices, records.agents[0]
    return Film(
        title=title,
        model=model,
        steps=np.array(records.evaluation_steps)[indices].tolist(),
        values=arrays["values"].astype(np.float64),
        greedy=arrays["greedy"][indices],
        scores=records.unbounded_scores()[0, indices],
        walks=[walk(model, masks, records.run.horizon) for masks in arrays["greedy"][indices]],
    )


def frames(film: Film) -> Iterator[Figure]:
    """Yields one figure again and again, each time with the next map."""
    grid = film.model.scenario.grid
    cell = min(_CELL, _MAX_SIDE / max(grid.rows, grid.columns))
    norm = Normalize(*colour_limits(film.values.ravel()))
    with figure_of(1, 1, (max(cell * grid.columns, 3) + 1, cell * grid.rows + 1)) as (figure, axes):
        figure.set_dpi(_DPI)
        colour_bar(figure, [axes[0, 0]], norm, "value", extend="both")
        _draw(axes[0, 0], film, 0, norm)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # a layout takes longer than a frame
    for index in range(len(film.steps)):
        with settings():
            _draw(axes[0, 0], film, index, norm)
            yield figure


def _draw(axis: Axes, film: Film, index: int, norm: Normalize) -> None:
    model, walked = film.model, film.walks[index]
    agent, state = walked.cells[-1], walked.states[-1]
    # The map shows the states that differ from the walk's last one by the agent's cell alone.
    first = state - int(model.cell[state])
    observed = model.observation[first : first + len(model.position)]
    scene = scene_of(model, int(model.context[state]))
    values, greedy = film.values[index, observed], contains(film.greedy[index, observed])
    # All actions are greedy mostly where the agent has never been.
    is_marked = greedy & ~greedy.all(axis=1, keepdims=True) & (np.arange(scene.n_cells) != agent)[:, None]
    axis.clear()
    heat(axis, scene, np.where(scene.is_over, np.nan, values.max(axis=1)), norm)
    mark(axis, scene, is_marked)
    axis.plot(*scene.position[[*walked.cells]].T[::-1], **_PATH)
    axis.plot(*scene.position[[agent]].T[::-1], **_AGENT)
    numbers = f"step {film.steps[index]:,}, score {film.scores[index]:.2f}: {ENDINGS[walked.ending]}"
    axis.set_title(f"{film.title}\n{numbers}", loc="left", size="small", wrap=True, parse_math=False)
    axis.set(xticks=[], yticks=[], xlabel="", ylabel="")


def write(film: Film, path: Path) -> None:
    """Writes an animated WebP or GIF that repeats; a WebP is a quarter of the size and has all colours."""
    first, *others = map(_image, frames(film))
    duration = [_FRAME_MS] * len(others) + [_LAST_MS]
    first.save(path, save_all=True, append_images=others, loop=0, quality=70, duration=duration)


def _image(figure: Figure) -> Image.Image:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="rgba", dpi="figure")
    size = figure.canvas.get_width_height()
    return Image.frombytes("RGBA", size, buffer.getvalue()).convert("RGB")
