"""Experiments: what a TOML file declares, and the populations of runs that follow.

An experiment is a product: conditions x scenarios x learners x seeds. A learner is a variant, that is
an algorithm with settings, together with one form of observation. A condition changes values of
scenarios and settings: it is a reading of the paper, a point of a grid or a trial of a search.
Nothing after `load_experiment` looks up a name again, or asks how a condition was declared.
"""

import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from itertools import chain, product, zip_longest
from os.path import isfile, join  # which take any text for a path
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from agents import Algorithm, LearnerSettings, dynamic_programming, load_algorithm
from benchmark.specification import DEFAULT_CONDITION as DEFAULT_CONDITION
from benchmark.specification import RunSpecification
from benchmark.trials import Chosen, Search, Space, read_chosen, trials
from envs import InputError, Scenario, inputs, load_scenario, model
from envs.inputs import (
    Label,
    Line,
    Name,
    Names,
    Table,
    Text,
    override,
    parse,
    require,
    unknown_name,
)
from envs.observations import ENCODINGS
from envs.sources import find_modules_in

EXPERIMENT_DIRECTORY: Final = Path(__file__).parent / "experiments"
# The experiments whose results are published, in the order of README. .gitignore lists them, too.
PUBLISHED: Final = (
    "reproduce",
    "compare_deep",
    "when",
    "groups",
    "sb3",
    "tuning",
    "tuning_map",
    "tuning_tables",
    "equivalence",
)
MAX_RUNS: Final = 100_000  # of an experiment: more than a day at a second each
# Folders of results that are not those of an experiment, or not of its declared seeds
_RESERVED: Final = ("speed", "*_smoke", "*_seeds_*")
_MINIATURE: Final = "_smoke"  # how its name ends
# What a reference implementation takes from its variant, and does not set itself
_SHARED: Final = ("settings", "policy", "tuned_by", "search")
# Which of these tables the studies of this project read
_VARIATIONS: Final = ("readings", "grids", "search", "solved")
_READ: Final = {
    "comparison": (),
    "replication": ("readings",),
    "map": ("grids", "solved"),
    "search": ("search", "solved"),
}


# What a file declares


class Variant(Table):
    """An algorithm with its settings, and the observations from which it learns.

    A *reference implementation* of another variant learns the same by other code. It takes that
    variant's settings, its policy and, unless it names some of them, its observations.
    """

    algorithm: str
    """One of the algorithms below, or `module:attribute` of any other."""
    title: Annotated[Label, Field(max_length=60)] = ""
    """What readers call it; by default its name."""
    observations: Annotated[Names, Field(min_length=1)]
    """Forms of observation; each makes a learner."""
    seeds: Annotated[int, Field(ge=1, le=100_000)]
    """Runs per scenario and condition."""
    first_seed: Annotated[int, Field(ge=0, le=900_000)] = 0
    """The first seed; the others follow it."""
    policy: Literal["greedy", "stochastic"] = "greedy"
    """The policy that is evaluated."""
    settings: dict[str, object] = Field(default_factory=dict)
    """Settings of the algorithm, see below."""
    reference_for: str = ""
    """The variant that this is a reference implementation of. With --seeds it gets a proportional
    share."""
    search: Space = Field(default_factory=dict)
    """What a search varies: a table for each setting, by dotted key."""
    tuned_by: Line = ""
    """`EXPERIMENT:VARIANT`: learners take what that search has chosen for them, except their own
    settings. If the search has several parts, the runs of a learner take turns with their picks."""

    @property
    def all_seeds(self) -> range:
        """The seeds of its runs."""
        return range(self.first_seed, self.first_seed + self.seeds)

    @property
    def source(self) -> tuple[str, str]:
        """The search in `tuned_by`, and the variant there; empty texts without a search."""
        search, _, variant = self.tuned_by.rpartition(":")
        return search, variant


class Change(Table):
    """A change of scenarios and settings. All conditions have the same random streams."""

    scenario: dict[str, object] = Field(default_factory=dict)
    """Changes of scenarios, as dotted keys."""
    scenarios: Names | None = None
    """Names of the scenarios that it changes; all by default."""
    settings: dict[str, object] = Field(default_factory=dict)
    """Changes of the settings of every variant, as dotted keys."""

    def of_settings(self, _: str) -> dict[str, object]:
        """Returns what it changes of the settings of a variant."""
        return self.settings


class Reading(Change):
    """One way to read the paper, or a control."""

    title: Annotated[Label, Field(max_length=60)] = ""
    """What a figure calls it; by default its name."""
    question: Annotated[Text, Field(min_length=1)]
    """What the paper leaves open."""
    answer: Annotated[Text, Field(min_length=1)]
    """How this reading answers it."""
    curve: Literal["visited", "table"] = "visited"
    """The maximum Q that claims are about: of the visited observations, or of the whole table."""
    seeds: Annotated[int, Field(ge=2, le=100_000)] | None = None
    """Runs per scenario and learner; by default the variant's."""


