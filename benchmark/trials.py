"""Trials of a search: what they draw, and the file of the settings that were chosen among them.

Trial 0 has a learner's settings as they are. The others are points of a scrambled Sobol sequence
(Sobol 1967, Owen 1998), one sequence per variant. So trial t depends neither on how many there are
nor on who executes it.

A search can be repeated: its trials fall into parts, consecutive blocks of equal size, each with
its own pick. Blocks of a Sobol sequence whose size is a power of two, and which begin at a multiple
of it, are themselves evenly spread. With several parts, trial t is therefore point t, and trial 0
replaces point 0.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from benchmark.folder import sealed, unsealed
from envs import InputError
from envs.inputs import Count, Table, distinct, require

Seed = Annotated[int, Field(ge=0, le=900_000)]
_DIGITS: Final = 3  # significant ones, of numbers that are drawn


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
    """Trials of each learner, besides trial 0."""
    parts: Count = 1
    """Parts of equal size into which trials fall, with trial 0. Each has its own pick."""
    finalists: Count = 4
    """Trials of each part that are run again, with fresh seeds."""
    first_seed: Seed
    """The first of the fresh seeds."""
    seeds: Annotated[int, Field(ge=2, le=10_000)] = 40
    """Fresh runs of each finalist per scenario."""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        n = self.trials + 1
        accepted = f"a number that divides trials + 1 = {n}, with trial 0"
        require(n % self.parts == 0, f"parts = {self.parts}", accepted)
        most = min(n // self.parts, self.trials)
        accepted = f"at most {most}, trials of a part"
        require(self.finalists <= most, f"finalists = {self.finalists}", accepted)
        return self

    @property
    def blocks(self) -> list[range]:
        """The trials of every part, in order."""
        size = (self.trials + 1) // self.parts
        return [range(start, start + size) for start in range(0, self.trials + 1, size)]

    def miniature(self) -> "Search":
        """Returns the same search with few trials and runs."""
        small = {"parts": min(self.parts, 2), "trials": 3, "finalists": 1, "seeds": 2}
        return self.model_copy(update=small)

    @property
    def fresh(self) -> range:
        """The seeds of finalists."""
        return range(self.first_seed, self.first_seed + self.seeds)


def trials(variant: str, space: Space, n: int, parts: int = 1) -> list[dict[str, object]]:
    """Returns the settings of trials 0 to n, as changes of the variant's own by dotted key.

    >>> space = {"epsilon": Span(low=0, high=1)}
    >>> trials("q", space, 8)[:3] == trials("q", space, 2)
    True
    """
    from scipy.stats import qmc  # takes half a second to import

    seed = np.random.SeedSequence(int.from_bytes(hashlib.sha256(variant.encode()).digest()))
    sobol = qmc.Sobol(len(space), seed=np.random.default_rng(seed))
    points = sobol.random_base2(int(n).bit_length()).tolist()
    first = int(parts > 1)
    return [{}] + [
        {key: axis.at(share) for (key, axis), share in zip(space.items(), point, strict=True)}
        for point in points[first : first + n]
    ]


class Finalist(Table):
    """The settings of a trial that was run again."""

    trial: int
    settings: dict[str, object]
    score: float  # mean, on fresh runs, of what the search compares runs by


class Chosen(Finalist):
    """The settings that a search has chosen for a learner, and the effort of the search."""

    picks: tuple[Finalist, ...] = ()  # the best of every part, if there are several parts
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
    chosen_file(path).write_text(sealed(choices.model_dump(mode="json", exclude_defaults=True), 1))


def read_chosen(path: Path, source: str) -> Choices:
    """Reads what the search in an experiment's file has chosen.

    Refuses by an InputError, which begins with the source, a missing, damaged or changed file.
    """
    file = chosen_file(path)
    try:
        content = b"" if file.is_fifo() else file.read_bytes()
        unsealed(content)
        return Choices.model_validate_json(content)
    except (OSError, ValueError, TypeError, RecursionError) as error:
        what = "is missing" if isinstance(error, FileNotFoundError) else "is damaged"
        again = f"python -m benchmark run {path} --report makes it anew"
        raise InputError(f"{source}: {file.name} {what}; {again}.") from error
