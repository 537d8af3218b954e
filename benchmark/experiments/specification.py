"""Runs: what identifies them, and which ones an experiment has."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents import LearnerSettings, Schedule, dynamic_programming, load_algorithm
from benchmark.experiments.schema import DEFAULT_CONDITION, Experiment, Variant, read_experiment
from envs import ACTIONS, InputError, Scenario, load_scenario, model
from envs.inputs import in_either_case, override, parse, unknown_name
from envs.observations import check_one_hot

MOST_RUNS: Final = 500_000  # of an experiment
MOST_EVALUATIONS: Final = 100_000  # of a run
LARGEST_RECORD: Final = 100_000_000  # bytes, before compression


@dataclass(frozen=True, eq=False)
class RunSpecification:
    """One run, fully resolved: everything its result depends on."""

    stream: str
    condition: str  # what its experiment calls the condition; the identity has what the condition changes
    scenario: Scenario
    variant: str
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
            # The key has its name from when the stream always was the experiment's name: another name would
            # change the digests of all runs.
            "experiment": self.stream,
            "scenario": self.scenario.model_dump(mode="json"),
            "arm": self.variant,  # the key has its name from before, as digests depend on it
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

    def with_seed(self, seed: int) -> "RunSpecification":
        """Returns another run of the same population."""
        run = object.__new__(RunSpecification)  # nothing is checked again: there may be 100,000 runs
        run.__dict__.update(self.__dict__, seed=seed, population=self.population)
        run.__dict__.pop("digest", None)
        return run

    @property
    def content(self) -> str:
        """The whole specification as canonical JSON."""
        return f'{self.population[:-1]},"seed":{self.seed}}}'

    @cached_property
    def digest(self) -> str:
        """The run's identity: SHA-256 of its content."""
        return hashlib.sha256(self.content.encode()).hexdigest()

    @property
    def folder(self) -> str:
        """A readable path for files about this run alone; it names any condition but the default one."""
        learner = f"{self.stream}/{self.scenario.name}/{self.variant}_{self.observation}"
        condition = "" if self.condition == DEFAULT_CONDITION else f"{self.condition}/"
        return f"{learner}/{condition}seed_{self.seed}"

    @property
    def record_size(self) -> int:
        """About how many bytes are recorded before compression: greedy actions, and values of all actions."""
        budget = self.settings.budget
        n_evaluations, n_maps = (-(-budget // every) + 1 for every in (self.evaluation_every, self.map_every))
        return self.scenario.n_observations * (n_evaluations + 4 * len(ACTIONS) * n_maps)

    @property
    def schedule(self) -> Schedule:
        """When the learner's policy and values are kept."""
        budget = self.settings.budget
        steps = (evaluation_steps(budget, every) for every in (self.evaluation_every, self.map_every))
        return Schedule(budget, *map(tuple, steps))

    @property
    def seed_sequence(self) -> np.random.SeedSequence:
        """The run's random stream, derived from names and never from a place in a list.

        Conditions share their streams: the scenario enters by its name alone, settings not at all.
        """
        names = [self.stream, self.scenario.name, self.variant, self.observation, self.seed]
        entropy = hashlib.sha256(json.dumps(names).encode()).digest()
        return np.random.SeedSequence(int.from_bytes(entropy))


def population_of(content: str) -> str:
    """Returns the population of a run, by its content, see `RunSpecification`."""
    return content[: content.rindex(',"seed":')] + "}"


def evaluation_steps(budget: int, every: int) -> list[int]:
    """Lists when policies are evaluated: from 0 to the budget, the end always included.

    >>> evaluation_steps(600, 250)
    [0, 250, 500, 600]
    """
    return [*range(0, budget, every), budget]


def load_experiment(experiment: str | Path) -> Experiment:
    """Reads an experiment and checks it together with the algorithms and scenarios that it names.

    The demands of its report are checked by the report.

    Args:
      experiment: The name of a shipped experiment, or the path of a TOML file.

    Raises:
      InputError: One sentence that names the file, the key, its value and what is accepted.
    """
    loaded, path = read_experiment(experiment)
    for name, variant in loaded.algorithms.items():
        where = f"{path}: algorithms.{name}"
        accepted = load_algorithm(variant.algorithm, where).observations
        of = variant.reference_for
        of_variant = loaded.algorithms[of].observations if of else accepted
        for observation in variant.observations:
            if observation not in accepted:
                unknown_name(where, f"observation for {variant.algorithm}", observation, accepted)
            if observation not in of_variant:
                reason = f"{of} does not learn from {observation}; accepted: {', '.join(of_variant)}"
                raise InputError(f"{where}.observations: {reason}.")
        for condition in loaded.conditions:
            _settings(loaded, name, condition, str(path))
    with _refused_in(str(path)):
        names = [load_scenario(scenario).name for scenario in loaded.scenarios]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{path}: scenarios: {twice[0]} is named twice.")
    if pair := in_either_case(names):
        raise InputError(
            f"{path}: scenarios: {' and '.join(pair)}: accepted: names that differ in more than case."
        )
    for condition, changes in loaded.conditions.items():
        for table, change in changes.items():
            for name in change.scenarios or ():
                if name not in names:
                    unknown_name(f"{path}: {table}.scenarios", "scenario", name, names)
        tables = [f"{table}.scenario" for table, change in changes.items() if change.scenario]
        for declared in loaded.scenarios:
            with _refused_in(f"{path}: {' with '.join(tables)}"):
                scenario = _scenario(loaded, condition, declared)
            for name, variant in loaded.algorithms.items():
                with _refused_in(f"{path}: algorithms.{name}"):
                    _check_size(_run(loaded, condition, scenario, name, variant.observations[0]), variant)
    return loaded


@contextmanager
def _refused_in(where: str) -> Iterator[None]:
    """Names the place in front of what is refused."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _check_size(run: RunSpecification, variant: Variant) -> None:
    """Checks that observations, and what is recorded of a run, fit into memory.

    Raises:
      InputError: They do not.
    """
    scenario, every = run.scenario, f"evaluation_every = {run.evaluation_every}"
    if "one_hot" in variant.observations:
        check_one_hot(scenario.n_observations, scenario.n_features)
    n_evaluations = -(-run.settings.budget // run.evaluation_every) + 1
    if n_evaluations > MOST_EVALUATIONS:
        raise InputError(
            f"{every} with budget = {run.settings.budget}: {n_evaluations:,} evaluations; "
            f"accepted: at most {MOST_EVALUATIONS:,}."
        )
    if run.record_size > LARGEST_RECORD:
        raise InputError(
            f"{every} and map_every = {run.map_every} with budget = {run.settings.budget} and "
            f"{scenario.n_observations:,} observations in {scenario.name}: records of "
            f"{run.record_size / 1e6:,.0f} MB; accepted: at most {LARGEST_RECORD / 1e6:,.0f} MB."
        )


def specifications(
    experiment: Experiment,
    condition: str,
    scenario: str,
    variant: str,
    observation: str,
    seeds: Sequence[int] | None = None,
) -> list[RunSpecification]:
    """Lists the runs of one population, as the experiment names it, with the declared seeds or others."""
    chosen = experiment.declared_seeds(variant, condition) if seeds is None else seeds
    first = _run(experiment, condition, _scenario(experiment, condition, scenario), variant, observation)
    return [first.with_seed(seed) for seed in chosen]


def _run(
    experiment: Experiment, condition: str, scenario: Scenario, variant: str, observation: str
) -> RunSpecification:
    """Returns the first run of a population, in a scenario as it is under the condition."""
    declared = experiment.algorithms[variant]
    evaluation_every, map_every = experiment.schedule(variant)
    return RunSpecification(
        stream=experiment.stream or experiment.name,
        condition=condition,
        scenario=scenario,
        variant=variant,
        algorithm=declared.algorithm,
        versions={
            "algorithm": load_algorithm(declared.algorithm).version,
            "evaluation": dynamic_programming.VERSION,
            "model": model.VERSION,
        },
        observation=observation,
        settings=_settings(experiment, variant, condition, experiment.name),
        horizon=experiment.horizon,
        evaluation_every=evaluation_every,
        map_every=map_every,
        evaluated_from=experiment.evaluated_from,
        seed=experiment.declared_seeds(variant, condition)[0],
    )


def all_specifications(experiment: Experiment, seeds: Sequence[int] | None = None) -> list[RunSpecification]:
    """Lists every run of an experiment once: first seeds of all populations, then second seeds, and so on.

    An interrupted experiment therefore has runs of every population. Conditions of the default reading come
    first. A condition that changes nothing in a scenario has the same runs there as an earlier condition.

    Raises:
      InputError: There are too many.
    """
    conditions = sorted(experiment.conditions, key=lambda name: name.split("/")[0] != DEFAULT_CONDITION)
    populations = [(condition, *each) for condition in conditions for each in experiment.populations]
    n_runs = sum(
        len(experiment.declared_seeds(variant, condition) if seeds is None else seeds)
        for condition, _, variant, _ in populations
    )
    if n_runs > MOST_RUNS:
        raise InputError(f"{experiment.argument}: {n_runs:,} runs; accepted: at most {MOST_RUNS:,}.")
    every = [specifications(experiment, *population, seeds) for population in populations]
    runs: dict[str, RunSpecification] = {}
    for run in chain.from_iterable(zip_longest(*every)):
        if run is not None:
            runs.setdefault(run.digest, run)
    return list(runs.values())


def _scenario(experiment: Experiment, condition: str, scenario: str) -> Scenario:
    """Returns a scenario under a condition."""
    name = Path(scenario).stem
    changed: dict[str, Any] = {}
    for change in experiment.conditions[condition].values():
        if change.scenarios is None or name in change.scenarios:
            changed |= change.scenario
    return load_scenario(scenario, changed)


def _settings(experiment: Experiment, variant: str, condition: str, source: str) -> LearnerSettings:
    """Returns a variant's settings under a condition, checked."""
    declared = experiment.algorithms[variant]
    cls = load_algorithm(declared.algorithm, f"{source}: algorithms.{variant}").settings
    for key in experiment.settings:
        if key not in cls.model_fields:
            unknown_name(f"{source}: [settings], which {variant} shares", "key", key, cls.model_fields)
    where = f"{source}: algorithms.{variant}.settings"
    if experiment.settings:
        where += " with [settings]"
    changed: dict[str, Any] = {}
    for table, change in experiment.conditions[condition].items():
        changed |= change.settings
        if change.settings:
            where += f" with {table}.settings"
    return parse(cls, override(experiment.settings | declared.settings, changed, where), where)