class Trial(Change):
    """A trial of a search, which is drawn and not declared."""

    drawn: dict[str, dict[str, object]]  # by variant

    def of_settings(self, variant: str) -> dict[str, object]:
        """Returns what was drawn for a variant."""
        return self.drawn[variant]


# A float distinguishes numbers of at most fifteen digits.
Value = Annotated[
    str,
    inputs.accepted_if(
        lambda value: re.fullmatch(r"(?=.{1,15}$)[0-9]+(\.[0-9]+)?(x[0-9]+)?", value) is not None,
        'a number of at most 15 characters, or two joined by "x", such as 4, 0.5 or 5x6',
    ),
]
Axis = Annotated[dict[Value, Change], Field(min_length=1)]


class Grid(Change):
    """Conditions that are the product of axes, with changes at all its points. A map draws grids."""

    question: Label = ""
    """What the grid is to answer, for readers."""
    learners: Names = ()
    """Names of learners, or of variants with all their observations; all by default. A learner that
    no grid names is in all grids."""
    axes: Annotated[dict[Name, Axis], Field(min_length=1)]
    """Changes at each value of an axis, as `axes.AXIS.VALUE`. A value is a number, or two joined by
    "x"."""
    is_compared: bool = True
    """Whether a map decides contrasts at its points."""


