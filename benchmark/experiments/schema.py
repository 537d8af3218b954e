"""The tables of an experiment, as read from TOML.

An experiment is a product: conditions x scenarios x learners x seeds. A learner is a variant, that is an
algorithm with settings, together with one observation. A condition changes values of scenarios and settings:
it is a reading of the paper, a point of a grid or a trial of a search.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property, partial
from itertools import product
from os.path import isfile, join  # which take any text for a path
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from benchmark.experiments.search import Search, Space, trials
from envs import InputError, inputs
from envs.inputs import Label, Line, Name, Names, Table, Text, require
from envs.sources import find_modules_in

EXPERIMENT_DIRECTORY: Final = Path(__file__).parent
DEFAULT_CONDITION: Final = "default"
# Folders of results that are not those of an experiment, or not of its declared seeds
_RESERVED: Final = ("speed", "*_smoke", "*_seeds_*")
_MINIATURE: Final = "_smoke"  # how its name ends
# What a reference implementation takes from its variant, and does not set itself.
_SHARED: Final = {"settings", "policy", "tuned_by"}

# Palette of variants in figures, see `benchmark.drawing.style.PALETTE`.
Colour = Literal[
    "black", "grey", "silver", "ash", "green", "olive", "lime", "blue", "navy", "violet", "orange", "brown"
]


class Variant(Table):
    """An algorithm with its settings, and the observations from which it learns.

    A *reference implementation* of another variant learns the same by other code. It takes that variant's
    settings, its policy and, unless it names some of them, its observations.
    """

    algorithm: str
    """One of the algorithms below, or `module:attribute` of any other."""
    title: Annotated[Label, Field(max_length=60)] = ""
    """What readers call it; by default its name."""
    colour: Colour | None = None
    """Its colour and marker in figures; by default those that no other variant of the experiment has."""
    observations: Annotated[Names, Field(min_length=1)]
    """Forms of observation; each makes a learner."""
    seeds: Annotated[int, Field(ge=1, le=100_000)]
    """Runs per scenario and condition."""
    first_seed: Annotated[int, Field(ge=0, le=900_000)] = 0
    """The first seed; the others follow it."""
    policy: Literal["greedy", "stochastic"] = "greedy"
    """The policy that a comparison evaluates."""
    settings: dict[str, object] = Field(default_factory=dict)
    """Settings of the algorithm, see below."""
    reference_for: str = ""
    """The variant that this is a reference implementation of. With --seeds it gets a proportional share."""
    search: Space = Field(default_factory=dict)
    """What a search varies: a table for each setting, by dotted key."""
    tuned_by: Line = ""
    """`EXPERIMENT:VARIANT`: learners take what that search has chosen for them, except their own settings. If
    the search has several parts, the runs of a learner take turns with their picks."""

    @property
    def source(self) -> tuple[str, str]:
        """The search in `tuned_by`, and the variant there; empty texts without a search."""
        search, _, variant = self.tuned_by.rpartition(":")
        return search, variant


class Changes(Table):
    """Changes of scenarios and settings, as dotted keys. All conditions have the same random streams."""

    scenario: dict[str, object] = Field(default_factory=dict)
    """Changes of scenarios, as dotted keys."""
    scenarios: Names | None = None
    """Names of the scenarios that it changes; all by default."""
    settings: dict[str, object] = Field(default_factory=dict)
    """Changes of the settings of every variant, as dotted keys."""


class Reading(Changes):
    """One way to read the paper, or a control."""

    title: Annotated[Label, Field(max_length=60)] = ""
    """What a figure calls it; by default its name."""
    question: Annotated[Text, Field(min_length=1)]
    """What the paper leaves open."""
    answer: Annotated[Text, Field(min_length=1)]
    """How this reading answers it."""
    curve: Literal["visited", "table"] = "visited"
    """Which maximum Q the claims are about: of the visited observations, or of the whole table."""
    seeds: Annotated[int, Field(ge=2, le=100_000)] | None = None
    """Runs per scenario and learner; by default the variant's."""


# A float distinguishes numbers of at most fifteen digits.
Value = Annotated[
    str,
    inputs.accepted_if(
        lambda value: re.fullmatch(r"(?=.{1,15}$)[0-9]+(\.[0-9]+)?(x[0-9]+)?", value) is not None,
        'a number of at most 15 characters, or two joined by "x", such as 4, 0.5 or 5x6',
    ),
]


