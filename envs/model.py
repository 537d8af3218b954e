"""Compiles a scenario into arrays: the only place where moves, events and rewards are computed.

A scenario is a finite Markov decision process. Its state is (cell, wrong PINGs so far), numbered
`pings * O + row * columns + column` with O cells and `ping_limit` values of `pings`: 120 cells and
600 states in the paper's scenarios. An agent observes only the cell, so the task is partially
observed. Everything that acts, learns, plans or evaluates reads the arrays. A time limit is not in
the arrays: it truncates an episode, and learners bootstrap through it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, NamedTuple, TypeVar, assert_never

import numpy as np
from numpy.typing import NDArray

from envs.regions import ZONES, zones
from envs.scenario import DistanceFeedback, NoFeedback, Scenario, UniformFeedback

VERSION: Final = 1  # part of every run's identity: raise it when a change alters the dynamics

ACTIONS: Final = ("UP", "DOWN", "LEFT", "RIGHT", "PING")
PING: Final = ACTIONS.index("PING")
MOVES: Final = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])  # (row, column) steps of actions 0 to 3
EVENTS: Final = (
    "none",  # a reset, or an action in a state where the episode is over
    "move",
    "uncomfortable",  # a move that ended in the uncomfortable region
    "issuer_reached",  # condition C1
    "target_ping",  # condition C3, success
    "wrong_ping",
    "last_wrong_ping",  # condition C2
)

Numbers = TypeVar("Numbers", float, NDArray[np.float64])


class Transition(NamedTuple):
    """The outcome of an action in a state, as Python values."""

    next_state: int
    grid_reward: float
    issuer_reward: float  # mean
    issuer_noise: float  # half-width of the uniform noise around the mean
    terminated: bool
    event: int  # index into EVENTS
    zone: int  # of the next state, index into ZONES
    wrong_pings: int  # so far in the episode, including this action


@dataclass(frozen=True, eq=False)
class Model:
    """A compiled scenario: S states, A = 5 actions, O observations (cells); arrays are read-only."""

    scenario: Scenario
    start: int  # the state in which every episode starts
    next_state: NDArray[np.int32]  # (S, A); a PING that ends the episode stays in its state
    grid_reward: NDArray[np.float64]  # (S, A)
    issuer_reward: NDArray[np.float64]  # (S, A) mean
    issuer_noise: NDArray[np.float64]  # (S, A) half-width of the uniform noise
    terminated: NDArray[np.bool_]  # (S, A)
    event: NDArray[np.int8]  # (S, A) index into EVENTS
    wrong_pings: NDArray[np.int32]  # (S, A) wrong PINGs in the episode after the action
    observation: NDArray[np.int32]  # (S,) the cell, row * columns + column
    zone: NDArray[np.int8]  # (S,) index into ZONES

    def __reduce__(self) -> tuple[Callable[[Scenario], "Model"], tuple[Scenario]]:
        """Pickles only the scenario, from which the model is compiled again."""
        return compile_scenario, (self.scenario,)

    @property
    def n_observations(self) -> int:
        """O, the number of cells."""
        return self.scenario.grid.rows * self.scenario.grid.columns

    @cached_property
    def fresh_state(self) -> NDArray[np.int32]:
        """(O,) the state of each cell with no wrong PING so far."""
        _, first = np.unique(self.observation, return_index=True)  # states are ordered by wrong PINGs
        return first.astype(np.int32)

    @cached_property
    def position(self) -> NDArray[np.int_]:
        """(O, 2) row and column of each cell."""
        return np.stack(np.divmod(np.arange(self.n_observations), self.scenario.grid.columns), axis=1)

    @property
    def zone_of_cell(self) -> NDArray[np.int8]:
        """(O,) index into ZONES."""
        return self.zone[self.fresh_state]

    @cached_property
    def is_over(self) -> NDArray[np.bool_]:
        """(S,) whether the episode is over in a state, so that no action changes anything."""
        return np.asarray(self.terminated.all(axis=1))

    @cached_property
    def is_wrong_ping(self) -> NDArray[np.bool_]:
        """(S, A) whether the action is a disagreement: a PING outside the target region."""
        return np.isin(self.event, [EVENTS.index("wrong_ping"), EVENTS.index("last_wrong_ping")])

    @cached_property
    def is_noisy(self) -> bool:
        """Whether the issuer's reward is random, so that a step needs a draw."""
        return bool(self.issuer_noise.any())

    @cached_property
    def transitions(self) -> list[list[Transition]]:
        """The arrays as Python values, `transitions[state][action]`: the fast way to step a single env."""
        columns = (
            self.next_state.tolist(),
            self.grid_reward.tolist(),
            self.issuer_reward.tolist(),
            self.issuer_noise.tolist(),
            self.terminated.tolist(),
            self.event.tolist(),
            self.zone[self.next_state].tolist(),
            self.wrong_pings.tolist(),
        )
        return [[Transition(*row) for row in zip(*rows, strict=True)] for rows in zip(*columns, strict=True)]

    @cached_property
    def P(self) -> dict[int, dict[int, list[tuple[float, int, float, bool]]]]:  # noqa: N802
        """`P[state][action] = [(probability, next state, mean reward, terminated)]`, as in toy-text."""
        return {
            state: {
                action: [(1.0, t.next_state, t.grid_reward + t.issuer_reward, t.terminated)]
                for action, t in enumerate(actions)
            }
            for state, actions in enumerate(self.transitions)
        }