class Solved(Table):
    """When a run has learned.

    It has learned at the first evaluation from which exact success stays at or above a level until
    the first one at or after twice as many steps, or to the end of the budget. If its algorithm can
    end early, a run ends once that is certain. Only curves are recorded.
    """

    success: Annotated[float, Field(gt=0, le=1)] = 0.9
    """The level."""
    growth: Annotated[float, Field(ge=1.001, le=2)] = 1.15
    """Approximate ratio of the steps of one evaluation to those of the one before."""
    given_up_after: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Share of the budget after which a run is given up, at the next evaluation, if success has never
    reached half of the level. From then on its curves stay constant, so it never learns; it ends
    there if it can."""


@dataclass(frozen=True)
class Condition:
    """A point of the product of axes, whose values change scenarios and settings."""

    axes: Mapping[str, str]
    """The value of every axis: a "reading", a "grid" and its axes, or a "trial"."""
    changes: tuple[Change, ...]
    """What each of these values changes, in this order."""
    learners: tuple[str, ...] = ()
    """Names of the learners, or of their variants, that run under it; all if it is empty."""

    @property
    def name(self) -> str:
        """A reading, GRID/AXIS=VALUE for all axes, or trial=NUMBER; "default" without any axis."""
        name = "/".join(f"{axis}={value}" for axis, value in self.axes.items())
        return name.removeprefix("reading=").removeprefix("grid=") or DEFAULT_CONDITION

    @property
    def keys(self) -> dict[str, str | int]:
        """The columns that name it in tables."""
        if "grid" in self.axes:
            _, *point = (f"{axis} {value}" for axis, value in self.axes.items())
            return {"grid": self.axes["grid"], "point": ", ".join(point)}
        return {axis: int(value) if axis == "trial" else value for axis, value in self.axes.items()}

    def has(self, variant: str, observation: str) -> bool:
        """Returns whether a learner runs under it."""
        names = {variant, f"{variant}, {observation}"}
        return not self.learners or not names.isdisjoint(self.learners)

    def of_scenario(self, name: str) -> dict[str, object]:
        """Returns what it changes of a scenario, by dotted key."""
        return _merged(
            change.scenario
            for change in self.changes
            if change.scenarios is None or name in change.scenarios
        )

    def of_settings(self, variant: str) -> dict[str, object]:
        """Returns what it changes of the settings of a variant, by dotted key."""
        return _merged(change.of_settings(variant) for change in self.changes)


def _merged(tables: Iterable[Mapping[str, object]]) -> dict[str, object]:
    return {key: value for table in tables for key, value in table.items()}


def _points(
    axes: Mapping[str, Mapping[str, Change]], learners: tuple[str, ...] = ()
) -> Iterator[Condition]:
    """Yields the product of axes."""
    for values in product(*axes.values()):
        point = dict(zip(axes, values, strict=True))
        yield Condition(point, tuple(axes[axis][value] for axis, value in point.items()), learners)


class Declaration(Table):
    """A declared set of runs: every condition, scenario and learner, each with its seeds."""

    name: Name
    """The stem of the file."""
    description: Text
    """What the experiment is about, for readers."""
    report: dict[str, object] | None = None
    """What is drawn, see below; a text stands for a table with this `kind`. Without it, nothing is
    drawn."""
    note: Text = ""
    """For readers of the results, for example how settings were chosen."""
    stream: Name = ""
    """Experiments with the same stream share runs; by default, the experiment's name."""
    scenarios: Annotated[tuple[str, ...], Field(min_length=1)]
    """Names of shipped scenarios, or paths of TOML files."""
    horizon: Annotated[int, Field(ge=1, le=10_000)]
    """Steps after which an evaluated episode is truncated."""
    evaluation_every: Annotated[int, Field(ge=1, le=10**9)]
    """Steps from one evaluation of the policy to the next, in units of the budget."""
    map_every: Annotated[int, Field(ge=1, le=10**9)] | None = None
    """Steps from one record of all values to the next: a multiple of `evaluation_every`, by default
    equal to it. With `solved`, values are not recorded."""
    settings: dict[str, object] = Field(default_factory=dict)
    """Settings of every variant, unless the variant sets the same key."""
    algorithms: Annotated[dict[Name, Variant], Field(min_length=1)]
    """The variants, by name."""
    search: Search | None = None
    """A search for the settings of every variant that has a table `search`."""
    readings: dict[Name, Reading] = Field(default_factory=dict)
    """Readings of the paper and controls, by name; one is called "default"."""
    grids: dict[Name, Grid] = Field(default_factory=dict)
    """Products of axes, by name."""
    solved: Solved | None = None
    """With this table, runs are measured until they have learned; a search compares how early."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        self._check_tables()
        self._check_names()
        self._check_schedules()
        self._check_search()
        return self

    def _check_tables(self) -> None:
        given = [name for name in _VARIATIONS if getattr(self, name)]
        varied = [name for name in given if name != "solved"]
        require(len(varied) < 2, " and ".join(varied), "one of readings, grids and search")
        kind = (self.report or {}).get("kind")
        if isinstance(kind, str) and kind in _READ:
            for name in given:
                accepted = f"{' and '.join(_READ[kind]) or 'none of them'}, which its report reads"
                require(name in _READ[kind], f"{name} in a {kind}", accepted)
        is_named = not self.readings or DEFAULT_CONDITION in self.readings
        require(is_named, "readings", f"one named {DEFAULT_CONDITION} among them")

    def _check_names(self) -> None:
        names = tuple(Path(name).stem for name in self.scenarios)
        inputs.distinct(names, "scenarios: ")
        learners = {*self.algorithms, *self._learners}
        for name, grid in self.grids.items():
            require("grid" not in grid.axes, f"grids.{name}.axes.grid", "any other name")
            for learner in grid.learners:
                accepted = ", ".join(f'"{each}"' for each in sorted(learners))
                require(learner in learners, f"grids.{name}.learners: {learner}", accepted)
        for condition in {} if self.search else self.conditions.values():
            for change in condition.changes:
                is_used = change.scenarios is None or change.scenario
                where = f"{condition.name}: scenarios"
                require(bool(is_used), where, "changes in a table scenario beside it")
                for name in change.scenarios or ():
                    require(name in names, f"{where}: {name}", ", ".join(names))
            for kind in ("scenario", "settings"):
                keys = [key for change in condition.changes for key in getattr(change, kind)]
                inputs.distinct(tuple(keys), f"{condition.name}: {kind}.")

    def _check_schedules(self) -> None:
        if self.map_every is not None:
            found = f"map_every = {self.map_every}"
            require(self.solved is None, found, "no such key, since solved records no values")
            accepted = f"a multiple of evaluation_every = {self.evaluation_every}"
            require(self.map_every % self.evaluation_every == 0, found, accepted)

    def _check_search(self) -> None:
        for name, variant in self.algorithms.items():
            where = f"algorithms.{name}"
            if self.search is None:
                require(not variant.search, f"{where}.search", "a table [search] beside it")
            else:
                self._check_searched(where, variant, self.search)

    def _check_searched(self, where: str, variant: Variant, search: Search) -> None:
        require(not variant.reference_for, f"{where}.reference_for", "no such key in a search")
        require(bool(variant.search), where, "a table search, as the experiment has one")
        require("budget" not in variant.search, f"{where}.search.budget", "other settings")
        found = f"{where}.first_seed = {variant.first_seed}"
        fresh = search.fresh
        accepted = f"seeds outside {fresh.start} to {fresh.stop - 1}, which its finalists use"
        require(not overlap(variant.all_seeds, fresh), found, accepted)
        efforts = {
            (each.seeds, str((self.settings | each.settings).get("budget")))
            for each in self.algorithms.values()
        }
        require(len(efforts) == 1, "algorithms", "the same seeds and budget for all in a search")

    @property
    def _learners(self) -> dict[str, str]:
        """The variant of every learner."""
        variants = self.algorithms.items()
        return {f"{name}, {form}": name for name, each in variants for form in each.observations}

    @property
    def is_miniature(self) -> bool:
        """Whether it only checks that everything works, see `miniature`."""
        return self.name.endswith(_MINIATURE)

    def miniature(self) -> "Declaration":
        """Returns the same experiment with two runs of each learner and a search of few trials.

        Budgets are divided when settings are resolved.
        """
        variants, readings = dict(self.algorithms), dict(self.readings)
        for name, variant in variants.items():
            variants[name] = variant.model_copy(update={"seeds": min(variant.seeds, 2)})
        for name, reading in readings.items():  # twice as many as others
            readings[name] = reading.model_copy(update={"seeds": reading.seeds and 4})
        search = self.search
        if search is not None:
            small = {"parts": min(search.parts, 2), "trials": 3, "finalists": 1, "seeds": 2}
            search = search.model_copy(update=small)
        note = "This miniature only checks that everything works: its numbers mean nothing."
        changed = {"algorithms": variants, "readings": readings, "search": search, "note": note}
        return self.model_copy(update=changed | {"name": f"{self.name}{_MINIATURE}"})

    def seeds_of(self, variant: str, condition: Condition) -> range:
        """Returns the seeds of a variant's runs under a condition."""
        declared, reading = self.algorithms[variant], self.readings.get(condition.name)
        n_seeds = (reading and reading.seeds) or declared.seeds
        return range(declared.first_seed, declared.first_seed + n_seeds)

    @cached_property
    def conditions(self) -> dict[str, Condition]:
        """All conditions by name: readings, the default one first, points of grids, or trials."""
        if self.readings:
            readings = {DEFAULT_CONDITION: self.readings[DEFAULT_CONDITION]} | self.readings
            made = _points({"reading": readings})
        elif self.search is not None:
            made = _points({"trial": self._trials(self.search)})
        else:
            made = self._points_of_grids() if self.grids else _points({})
        return {condition.name: condition for condition in made}

    def _points_of_grids(self) -> Iterator[Condition]:
        named = {name for grid in self.grids.values() for name in grid.learners}
        unnamed = [name for name, of in self._learners.items() if named.isdisjoint((name, of))]
        for name, grid in self.grids.items():
            learners = grid.learners and (*grid.learners, *unnamed)
            yield from _points({"grid": {name: grid}, **grid.axes}, learners)

    def _trials(self, search: Search) -> dict[str, Trial]:
        drawn = {
            name: trials(name, variant.search, search.trials, search.parts)
            for name, variant in self.algorithms.items()
        }
        names = range(search.trials + 1)
        return {str(t): Trial(drawn={name: drawn[name][t] for name in drawn}) for t in names}


