"""The search for settings that an experiment declares, and the settings that it has chosen.

Trial 0 has a learner's settings as they are. The others are points of a scrambled Sobol sequence (Sobol 1967,
Owen 1998), one sequence per variant. So trial t depends neither on how many there are nor on who executes it.

A search can be repeated: its trials fall into parts, consecutive blocks of equal size, each with its own
pick. Blocks of a Sobol sequence whose size is a power of two, and which begin at a multiple of it, are
themselves evenly spread. With several parts, trial t is therefore point t, and trial 0 replaces point 0.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from benchmark.sealed import unsealed
from envs import InputError
from envs.inputs import Table, distinct, require

_DIGITS: Final = 3  # significant ones, of numbers that are drawn


class Span(Table):
    """A setting that is drawn between two numbers, evenly on its scale."""

    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    scale: Literal["linear", "log"] = "linear"
    """On which scale values are even."""
    whole: bool = False
    """Whether it is a whole number."""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        require(self.low < self.high, f"low = {self.low}", f"less than high = {self.high}")
        require(self.low > 0 or self.scale == "linear", f"low = {self.low}", 'above 0, or scale = "linear"')
        return self

    def at(self, share: float) -> float:
        """Returns the value below which a share, from 0 to 1, of the range lies.

        >>> Span(low=0.01, high=1, scale="log").at(0.5)
        0.1
        """
        low, high = np.log([self.low, self.high]) if self.scale == "log" else (self.low, self.high)
        value = low + share * (high - low)
        value = float(f"{np.exp(value) if self.scale == 'log' else value:.{_DIGITS}g}")
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


Axis = Annotated[Annotated[Span, Tag("range")] | Annotated[Choice, Tag("choice")], Discriminator(_kind)]
Space = dict[str, Axis]  # dotted key of a setting to its range


class Search(Table):
    """How much a search tries. The runs of a trial are those that its variant declares, in every scenario."""

    trials: Annotated[int, Field(ge=1, le=5000)]
    """Trials of each learner, besides trial 0."""
    parts: Annotated[int, Field(ge=1, le=100)] = 1
    """Parts of equal size into which trials fall, with trial 0. Each has its own pick."""
    finalists: Annotated[int, Field(ge=1, le=100)] = 4
    """Trials of each part that are run again, with fresh seeds."""
    first_seed: Annotated[int, Field(ge=0, le=900_000)]
    """The first of the fresh seeds."""
    seeds: Annotated[int, Field(ge=2, le=10_000)] = 40
    """Fresh runs of each finalist per scenario."""

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        size, rest = divmod(n := self.trials + 1, self.parts)
        require(rest == 0, f"parts = {self.parts}", f"a number that divides trials + 1 = {n}, with trial 0")
        most = min(size, self.trials)
        require(self.finalists <= most, f"finalists = {self.finalists}", f"at most {most}, trials of a part")
        return self

    @property
    def blocks(self) -> list[range]:
        """The trials of every part, in order."""
        size = (self.trials + 1) // self.parts
        return [range(start, start + size) for start in range(0, self.trials + 1, size)]

    @property
    def fresh(self) -> range:
        """The seeds of finalists."""
        return range(self.first_seed, self.first_seed + self.seeds)


def trials(name: str, space: Space, n: int, parts: int = 1) -> list[dict[str, object]]:
    """Returns the settings of trials 0 to n, each as changes of the variant's own; trial 0 changes nothing.

    >>> space = {"epsilon": Span(low=0, high=1)}
    >>> trials("q", space, 8)[:3] == trials("q", space, 2)
    True
    """
    from scipy.stats import qmc  # takes half a second to import

    seed = np.random.SeedSequence(int.from_bytes(hashlib.sha256(name.encode()).digest()))
    shares = qmc.Sobol(len(space), seed=np.random.default_rng(seed)).random_base2(int(n).bit_length())
    drawn = shares[:n] if parts == 1 else shares[1 : n + 1]
    rows = (zip(space, space.values(), row, strict=True) for row in drawn.tolist())
    return [{}, *({key: axis.at(share) for key, axis, share in row} for row in rows)]


class Finalist(Table):
    """The settings of a trial that was run again."""

    trial: int
    settings: dict[str, object]
    score: float  # mean on fresh runs of what the search compares runs by


class Chosen(Finalist):
    """The settings that a search has chosen for a learner, and the effort of the search."""

    picks: tuple[Finalist, ...] = ()  # the best of every part, if there are several parts
    trials: int  # that were tried, without trial 0
    runs: int  # on which the choice depends
    steps: int  # environment steps of all these runs; an upper bound if they can end early
    cpu_time_s: float  # of their training


class Choices(Table):
    """What a search has chosen, as a file has it."""

    search: str  # digest of what was declared, see `choices.digest_of_search`
    trials: str  # digest of the published table of all trials
    learners: dict[str, Chosen]  # by name
    sha256: str = ""  # see `benchmark.sealed`


def chosen_file(path: Path) -> Path:
    """Returns where the chosen settings of the search in an experiment's file are."""
    return path.with_name(f"{path.stem}.chosen.json")


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
        name = path.stem if path.parent == Path(__file__).parent else path
        problem = f"{file.name} {what}; python -m benchmark run {name} --report makes it anew"
        raise InputError(f"{source}: {problem}.") from error