def draw_issuer_reward(mean: Numbers, noise: Numbers, uniform: Numbers) -> Numbers:
    """Returns the issuer's reward for a draw. Also works on arrays, and inside numba.

    Args:
      mean: Mean reward.
      noise: Half-width of the uniform noise.
      uniform: A draw from [0, 1).

    >>> draw_issuer_reward(0.0, 1.0, 0.25)
    -0.5
    """
    return mean + noise * (2.0 * uniform - 1.0)


@lru_cache(maxsize=64)
def compile_scenario(scenario: Scenario) -> Model:
    """Compiles a scenario; equal scenarios share one `Model`."""
    rows, columns = scenario.grid.rows, scenario.grid.columns
    n_cells, n_pings = rows * columns, scenario.ping_limit
    pings, cell = np.divmod(np.arange(n_pings * n_cells), n_cells)  # (S,) each
    position = np.stack(np.divmod(cell, columns), axis=1)  # (S, 2) row, column
    offset = np.abs(position - scenario.issuer.position)  # (S, 2)
    zone = zones(scenario)[cell]

    moved = np.clip(position[:, None] + MOVES, 0, (rows - 1, columns - 1))  # (S, 4, 2)
    next_cell = np.column_stack([moved @ (columns, 1), cell])  # (S, A)
    entered = zone[next_cell[:, :PING]]
    move_event = np.select(
        [entered == ZONES.index("issuer"), entered == ZONES.index("uncomfortable")],
        [EVENTS.index("issuer_reached"), EVENTS.index("uncomfortable")],
        EVENTS.index("move"),
    )
    ping_event = np.select(
        [zone == ZONES.index("target"), pings == n_pings - 1],
        [EVENTS.index("target_ping"), EVENTS.index("last_wrong_ping")],
        EVENTS.index("wrong_ping"),
    )
    event = np.column_stack([move_event, ping_event])  # (S, A)
    is_wrong = np.isin(event, [EVENTS.index("wrong_ping"), EVENTS.index("last_wrong_ping")])
    wrong_pings = pings[:, None] + is_wrong
    next_state = np.minimum(wrong_pings, n_pings - 1) * n_cells + next_cell

    rewards = scenario.rewards
    reward_of_event = {
        "none": 0.0,
        "move": rewards.other,
        "uncomfortable": rewards.uncomfortable,
        "issuer_reached": rewards.issuer_reached,
        "target_ping": rewards.target_ping,
        "wrong_ping": rewards.wrong_ping,
        "last_wrong_ping": rewards.last_wrong_ping,
    }
    grid_reward = np.array([reward_of_event[name] for name in EVENTS])[event]
    too_close = (event == EVENTS.index("wrong_ping")) & (zone == ZONES.index("uncomfortable"))[:, None]
    grid_reward[too_close] = rewards.wrong_ping_uncomfortable
    issuer_reward = np.zeros(event.shape)
    issuer_noise = np.zeros(event.shape)
    issuer_reward[:, PING], issuer_noise[:, PING] = _issuer_feedback(scenario, offset.sum(axis=1))
    terminated = np.isin(
        event, [EVENTS.index(name) for name in ("issuer_reached", "target_ping", "last_wrong_ping")]
    )

    over = zone == ZONES.index("issuer")  # absorbing: the move into this cell ended the episode
    next_state[over] = np.flatnonzero(over)[:, None]
    wrong_pings[over] = pings[over, None]
    event[over] = EVENTS.index("none")
    grid_reward[over] = issuer_reward[over] = issuer_noise[over] = 0.0
    terminated[over] = True

    model = Model(
        scenario=scenario,
        start=scenario.grid.start[0] * columns + scenario.grid.start[1],
        next_state=next_state.astype(np.int32),
        grid_reward=grid_reward,
        issuer_reward=issuer_reward,
        issuer_noise=issuer_noise,
        terminated=terminated,
        event=event.astype(np.int8),
        wrong_pings=wrong_pings.astype(np.int32),
        observation=cell.astype(np.int32),
        zone=zone,
    )
    for value in vars(model).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    return model


def _issuer_feedback(
    scenario: Scenario, manhattan: NDArray[np.int_]
) -> tuple[NDArray[np.float64] | float, float]:
    """Returns mean and half-width of the issuer's reward for a PING at each L1 distance from the issuer."""
    feedback = scenario.issuer.feedback
    match feedback:
        case UniformFeedback():
            return (feedback.low + feedback.high) / 2, (feedback.high - feedback.low) / 2
        case DistanceFeedback():
            from_start = np.abs(np.subtract(scenario.grid.start, scenario.issuer.position)).sum()
            return -manhattan / from_start, 0.0
        case NoFeedback():
            return 0.0, 0.0
        case _:
            assert_never(feedback)
