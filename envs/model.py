"""Compiles a scenario into arrays: the only place where moves, events and rewards are computed.

A scenario is a finite Markov decision process. Its state is (place of the issuer, tick of the
clock, whether feedback is to come, wrong PINGs so far, the agent's cell), numbered in this order,
the cell last. In the paper's scenarios all but the last two have a single value, so the number is
`pings * C + row * columns + column` with C cells: 120 cells and 600 states. The place (for a group,
where all of its people stand; with onlookers, a place and a way in which they stand) is drawn at
the start of an episode and stays.

`envs/scenarios/README.md` says what happens in a step, and in which order. Everything that acts,
learns, plans or evaluates reads the arrays. A time limit is not in them: it truncates an episode,
and learners bootstrap through it.
"""

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from envs.arrays import Bools, Codes, Floats, Indices, Ints, read_only, read_only_property
from envs.layout import NEW_PLACE, NEW_WAY, SEEN, random_orders, shown_cells
from envs.people import BoundedFeedback, OwnFeedback, Ping
from envs.regions import ISSUER, TARGET, UNCOMFORTABLE, ZONES
from envs.scenario import Scenario

VERSION = 1  # part of every run's identity: raise it when a change alters the dynamics

ACTIONS = ("UP", "DOWN", "LEFT", "RIGHT", "PING")
PING = ACTIONS.index("PING")
MOVES = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])  # (row, column) steps of actions 0 to 3
EVENTS = (
    "none",  # a reset, or an action in a state where the episode is over
    "move",
    "uncomfortable",  # a move that ended in the uncomfortable region
    "issuer_reached",  # condition C1
    "target_ping",  # condition C3, success
    "wrong_ping",
    "last_wrong_ping",  # condition C2
)
NONE, MOVE, UNCOMFORTABLE_MOVE, ISSUER_REACHED, TARGET_PING, WRONG_PING, LAST_WRONG_PING = range(
    len(EVENTS)
)

Numbers = TypeVar("Numbers", float, Floats)
T = TypeVar("T")
P = ParamSpec("P")

_STATES_AT_ONCE = 200_000  # states that are compiled together, to save memory


@dataclass(frozen=True, eq=False)
class Component:
    """A component of an observation."""

    name: str
    value: Indices  # (S,) that of each state, 0 to size - 1
    numbers: Ints  # (size, D) what each value stands for, from 0
    largest: Ints  # (D,) the largest of these numbers
    per_cell: Ints  # (D,) difference of a number between adjacent cells; 0 if it is no position
    ones: Ints  # (size, people or 1) which columns of the component's one-hot block are 1
    width: int  # number of columns of this block

    @property
    def size(self) -> int:
        """How many values it has."""
        return len(self.numbers)


