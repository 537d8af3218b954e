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

from agents import load_algorithm
from envs import OBSERVATIONS, InputError, Scenario, load_scenario
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
    """One way to read the paper: what it changes, as dotted keys."""

    question: str
    answer: str
    scenario: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)
    curve: Literal["visited", "table"] = "visited"  # which maximum Q the claims are about


class Experiment(Table):
    """A declared set of runs: every reading, scenario and arm, each with its seeds."""

    name: str
    description: str
    report: Literal["reproduce"]  # the report drawn from it
    scenarios: Annotated[tuple[str, ...], Field(min_length=1)]
    horizon: Annotated[int, Field(ge=1, le=100_000)]
    evaluation_every: Annotated[int, Field(ge=1)]
    algorithms: Annotated[dict[str, Arm], Field(min_length=1)]
    readings: dict[str, Reading]


@dataclass(frozen=True, eq=False)
class RunSpecification:
    """One run, fully resolved: everything its result depends on."""

    experiment: str
    scenario: Scenario
    algorithm: str
    version: int  # of the algorithm
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
            "version": self.version,
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
        """When the policy is evaluated, from 0 to the budget, the end always included."""
        budget: int = self.settings.budget  # type: ignore[attr-defined]
        return [*range(0, budget, self.evaluation_every), budget]

    @property
    def seed_sequence(self) -> np.random.SeedSequence:
        """The run's random stream, by what it is called and not by where it stands in a list.

        Readings share their streams: the scenario enters by its name alone, settings not at all.
        """
        names = [self.experiment, self.scenario.name, self.algorithm, self.observation, self.seed]
        entropy = hashlib.sha256(json.dumps(names).encode()).digest()
        return np.random.SeedSequence(int.from_bytes(entropy))


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
    path = Path(experiment)
    if path.suffix != ".toml":
        path = EXPERIMENT_DIRECTORY / f"{experiment}.toml"
        if str(experiment) not in experiment_names():
            unknown_name("experiments", "experiment", str(experiment), experiment_names())
    data = read_toml(path)
    if "name" in data:
        unknown_name(str(path), "key", "name", [key for key in Experiment.model_fields if key != "name"])
    loaded = parse(Experiment, data | {"name": path.stem}, str(path))
    if DEFAULT_READING not in loaded.readings:
        raise InputError(f"{path}: the table readings.{DEFAULT_READING} is missing.")
    for name, arm in loaded.algorithms.items():
        if arm.observation not in OBSERVATIONS:
            unknown_name(f"{path}: algorithms.{name}", "observation", arm.observation, OBSERVATIONS)
        for reading in loaded.readings:
            _settings(loaded, name, reading, str(path))
    for scenario in loaded.scenarios:
        for changes in loaded.readings.values():
            load_scenario(scenario, changes.scenario)
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
    loaded = load_scenario(scenario, experiment.readings[reading].scenario)
    return [
        RunSpecification(
            experiment=experiment.name,
            scenario=loaded,
            algorithm=declared.algorithm,
            version=load_algorithm(declared.algorithm).VERSION,
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