class Grid(Changes):
    """Conditions that are the product of axes, with changes at all its points. A map draws grids."""

    question: Label = ""
    """What the grid is to answer, for readers."""
    learners: Names = ()
    """Names of learners, or of variants with all their observations; all by default. A learner that no grid
    names is in all grids."""
    axes: Annotated[dict[Name, Annotated[dict[Value, Changes], Field(min_length=1)]], Field(min_length=1)]
    """Changes at each value of an axis, as `axes.AXIS.VALUE`. A value is a number, or two joined by "x"."""
    is_compared: bool = True
    """Whether a map decides contrasts at its points."""

    @property
    def points(self) -> dict[str, dict[str, str]]:
        """The value of each axis at every point of their product, by the point's name.

        >>> axes = {"room": {"5x6": Changes()}, "places": {"4": Changes(), "8": Changes()}}
        >>> Grid(axes=axes).points.keys()
        dict_keys(['room=5x6/places=4', 'room=5x6/places=8'])
        """
        points = (dict(zip(self.axes, values, strict=True)) for values in product(*self.axes.values()))
        return {"/".join(f"{axis}={value}" for axis, value in point.items()): point for point in points}


class Solved(Table):
    """When a run has solved its scenario.

    It has solved it at the first evaluation from which exact success stays at or above a level until the
    first one at or after twice as many steps, or to the end of the budget. If its algorithm can end early, a
    run ends once that is certain. Only curves are recorded.
    """

    success: Annotated[float, Field(gt=0, le=1)] = 0.9
    """The level."""
    growth: Annotated[float, Field(ge=1.001, le=2)] = 1.15
    """Approximate ratio of the steps of one evaluation to those of the one before."""
    given_up_after: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Share of the budget after which a run is given up, at the next evaluation, if success has never reached
    half of the level. From then on its curves stay constant, so it never learns; it ends there if it can."""


@dataclass(frozen=True)
class Condition:
    """A named change of scenarios and settings: a reading, a point of a grid, or a trial of a search."""

    name: str
    """The name of the reading; GRID/AXIS=VALUE for all axes, or trial=NUMBER."""
    changes: Mapping[str, Changes] = field(default_factory=dict)
    """What it changes, in this order, by the tables of the file."""
    axes: Mapping[str, str] = field(default_factory=dict)
    """Of a point, its grid and the value of every axis; of a trial, its number."""
    learners: tuple[str, ...] = ()
    """Names of the learners, or of their variants, that run under it; all if it is empty."""
    of_variants: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    """Of a trial, changes of settings by variant."""

    def has(self, variant: str, observation: str) -> bool:
        """Returns whether a learner runs under it."""
        return not self.learners or not {variant, f"{variant}, {observation}"}.isdisjoint(self.learners)

    def scenario_changes(self, scenario: str) -> dict[str, object]:
        """Returns what it changes of a scenario, by dotted key."""
        changes = self.changes.values()
        applied = (each for each in changes if each.scenarios is None or scenario in each.scenarios)
        return {key: value for change in applied for key, value in change.scenario.items()}

    def settings_changes(self, variant: str) -> dict[str, object]:
        """Returns what it changes of a variant's settings, by dotted key."""
        changes = (*(change.settings for change in self.changes.values()), self.of_variants.get(variant, {}))
        return {key: value for changed in changes for key, value in changed.items()}