class Extension(Table):
    """An experiment that differs from another in some values."""

    extends: str
    """A shipped experiment's name, or the path of a TOML file."""
    description: Text
    """What the experiment is about, for readers."""
    changes: dict[str, object]
    """New values, by dotted key. The base's `note` and `report.question` are dropped, and with a new
    table `solved` its `map_every`, too."""


def overlap(a: range, b: range) -> bool:
    """Returns whether two ranges of seeds have one in common."""
    return max(a.start, b.start) < min(a.stop, b.stop)


def experiment_names() -> list[str]:
    """Lists the shipped experiments: one TOML file each, named after it."""
    return sorted(path.stem for path in EXPERIMENT_DIRECTORY.glob("*.toml"))


def read_experiment(experiment: str | Path) -> tuple[Declaration, Path]:
    """Reads an experiment's tables and checks their form, not yet what they name.

    Returns also their file. Refuses, by an InputError, a file that cannot be read, and keys and values
    that are not accepted.
    """
    path = _path(experiment)
    inputs.check_file_name(path, "results are")
    if any(fnmatchcase(path.stem, name) for name in _RESERVED):
        accepted = f"any name but {', '.join(_RESERVED)}"
        raise InputError(f"{path}: results are named after the file; accepted: {accepted}.")
    data = _with_references(_read(path), str(path))
    declared = parse(Declaration, data, str(path), name=path.stem)
    scenarios = tuple(_beside(path, name) for name in declared.scenarios)
    return declared.model_copy(update={"scenarios": scenarios}), path


def _beside(path: Path, name: str) -> str:
    """Returns a path from the folder of an experiment's file, if it exists, else as it is."""
    beside = join(path.parent, name)  # noqa: PTH118
    return beside if isfile(beside) else name  # noqa: PTH113


def _path(experiment: str | Path) -> Path:
    path, names = Path(experiment), experiment_names()
    shipped = EXPERIMENT_DIRECTORY / f"{path.stem}.toml"
    if path.suffix == ".toml":
        if path.stem in names and path.resolve() != shipped.resolve():
            reason = f"results are named after the file, and {path.stem} is a shipped experiment"
            raise InputError(f"{path}: {reason}; rename it.")
        return path
    if str(experiment) not in names:
        other = "the path of a .toml file"
        unknown_name("experiments", "experiment", str(experiment), names, other)
    return shipped


def _read(path: Path, extended_by: tuple[Path, ...] = ()) -> dict[str, object]:
    """Reads an experiment's tables; those of an extension are those of its base with changes.

    Modules beside the file can be imported from now on.
    """
    data = inputs.read_toml(path)
    if path.parent != EXPERIMENT_DIRECTORY:
        find_modules_in(str(path.parent.resolve()))
    if "extends" in data:
        data = _extended(parse(Extension, data, str(path)), path, extended_by)
    if isinstance(data.get("report"), str):
        data["report"] = {"kind": data["report"]}
    elif "search" in data:
        data.setdefault("report", {"kind": "search"})
    return data


