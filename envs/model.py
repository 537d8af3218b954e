"""Compiles a scenario into arrays: the only place where moves, events and rewards are computed.

A scenario is a finite Markov decision process. Its state is (place of the issuer, tick of the clock, whether
feedback is to come, wrong PINGs so far, the agent's cell), numbered in this order, the cell last. In the
paper's scenarios all but the last two have a single value, so the number is `pings * C + row * columns +
column` with C cells: 120 cells and 600 states. The place is drawn at the start of an episode and stays.

`envs/scenarios/README.md` says what happens in a step, and in which order. Everything that acts, learns,
plans or evaluates reads the arrays. A time limit is not in them: it truncates an episode, and learners
bootstrap through it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from envs.regions import ZONES
from envs.scenario import BoundedFeedback, NoisyFeedback, Scenario

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
_WRONG_PINGS: Final = [EVENTS.index("wrong_ping"), EVENTS.index("last_wrong_ping")]

Numbers = TypeVar("Numbers", float, NDArray[np.float64])


@dataclass(frozen=True, eq=False)
class Component:
    """A component of an observation."""

    name: str
    of_state: NDArray[np.int32]  # (S,) its value, 0 to size - 1
    coordinates: NDArray[np.float64]  # (size, D) each in [0, 1]

    @property
    def size(self) -> int:
        """How many values it has."""
        return len(self.coordinates)


@dataclass(frozen=True, eq=False)
class Model:
    """A compiled scenario. S states, A = 5 actions, K outcomes, O observations, C cells; read-only arrays."""

    scenario: Scenario
    starts: NDArray[np.int32]  # (B,) the states in which an episode starts, all equally likely
    unseen_starts: NDArray[np.int32]  # the same with the issuer in an unseen place
    next_state: NDArray[np.int32]  # (S, A, K); a PING that ends the episode stays in its state
    probability: NDArray[np.float64]  # (S, A, K) of each outcome
    grid_reward: NDArray[np.float64]  # (S, A)
    issuer_reward: NDArray[np.float64]  # (S, A) mean
    issuer_noise: NDArray[np.float64]  # (S, A) half-width of the uniform noise
    terminated: NDArray[np.bool_]  # (S, A)
    event: NDArray[np.int8]  # (S, A) index into EVENTS
    wrong_pings: NDArray[np.int32]  # (S, A) wrong PINGs in the episode after the action
    observation: NDArray[np.int32]  # (S,) 0 to O - 1: the components' values, the first changing fastest
    components: tuple[Component, ...]  # what is observed, the agent's cell or the offset first
    cell: NDArray[np.int32]  # (S,) the agent's, row * columns + column
    context: NDArray[np.int32]  # (S,) place * P + phase
    zone: NDArray[np.int8]  # (S,) index into ZONES

    def __reduce__(self) -> tuple[Callable[[Scenario], "Model"], tuple[Scenario]]:
        """Pickles only the scenario, from which the model is compiled again."""
        return compile_scenario, (self.scenario,)

    @property
    def start(self) -> int:
        """The first of the states in which an episode starts; the only one in the paper's scenarios."""
        return int(self.starts[0])

    @cached_property
    def n_observations(self) -> int:
        """O, the product of the components' sizes."""
        return self.scenario.n_observations

    @property
    def n_outcomes(self) -> int:
        """K."""
        return int(self.next_state.shape[2])

    @property
    def n_places(self) -> int:
        """J; the states of a place are contiguous, and an episode never leaves them."""
        return len(self.scenario.places)

    @cached_property
    def fresh_state(self) -> NDArray[np.int64]:
        """(F,) the states with no wrong PING so far and no feedback to come, no walls; in S1 the cells."""
        return np.flatnonzero(self._is_fresh & ~self.scenario.grid.is_wall[self.cell])

    @cached_property
    def _is_fresh(self) -> NDArray[np.bool_]:
        block = len(self.position) * self.scenario.ping_limit * (1 + self.scenario.is_delayed)
        return np.asarray(np.arange(len(self.observation)) % block < len(self.position))

    @cached_property
    def has_cell_maps(self) -> bool:
        """Whether one map shows all: cells are observed, with one place and phase and no wall, as in S1."""
        is_cell = self.scenario.observe == ("agent",)
        return is_cell and not self.context.any() and not self.scenario.grid.is_wall.any()

    def states_of(self, context: int) -> NDArray[np.int64]:
        """Returns the fresh state of every cell, (C,), in a place and phase, at the phase's first tick."""
        return np.flatnonzero(self._is_fresh & (self.context == context))[: len(self.position)]

    @cached_property
    def position(self) -> NDArray[np.int_]:
        """(C, 2) row and column of each cell."""
        return self.scenario.grid.position

    @property
    def zone_of_cell(self) -> NDArray[np.int8]:
        """(F,) index into ZONES of each fresh state; in S1 to S3 of each cell."""
        return self.zone[self.fresh_state]

    @cached_property
    def is_over(self) -> NDArray[np.bool_]:
        """(S,) whether no action changes anything: the agent has run into someone, or the cell is a wall."""
        is_person = self.zone == ZONES.index("issuer")
        return np.asarray(is_person | self.scenario.grid.is_wall[self.cell])

    @cached_property
    def is_wrong_ping(self) -> NDArray[np.bool_]:
        """(S, A) whether the action is a disagreement: a PING outside the target region."""
        return np.isin(self.event, _WRONG_PINGS)

    @cached_property
    def is_noisy(self) -> bool:
        """Whether the issuer's reward is random, so that a step needs a draw."""
        return bool(self.issuer_noise.any())


