"""People in a scenario: where they stand and walk, and the reward that they add to a PING."""

from collections.abc import Callable, Hashable, Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from envs.arrays import Floats
from envs.inputs import InputError, Label, Line, Share, Table, require, shortened
from envs.packages import contained
from envs.regions import HEADINGS, Cell, Heading, Length, Place, Regions, Ring
from envs.sources import imported

MAX_STATES = 4_000_000  # states of a scenario
_MAX_REWARD = 1_000_000
Reward = Annotated[float, Field(ge=-_MAX_REWARD, le=_MAX_REWARD)]
Steps = Annotated[int, Field(ge=1, le=1000)]


class PlainFeedback(Table):
    """No reward, or minus the person's L1 distance from the agent, relative to the farthest start.

    The nearest of several people answers, and both distances are measured from that person. Delayed
    feedback, also by distance, comes with the action after the PING, and never if the PING ends the
    episode. With it, nobody may move, since the model does not remember where people stood at the
    PING.
    """

    kind: Literal["none", "distance", "delayed"]
    """Which of the three."""


class BoundedFeedback(Table):
    """A reward drawn uniformly between bounds at each PING, or `high` if correct, else `low`."""

    kind: Literal["uniform", "binary"]
    """Drawn between the bounds, or one of them."""
    low: Reward
    """Smallest reward, or that for a wrong PING."""
    high: Reward
    """Largest reward, or that for a correct PING."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        is_ordered = self.kind == "binary" or self.low < self.high
        require(is_ordered, f"low = {self.low}", f"less than high = {self.high}")
        return self


class Ping(NamedTuple):
    """A PING, as the person who answers it sees it."""

    agent: Cell
    person: Cell
    heading: Heading  # where the person looks
    distance: int  # between them, rows plus columns
    farthest: int  # the largest such distance at the start of an episode in this place
    zone: str  # where the agent is, one of `envs.ZONES`
    phase: str  # its name; "always" if there are none
    wrong_pings: int  # so far in the episode, without this one


class OwnFeedback(Table):
    """What your function returns for a `Ping`: a reward, or bounds of one drawn uniformly."""

    kind: Line
    """The function, as `module:attribute`."""

    def function(self, source: str) -> Callable[[Ping], Any]:
        """Imports the function; raises an InputError, which names the source, if that fails."""
        function = imported(self.kind, source, "feedback.kind")
        if callable(function) and isinstance(function, Hashable):
            return function
        raise InputError(f"{source}: feedback.kind {shortened(self.kind)}: accepted: a function.")

    def answers(self, pings: Sequence[Ping], source: str) -> Floats:
        """Returns the lowest and the highest reward for PINGs from a cell, (2, n); asks twice."""
        function = contained()(self.function(source))
        try:
            both = [[np.broadcast_to(function(ping), 2) for ping in pings] for _ in range(2)]
            answers, again = map(np.array, both)
        except Exception as error:  # whatever the function raises
            reason = f"{type(error).__name__}: {error}".removesuffix(".")
        else:
            if answers.dtype.kind not in "iuf":
                reason = "no number"
            elif not ((abs(answers) <= _MAX_REWARD) & (answers[:, :1] <= answers)).all():
                reason = shortened(str(answers.tolist()))
            elif not np.array_equal(answers, again):
                reason = "another answer when asked again"
            else:
                return answers.T.astype(np.float64)
        raise InputError(
            f"{source}: feedback.kind {shortened(self.kind)}: for a PING in "
            f"{list(pings[0].agent)}: {reason}; accepted: a number from "
            f"{-_MAX_REWARD:,} to {_MAX_REWARD:,}, or a pair of them, the lowest and the highest."
        )


def _kind(value: Any) -> Any:
    """Returns which kind of feedback a table is; any function counts as "module:attribute"."""
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return "module:attribute" if isinstance(kind, str) and ":" in kind else kind


FEEDBACK = {  # in words, by kind
    "none": "no feedback",
    "uniform": "random feedback",
    "distance": "feedback by distance",
    "delayed": "delayed feedback by distance",
    "binary": "binary feedback",
}
_ACCEPTED = f"accepted: a table whose kind is {', '.join(FEEDBACK)} or module:attribute"
Feedback = Annotated[
    Annotated[PlainFeedback, Tag("none")]
    | Annotated[BoundedFeedback, Tag("uniform")]
    | Annotated[PlainFeedback, Tag("distance")]
    | Annotated[PlainFeedback, Tag("delayed")]
    | Annotated[BoundedFeedback, Tag("binary")]
    | Annotated[OwnFeedback, Tag("module:attribute")],
    Discriminator(_kind, "kind", _ACCEPTED),
]


class Walk(Table):
    """A walk in straight lines from a person's position to each corner, and back; then again.

    The person looks where it goes. All who walk start at the same time.
    """

    corners: Annotated[tuple[Cell, ...], Field(min_length=1, max_length=100)]
    """Where the walk turns: each is in the row or column of the one before."""
    steps: Steps = 1
    """Steps of the agent for each cell of the walk."""

    def route(self, position: Cell) -> list[tuple[Cell, Heading]]:
        """Returns the cells of a round from a position, and where the person looks in each."""
        route: list[tuple[Cell, Heading]] = []
        for (row, column), (to_row, to_column) in pairwise([position, *self.corners, position]):
            step = int(np.sign(to_row - row)), int(np.sign(to_column - column))
            heading = next(name for name, direction in HEADINGS.items() if direction == step)
            n_steps = abs(to_row - row) + abs(to_column - column)
            route += [((row + k * step[0], column + k * step[1]), heading) for k in range(n_steps)]
        return route


class Issuer(Table):
    """The person whose personal space matters, and the reward that this person adds to a PING."""

    position: Place
    """Where the person stands when an episode starts."""
    places: Annotated[int, Field(ge=1, le=MAX_STATES)] | None = None
    """How many of the cells of `position` are places, drawn once, see `draw`; all by default. With
    a `group`, how many of the ways in which all of them may stand."""
    unseen: Annotated[int, Field(ge=0, le=MAX_STATES)] = 0
    """Further places, drawn after these: part of the observations, but never used in training
    episodes."""
    permuted: Share = 0.0
    """Fraction of cells shown with another cell's coordinates."""
    feedback: Feedback
    """The reward that the person adds to every PING."""
    heading: Heading = "up"
    """Where the person looks."""
    walk: Walk | None = None
    """How the person walks; by default not at all."""


