"""Experiments: declared sets of runs, read from TOML and written out as ordered specifications."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from agents import LearnerSettings, Schedule, dynamic_programming, load_algorithm
from envs import InputError, Scenario, load_scenario, model
from envs.inputs import Table, override, parse, read_toml, unknown_name

EXPERIMENT_DIRECTORY = Path(__file__).parent
DEFAULT_READING = "default"


class Arm(Table):
    """An algorithm with its settings, and the observations from which it is to learn."""

    algorithm: str
    observations: Annotated[tuple[str, ...], Field(min_length=1)]
    seeds: Annotated[int, Field(ge=1, le=100_000)]  # runs a scenario, of seeds 0 to seeds - 1
    group: str = ""  # arms of one group are drawn together; those of none are drawn with every group
    settings: dict[str, Any] = Field(default_factory=dict)


class Reading(Table):
    """One way to read the paper, or a control: what it changes, as dotted keys."""

    question: Annotated[str, Field(min_length=1)]
    answer: Annotated[str, Field(min_length=1)]
    scenario: dict[str, Any] = Field(default_factory=dict)
    scenarios: tuple[str, ...] | None = None  # whose scenario it changes; all of them by default
    settings: dict[str, Any] = Field(default_factory=dict)
    curve: Literal["visited", "table"] = "visited"  # which maximum Q the claims are about


class Experiment(Table):
    """A declared set of runs: every reading, scenario, arm and observation, each with its seeds."""

    name: str
    description: str
    report: str  # which tables and figures are drawn of it, see `benchmark.reports`
    items: tuple[str, ...] = ()  # `module:attribute` of further ones
    note: str = ""  # for readers of the results: how settings were chosen, say
    scenarios: Annotated[tuple[str, ...], Field(min_length=1)]
    horizon: Annotated[int, Field(ge=1, le=100_000)]
    evaluation_every: Annotated[int, Field(ge=1, le=10**9)]
    map_every: Annotated[int, Field(ge=1, le=10**9)]  # a multiple of `evaluation_every`
    # Where evaluated episodes start: as the scenario says, or also anywhere, all cells alike.
    evaluated_from: Annotated[tuple[Literal["start", "every_cell"], ...], Field(min_length=1)] = ("start",)
    settings: dict[str, Any] = Field(default_factory=dict)  # of every arm that does not say otherwise
    algorithms: Annotated[dict[str, Arm], Field(min_length=1)]
    readings: dict[str, Reading] = Field(
        default_factory=lambda: {
            DEFAULT_READING: Reading(question="How is the paper read?", answer="as it is by default")
        }
    )

    @model_validator(mode="after")
    def _maps_are_evaluated(self) -> Self:
        if self.map_every % self.evaluation_every:
            raise ValueError(
                f"map_every = {self.map_every}: accepted: a multiple of "
                f"evaluation_every = {self.evaluation_every}"
            )
        return self

    @property
    def argument(self) -> str:
        """What the command line calls it."""
        return self.name if self.name in experiment_names() else f"PATH/{self.name}.toml"

    @property
    def cells(self) -> list[tuple[str, str, str]]:
        """(scenario, arm, observation) of every cell of the grid, as declared."""
        return [
            (scenario, name, observation)
            for scenario in self.scenarios
            for name, arm in self.algorithms.items()
            for observation in arm.observations
        ]


class _Extension(Table):
    """An experiment that is another one but for some values."""

    extends: str  # the name of a shipped experiment
    description: str
    changes: dict[str, Any]  # dotted key to value


@dataclass(frozen=True, eq=False)
class RunSpecification:
    """One run, fully resolved: everything its result depends on."""

    experiment: str
    scenario: Scenario
    arm: str
    algorithm: str
    versions: Mapping[str, int]  # of the algorithm, the model and the evaluation
    observation: str
    settings: LearnerSettings
    horizon: int
    evaluation_every: int
    map_every: int
    evaluated_from: tuple[str, ...]
    seed: int

    @cached_property
    def population(self) -> str:
        """The specification without its seed, as canonical JSON: runs that share it train together."""
        content = {
            "experiment": self.experiment,
            "scenario": self.scenario.model_dump(mode="json"),
            "arm": self.arm,
            "algorithm": self.algorithm,
            "versions": dict(self.versions),
            "observation": self.observation,
            "settings": self.settings.model_dump(mode="json"),
            "horizon": self.horizon,
            "evaluation_every": self.evaluation_every,
            "map_every": self.map_every,
            "evaluated_from": list(self.evaluated_from),
        }
        return json.dumps(content, sort_keys=True, separators=(",", ":"))

    @cached_property
    def content(self) -> str:
        """The whole specification as canonical JSON."""
        return f'{self.population[:-1]},"seed":{self.seed}}}'

    @cached_property
    def digest(self) -> str:
        """The run's identity: SHA-256 of its content."""
        return hashlib.sha256(self.content.encode()).hexdigest()

    @property
    def folder(self) -> str:
        """A readable path for what is written of the run alone."""
        return f"{self.experiment}/{self.scenario.name}/{self.arm}_{self.observation}/seed_{self.seed}"

    @property
    def evaluation_steps(self) -> list[int]:
        """When the policy is evaluated."""
        return evaluation_steps(self.settings.budget, self.evaluation_every)

    @property
    def map_steps(self) -> list[int]:
        """When the values of all cells are kept."""
        return evaluation_steps(self.settings.budget, self.map_every)

    @property
    def schedule(self) -> Schedule:
        """When training is looked at."""
        return Schedule(self.settings.budget, tuple(self.evaluation_steps), tuple(self.map_steps))

    @property
    def seed_sequence(self) -> np.random.SeedSequence:
        """The run's random stream, by what it is called and not by where it stands in a list.

        Readings share their streams: the scenario enters by its name alone, settings not at all.
        """
        names = [self.experiment, self.scenario.name, self.arm, self.observation, self.seed]
        entropy = hashlib.sha256(json.dumps(names).encode()).digest()
        return np.random.SeedSequence(int.from_bytes(entropy))