def _extended(extension: Extension, path: Path, extended_by: tuple[Path, ...]) -> dict[str, object]:
    base = _path(_beside(path, extension.extends))
    if not base.exists() or base in (path, *extended_by):
        found = f"extends = {json.dumps(extension.extends)}"
        raise InputError(f"{path}: {found}: accepted: another experiment that exists.")
    data = _read(base, (path, *extended_by))
    data.pop("note", None)  # which may be false of this one
    if isinstance(report := data.get("report"), dict):
        report.pop("question", None)
    if "solved" in extension.changes and "solved" not in data:
        data.pop("map_every", None)
    return override(data | {"description": extension.description}, extension.changes, str(path))


def _with_references(data: dict[str, object], source: str) -> dict[str, object]:
    """Returns an experiment's tables, references with what they take from their variants."""
    variants = data.get("algorithms")
    if not isinstance(variants, dict) or not all(isinstance(v, dict) for v in variants.values()):
        return data  # is refused with the other tables
    own = {name: each for name, each in variants.items() if not each.get("reference_for")}
    complete = dict(variants)
    for name in variants.keys() - own.keys():
        where, of = f"{source}: algorithms.{name}", str(variants[name]["reference_for"])
        if of not in own:
            unknown_name(f"{where}: reference_for", "variant", of, own)
        for key in _SHARED:
            if key in variants[name]:
                reason = f"a reference implementation takes it from {of}; remove it"
                raise InputError(f"{where}.{key}: {reason}.")
        taken = {*_SHARED, "observations"} - {"search"}
        complete[name] = {key: own[of][key] for key in taken & own[of].keys()} | variants[name]
    return data | {"algorithms": complete}


# What follows from it


@dataclass(frozen=True, eq=False)
class Learner:
    """A variant with one form of observation."""

    variant: str
    observation: str
    declared: Variant
    algorithm: Algorithm
    family: str
    """What its variant counts as: "tabular", "linear", "deep" or "other"."""
    chosen: Chosen | None
    """What its search has chosen for it, if it has one."""

    @property
    def name(self) -> str:
        """Its name in files."""
        return f"{self.variant}, {self.observation}"

    @property
    def title(self) -> str:
        """What readers call it, see `title_of`."""
        return title_of(self.declared.title or self.variant, self.observation, self.family)

    @property
    def policy(self) -> str:
        """The policy that counts: "greedy" or "stochastic"."""
        return self.declared.policy

    @property
    def search(self) -> str:
        """The search that its settings come from; empty if they are declared."""
        return self.declared.source[0]

    @property
    def reference_for(self) -> str:
        """The learner that it is the reference implementation of; empty if it is none."""
        of = self.declared.reference_for
        return f"{of}, {self.observation}" if of else ""


_OBSERVED: Final = {
    "index": " on the cells' index",
    "one_hot": " on one-hot cells",
    "factored": " on one-hot rows and columns",
    "tiles": " on tiles",
    "coordinates": " on coordinates",
    "centred": " on centred coordinates",
    "offset": " on the offset's index",
    "offset_one_hot": " on one-hot offsets",
    "offset_factored": " on one-hot rows and columns of offsets",
    "offset_tiles": " on tiles of offsets",
    "offset_coordinates": " on offset coordinates",
    "offset_centred": " on centred offset coordinates",
    "planes": " on images of the room",
}
# A table has a row for each observation, in whatever form it is given.
_ROWS: Final = {"index": "", "one_hot": "", "offset": " of offsets"}


def title_of(variant: str, observation: str, family: str) -> str:
    """Returns what readers call a learner.

    >>> title_of("Q-learning table", "offset", "tabular")
    'Q-learning table of offsets'
    >>> title_of("tile coding", "coordinates", "linear")
    'tile coding on coordinates'
    """
    observed = _OBSERVED.get(observation, f" on {observation}")
    if family == "tabular":
        observed = _ROWS.get(observation.removesuffix("_one_hot"), observed)
    return variant + observed


