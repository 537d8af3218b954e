"""Trials of a search: what they draw, and the file of the settings that were chosen among them.

Trial 0 has a learner's settings as they are. The next ones are points of a scrambled Sobol sequence
(Sobol 1967, Owen 1998), one sequence per variant. So what trial t draws depends neither on how many
there are nor on who executes it. The last ones are declared: `Variant.candidates`.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from benchmark.folder import damaged, sealed, unsealed
from envs.inputs import Count, Table, distinct, require

Seed = Annotated[int, Field(ge=0, le=900_000)]
Values = dict[str, object]  # new ones, by dotted key
_DIGITS = 3  # significant ones, of numbers that are drawn


class Span(Table):
    """A setting that is drawn between two numbers, evenly on its scale."""

    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    scale: Literal["linear", "log"] = "linear"
    """The scale on which values are even."""
    whole: bool = False
    """Whether it is a whole number."""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        require(self.low < self.high, f"low = {self.low}", f"less than high = {self.high}")
        is_possible = self.low > 0 or self.scale == "linear"
        require(is_possible, f"low = {self.low}", 'above 0, or scale = "linear"')
        return self

    def at(self, share: float) -> float:
        """Returns the value below which a share, from 0 to 1, of the range lies.

        >>> Span(low=0.01, high=1, scale="log").at(0.5)
        0.1
        """
        if self.scale == "log":
            value = np.exp(np.log(self.low) + share * (np.log(self.high) - np.log(self.low)))
        else:
            value = self.low + share * (self.high - self.low)
        value = float(f"{value:.{_DIGITS}g}")
        value = min(max(value, self.low), self.high)  # whatever rounding does
        return round(value) if self.whole else value


class Choice(Table):
    """A setting that is drawn from a few values."""

    values: Annotated[tuple[object, ...], Field(min_length=2), AfterValidator(distinct)]
    """All values, each equally likely."""

    def at(self, share: float) -> object:
        """Returns the value at a share, from 0 to less than 1, of the list."""
        return self.values[int(share * len(self.values))]


def _kind(value: object) -> str:
    is_choice = isinstance(value, Choice) or (isinstance(value, Mapping) and "values" in value)
    return "choice" if is_choice else "range"


# Settings that are drawn, by dotted key
Space = dict[
    str,
    Annotated[
        Annotated[Span, Tag("range")] | Annotated[Choice, Tag("choice")], Discriminator(_kind)
    ],
]


class Search(Table):
    """How much a search tries. The runs of a trial are those that its variant declares."""

    trials: Annotated[int, Field(ge=1, le=5000)]
    """Trials of each learner that are drawn, besides trial 0 and candidates."""
    finalists: Count = 4
    """The best trials of each learner, which run again with fresh seeds, as trial 0 does."""
    first_seed: Seed
    """The first of the fresh seeds."""
    seeds: Annotated[int, Field(ge=2, le=10_000)] = 40
    """Fresh runs of each finalist per scenario."""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        accepted = f"at most {self.trials}, the trials that are drawn"
        require(self.finalists <= self.trials, f"finalists = {self.finalists}", accepted)
        return self

    def miniature(self) -> "Search":
        """Returns the same search with few trials and runs."""
        return self.model_copy(update={"trials": 3, "finalists": 1, "seeds": 2})

    @property
    def fresh(self) -> range:
        """The fresh seeds."""
        return range(self.first_seed, self.first_seed + self.seeds)


def trials(variant: str, space: Space, n: int) -> list[Values]:
    """Returns what trials 0 to n change of a variant's settings, by dotted key.

    >>> space = {"epsilon": Span(low=0, high=1)}
    >>> trials("q", space, 8)[:3] == trials("q", space, 2)
    True
    """
    from scipy.stats import qmc  # takes half a second to import

    seed = np.random.SeedSequence(int.from_bytes(hashlib.sha256(variant.encode()).digest()))
    sobol = qmc.Sobol(len(space), seed=np.random.default_rng(seed))
    points = sobol.random_base2(int(n).bit_length()).tolist()
    return [{}] + [
        {key: axis.at(share) for (key, axis), share in zip(space.items(), point, strict=True)}
        for point in points[:n]
    ]


class Chosen(Table):
    """The settings that a search has chosen for a learner, and the effort of the search."""

    trial: int
    settings: Values
    score: float  # mean, on fresh runs, of what the search compares runs by
    trials: int  # that were tried, without trial 0
    runs: int  # on which the choice depends
    steps: int  # environment steps of all these runs; an upper bound if they can end early
    cpu_time_s: float  # of their training


class Choices(Table):
    """What a search has chosen, as a file has it."""

    search: str  # digest of what was declared, see `digest_of_search`
    trials: str  # digest of the published table of all trials
    learners: dict[str, Chosen]  # by name
    sha256: str = ""  # of all else, so that a change of any value is noticed


def chosen_file(path: Path) -> Path:
    """Returns where the chosen settings of the search in an experiment's file are."""
    return path.with_name(f"{path.stem}.chosen.json")


def write_choices(path: Path, choices: Choices) -> None:
    """Writes what the search in an experiment's file has chosen."""
    chosen_file(path).write_text(sealed(choices.model_dump(mode="json"), 1))


def read_chosen(path: Path) -> Choices:
    """Reads what the search in an experiment's file has chosen.

    An InputError refuses a missing, damaged or changed file.
    """
    file = chosen_file(path)
    with damaged(file):
        content = file.read_bytes()
        unsealed(content)
        return Choices.model_validate_json(content)