# Names and probabilities. Sorted, so that equal phases have equal hashes and draw alike.
Chances = Annotated[
    dict[str, Annotated[float, Field(gt=0, le=1)]],
    Field(max_length=20),
    AfterValidator(lambda chances: dict(sorted(chances.items()))),
]


class Phase(Table):
    """What is different about the person for some time, and how the phase ends.

    Either every phase lasts a number of `steps`, and the first follows the last; or every phase has
    `next`, the probability of each other phase to follow after a step, and otherwise goes on. Keys
    that a phase omits have the values of the scenario's other tables.
    """

    name: Annotated[Label, Field(min_length=1, max_length=40)]
    """Name of the phase, for pictures and for `next`."""
    position: Cell | None = None
    """Where the person stands in this phase."""
    heading: Heading | None = None
    """Where the person looks in this phase."""
    regions: Regions | None = None
    """The regions around the person in this phase."""
    steps: Steps | None = None
    """How many steps the phase lasts."""
    next: Chances | None = None
    """The probability of each other phase to follow after a step, by name; the sum is at most 1."""


class Group(Table):
    """People who are drawn with the person of `issuer`, and have its regions and feedback.

    Each set of cells of `issuer.position` at these distances is a place, if it leaves a start and a
    way to a target region. The nearest answers a PING. Strangers have a region each; people who
    talk have a ring.
    """

    people: Annotated[int, Field(ge=2, le=6)]
    """How many people, the one of `issuer` included."""
    apart: tuple[Length, Length]
    """Smallest and largest distance between any two of them, in the unit of `regions`."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        least, most = self.apart
        require(least <= most, f"apart = {[least, most]}", "the smallest distance first")
        return self


class Onlookers(Table):
    """People who are observed like the issuer, but do not matter: the agent walks through them.

    They stand in different cells. A number of ways to stand are drawn once, and combined with the
    places of the person in turn: the first place with the first way, and so on, each list starting
    again at its end. There are as many combinations as places or ways, whichever are more; each
    episode has one. If the ways are no multiple of the places, some places occur once more than
    others. Each unseen place is combined with one of the same ways, in turn. If there are unseen
    places, each other place is also combined with a new way, which no episode of training has.
    """

    people: Annotated[int, Field(ge=0, le=1000)]
    """How many there are. With fewer people, the first ones stand in the same cells."""
    ways: Annotated[int, Field(ge=1, le=MAX_STATES)]
    """How many ways to stand are drawn; with 1, they stand in the same cells in every episode,
    except whoever would stand in the person's cell."""
    badge: bool = False
    """Whether people are observed in random order, each with a number: 1 for those who count, else
    0."""


class Person(Table):
    """Another person; without regions and feedback a bystander, who is only an obstacle."""

    position: Cell
    """Where the person stands."""
    feedback: Feedback | None = None
    """The reward that the person adds to a PING if no other person is nearer, bystanders left
    out."""
    regions: Regions | None = None
    """The regions around this person alone."""
    heading: Heading = "up"
    """Where the person looks."""
    walk: Walk | None = None
    """How the person walks; by default it does not."""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        is_whole = (self.feedback is None) == (self.regions is None)
        require(is_whole, "regions, feedback", "both, or neither (a bystander)")
        is_ring = self.regions is not None and isinstance(self.regions.target, Ring)
        require(not is_ring, 'regions.target.kind = "ring"', "square, circle or egg")
        return self