@dataclass(frozen=True, eq=False)
class Model:
    """A compiled scenario; all arrays are read-only.

    Axis letters: S states, A = 5 actions, K outcomes, O observations, C cells.
    """

    scenario: Scenario
    starts: Indices  # (B,) the states in which an episode starts, all equally likely
    unseen_starts: Indices  # the same with the issuer in an unseen place
    new_way_starts: Indices  # the same with onlookers who stand as they never do in training
    next_state: Indices  # (S, A, K); a PING that ends the episode stays in its state
    probability: Floats  # (S, A, K) of each outcome
    grid_reward: Floats  # (S, A)
    issuer_reward: Floats  # (S, A) mean
    issuer_noise: Floats  # (S, A) half-width of the uniform noise
    terminated: Bools  # (S, A)
    event: Codes  # (S, A) index into EVENTS
    wrong_pings: Indices  # (S, A) wrong PINGs in the episode after the action
    observation: Indices  # (S,) 0 to O - 1: the components' values, the first changing fastest
    components: tuple[Component, ...]  # what is observed, the agent's cell or offsets first
    cell: Indices  # (S,) the agent's, row * columns + column
    context: Indices  # (S,) place * P + phase
    zone: Codes  # (S,) index into ZONES
    # kept with it
    derived: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False)

    def __repr__(self) -> str:
        return f"<Model of {self.scenario.name}>"

    def __reduce__(self) -> tuple[Callable[[Scenario], "Model"], tuple[Scenario]]:
        """Pickles only the scenario, from which the model is compiled again."""
        return compile_scenario, (self.scenario,)

    @property
    def start(self) -> int:
        """The first of the states in which episodes start; the only one in the paper."""
        return int(self.starts[0])

    @cached_property
    def n_observations(self) -> int:
        """O, the product of the components' sizes."""
        return math.prod(component.size for component in self.components)

    @property
    def parts(self) -> Iterator[tuple[Component, Ints]]:
        """Each component, and its value, (O,), in all observations."""
        sizes = [component.size for component in self.components]
        values = np.unravel_index(np.arange(self.n_observations), sizes[::-1])[::-1]
        return zip(self.components, values, strict=True)

    @property
    def n_outcomes(self) -> int:
        """K."""
        return int(self.next_state.shape[2])

    @property
    def n_places(self) -> int:
        """J; the states of a place are contiguous, and an episode never leaves them."""
        return len(self.scenario.layout.standing)

    @read_only_property
    def fresh_state(self) -> Ints:
        """(F,) the states with no wrong PING and no feedback to come, no walls; in S1 the cells."""
        block = len(self.position) * self.scenario.ping_limit * (1 + self.scenario.is_delayed)
        is_fresh = np.arange(len(self.observation)) % block < len(self.position)
        return np.flatnonzero(is_fresh & ~self.scenario.grid.is_wall[self.cell])

    def states_of(self, context: int) -> Ints:
        """Returns every cell's fresh state, (C,), in a place and phase, at its first tick."""
        place, phase = divmod(context, len(self.scenario.layout.stages))
        _, n_ticks, *parts = _shape(self.scenario)
        first = place * n_ticks + int(np.argmax(self.scenario.layout.ticks == phase))
        return np.arange(parts[-1]) + first * math.prod(parts)

    @property
    def position(self) -> Ints:
        """(C, 2) row and column of each cell."""
        return self.scenario.grid.position

    @read_only_property
    def is_over(self) -> Bools:
        """(S,) whether no action changes anything: a person was run into, or the cell is a wall."""
        return np.asarray(self.event[:, PING] == NONE)

    @read_only_property
    def is_wrong_ping(self) -> Bools:
        """(S, A) whether the action is a disagreement: a PING outside the target region."""
        return np.isin(self.event, [WRONG_PING, LAST_WRONG_PING])

    @cached_property
    def is_noisy(self) -> bool:
        """Whether the issuer's reward is random, so that a step needs a draw."""
        return bool(self.issuer_noise.any())


def kept_with_model(
    derive: Callable[Concatenate[Model, P], T],
) -> Callable[Concatenate[Model, P], T]:
    """Decorates a function of a model: its result is computed once, and kept with the model."""

    @wraps(derive)
    def derived(model: Model, /, *args: P.args, **kwargs: P.kwargs) -> T:
        key = derive, args, tuple(sorted(kwargs.items()))
        if key not in model.derived:
            model.derived[key] = read_only(derive(model, *args, **kwargs))
        kept: T = model.derived[key]
        return kept

    return derived


def draw_issuer_reward(mean: Numbers, noise: Numbers, uniform: Numbers) -> Numbers:
    """Returns the issuer's reward for a draw from [0, 1), also of arrays and inside numba.

    >>> draw_issuer_reward(0.0, 1.0, 0.25)
    -0.5
    """
    return mean + noise * (2.0 * uniform - 1.0)


def compile_scenario(scenario: Scenario) -> Model:
    """Compiles a scenario; equal scenarios share one `Model` while it is among the latest."""
    compiled = _compile if math.prod(_shape(scenario)) <= _STATES_AT_ONCE else _compile_large
    # A notebook may have redefined a user's function.
    return compiled(scenario, *(its.function(scenario.name) for its in scenario.own_feedback))