class Declaration(Table):
    """A declared set of runs: every condition, scenario, variant and observation, each with its seeds."""

    name: Name
    """The stem of the file."""
    description: Text
    """What the experiment is about, for readers."""
    report: dict[str, object] | None = None
    """What is drawn, see below; a text stands for a table with this `kind`. Without it, nothing is drawn."""
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
    map_every: Annotated[int, Field(ge=1, le=10**9)]
    """Steps from one record of all values to the next: a multiple of `evaluation_every`."""
    evaluated_from: Annotated[tuple[Literal["start", "every_cell"], ...], Field(min_length=1)] = ("start",)
    """Where evaluated episodes start: at the scenario's start cell, or in a cell drawn uniformly."""
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
    """With this table, runs are measured until they solve their scenario; a search compares how early."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        inputs.check_all(self._check_conditions, self._check_schedules, self._check_search)
        return self

    def _check_conditions(self) -> None:
        tables = {"readings": self.readings, "grids": self.grids, "search": self.search}
        given = [name for name, table in tables.items() if table]
        require(len(given) < 2, " and ".join(given), "one of readings, grids and search")
        is_named = not self.readings or DEFAULT_CONDITION in self.readings
        require(is_named, "readings", f"one named {DEFAULT_CONDITION} among them")
        stems = [Path(name).stem for name in self.scenarios]
        for name, reading in self.readings.items():
            for stem in {*(reading.scenarios or ())}.difference(stems):
                require(False, f"readings.{name}.scenarios: {stem}", ", ".join(stems))
        known = {*self.algorithms, *self._learners}
        for name, grid in self.grids.items():
            for learner in grid.learners:
                where = f"grids.{name}.learners: {learner}"
                require(learner in known, where, ", ".join(f'"{each}"' for each in sorted(known)))

    def _check_schedules(self) -> None:
        starts = f"evaluated_from = {list(self.evaluated_from)}"
        require("start" in self.evaluated_from, starts, '"start" among them')
        accepted = f"a multiple of evaluation_every = {self.evaluation_every}"
        require(self.map_every % self.evaluation_every == 0, f"map_every = {self.map_every}", accepted)
        inputs.distinct(tuple(Path(name).stem for name in self.scenarios), "scenarios: ")

    def _check_search(self) -> None:
        if self.search is None:
            for name, variant in self.algorithms.items():
                require(not variant.search, f"algorithms.{name}.search", "a table [search] beside it")
            return
        efforts = [
            (variant.seeds, (self.settings | variant.settings).get("budget"))
            for variant in self.algorithms.values()
        ]
        is_fair = all(effort == efforts[0] for effort in efforts)
        require(is_fair, "algorithms", "the same seeds and budget for all in a search")
        inputs.check_all(*(partial(self._check_searched, name) for name in self.algorithms))

    def _check_searched(self, name: str) -> None:
        variant, where = self.algorithms[name], f"algorithms.{name}"
        require(bool(variant.search), where, "a table search, as the experiment has one")
        require("budget" not in variant.search, f"{where}.search.budget", "other settings")
        seeds, fresh = self.seeds_of_search(name)
        accepted = f"seeds outside {fresh.start} to {fresh.stop - 1}, which its finalists use"
        require(not overlap(seeds, fresh), f"{where}.first_seed = {variant.first_seed}", accepted)

    @property
    def _learners(self) -> dict[str, str]:
        """The variant of every learner."""
        variants = self.algorithms.items()
        return {f"{name}, {form}": name for name, variant in variants for form in variant.observations}

    @property
    def argument(self) -> str:
        """How the experiment is given on the command line."""
        name = self.name.removesuffix(_MINIATURE)
        given = name if name in experiment_names() else f"PATH/{name}.toml"
        return f"{given} --smoke" if self.is_miniature else given

    @property
    def is_miniature(self) -> bool:
        """Whether it only checks that everything works, see `miniature`."""
        return self.name.endswith(_MINIATURE)

    def miniature(self) -> "Declaration":
        """Returns the same experiment with two runs of each learner and a search of few trials.

        Budgets are divided when settings are resolved, see `benchmark.experiments.experiment`.
        """
        variants = {
            name: variant.model_copy(update={"seeds": min(variant.seeds, 2)})
            for name, variant in self.algorithms.items()
        }
        readings = {
            name: reading.model_copy(update={"seeds": reading.seeds and 4})  # twice those of others
            for name, reading in self.readings.items()
        }
        search = self.search
        if search is not None:
            small = {"parts": min(search.parts, 2), "trials": 3, "finalists": 1, "seeds": 2}
            search = search.model_copy(update=small)
        note = "This miniature only checks that everything works: its numbers mean nothing."
        changed = {"algorithms": variants, "readings": readings, "search": search}
        return self.model_copy(update=changed | {"name": f"{self.name}{_MINIATURE}", "note": note})

    def seeds_of(self, variant: str, condition: Condition) -> range:
        """Returns the seeds of a variant's runs under a condition."""
        declared, reading = self.algorithms[variant], self.readings.get(condition.name)
        n_seeds = (reading and reading.seeds) or declared.seeds
        return range(declared.first_seed, declared.first_seed + n_seeds)

    def seeds_of_search(self, variant: str) -> tuple[range, range]:
        """Returns the seeds of a variant's trials, and those of its finalists."""
        assert self.search is not None
        first, n = self.algorithms[variant].first_seed, self.algorithms[variant].seeds
        return range(first, first + n), self.search.fresh

    @cached_property
    def conditions(self) -> dict[str, Condition]:
        """All conditions by name: readings, the default one first, points of grids, or trials."""
        made = self._points() if self.grids else self._readings()
        conditions = made if self.search is None else self._trials(self.search)
        return {condition.name: condition for condition in conditions}

    def _readings(self) -> Iterator[Condition]:
        for name in dict.fromkeys((DEFAULT_CONDITION, *self.readings)):
            yield Condition(name, {f"readings.{name}": self.readings.get(name, Changes())})

    def _points(self) -> Iterator[Condition]:
        named = {name for grid in self.grids.values() for name in grid.learners}
        unnamed = [name for name, variant in self._learners.items() if named.isdisjoint((name, variant))]
        for grid_name, grid in self.grids.items():
            table, learners = f"grids.{grid_name}", grid.learners and (*grid.learners, *unnamed)
            for name, point in grid.points.items():
                changes: dict[str, Changes] = {table: grid}
                for axis, value in point.items():
                    changes[f"{table}.axes.{axis}.{value}"] = grid.axes[axis][value]
                yield Condition(f"{grid_name}/{name}", changes, {"grid": grid_name, **point}, learners)

    def _trials(self, search: Search) -> Iterator[Condition]:
        n, parts = search.trials, search.parts
        drawn = {name: trials(name, it.search, n, parts) for name, it in self.algorithms.items()}
        for t in range(n + 1):
            of_variants = {name: settings[t] for name, settings in drawn.items()}
            yield Condition(f"trial={t}", axes={"trial": str(t)}, of_variants=of_variants)


