"""Experiments: what a TOML file declares, and the populations of runs that follow.

An experiment is a product: conditions x scenarios x learners x seeds. A learner is a variant, that
is an algorithm with settings, together with one form of observation. A condition changes values of
scenarios and settings: it is a reading of the paper, a point of a grid or a trial of a search.
Nothing after `load_experiment` looks up a name again, or asks how a condition was declared.
"""

import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product, zip_longest
from os.path import isfile, join  # which take any text for a path
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from agents import Algorithm, LearnerSettings, dynamic_programming, load_algorithm
from benchmark.specification import DEFAULT_CONDITION as DEFAULT_CONDITION
from benchmark.specification import RunSpecification
from benchmark.trials import Chosen, Search, Seed, Space, Values, read_chosen, trials
from envs import InputError, Scenario, inputs, load_scenario, model
from envs.inputs import (
    Count,
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
from envs.sources import search_beside

EXPERIMENT_DIRECTORY = Path(__file__).parent / "experiments"
# The experiments whose results are published, in the order of README. .gitignore lists them, too.
PUBLISHED = ("reproduce", "compare_deep", "when", "suite", "tuning")
_MINIATURE = "_smoke"  # how its name ends
# Folders of results that are not those of an experiment, or not of its declared seeds
_RESERVED = "speed|.*_smoke|.*_seeds_.*"
# Tables that studies of this project do not read
_UNREAD = {
    "comparison": "readings grids search solved",
    "replication": "grids search solved",
    "map": "readings search",
    "search": "readings grids",
    "suite": "readings grids search",
}


# What a file declares


Title = Annotated[Label, Field(max_length=60)]


class Variant(Table):
    """An algorithm with its settings, and the observations from which it learns."""

    algorithm: str
    """One of the algorithms below, or `module:attribute` of any other."""
    title: Title = ""
    """What readers call it; by default its name."""
    observations: Annotated[Names, Field(min_length=1)]
    """Forms of observation; each makes a learner."""
    seeds: Annotated[int, Field(ge=1, le=10_000)]
    """Runs per scenario and condition. With --seeds, learners get shares in proportion."""
    first_seed: Seed = 0
    """The first seed; the others follow it."""
    policy: Literal["greedy", "stochastic"] = "greedy"
    """The policy that is evaluated."""
    settings: Values = Field(default_factory=dict)
    """Settings of the algorithm, see below."""
    search: Space = Field(default_factory=dict)
    """What a search varies: a table for each setting, by dotted key."""
    candidates: tuple[Values, ...] = ()
    """Further trials of a search, after those drawn: settings that are known to work, by dotted
    key. All variants have as many."""
    scenarios: Names = ()
    """Names of the scenarios in which a search tries it; all by default."""
    tuned_by: Line = ""
    """`EXPERIMENT:VARIANT`: learners take what that search has chosen for them, except their own
    settings."""

    def numbered(self, n: int | None = None) -> range:
        """Returns the seeds of its runs, or of n runs."""
        return range(self.first_seed, self.first_seed + (n or self.seeds))


class Change(Table):
    """A change of scenarios and settings. All conditions have the same random streams."""

    scenario: Values = Field(default_factory=dict)
    """Changes of scenarios, as dotted keys."""
    scenarios: Names | None = None
    """Names of the scenarios that it changes; all by default."""
    settings: Values = Field(default_factory=dict)
    """Changes of the settings of every variant, as dotted keys."""


class Reading(Change):
    """One way to read the paper, or a control."""

    title: Title = ""
    """What a figure calls it; by default its name."""
    answer: Annotated[Text, Field(min_length=1)]
    """How it answers what the paper leaves open."""
    curve: Literal["visited", "table"] = "visited"
    """The maximum Q that claims are about: of the visited observations, or of the whole table."""
    seeds: Annotated[int, Field(ge=2, le=10_000)] | None = None
    """Runs per scenario and learner; by default the variant's."""


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
    """Conditions that are the product of axes, with changes at all its points: a map draws them."""

    learners: Names = ()
    """Names of learners, or of variants with all their observations; all by default. A learner that
    no grid names is in all grids."""
    axes: Annotated[dict[Name, Axis], Field(min_length=1)]
    """Changes at each value of an axis, as `axes.AXIS.VALUE`. A value is a number, or two joined by
    "x"."""


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
    """Share of the budget after which a run is given up, at the next evaluation, if success has
    never reached half of the level. From then on its curves stay constant, so it never learns; it
    ends there if it can."""


@dataclass(frozen=True)
class Condition:
    """Values of axes, which change scenarios and settings."""

    keys: Mapping[str, str | int]
    """The columns that name it in tables: a `reading`, a `grid` and a `point`, or a `trial`."""
    changes: tuple[Change, ...] = ()
    """What its values change, in this order."""
    learners: tuple[str, ...] = ()
    """Names of learners, or of variants, that run under it; by default all. Those that no condition
    names run under all."""
    seeds: int | None = None
    """Runs of each learner; by default as many as its variant declares."""

    @property
    def name(self) -> str:
        """A reading, GRID/POINT or "trial N"; "default" if there is none of them."""
        names = (f"trial {key}" if isinstance(key, int) else key for key in self.keys.values())
        return "/".join(names) or DEFAULT_CONDITION

    def scenario(self, name: str) -> Values:
        """Returns what it changes of a scenario, by dotted key."""
        return _merged(
            change.scenario
            for change in self.changes
            if change.scenarios is None or name in change.scenarios
        )


def _merged(tables: Iterable[Values]) -> Values:
    merged = Values()
    for table in tables:
        for key in table:
            merged.pop(key, None)  # a later value comes later, so `a = {}` undoes an earlier `a.b`
        merged |= table
    return merged


class Declaration(Table):
    """A declared set of runs: every condition, scenario and learner, each with its seeds."""

    name: Name
    """The stem of the file."""
    description: Text
    """What the experiment is about, for readers."""
    report: Values | None = None
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
    evaluation_every: Count
    """Steps from one evaluation of the policy to the next, in units of the budget."""
    map_every: Count | None = None
    """Steps from one record of all values to the next: a multiple of `evaluation_every`, by default
    equal to it. With `solved`, values are not recorded."""
    settings: Values = Field(default_factory=dict)
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
    """With this table, runs are measured until they have learned."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        kind = str((self.report or {}).get("kind"))
        for name in _UNREAD.get(kind, "").split():
            require(not getattr(self, name), f"{name} in a {kind}", "no such table")
        inputs.distinct(self.scenario_names, "scenarios: ")
        every, maps = self.evaluation_every, self.map_every
        if maps is not None:
            found = f"map_every = {maps}"
            require(self.solved is None, found, "no such key, as solved records no values")
            require(maps % every == 0, found, f"a multiple of evaluation_every = {every}")
        self._check_variants()
        for condition in [] if self.search else self.conditions:
            for change in condition.changes:
                self._check_scenarios(change.scenarios or (), condition.name)
            for kind in ("scenario", "settings"):
                keys = chain(*(getattr(change, kind) for change in condition.changes))
                inputs.distinct(tuple(keys), f"{condition.name}: {kind}.")
        return self

    def _check_variants(self) -> None:
        efforts = set()
        for name, variant in self.algorithms.items():
            where = f"algorithms.{name}"
            is_searched = bool(variant.search) == (self.search is not None)
            accepted = "in each variant, together with a table [search], or in none"
            require(is_searched, f"{where}.search", accepted)
            for key in ("candidates", "scenarios"):
                is_read = self.search is not None or not getattr(variant, key)
                require(is_read, f"{where}.{key}", "only together with a table [search]")
            self._check_scenarios(variant.scenarios, where)
            if self.search is not None:
                tried = chain(variant.search, *variant.candidates)
                require("budget" not in tried, f"{where}: a search of budget", "other settings")
                _check_apart(variant.numbered(), self.search.fresh, f"{where}.first_seed")
                efforts.add((variant.seeds, len(variant.candidates)))
        accepted = "as many seeds and candidates in each variant of a search"
        require(len(efforts) < 2, "algorithms", accepted)

    def _check_scenarios(self, names: Names, where: str) -> None:
        for name in names:
            found = f"{where}: scenarios: {name}{inputs.guess(name, self.scenario_names)}"
            require(name in self.scenario_names, found, ", ".join(self.scenario_names))

    @property
    def scenario_names(self) -> tuple[str, ...]:
        """The names of scenarios."""
        return tuple(Path(name).stem for name in self.scenarios)

    @property
    def is_miniature(self) -> bool:
        """Whether it only checks that everything works, see `miniature`."""
        return self.name.endswith(_MINIATURE)

    def miniature(self) -> "Declaration":
        """Returns the same experiment with two runs of each learner and a search of few trials.

        Budgets are divided when settings are resolved.
        """
        readings = {
            name: reading.model_copy(update={"seeds": reading.seeds and min(reading.seeds, 4)})
            for name, reading in self.readings.items()
        }
        variants = {
            name: variant.model_copy(
                update={"seeds": min(variant.seeds, 2), "candidates": variant.candidates[:1]}
            )
            for name, variant in self.algorithms.items()
        }
        changed = {
            "name": f"{self.name}{_MINIATURE}",
            "note": "This miniature only checks that everything works: its numbers mean nothing.",
            "algorithms": variants,
            "readings": readings,
            "search": self.search and self.search.miniature(),
        }
        return self.model_copy(update=changed)

    @cached_property
    def conditions(self) -> list[Condition]:
        """Readings, the default one first, points of grids, or trials of each variant in turn."""
        found = [
            Condition({"reading": name}, (self.readings[name],), seeds=self.readings[name].seeds)
            for name in sorted(self.readings, key=lambda name: name != DEFAULT_CONDITION)
        ]
        for name, grid in self.grids.items():
            axes = (
                [(f"{axis} {value}", change) for value, change in values.items()]
                for axis, values in grid.axes.items()
            )
            for values in product(*axes):
                points, changes = zip(*values, strict=True)
                keys = {"grid": name, "point": ", ".join(points)}
                found.append(Condition(keys, (grid, *changes), grid.learners))
        tried = {name: self.trials_of(name) for name in self.algorithms if self.search}
        for t, of_all in enumerate(zip(*tried.values(), strict=True)):
            for name, settings in zip(tried, of_all, strict=True):
                found.append(Condition({"trial": t}, (Change(settings=settings),), (name,)))
        return found or [Condition({})]

    def trials_of(self, name: str) -> list[Values]:
        """Returns what each trial of a variant changes, by dotted key."""
        assert self.search is not None
        variant = self.algorithms[name]
        drawn = trials(name, variant.search, self.search.trials)
        return [*drawn, *map(_flat, variant.candidates)]


def _check_apart(own: range, taken: range, where: str) -> None:
    """Refuses seeds that a search uses."""
    require(
        own.start not in taken and taken.start not in own,
        f"{where}: a search uses the seeds {taken.start} to {taken.stop - 1}",
        f"seeds other than {own.start} to {own.stop - 1}",
    )


class Extension(Table):
    """An experiment that differs from another, which extends none, in some values."""

    extends: str
    """A shipped experiment's name, or the path of a TOML file."""
    description: Text
    """What the experiment is about, for readers."""
    changes: Values
    """New values, by dotted key. The base's `note` and `report.question` are dropped, and with a
    new table `solved` its `map_every`, too."""


def experiment_names() -> list[str]:
    """Lists the shipped experiments: one TOML file each, named after it."""
    return sorted(path.stem for path in EXPERIMENT_DIRECTORY.glob("*.toml"))


def read_experiment(experiment: str | Path) -> tuple[Declaration, Path]:
    """Reads an experiment's tables and checks their form, not yet what they name.

    Returns also their file. Refuses, by an InputError, a file that cannot be read, and keys and
    values that are not accepted.
    """
    path = _path(experiment)
    inputs.check_file_name(path, "results are")
    is_own = path.resolve().parent != EXPERIMENT_DIRECTORY
    if is_own and re.fullmatch("|".join([_RESERVED, *experiment_names()]), path.stem):
        accepted = "any name but speed, *_smoke, *_seeds_* and those of shipped experiments"
        raise InputError(f"{path}: results are named after the file; accepted: {accepted}.")
    declared = parse(Declaration, _read(path), str(path), name=path.stem)
    scenarios = tuple(_beside(path, name) for name in declared.scenarios)
    return declared.model_copy(update={"scenarios": scenarios}), path


def is_from_bench(path: Path) -> bool:
    """Returns whether `bench` wrote this file, among results, where no code is looked for."""
    return path.stem.startswith("bench_") and path.resolve().parent.name == path.stem


def _beside(path: Path, name: str) -> str:
    """Returns a path from the folder of an experiment's file, if it exists, else as it is."""
    beside = join(path.parent, name)  # noqa: PTH118
    return beside if isfile(beside) else name  # noqa: PTH113


def _path(experiment: str | Path) -> Path:
    if Path(experiment).suffix == ".toml":
        return Path(experiment)
    if (name := str(experiment)) not in experiment_names():
        other = "the path of a .toml file"
        unknown_name("experiments", "experiment", name, experiment_names(), other)
    return EXPERIMENT_DIRECTORY / f"{name}.toml"


def _read(path: Path) -> Values:
    """Reads an experiment's tables; those of an extension are those of its base with changes."""
    data = _tables(path)
    if "extends" in data:
        extension = parse(Extension, data, str(path))
        base = _path(_beside(path, extension.extends))
        search_beside(base)
        data = _tables(base)
        # These may be false of this one.
        described = {"description": extension.description, "note": ""}
        if "solved" in extension.changes:
            data.pop("map_every", None)
        if isinstance(data.get("report"), dict):
            described["report.question"] = ""
        for changes in (described, extension.changes):
            data = override(data, changes, str(path))
    if not is_from_bench(path):
        search_beside(path)
    return data


def _tables(path: Path) -> Values:
    """Reads the tables of one file."""
    data = inputs.read_toml(path)
    if isinstance(data.get("report"), str):
        data["report"] = {"kind": data["report"]}
    return data


# What follows from it


# What readers call forms of observation
OBSERVED = {
    "index": "the cells' index",
    "one_hot": "one-hot cells",
    "factored": "one-hot rows and columns",
    "tiles": "tiles",
    "coordinates": "coordinates",
    "centred": "centred coordinates",
    "offset": "the offset's index",
    "offset_one_hot": "one-hot offsets",
    "offset_factored": "one-hot rows and columns of offsets",
    "offset_tiles": "tiles of offsets",
    "offset_coordinates": "offset coordinates",
    "offset_centred": "centred offset coordinates",
    "relative_coordinates": "everybody's offsets",
    "relative_centred": "everybody's centred offsets",
    "planes": "images of the room",
}
# A table has a row for each observation, in whatever form it is given.
_ROWS = {"index": "", "one_hot": "", "offset": " of offsets"}


@dataclass(frozen=True, eq=False)
class Learner:
    """A variant with one form of observation."""

    variant: str
    observation: str
    declared: Variant
    algorithm: Algorithm
    chosen: Chosen | None
    """What its search has chosen for it, if it has one."""

    @property
    def name(self) -> str:
        """Its name in files."""
        return f"{self.variant}, {self.observation}"

    @property
    def title(self) -> str:
        """What readers call it, for example "Q-learning table of offsets"."""
        observed = f" on {OBSERVED.get(self.observation, self.observation)}"
        if self.algorithm.family == "tabular":
            observed = _ROWS.get(self.observation.removesuffix("_one_hot"), observed)
        return (self.declared.title or self.variant) + observed

    @property
    def policy(self) -> str:
        """The policy that counts: "greedy" or "stochastic"."""
        return self.declared.policy

    @property
    def search(self) -> str:
        """The search that its settings come from; empty if they are declared."""
        return self.declared.tuned_by.rpartition(":")[0]


@dataclass(frozen=True, eq=False)
class Population:
    """Runs of a learner in a scenario under a condition, which differ by seed."""

    condition: Condition
    scenario: Scenario  # as it is under the condition
    learner: Learner
    first: RunSpecification
    seeds: range  # as declared
    most: int  # seeds of any variant of the experiment under the condition

    @property
    def keys(self) -> dict[str, str | int]:
        """The columns that name it in tables."""
        name = self.scenario.name
        return {"scenario": name, **self.condition.keys, "learner": self.learner.name}

    def taken(self, seeds: Sequence[int] | None) -> Sequence[int]:
        """Returns the declared seeds, or a proportional share of given ones, two or more."""
        if seeds is None:
            return self.seeds
        return seeds[: max(2, len(seeds) * len(self.seeds) // self.most)]

    def runs(self, seeds: Iterable[int] | None = None) -> list[RunSpecification]:
        """Lists its runs, with the declared seeds or others."""
        return [self.first.with_seed(seed) for seed in (self.seeds if seeds is None else seeds)]


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


def load_experiment(experiment: str | Path, *, smoke: bool = False) -> Experiment:
    """Reads an experiment, and checks it together with the algorithms and scenarios that it names.

    It is the name of a shipped experiment, or the path of a TOML file. With `smoke`, it is a
    miniature, with two runs of each learner and a twenty-fifth of the budget, at most 1,000. A
    mistake is an InputError with a sentence. What a report demands is checked by its study.
    """
    declared, path = read_experiment(experiment)
    return _Loading(declared.miniature() if smoke else declared, path).experiment()


@contextmanager
def _of_file(where: str) -> Iterator[None]:
    """Says to which part of a file mistakes belong."""
    try:
        yield
    except ValueError as error:
        lines = (f"{where}: {str(line).removesuffix('.')}." for line in error.args)
        raise InputError(*lines) from error


class _Loading:
    """An experiment's tables, while all that they name is looked up."""

    def __init__(self, declared: Declaration, path: Path) -> None:
        self.declared, self.path = declared, path
        self.searched = set[str]()  # contents of the scenarios of searches
        with _of_file(str(path)):  # without any change, as the file names them
            self.scenarios = {name: load_scenario(name) for name in declared.scenarios}

    def experiment(self) -> Experiment:
        """Returns the experiment, or raises an InputError."""
        declared, path = self.declared, self.path
        learners = {each.name: each for name in declared.algorithms for each in self.learners(name)}
        if len({learner.title for learner in learners.values()}) < len(learners):
            raise InputError(f"{path}: algorithms: accepted: learners whose titles differ.")
        conditions, known = declared.conditions, learners.keys() | declared.algorithms.keys()
        named = {*chain(*(condition.learners for condition in conditions))}
        for name in sorted(named - known):
            unknown_name(f"{path}: grids: learners", "learner", name, known)
        populations = [
            self.population(condition, scenario, each)
            for condition in conditions
            for scenario in self.changed(condition)
            for each in learners.values()
            if scenario.name in (each.declared.scenarios or declared.scenario_names)
            if not condition.learners
            or {each.name, each.variant} & {*condition.learners}
            or not {each.name, each.variant} & named
        ]
        scenarios = {scenario.name: scenario for scenario in self.scenarios.values()}
        # A miniature has a file of chosen settings of its own.
        path = path.with_stem(declared.name)
        return Experiment(declared, path, learners, scenarios, populations)

    def learners(self, name: str) -> Iterator[Learner]:
        """Yields the learners of a variant."""
        variant, where = self.declared.algorithms[name], f"{self.path}: algorithms.{name}"
        algorithm, chosen = load_algorithm(variant.algorithm, where), self.chosen(name)
        for form in variant.observations:
            if form not in algorithm.observations:
                what = f"observation for {variant.algorithm}"
                unknown_name(where, what, form, algorithm.observations)
            if variant.policy not in algorithm.policies:
                what = f"policy of {variant.algorithm}"
                unknown_name(where, what, variant.policy, algorithm.policies)
            yield Learner(name, form, variant, algorithm, chosen.get(form))

    def chosen(self, name: str) -> dict[str, Chosen]:
        """Returns what a search has chosen for the learners of a variant, by observation.

        Its scenarios and seeds must not be those of the search.
        """
        variant = self.declared.algorithms[name]
        if not variant.tuned_by:
            return {}
        where = f"{self.path}: algorithms.{name}.tuned_by = {variant.tuned_by}"
        source, _, searched = variant.tuned_by.rpartition(":")
        declared, path = read_experiment(_beside(self.path, source or searched))
        if declared.search is None or not source:
            raise InputError(f"{where}: accepted: SEARCH:VARIANT of one with a table [search].")
        made = read_chosen(path)
        if made.search != digest_of_search(declared):
            raise InputError(f"{where}: {path} has changed since; run it again, with --report.")
        names = {form: f"{searched}, {form}" for form in variant.observations}
        for name in names.values():
            if name not in made.learners:
                unknown_name(where, "learner of the search", name, made.learners)
        with _of_file(where):
            for condition in self.declared.conditions:
                own = variant.numbered(condition.seeds)
                _check_apart(own, declared.algorithms[searched].numbered(), "seeds")
                _check_apart(own, declared.search.fresh, "seeds")
        self.searched.update(map(_content, map(load_scenario, declared.scenarios)))
        return {form: made.learners[name] for form, name in names.items()}

    def changed(self, condition: Condition) -> Iterator[Scenario]:
        """Yields the scenarios as they are under a condition; none may be that of a search."""
        with _of_file(f"{self.path}: {condition.name}"):
            for name, scenario in self.scenarios.items():
                changes = condition.scenario(scenario.name)
                changed = load_scenario(name, changes) if changes else scenario
                if self.searched and _content(changed) in self.searched:
                    what = f"{changed.name} is a scenario of a search"
                    raise InputError(f"{what}; accepted: other scenarios.")
                yield changed

    def settings(self, learner: Learner, condition: Condition) -> LearnerSettings:
        """Returns a learner's settings, checked.

        Of equal keys the later ones count: shared ones, what a search has chosen, its own, those of
        the condition.
        """
        cls = learner.algorithm.settings
        where = f"{self.path}: algorithms.{learner.variant}.settings ({condition.name})"
        layers = [
            self.declared.settings,
            learner.chosen.settings if learner.chosen else {},
            learner.declared.settings,
            *(change.settings for change in condition.changes),
        ]
        given = override({}, _merged(map(_flat, layers)), where)
        settings = parse(cls, given, where)
        if self.declared.is_miniature:
            return parse(cls, given | _in_miniature(given, settings.budget), where)
        return settings

    def population(self, condition: Condition, scenario: Scenario, learner: Learner) -> Population:
        """Returns the runs of a learner in a scenario, which is as it is under the condition."""
        declared, variant = self.declared, learner.declared
        settings = self.settings(learner, condition)
        evaluation_every = declared.evaluation_every
        map_every = declared.map_every or evaluation_every
        if declared.is_miniature:
            evaluation_every = max(settings.budget // 4, 1)
            map_every = 2 * evaluation_every
        solved = None
        if declared.solved is not None:  # the version is that of what is recorded
            solved = declared.solved.model_dump() | {"policy": variant.policy, "version": 2}
        seeds = variant.numbered(condition.seeds)
        first = RunSpecification(
            stream=declared.stream or declared.name,
            condition=condition.name,
            scenario=scenario,
            variant=learner.variant,
            algorithm=variant.algorithm,
            versions={
                "algorithm": learner.algorithm.version,
                "evaluation": dynamic_programming.VERSION,
                "model": model.VERSION,
            },
            observation=learner.observation,
            settings=settings,
            horizon=declared.horizon,
            evaluation_every=evaluation_every,
            map_every=map_every,
            seed=seeds[0],
            solved=solved,
        )
        most = condition.seeds or max(each.seeds for each in declared.algorithms.values())
        return Population(condition, scenario, learner, first, seeds, most)


def digest_of_search(search: Declaration) -> str:
    """Returns a digest of what a search depends on: its file but texts, scenarios and versions."""
    content = search.model_dump(mode="json", exclude={"description", "note", "report"})
    for variant in content["algorithms"].values():
        del variant["title"]
    scenarios = map(load_scenario, search.scenarios)
    content["scenarios"] = [scenario.model_dump(mode="json") for scenario in scenarios]
    algorithms = [load_algorithm(each.algorithm).version for each in search.algorithms.values()]
    content["versions"] = [*algorithms, dynamic_programming.VERSION]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _content(scenario: Scenario) -> str:
    """Returns a scenario without its name and description, which do not change the task."""
    return scenario.model_dump_json(exclude={"name", "description"})


def _flat(table: Values, prefix: str = "") -> Values:
    """Returns nested tables as one, by dotted key."""
    flat: Values = {}
    for key, value in table.items():
        if isinstance(value, dict) and value:
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _in_miniature(settings: Values, budget: int) -> dict[str, int]:
    """Returns a small budget, and rollouts and intervals of records that divide it."""
    small = {"budget": min(max(budget // 25, 1), 1000)} | dict.fromkeys({"n_envs"} & {*settings}, 1)
    for key in ("n_steps", "train_freq", "record_every"):
        if isinstance(value := settings.get(key), int):
            small[key] = math.gcd(value, small["budget"])
    return small


def interleaved(listed: Iterable[Sequence[RunSpecification]]) -> list[RunSpecification]:
    """Lists runs of populations once: the first run of each, then the second of each, and so on.

    An interrupted experiment therefore has runs of every population. A condition that changes
    nothing in a scenario has the same runs there as an earlier condition.
    """
    first = dict[str, RunSpecification]()
    for run in filter(None, chain.from_iterable(zip_longest(*listed))):
        first.setdefault(run.digest, run)
    return [*first.values()]
