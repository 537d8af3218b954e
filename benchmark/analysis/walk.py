"""The walk of a greedy policy through the compiled model, as films, `watch` and the page show it.

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

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agents.policy import contains
from envs import EVENTS, Model

CIRCLE: Final = "circle"
HORIZON: Final = "horizon"
_SEED: Final = 2021
_WORD: Final = 2**32


@dataclass(frozen=True)
class Walk:
    """A walk of L steps."""

    states: tuple[int, ...]  # (L + 1,) the start first
    cells: tuple[int, ...]  # (L + 1,) the agent's cell in each state
    actions: tuple[int, ...]  # (L,)
    ending: str  # the event that ended the episode, or CIRCLE, or HORIZON


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