def evaluation_steps(budget: int, every: int) -> list[int]:
    """Lists when policies are evaluated: from 0 to the budget, the end always included.

    >>> evaluation_steps(600, 250)
    [0, 250, 500, 600]
    """
    return [*range(0, budget, every), budget]


def experiment_names() -> list[str]:
    """Lists the shipped experiments: one TOML file each, named after it."""
    return sorted(path.stem for path in EXPERIMENT_DIRECTORY.glob("*.toml"))


def load_experiment(experiment: str | Path) -> Experiment:
    """Reads an experiment and checks it, with all that it names.

    Args:
      experiment: The name of a shipped experiment, or the path of a TOML file.

    Raises:
      InputError: One sentence that names the file, the key, its value and what is accepted.
    """
    path = _path(experiment)
    data = _read(path)
    loaded = parse(Experiment, data, str(path), name=path.stem)
    if DEFAULT_READING not in loaded.readings:
        raise InputError(f"{path}: the table readings.{DEFAULT_READING} is missing.")
    for name, arm in loaded.algorithms.items():
        where = f"{path}: algorithms.{name}"
        accepted = load_algorithm(arm.algorithm, where).observations
        for observation in arm.observations:
            if observation not in accepted:
                unknown_name(where, f"observation for {arm.algorithm}", observation, accepted)
        for reading in loaded.readings:
            _settings(loaded, name, reading, str(path))
    if loaded.report == "comparison" and len(loaded.readings) > 1:
        raise InputError(f"{path}: readings: a comparison takes the {DEFAULT_READING} one alone.")
    if loaded.report == "replication" and [a.algorithm for a in loaded.algorithms.values()] != ["q_learning"]:
        raise InputError(f"{path}: algorithms: a replication takes a single one, of q_learning.")
    try:
        names = [load_scenario(scenario).name for scenario in loaded.scenarios]
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: scenarios: {name} is named twice.")
    for reading, changes in loaded.readings.items():
        for name in changes.scenarios or ():
            if name not in names:
                unknown_name(f"{path}: readings.{reading}.scenarios", "scenario", name, names)
        for scenario in loaded.scenarios:
            try:
                _scenario(loaded, reading, scenario)
            except InputError as error:
                raise InputError(f"{path}: readings.{reading}.scenario: {error}") from error
    return loaded