class Extension(Table):
    """An experiment that differs from another in some values."""

    extends: str
    """A shipped experiment's name, or the path of a TOML file."""
    description: str
    """What the experiment is about, for readers."""
    changes: dict[str, object]
    """New values, by dotted key. The base's `note` and `report.question` are dropped."""


def overlap(a: range, b: range) -> bool:
    """Returns whether two ranges of seeds have one in common."""
    return max(a.start, b.start) < min(a.stop, b.stop)


def experiment_names() -> list[str]:
    """Lists the shipped experiments: one TOML file each, named after it."""
    return sorted(path.stem for path in EXPERIMENT_DIRECTORY.glob("*.toml"))


def read_experiment(experiment: str | Path) -> tuple[Declaration, Path]:
    """Reads an experiment's tables and checks their form, not yet what they name; returns also their file.

    Refuses, by an InputError, a file that cannot be read, and keys and values that are not accepted.
    """
    path = _path(experiment)
    inputs.check_file_name(path, "results are")
    if any(fnmatchcase(path.stem, name) for name in _RESERVED):
        accepted = f"any name but {', '.join(_RESERVED)}"
        raise InputError(f"{path}: results are named after the file; accepted: {accepted}.")
    read = inputs.parse(Declaration, _with_references(_read(path), str(path)), str(path), name=path.stem)
    scenarios = tuple(_beside(path, name) for name in read.scenarios)
    return read.model_copy(update={"scenarios": scenarios}), path


def _beside(path: Path, name: str) -> str:
    """Returns a path from the folder of an experiment's file, if there is such a file, else as it is."""
    beside = join(path.parent, name)  # noqa: PTH118
    return beside if isfile(beside) else name  # noqa: PTH113


def _path(experiment: str | Path) -> Path:
    path, names = Path(experiment), experiment_names()
    shipped = EXPERIMENT_DIRECTORY / f"{path.stem}.toml"
    if path.suffix == ".toml":
        if path.stem in names and path.resolve() != shipped.resolve():
            reason = f"results are named after the experiment's file, and {path.stem} is a shipped one"
            raise InputError(f"{path}: {reason}; rename it.")
        return path
    if str(experiment) not in names:
        inputs.unknown_name("experiments", "experiment", str(experiment), names, "the path of a .toml file")
    return shipped


def _read(path: Path, extended_by: tuple[Path, ...] = ()) -> dict[str, object]:
    """Reads an experiment's tables; those of an extension are those of its base with changes.

    Modules beside the file can be imported from now on.
    """
    data = inputs.read_toml(path)
    if path.parent != EXPERIMENT_DIRECTORY:
        find_modules_in(str(path.parent.resolve()))
    if "extends" in data:
        extension = inputs.parse(Extension, data, str(path))
        base = _path(_beside(path, extension.extends))
        if not base.exists() or base in (path, *extended_by):
            reason = f"extends = {json.dumps(extension.extends)}"
            raise InputError(f"{path}: {reason}: accepted: another experiment that exists.")
        data = _read(base, (path, *extended_by))
        # These may be false of this one.
        texts = ["note", *(["report.question"] if "report" in data else [])]
        changes = dict.fromkeys(texts, "") | {"description": extension.description} | extension.changes
        data = inputs.override(data, changes, str(path))
    if isinstance(data.get("report"), str):
        data["report"] = {"kind": data["report"]}
    elif "search" in data:
        data.setdefault("report", {"kind": "search"})
    return data


def _with_references(data: dict[str, object], source: str) -> dict[str, object]:
    """Returns an experiment's tables, references with what they take from their variants."""
    variants = data.get("algorithms")
    if not isinstance(variants, dict) or not all(isinstance(variant, dict) for variant in variants.values()):
        return data  # is refused with the other tables
    own = {name: variant for name, variant in variants.items() if not variant.get("reference_for")}
    complete = {}
    for name, variant in variants.items():
        if name not in own:
            where, of = f"{source}: algorithms.{name}", str(variant["reference_for"])
            if of not in own:
                inputs.unknown_name(f"{where}: reference_for", "variant", of, own)
            for key in sorted(_SHARED & variant.keys()):
                raise InputError(f"{where}.{key}: a reference implementation takes it from {of}; remove it.")
            shared = {key: own[of][key] for key in own[of].keys() & {*_SHARED, "observations"}}
            variant = shared | variant
        complete[name] = variant
    return data | {"algorithms": complete}