def draw_issuer_reward(mean: Numbers, noise: Numbers, uniform: Numbers) -> Numbers:
    """Returns the issuer's reward for a draw from [0, 1), also of arrays and inside numba.

    >>> draw_issuer_reward(0.0, 1.0, 0.25)
    -0.5
    """
    return mean + noise * (2.0 * uniform - 1.0)


@lru_cache(maxsize=64)
def compile_scenario(scenario: Scenario) -> Model:
    """Compiles a scenario; equal scenarios share one `Model`."""
    rows, columns = scenario.grid.size
    n_cells, n_pings, n_delays = rows * columns, scenario.ping_limit, 1 + scenario.is_delayed
    n_ticks, n_phases = len(scenario.ticks), len(scenario.stages)
    shape = len(scenario.places), n_ticks, n_delays, n_pings, n_cells
    place, tick, delayed, pings, cell = np.unravel_index(np.arange(math.prod(shape)), shape)  # (S,) each
    context = place * n_phases + scenario.ticks[tick]
    zone_of = scenario.zone.reshape(-1, n_cells)  # (J * P, C)
    zone = zone_of[context, cell]

    # The agent's part: event, grid reward and next cell
    position = scenario.grid.position
    moved = np.clip(position[:, None] + MOVES, 0, (rows - 1, columns - 1)) @ (columns, 1)  # (C, 4)
    moved = np.where(scenario.grid.is_wall[moved], np.arange(n_cells)[:, None], moved)
    next_cell = np.column_stack([moved[cell], cell])  # (S, A)
    entered = zone_of[context[:, None], next_cell[:, :PING]]
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
    wrong_pings = pings[:, None] + np.isin(event, _WRONG_PINGS)
    rewards = scenario.rewards
    reward_of_event = {"none": 0.0, "move": rewards.other} | dict(rewards)
    grid_reward = np.array([reward_of_event[name] for name in EVENTS])[event]
    too_close = (event == EVENTS.index("wrong_ping")) & (zone == ZONES.index("uncomfortable"))[:, None]
    grid_reward[too_close] = rewards.wrong_ping_uncomfortable
    terminated = np.isin(
        event, [EVENTS.index(name) for name in ("issuer_reached", "target_ping", "last_wrong_ping")]
    )

    # The issuer's part: feedback, and the next tick
    mean, noise, comes_late = (values[context, cell] for values in _feedback(scenario))  # (S,) each
    issuer_reward = np.zeros(event.shape)
    issuer_noise = np.zeros(event.shape)
    issuer_reward[:, PING] = np.where(comes_late, 0.0, mean)
    issuer_noise[:, PING] = noise
    issuer_reward[delayed == 1] += mean[delayed == 1, None]
    next_delayed = np.zeros(event.shape, dtype=np.int64)
    next_delayed[:, PING] = comes_late
    ticks, chances = scenario.following
    next_tick = np.broadcast_to(ticks[tick][:, None], (*event.shape, ticks.shape[1]))  # (S, A, K)
    if scenario.moves:
        is_person = zone_of == ZONES.index("issuer")  # (J * P, C)
        next_context = place[:, None, None] * n_phases + scenario.ticks[next_tick]
        waits = is_person[next_context, next_cell[:, :, None]] & ~terminated[:, :, None]
        next_tick = np.where(waits, tick[:, None, None], next_tick)
    next_tick = np.where(terminated[:, :, None], tick[:, None, None], next_tick)
    next_delayed = np.where(terminated, delayed[:, None], next_delayed)
    next_pings = np.minimum(wrong_pings, n_pings - 1)
    following = np.broadcast_arrays(
        place[:, None, None],
        next_tick,
        next_delayed[:, :, None],
        next_pings[:, :, None],
        next_cell[:, :, None],
    )
    next_state = np.ravel_multi_index(tuple(following), shape)

    over = (zone == ZONES.index("issuer")) | scenario.grid.is_wall[cell]  # absorbing
    next_state[over] = np.flatnonzero(over)[:, None, None]
    wrong_pings[over] = pings[over, None]
    event[over] = EVENTS.index("none")
    grid_reward[over] = issuer_reward[over] = issuer_noise[over] = 0.0
    terminated[over] = True

    def states(starts: NDArray[np.int_]) -> NDArray[np.int32]:
        j, first_tick, first_cell = starts.T
        zero = np.zeros(len(j), dtype=np.int64)
        return np.ravel_multi_index((j, first_tick, zero, zero, first_cell), shape).astype(np.int32)

    components = _components(scenario, place, scenario.ticks[tick], pings, cell)
    observation, size = np.zeros(len(cell), dtype=np.int64), 1
    for component in components:
        observation += size * component.of_state
        size *= component.size
    model = Model(
        scenario=scenario,
        starts=states(scenario.starts),
        unseen_starts=states(scenario.unseen_starts),
        next_state=next_state.astype(np.int32),
        probability=np.ascontiguousarray(np.broadcast_to(chances[tick][:, None], next_state.shape)),
        grid_reward=grid_reward,
        issuer_reward=issuer_reward,
        issuer_noise=issuer_noise,
        terminated=terminated,
        event=event.astype(np.int8),
        wrong_pings=wrong_pings.astype(np.int32),
        observation=observation.astype(np.int32),
        components=components,
        cell=cell.astype(np.int32),
        context=context.astype(np.int32),
        zone=zone,
    )
    for value in vars(model).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    return model