def specifications(
    experiment: Experiment,
    reading: str,
    scenario: str,
    arm: str,
    observation: str,
    seeds: Sequence[int] | None = None,
) -> list[RunSpecification]:
    """Lists the runs of one cell of the experiment, in the order of their seeds.

    Args:
      experiment: As loaded.
      reading: A key of its readings.
      scenario: One of its scenarios.
      arm: A key of its algorithms.
      observation: One of the arm's.
      seeds: Other seeds than the declared ones.
    """
    declared = experiment.algorithms[arm]
    algorithm = load_algorithm(declared.algorithm)
    settings = _settings(experiment, arm, reading, experiment.name)
    loaded = _scenario(experiment, reading, scenario)
    versions = {
        "algorithm": algorithm.version,
        "evaluation": dynamic_programming.VERSION,
        "model": model.VERSION,
    }
    return [
        RunSpecification(
            experiment=experiment.name,
            scenario=loaded,
            arm=arm,
            algorithm=declared.algorithm,
            versions=versions,
            observation=observation,
            settings=settings,
            horizon=experiment.horizon,
            evaluation_every=experiment.evaluation_every,
            map_every=experiment.map_every,
            evaluated_from=experiment.evaluated_from,
            seed=seed,
        )
        for seed in (range(declared.seeds) if seeds is None else seeds)
    ]


def all_specifications(experiment: Experiment, seeds: Sequence[int] | None = None) -> list[RunSpecification]:
    """Lists every run of an experiment once: the first seed of every cell, then the second, and so on.

    Whatever part of that has been run so far covers the whole grid. The default reading comes first.
    """
    readings = sorted(experiment.readings, key=lambda name: name != DEFAULT_READING)
    cells = [
        specifications(experiment, reading, *cell, seeds) for reading in readings for cell in experiment.cells
    ]
    rounds = zip_longest(*cells)
    return list({run.digest: run for runs in rounds for run in runs if run is not None}.values())


def _path(experiment: str | Path) -> Path:
    """Returns the file of an experiment, by its name or path."""
    path = Path(experiment)
    shipped = EXPERIMENT_DIRECTORY / f"{path.stem}.toml"
    if path.suffix != ".toml":
        if str(experiment) not in experiment_names():
            accepted = [*experiment_names(), "or the path of a .toml file"]
            unknown_name("experiments", "experiment", str(experiment), accepted)
        return shipped
    if path.stem in experiment_names() and path.resolve() != shipped.resolve():
        raise InputError(
            f"{path}: results go by the file's name, and {path.stem} is a shipped one; rename it."
        )
    return path


def _read(path: Path, readers: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Reads an experiment's tables, changed if it is another one but for some values."""
    data = read_toml(path)
    if "extends" not in data:
        return data
    extension = parse(_Extension, data, str(path))
    base = _path(extension.extends)
    if base in (path, *readers):
        raise InputError(f"{path}: extends = {json.dumps(extension.extends)}: it extends itself.")
    changes = {"description": extension.description} | extension.changes
    return override(_read(base, (path, *readers)), changes, str(path))


def _scenario(experiment: Experiment, reading: str, scenario: str) -> Scenario:
    """Returns a scenario as a reading has it."""
    changes = experiment.readings[reading]
    loaded = load_scenario(scenario)
    if changes.scenarios is not None and loaded.name not in changes.scenarios:
        return loaded
    return load_scenario(scenario, changes.scenario)


def _settings(experiment: Experiment, arm: str, reading: str, source: str) -> LearnerSettings:
    """Returns an arm's settings under a reading, checked."""
    declared = experiment.algorithms[arm]
    cls = load_algorithm(declared.algorithm, f"{source}: algorithms.{arm}").settings
    changed: Mapping[str, Any] = experiment.readings[reading].settings
    where = f"{source}: algorithms.{arm}.settings"
    for key in experiment.settings:
        if key not in cls.model_fields:
            unknown_name(f"{source}: [settings], of {arm} too", "key", key, cls.model_fields)
    if experiment.settings:
        where += " with [settings]"
    if changed:
        where += f" with readings.{reading}.settings"
    return parse(cls, override(experiment.settings | declared.settings, changed, where), where)