@dataclass(frozen=True, eq=False)
class Population:
    """The runs of a learner in a scenario under a condition, which differ by seed and perhaps pick."""

    condition: Condition
    scenario: Scenario  # as it is under the condition
    learner: Learner
    firsts: tuple[RunSpecification, ...]  # a run with each pick of a search; usually one
    seeds: range  # as declared
    beside: range  # seeds of the variant that it is the reference for, else its own

    @property
    def first(self) -> RunSpecification:
        """The run with the first seed and the first pick."""
        return self.firsts[0]

    @property
    def keys(self) -> dict[str, str | int]:
        """The columns that name it in tables."""
        name = self.scenario.name
        return {"scenario": name, **self.condition.keys, "learner": self.learner.name}

    def pick_of(self, seed: int) -> int:
        """Returns the index of a seed's run in `firsts`; a reference has the same."""
        return (seed - self.beside.start) % len(self.firsts)

    def taken(self, seeds: Sequence[int] | None) -> Sequence[int]:
        """Returns the declared seeds, or a proportional share of given ones, two or more."""
        if seeds is None:
            return self.seeds
        return seeds[: max(2, len(seeds) * len(self.seeds) // len(self.beside))]

    def runs(self, seeds: Iterable[int] | None = None) -> list[RunSpecification]:
        """Lists its runs, with the declared seeds or others."""
        taken = self.seeds if seeds is None else seeds
        return [self.firsts[self.pick_of(seed)].with_seed(seed) for seed in taken]


@dataclass(frozen=True, eq=False, repr=False)
class Experiment:
    """A declared set of runs."""

    declared: Declaration
    path: Path
    learners: Mapping[str, Learner]  # by name
    scenarios: Mapping[str, Scenario]  # by name, without any change
    populations: Sequence[Population]  # by condition, scenario and learner, as declared

    @property
    def name(self) -> str:
        """The stem of its file."""
        return self.declared.name

    @property
    def argument(self) -> str:
        """How it is given on the command line: the name of a shipped one, else its file."""
        name = self.name.removesuffix(_MINIATURE)
        given = name if name in experiment_names() else f"{name}.toml"
        return f"{given} --smoke" if self.declared.is_miniature else given

    def population(self, condition: str, scenario: str, learner: str) -> Population:
        """Returns a population by its names; the scenario may be any other, by name or path."""
        alike = [
            each
            for each in self.populations
            if (each.condition.name, each.learner.name) == (condition, learner)
        ]
        name = Path(scenario).stem
        if name in self.scenarios:
            return next(each for each in alike if each.scenario.name == name)
        other = load_scenario(scenario, alike[0].condition.of_scenario(name))
        firsts = tuple(replace(first, scenario=other) for first in alike[0].firsts)
        return replace(alike[0], scenario=other, firsts=firsts)


def load_experiment(experiment: str | Path, *, smoke: bool = False) -> Experiment:
    """Reads an experiment, and checks it together with the algorithms and scenarios that it names.

    It is the name of a shipped experiment, or the path of a TOML file. With `smoke`, it is a miniature,
    with two runs of each learner and a twenty-fifth of the budget, at most 1,000. A mistake is an
    InputError with a sentence. Its report checks what it demands.
    """
    declared, path = read_experiment(experiment)
    return _Loading(declared.miniature() if smoke else declared, path).experiment()


@contextmanager
def _of_file(where: str) -> Iterator[None]:
    """Says to which part of a file mistakes belong."""
    try:
        yield
    except InputError as error:
        raise InputError(*(f"{where}: {line}" for line in error.args)) from error


@dataclass(frozen=True, eq=False)
class _Loading:
    """An experiment's tables, while all that they name is looked up."""

    declared: Declaration
    path: Path
    searched: dict[str, str] = field(default_factory=dict)
    """What scenarios of searches are, by content."""

    def experiment(self) -> Experiment:
        """Returns the experiment, or raises an InputError."""
        declared, path = self.declared, self.path
        learners = {each.name: each for name in declared.algorithms for each in self.learners(name)}
        if len({learner.title for learner in learners.values()}) < len(learners):
            raise InputError(f"{path}: algorithms: accepted: learners whose titles differ.")
        with _of_file(str(path)):
            scenarios = {Path(name).stem: load_scenario(name) for name in declared.scenarios}
        populations = [
            self.population(condition, scenario, learner)
            for condition in declared.conditions.values()
            for scenario in self.scenarios(condition)
            for learner in learners.values()
            if condition.has(learner.variant, learner.observation)
        ]
        n_runs = sum(len(population.seeds) for population in populations)
        if n_runs > MAX_RUNS:
            raise InputError(f"{path}: {n_runs:,} runs; accepted: at most {MAX_RUNS:,}.")
        self.check_scenarios(populations)
        if not declared.is_miniature:  # whose budget hides changes
            self.check_settings(populations)
            self.check_changes(populations)
        # A miniature has a file of chosen settings of its own.
        path = path.with_stem(declared.name)
        return Experiment(declared, path, learners, scenarios, populations)

    def learners(self, name: str) -> list[Learner]:
        """Returns the learners of a variant.

        A variant counts as what its algorithm is, but a net without hidden layers is linear, or a
        table if it learns from one-hot observations alone: it has a row of weights for each
        observation. If this differs between its forms of observation or its picks, the variant counts
        as what its algorithm is.
        """
        variant, where = self.declared.algorithms[name], f"{self.path}: algorithms.{name}"
        algorithm, chosen = load_algorithm(variant.algorithm, where), self.chosen(name)
        of = self.declared.algorithms.get(variant.reference_for, variant)
        for form in variant.observations:
            accepted = {*algorithm.observations} & {*of.observations}
            if form not in algorithm.observations or form not in of.observations:
                unknown_name(where, f"observation for {variant.algorithm}", form, accepted)
        learners = [
            Learner(name, form, variant, algorithm, algorithm.family, chosen.get(form))
            for form in variant.observations
        ]
        first = next(iter(self.declared.conditions.values()))
        families = {_family(each, own) for each in learners for own in self.settings(each, first)}
        if len(families) > 1:
            return learners
        return [replace(learner, family=family) for learner in learners for family in families]

    def chosen(self, name: str) -> dict[str, Chosen]:
        """Returns what a search has chosen for the learners of a variant, by observation.

        Its scenarios and seeds must not be those of the search.
        """
        variant = self.declared.algorithms[name]
        if not variant.tuned_by:
            return {}
        where = f"{self.path}: algorithms.{name}.tuned_by = {variant.tuned_by}"
        name_of_search, searched = variant.source
        if not name_of_search:
            raise InputError(f'{where}: accepted: "EXPERIMENT:VARIANT".')
        declared, path = read_experiment(name_of_search)
        if declared.search is None:
            raise InputError(f"{where}: {path} has no table [search]; accepted: one that has.")
        if searched not in declared.algorithms:
            unknown_name(where, f"variant of {path}", searched, declared.algorithms)
        for condition in self.declared.conditions.values():
            own = self.declared.seeds_of(name, condition)
            for taken in (declared.algorithms[searched].all_seeds, declared.search.fresh):
                if overlap(own, taken):
                    used = f"the search has used the seeds {taken.start} to {taken.stop - 1}"
                    accepted = f"seeds other than {own.start} to {own.stop - 1}"
                    raise InputError(f"{where}: {used}; accepted: {accepted}.")
        for scenario in map(load_scenario, declared.scenarios):
            reason = f"{scenario.name}, a scenario of the search {name_of_search}"
            self.searched[_content(scenario)] = reason
        made = read_chosen(path, where)
        if made.search != digest_of_search(declared):
            problem = f"{path} was made by another version of the search"
            raise InputError(f"{where}: {problem}; run it again, with --report.")
        names = {form: f"{searched}, {form}" for form in variant.observations}
        for learner in names.values():
            if learner not in made.learners:
                unknown_name(where, "learner of the search", learner, made.learners)
        return {form: made.learners[learner] for form, learner in names.items()}

    def scenarios(self, condition: Condition) -> Iterator[Scenario]:
        """Yields the scenarios as they are under a condition."""
        with _of_file(f"{self.path}: {condition.name}"):
            for name in self.declared.scenarios:
                yield load_scenario(name, condition.of_scenario(Path(name).stem))

    def layers(self, learner: Learner, condition: Condition) -> Iterator[list[dict[str, object]]]:
        """Yields a learner's settings with each of its picks, by dotted key: later ones count.

        They are those of all variants, the pick, those of the variant and those of the condition.
        """
        found, shared = learner.chosen, _flat(self.declared.settings)
        own = _flat(learner.declared.settings)
        changed = _flat(condition.of_settings(learner.variant))
        for pick in [{}] if found is None else [each.settings for each in found.picks or (found,)]:
            yield [shared, _flat(pick), own, changed]

    def settings(self, learner: Learner, condition: Condition) -> list[LearnerSettings]:
        """Returns a learner's settings under a condition, checked; several if there are several picks."""
        cls, where = (
            learner.algorithm.settings,
            f"{self.path}: algorithms.{learner.variant}.settings",
        )
        if condition.name != DEFAULT_CONDITION:
            where += f" ({condition.name})"
        given = [override({}, _merged(each), where) for each in self.layers(learner, condition)]
        if self.declared.is_miniature:
            given = [_in_miniature(each, cls) for each in given]
        return [parse(cls, each, where) for each in given]

    def population(self, condition: Condition, scenario: Scenario, learner: Learner) -> Population:
        """Returns the runs of a learner."""
        declared, variant = self.declared, learner.declared
        picks = self.settings(learner, condition)
        evaluation_every = declared.evaluation_every
        map_every = declared.map_every or evaluation_every
        if declared.is_miniature:
            evaluation_every = max(picks[0].budget // 4, 1)
            map_every = 2 * evaluation_every
        solved = None
        if declared.solved is not None:  # the version is that of what is recorded
            solved = declared.solved.model_dump(mode="json")
            solved |= {"policy": variant.policy, "version": 2}
        versions = {
            "algorithm": learner.algorithm.version,
            "evaluation": dynamic_programming.VERSION,
            "model": model.VERSION,
        }
        seeds = declared.seeds_of(learner.variant, condition)
        beside = declared.seeds_of(variant.reference_for or learner.variant, condition)
        firsts = tuple(
            RunSpecification(
                stream=declared.stream or declared.name,
                condition=condition.name,
                scenario=scenario,
                variant=learner.variant,
                algorithm=variant.algorithm,
                versions=versions,
                observation=learner.observation,
                settings=settings,
                horizon=declared.horizon,
                evaluation_every=evaluation_every,
                map_every=map_every,
                seed=seeds[0],
                solved=solved,
            )
            for settings in picks
        )
        return Population(condition, scenario, learner, firsts, seeds, beside)

    def check_scenarios(self, populations: Iterable[Population]) -> None:
        """Refuses scenarios of a search, under whatever name."""
        for scenario in {id(each.scenario): each.scenario for each in populations}.values():
            if self.searched and (reason := self.searched.get(_content(scenario))):
                found = f"{self.path}: {scenario.name} is {reason}"
                raise InputError(f"{found}; accepted: other scenarios.")

    def check_settings(self, populations: Iterable[Population]) -> None:
        """Refuses settings that others replace in all runs."""
        unused = {"settings": {*_flat(self.declared.settings)}}
        for each in populations:
            where = f"algorithms.{each.learner.variant}.settings"
            for _, pick, own, changed in self.layers(each.learner, each.condition):
                unused["settings"] &= pick.keys() | own.keys() | changed.keys()
                unused[where] = unused.get(where, {*own}) & changed.keys()
        for where, keys in unused.items():
            for key in sorted(keys):
                reason = "no run has it, since all replace it"
                raise InputError(f"{self.path}: {where}.{key}: {reason}; remove it.")

    def check_changes(self, populations: Iterable[Population]) -> None:
        """Refuses changes by a reading or a grid that change no run."""
        has_effect: dict[str, bool] = {}
        for each in populations:
            for where, less in _less(each.condition):
                if not has_effect.get(where):
                    has_effect[where] = self.differs(each, less)
        for where, found in has_effect.items():
            if not found:
                raise InputError(f"{self.path}: {where} changes no run; remove it.")

    def differs(self, population: Population, condition: Condition) -> bool:
        """Returns whether the runs of a population differ from those under another condition."""
        with suppress(InputError):
            scenarios = {each.name: each for each in self.scenarios(condition)}
            scenario = scenarios[population.scenario.name]
            other = self.population(condition, scenario, population.learner)
            runs = zip(population.firsts, other.firsts, strict=True)
            return any(x.population != y.population for x, y in runs)
        return True


def _less(condition: Condition) -> Iterator[tuple[str, Condition]]:
    """Yields the keys that a reading or a grid changes, and the condition without each."""
    first, rest = condition.changes[:1], condition.changes[1:]
    for (axis, value), change in zip(condition.axes.items(), first, strict=False):
        for kind in ("scenario", "settings"):
            changed: dict[str, object] = getattr(change, kind)
            for key in changed:
                others = {name: changed[name] for name in changed.keys() - {key}}
                less = change.model_copy(update={kind: others})
                where = f"{axis}s.{value}.{kind}.{key}"
                yield where, replace(condition, changes=(less, *rest))


def digest_of_search(search: Declaration) -> str:
    """Returns a digest of what a search depends on: its file but texts, scenarios and versions."""
    texts = {"description": True, "note": True, "report": True}
    excluded = texts | {"algorithms": {"__all__": {"title"}}}
    content = search.model_dump(mode="json", exclude=excluded)
    content["scenarios"] = [
        load_scenario(each).model_dump(mode="json") for each in search.scenarios
    ]
    algorithms = [
        load_algorithm(variant.algorithm).version for variant in search.algorithms.values()
    ]
    content["versions"] = [*algorithms, dynamic_programming.VERSION]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _content(scenario: Scenario) -> str:
    """Returns a scenario without its name and description, which do not change the task."""
    return scenario.model_dump_json(exclude={"name", "description"})


def _flat(table: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Returns nested tables as one, by dotted key."""
    flat: dict[str, object] = {}
    for key, value in table.items():
        if isinstance(value, dict) and value:
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _in_miniature(settings: dict[str, object], cls: type[LearnerSettings]) -> dict[str, object]:
    """Returns settings with a small budget, which rollouts and intervals of records divide."""
    whole = {key: value for key, value in settings.items() if isinstance(value, int)}
    declared = whole.get("budget", cls.model_fields["budget"].default)
    budget = min(max(declared // 25, 1), 1000)
    rollouts = whole.keys() & {"n_steps", "train_freq", "record_every"}
    small = {key: math.gcd(whole[key], budget) for key in rollouts} | {"budget": budget}
    return settings | small | dict.fromkeys(settings.keys() & {"n_envs"}, 1)


def _family(learner: Learner, settings: LearnerSettings) -> str:
    """Returns what a learner counts as with these settings."""
    net = dict(getattr(settings, "policy_kwargs", None) or {})
    layers = net.get("net_arch")
    if layers is None or len(layers) > 0 or net.get("features_extractor_class"):
        return learner.algorithm.family
    return "tabular" if ENCODINGS[learner.observation] == "one_hot" else "linear"


def all_specifications(
    experiment: Experiment, seeds: Sequence[int] | None = None
) -> list[RunSpecification]:
    """Lists every run of an experiment once; with stages, only those of the first.

    Runs take turns: the first of each population, then the second of each, and so on.
    """
    populations = experiment.populations
    return interleaved([(each, each.runs(each.taken(seeds))) for each in populations])


def interleaved(
    listed: Iterable[tuple[Population, Sequence[RunSpecification]]],
) -> list[RunSpecification]:
    """Lists runs of populations once: the first run of each, then the second of each, and so on.

    An interrupted experiment therefore has runs of every population. A condition that changes nothing
    in a scenario has the same runs there as an earlier condition.
    """
    first: dict[str, RunSpecification] = {}
    for run in chain.from_iterable(zip_longest(*(runs for _, runs in listed))):
        if run is not None:
            first.setdefault(run.digest, run)
    return [*first.values()]
