"""Experiments: declared sets of runs, read from TOML and written out as ordered specifications."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from agents import dynamic_programming, load_algorithm
from envs import InputError, Scenario, load_scenario, model
from envs.inputs import Table, override, parse, read_toml, unknown_name

EXPERIMENT_DIRECTORY = Path(__file__).parent / "experiments"
DEFAULT_READING = "default"


class Arm(Table):
    """One line of the comparison: an algorithm, what it observes, and how it is set."""

    algorithm: str
    observation: str
    seeds: Annotated[int, Field(ge=1, le=100_000)]  # runs a scenario, of seeds 0 to seeds - 1
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
    """A declared set of runs: every reading, scenario and arm, each with its seeds."""

    name: str
    description: str
    scenarios: Annotated[tuple[str, ...], Field(min_length=1)]
    horizon: Annotated[int, Field(ge=1, le=100_000)]
    evaluation_every: Annotated[int, Field(ge=1, le=10**9)]
    algorithms: Annotated[dict[str, Arm], Field(min_length=1, max_length=1)]
    readings: dict[str, Reading]


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
    algorithm: str
    versions: Mapping[str, int]  # of the algorithm, the model and the evaluation
    observation: str
    settings: Table
    horizon: int
    evaluation_every: int
    seed: int

    @cached_property
    def population(self) -> str:
        """The specification without its seed, as canonical JSON: runs that share it train together."""
        content = {
            "experiment": self.experiment,
            "scenario": self.scenario.model_dump(mode="json"),
            "algorithm": self.algorithm,
            "versions": dict(self.versions),
            "observation": self.observation,
            "settings": self.settings.model_dump(mode="json"),
            "horizon": self.horizon,
            "evaluation_every": self.evaluation_every,
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
    def evaluation_steps(self) -> list[int]:
        """When the policy is evaluated."""
        return evaluation_steps(self.settings.budget, self.evaluation_every)  # type: ignore[attr-defined]

    @property
    def seed_sequence(self) -> np.random.SeedSequence:
        """The run's random stream, by what it is called and not by where it stands in a list.

        Readings share their streams: the scenario enters by its name alone, settings not at all.
        """
        names = [self.experiment, self.scenario.name, self.algorithm, self.observation, self.seed]
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
    data = read_toml(path)
    if "extends" in data:
        base = parse(_Extension, data, str(path))
        unchanged = read_toml(_path(base.extends))
        data = override(unchanged, {"description": base.description} | base.changes, str(path))
    loaded = parse(Experiment, data, str(path), name=path.stem)
    if DEFAULT_READING not in loaded.readings:
        raise InputError(f"{path}: the table readings.{DEFAULT_READING} is missing.")
    for name, arm in loaded.algorithms.items():
        where = f"{path}: algorithms.{name}"
        accepted = load_algorithm(arm.algorithm, where).OBSERVATIONS
        if arm.observation not in accepted:
            unknown_name(where, f"observation for {arm.algorithm}", arm.observation, accepted)
        for reading in loaded.readings:
            _settings(loaded, name, reading, str(path))
    try:
        names = [load_scenario(scenario).name for scenario in loaded.scenarios]
    except InputError as error:
        raise InputError(f"{path}: scenarios: {error}") from error
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
    experiment: Experiment, reading: str, scenario: str, arm: str, seeds: Sequence[int] | None = None
) -> list[RunSpecification]:
    """Lists the runs of one cell of the experiment, in the order of their seeds.

    Args:
      experiment: As loaded.
      reading: A key of its readings.
      scenario: One of its scenarios.
      arm: A key of its algorithms.
      seeds: Other seeds than the declared ones.
    """
    declared = experiment.algorithms[arm]
    settings = _settings(experiment, arm, reading, experiment.name)
    loaded = _scenario(experiment, reading, scenario)
    versions = {
        "algorithm": load_algorithm(declared.algorithm).VERSION,
        "evaluation": dynamic_programming.VERSION,
        "model": model.VERSION,
    }
    return [
        RunSpecification(
            experiment=experiment.name,
            scenario=loaded,
            algorithm=declared.algorithm,
            versions=versions,
            observation=declared.observation,
            settings=settings,
            horizon=experiment.horizon,
            evaluation_every=experiment.evaluation_every,
            seed=seed,
        )
        for seed in (range(declared.seeds) if seeds is None else seeds)
    ]


def all_specifications(experiment: Experiment, seeds: Sequence[int] | None = None) -> list[RunSpecification]:
    """Lists every run of an experiment once, the default reading first."""
    readings = sorted(experiment.readings, key=lambda name: name != DEFAULT_READING)
    runs = {
        run.digest: run
        for reading in readings
        for scenario in experiment.scenarios
        for arm in experiment.algorithms
        for run in specifications(experiment, reading, scenario, arm, seeds)
    }
    return list(runs.values())


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


def _scenario(experiment: Experiment, reading: str, scenario: str) -> Scenario:
    """Returns a scenario as a reading has it."""
    changes = experiment.readings[reading]
    loaded = load_scenario(scenario)
    if changes.scenarios is not None and loaded.name not in changes.scenarios:
        return loaded
    return load_scenario(scenario, changes.scenario)


def _settings(experiment: Experiment, arm: str, reading: str, source: str) -> Table:
    """Returns an arm's settings under a reading, checked."""
    declared = experiment.algorithms[arm]
    cls = load_algorithm(declared.algorithm, f"{source}: algorithms.{arm}").Settings
    changed: Mapping[str, Any] = experiment.readings[reading].settings
    where = f"{source}: algorithms.{arm}.settings"
    if changed:
        where += f" with readings.{reading}.settings"
    settings: Table = parse(cls, override(declared.settings, changed, where), where)
    return settings