def _shape(scenario: Scenario) -> tuple[int, int, int, int, int]:
    """Returns how many values each part of a state has."""
    places = len(scenario.layout.standing)
    ticks = len(scenario.layout.ticks)
    return places, ticks, 1 + scenario.is_delayed, scenario.ping_limit, len(scenario.grid.position)


@lru_cache(maxsize=64)
def _compile(scenario: Scenario, *_: Callable[[Ping], Any]) -> Model:
    shape = _shape(scenario)
    n_places, n_block = shape[0], math.prod(shape[1:])  # states of a place
    feedback = _feedback(scenario)
    arrays: dict[str, NDArray[Any]] = {}
    step = max(_STATES_AT_ONCE // n_block, 1)
    for first in range(0, n_places, step):
        part = _compile_places(scenario, feedback, range(first, min(first + step, n_places)))
        for name, values in part.items():
            if name not in arrays:
                arrays[name] = np.zeros((n_places * n_block, *values.shape[1:]), values.dtype)
            if values.any():  # memory for zeros is not even touched
                arrays[name][first * n_block :][: len(values)] = values

    place, tick, cell = scenario.layout.starts.T
    starts = np.ravel_multi_index((place, tick, 0, 0, cell), shape).astype(np.int32)
    novelty = scenario.layout.novelty[place]
    components = _components(scenario, arrays["context"], arrays["cell"], arrays.pop("pings"))
    slowest_first = components[::-1]
    sizes = [part.size for part in slowest_first]
    observation = np.ravel_multi_index([part.value for part in slowest_first], sizes)
    model = Model(
        scenario=scenario,
        starts=starts[novelty == SEEN],
        unseen_starts=starts[novelty == NEW_PLACE],
        new_way_starts=starts[novelty == NEW_WAY],
        observation=observation.astype(np.int32),
        components=components,
        **arrays,
    )
    return read_only(model)


_compile_large = lru_cache(maxsize=2)(_compile.__wrapped__)  # each takes up to a gigabyte


def _compile_places(
    scenario: Scenario, feedback: Floats, places: range
) -> dict[str, NDArray[np.generic]]:
    """Returns the arrays of a model over the states of some places."""
    rows, columns = scenario.grid.size
    shape = _shape(scenario)
    n_phases = len(scenario.layout.stages)
    n_pings, n_cells = shape[3:]
    n_block = math.prod(shape[1:])
    state = np.arange(places[0] * n_block, (places[-1] + 1) * n_block)
    place, tick, delayed, pings, cell = np.unravel_index(state, shape)  # (S,) each
    context = place * n_phases + scenario.layout.ticks[tick]
    zone_of = scenario.layout.zone.reshape(-1, n_cells)  # (J * P, C)
    zone = zone_of[context, cell]

    # The agent's part: event, grid reward and next cell
    position = scenario.grid.position
    moved = np.clip(position[:, None] + MOVES, 0, (rows - 1, columns - 1)) @ (columns, 1)  # (C, 4)
    moved = np.where(scenario.grid.is_wall[moved], np.arange(n_cells)[:, None], moved)
    next_cell = np.column_stack([moved[cell], cell])  # (S, A)
    entered = zone_of[context[:, None], next_cell[:, :PING]]
    move_event = np.array([MOVE, MOVE, UNCOMFORTABLE_MOVE, ISSUER_REACHED])[entered]
    ping_event = np.select(
        [zone == TARGET, pings == n_pings - 1], [TARGET_PING, LAST_WRONG_PING], WRONG_PING
    )
    event = np.column_stack([move_event, ping_event])  # (S, A)
    wrong_pings = pings[:, None] + np.isin(event, [WRONG_PING, LAST_WRONG_PING])
    rewards = scenario.rewards
    reward_of_event = {"none": 0.0, "move": rewards.other} | dict(rewards)
    grid_reward = np.array([reward_of_event[name] for name in EVENTS])[event]
    too_close = (event == WRONG_PING) & (zone == UNCOMFORTABLE)[:, None]
    grid_reward[too_close] = rewards.wrong_ping_uncomfortable
    terminated = np.isin(event, [ISSUER_REACHED, TARGET_PING, LAST_WRONG_PING])

    # The issuer's part: feedback, and the next tick
    mean, noise, comes_late = feedback[:, context, pings % feedback.shape[2], cell]  # (S,) each
    issuer_reward, issuer_noise = np.zeros((2, *event.shape))
    issuer_reward[:, PING] = np.where(comes_late, 0.0, mean)
    issuer_noise[:, PING] = noise
    issuer_reward[delayed == 1] += mean[delayed == 1, None]
    next_delayed = np.zeros(event.shape, dtype=np.int64)
    next_delayed[:, PING] = comes_late
    ticks, chances = scenario.layout.following
    next_tick = np.broadcast_to(ticks[tick][:, None], (*event.shape, ticks.shape[1]))  # (S, A, K)
    next_context = place[:, None, None] * n_phases + scenario.layout.ticks[next_tick]
    waits = zone_of[next_context, next_cell[:, :, None]] == ISSUER
    next_tick = np.where(waits | terminated[:, :, None], tick[:, None, None], next_tick)
    next_delayed = np.where(terminated, delayed[:, None], next_delayed)
    next_pings = np.minimum(wrong_pings, n_pings - 1)
    parts = (part[:, :, None] for part in (next_delayed, next_pings, next_cell))
    next_state = np.ravel_multi_index((place[:, None, None], next_tick, *parts), shape)

    over = (zone == ISSUER) | scenario.grid.is_wall[cell]  # absorbing
    next_state[over] = state[over][:, None, None]
    wrong_pings[over] = pings[over, None]
    event[over] = NONE
    grid_reward[over] = issuer_reward[over] = issuer_noise[over] = 0.0
    terminated[over] = True
    return {
        "next_state": next_state.astype(np.int32),
        "probability": np.ascontiguousarray(
            np.broadcast_to(chances[tick][:, None], next_state.shape)
        ),
        "grid_reward": grid_reward,
        "issuer_reward": issuer_reward,
        "issuer_noise": issuer_noise,
        "terminated": terminated,
        "event": event.astype(np.int8),
        "wrong_pings": wrong_pings.astype(np.int32),
        "cell": cell.astype(np.int32),
        "context": context.astype(np.int32),
        "zone": zone,
        "pings": pings.astype(np.int32),
    }


def _components(
    scenario: Scenario, context: Indices, cell: Indices, pings: Indices
) -> tuple[Component, ...]:
    """Returns the observed components of states, given (S,) context, cell and wrong PINGs."""
    position = scenario.grid.position
    n_phases = len(scenario.layout.stages)
    counts = {"phase": (context % n_phases, n_phases), "wrong_pings": (pings, scenario.ping_limit)}

    def component(name: str) -> Component:
        if name == "agent":
            cells = np.arange(len(position))[:, None]
            return _of_positions(
                name, cell, position[cells], _farthest(scenario), cells, len(cells)
            )
        if name == "issuer":
            return _people(scenario, context)
        if name in ("offset", "relative"):
            return _offsets(name, scenario, context, cell)
        value, size = counts[name]
        numbers = np.arange(size)[:, None]
        largest = np.array([max(size - 1, 1)])
        return Component(name, value, numbers, largest, np.zeros(1, int), numbers, size)

    return tuple(map(component, scenario.observe))


def _of_positions(
    name: str, value: Ints | Indices, numbers: Ints, largest: Ints, ones: Ints, width: int
) -> Component:
    """Returns a component, given each person's row, column and perhaps badge, (size, people, D)."""
    size, n, n_numbers = numbers.shape
    per_cell = np.tile([1, 1, 0][:n_numbers], n)
    parts = numbers.reshape(size, -1), np.tile(largest, n), per_cell, ones, width
    return Component(name, value.astype(np.int32, copy=False), *parts)


def _farthest(scenario: Scenario) -> Ints:
    """Returns the last row and column, at least 1 each."""
    return np.array([max(length - 1, 1) for length in scenario.grid.size])


def _people(scenario: Scenario, context: Indices) -> Component:
    """Returns the component with all people's cells: those who count first, unless with badges."""
    layout = scenario.layout
    n = scenario.n_people
    n_phases = len(scenario.layout.stages)
    cells = layout.issuer_cells
    spots = np.searchsorted(cells, layout.standing.reshape(-1, n))  # (J * P, people) among cells
    if n == 1:
        groups = np.arange(len(cells))[:, None]
        group = spots[:, 0]
    else:
        groups = spots[::n_phases]
        group = np.arange(len(spots)) // n_phases
    position = scenario.grid.position
    largest = _farthest(scenario)
    positions = [*map(tuple, position[cells].tolist())]
    shown = np.array(shown_cells(positions, scenario.issuer.permuted, scenario.draw))[groups]
    if not scenario.onlookers:
        return _of_positions("issuer", group[context], shown, largest, groups, len(cells))
    ones = np.concatenate([layout.ways, layout.onlookers], axis=1)  # (J, people) cells
    numbers = position[ones]
    width = len(position)
    numbers[:, :n] = shown[group[::n_phases]]
    if scenario.onlookers.badge:
        order = random_orders(*ones.shape, "badges", scenario.draw)
        counts = (order < n) * 1
        numbers = np.take_along_axis(numbers, order[:, :, None], axis=1)
        numbers = np.concatenate([numbers, counts[:, :, None]], axis=2)
        ones = np.take_along_axis(ones, order, axis=1) + width * counts
        largest = np.append(largest, 1)
        width = 2 * width
    columns = np.arange(ones.shape[1])
    ones = ones + width * columns
    place = context // n_phases
    return _of_positions("issuer", place, numbers, largest, ones, width * len(columns))


def _offsets(name: str, scenario: Scenario, where: Indices, cell: Indices) -> Component:
    """Returns the component that says where people stand relative to the agent.

    With onlookers, "relative" has the cells of all people in their order. Otherwise, the offsets of
    those who count are sorted by their Euclidean distance from the agent, and those that are
    equally far by rows and columns. `where` is the context of each state, (S,).
    """
    position = scenario.grid.position
    if name == "relative" and scenario.onlookers:
        people = _people(scenario, where)
        seen = people.numbers.reshape(people.size, 1, people.ones.shape[1], -1)
        where = people.value
        offset = seen.repeat(len(position), axis=1)  # (J, C, people, 2 or 3)
        offset[..., :2] -= position[:, None]
    else:
        standing = scenario.layout.standing.reshape(-1, scenario.n_people)
        offset = position[standing][:, None] - position[:, None]  # (J * P, C, people, 2)
        order = (offset**2).sum(axis=3).argsort(axis=2, kind="stable")
        offset = np.take_along_axis(offset, order[..., None], axis=2)
    rows, columns = scenario.grid.size
    n, n_numbers = offset.shape[2:]
    shape = (2 * rows - 1, 2 * columns - 1, 2)[:n_numbers]
    from_0 = offset + np.array([rows - 1, columns - 1, 0])[:n_numbers]
    index = np.ravel_multi_index(tuple(np.moveaxis(from_0, 3, 0)), shape)  # (where, C, people)
    size = math.prod(shape)
    number_at = index[:, :, 0]
    values = np.arange(size)[:, None]
    if n > 1:  # of the many combinations, only those that occur
        combinations = index.reshape(-1, n)
        first, number = numbered([*combinations.T])
        number_at = number.reshape(number_at.shape)
        values = combinations[first]
    numbers = np.stack(np.unravel_index(values, shape), axis=2)
    ones = values + size * np.arange(n)
    largest = np.maximum(np.array(shape) - 1, 1)
    return _of_positions(name, number_at[where, cell], numbers, largest, ones, size * n)


def numbered(columns: Sequence[Ints]) -> tuple[Ints, Ints]:
    """Numbers the different rows of columns from 0, in lexicographic order.

    Returns the index of the first row with each number, and the number of each row.
    """
    key = np.zeros(len(columns[0]), dtype=np.int64)
    size = 1
    for column in columns:
        n_values = int(column.max()) + 1
        if size * n_values >= 2**62:  # as large as integers get
            key = np.unique(key, return_inverse=True)[1]
            size = int(key.max()) + 1
        key = key * n_values + column
        size = size * n_values
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number


def _feedback(scenario: Scenario) -> Floats:
    """Returns mean, half-width and lateness (0 or 1) of a PING's reward, (3, J * P, W, C).

    The nearest answers. W is `ping_limit` if users' functions are given the wrong PINGs so far,
    else 1. Feedback by distance is relative to the largest distance from a start in the same place.
    """
    layout = scenario.layout
    position = scenario.grid.position
    n_places, n_phases, _ = layout.standing.shape
    feedback = [it.feedback for it in scenario.people_in(0, 0) if it.feedback]
    answering = [[it.position for it in others if it.feedback] for others in layout.others]
    others_stand = np.array(answering, int)
    others_stand = others_stand.reshape(1, n_phases, -1, 2).repeat(n_places, axis=0)
    stands = np.concatenate([position[layout.standing], others_stand], axis=2)  # (J, P, people, 2)
    place, tick, cell = layout.starts.T
    from_start = np.zeros((n_places, len(feedback)), dtype=np.int_)
    far = abs(position[cell][:, None] - stands[place, layout.ticks[tick]]).sum(axis=2)
    np.maximum.at(from_start, place, far)
    far = abs(position - stands[:, :, :, None]).sum(axis=4)  # (J, P, people, C), L1 distances
    nearest = far.argmin(axis=2)[:, :, None]  # (J, P, 1, C)
    n_pings = scenario.ping_limit if scenario.own_feedback else 1
    rewards = np.zeros((3, n_places, n_phases, n_pings, len(position)))
    for k, its in enumerate(feedback):
        low: Floats | float
        high: Floats | float
        match its:
            case BoundedFeedback(kind="uniform", low=low, high=high):
                pass
            case BoundedFeedback(low=lower, high=higher):
                low = high = np.where(layout.zone[:, :, None] == TARGET, higher, lower)
            case OwnFeedback():
                low, high = _own_rewards(scenario, its, k, nearest, far, from_start)
            case _ if its.kind == "none":
                low = high = 0.0
            case _:
                low = high = -far[:, :, k, None] / from_start[:, None, k, None, None]
        values = (low + high) / 2, (high - low) / 2, its.kind == "delayed"
        for array, value in zip(rewards, values, strict=True):
            np.copyto(array, value, where=nearest == k)
    return rewards.reshape(3, -1, n_pings, len(position))


def _own_rewards(
    scenario: Scenario,
    feedback: OwnFeedback,
    person: int,
    nearest: Ints,
    far: Ints,
    from_start: Ints,
) -> Floats:
    """Returns the lowest and highest rewards by a user's function, (2, J, P, ping_limit, C).

    The function is called where the person is `nearest`, (J, P, 1, C). `far` has everybody's
    distance from each cell, (J, P, people, C), and `from_start` from the farthest start, (J,
    people).
    """
    layout = scenario.layout
    n_pings = scenario.ping_limit
    rewards = np.zeros((2, *far.shape[:2], n_pings, far.shape[3]))
    can_ping = (layout.zone != ISSUER) & ~scenario.grid.is_wall
    for j, phase, c in np.argwhere((nearest[:, :, 0] == person) & can_ping).tolist():
        its = [it for it in scenario.people_in(j, phase) if it.feedback][person]
        agent = divmod(c, scenario.grid.columns)
        distances = int(far[j, phase, person, c]), int(from_start[j, person])
        where = ZONES[layout.zone[j, phase, c]], layout.stages[phase].name
        seen = partial(Ping, agent, its.position, its.heading, *distances, *where)
        rewards[:, j, phase, :, c] = feedback.answers([*map(seen, range(n_pings))], scenario.name)
    return rewards