def _components(scenario: Scenario, *of_states: NDArray[np.int_]) -> tuple[Component, ...]:
    """Returns the observed components of all states, given (S,) their place, phase, wrong PINGs and cell."""
    place, phase, pings, cell = of_states
    grid = scenario.grid
    farthest = np.array(grid.size) - 1
    largest = np.maximum(farthest, 1)
    stands = np.array([[people[0].position for people in stages] for stages in scenario.people])  # (J, P, 2)
    cells = np.array(scenario.issuer_cells) @ (grid.columns, 1)
    shown = np.array(scenario.shown_cells)  # (I, 2)
    index = np.searchsorted(cells, stands @ (grid.columns, 1))  # (J, P)
    n_phases, n_pings = len(scenario.stages), scenario.ping_limit
    offset = stands[place, phase] - grid.position[cell] + farthest  # (S, 2), from 0
    components = {  # values of states, and coordinates of values
        "agent": (cell, grid.position / largest),
        "offset": (offset @ (2 * grid.columns - 1, 1), (grid.offset + farthest) / (2 * largest)),
        "issuer": (index[place, phase], shown / largest),
        "phase": (phase, np.arange(n_phases)[:, None] / max(n_phases - 1, 1)),
        "wrong_pings": (pings, np.arange(n_pings)[:, None] / max(n_pings - 1, 1)),
    }
    observed = ((name, *components[name]) for name in scenario.observe)
    return tuple(Component(name, of_state.astype(np.int32), values) for name, of_state, values in observed)


def _feedback(scenario: Scenario) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Returns mean, half-width and lateness of the reward for a PING, (J * P, C) each, by the nearest person.

    Feedback by distance is relative to the largest distance from a start in the same place.
    """
    position = scenario.grid.position
    stands = np.array([[[who.position for who in people] for people in stages] for stages in scenario.people])
    shape = *stands.shape[:2], len(position)  # J, P, C
    mean, noise, is_late = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.bool_)
    every_start = scenario.starts_by_place.values()
    for j, (stages, starts_here) in enumerate(zip(scenario.people, every_start, strict=True)):
        tick, cell = starts_here.T
        from_start = np.abs(position[cell][:, None] - stands[j, scenario.ticks[tick]]).sum(axis=2).max(axis=0)
        for p, people in enumerate(stages):
            far = np.abs(position - stands[j, p][:, None]).sum(axis=2)  # (people, C), L1 distances
            nearest = far.argmin(axis=0)
            for k, feedback in enumerate(person.feedback for person in people):
                value: NDArray[np.float64] | float = -far[k] / from_start[k]
                width = 0.0
                match feedback:
                    case BoundedFeedback(kind="uniform", low=low, high=high):
                        value, width = (low + high) / 2, (high - low) / 2
                    case BoundedFeedback(low=low, high=high):
                        value = np.where(scenario.zone[j, p] == ZONES.index("target"), high, low)
                    case NoisyFeedback():
                        width = feedback.noise
                    case _ if feedback.kind == "none":
                        value = 0.0
                mean[j, p] = np.where(nearest == k, value, mean[j, p])
                noise[j, p, nearest == k] = width
                is_late[j, p, nearest == k] = feedback.kind == "delayed"
    flat = shape[0] * shape[1], -1
    return mean.reshape(flat), noise.reshape(flat), is_late.reshape(flat)
