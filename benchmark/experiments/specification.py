"""Runs: what identifies them, and which ones an experiment has."""

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents import LearnerSettings, Schedule, dynamic_programming, load_algorithm
from benchmark.experiments.schema import DEFAULT_CONDITION, Experiment, overlap, read_experiment
from benchmark.experiments.search import Chosen, read_chosen
from envs import ACTIONS, InputError, Scenario, load_scenario, model
from envs.inputs import in_either_case, override, parse, unknown_name
from envs.observations import ENCODINGS, check_one_hot, seen_as

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
    # Of a run that is measured until it has solved its scenario: `Solved`, and the policy that counts.
    solved: Mapping[str, Any] | None = None

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
            **({} if self.solved is None else {"solved": dict(self.solved)}),
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
        if self.solved is not None:
            return 24 * len(self.schedule.evaluation_steps)
        n_evaluations, n_maps = (-(-budget // every) + 1 for every in (self.evaluation_every, self.map_every))
        seen = seen_as(self.scenario, self.observation)
        return seen.n_observations * (n_evaluations + 4 * len(ACTIONS) * n_maps)

    @property
    def schedule(self) -> Schedule:
        """When the learner's policy and values are kept."""
        budget = self.settings.budget
        if self.solved is not None:
            steps = evaluation_steps(budget, self.evaluation_every, self.solved["growth"])
            return Schedule(budget, tuple(steps))
        steps, map_steps = (
            evaluation_steps(budget, every) for every in (self.evaluation_every, self.map_every)
        )
        return Schedule(budget, tuple(steps), tuple(map_steps))

    @property
    def drawn_scenario(self) -> Scenario:
        """The scenario of this run alone: what a scenario draws is drawn anew for every seed."""
        return self.scenario.drawn(self.seed) if self.scenario.draws else self.scenario

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


def evaluation_steps(budget: int, every: int, growth: float = 1.0) -> list[int]:
    """Lists when policies are evaluated: from 0 to the budget, the end always included.

    All others are multiples of `every`. With a growth, each is about so many times as late as the one before.

    >>> evaluation_steps(600, 250), evaluation_steps(1600, 100, 1.5)
    ([0, 250, 500, 600], [0, 100, 200, 300, 500, 800, 1200, 1600])
    """
    if growth == 1:
        return [*range(0, budget, every), budget]
    steps = [0]
    while steps[-1] < budget:
        later = max(steps[-1] + every, math.ceil(steps[-1] * growth / every) * every)
        steps.append(min(later, budget))
    return steps


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
        if variant.tuned_by:
            _check_tuning(loaded, name, path)
        for observation in variant.observations:
            first = next(iter(loaded.conditions))
            usual = _family(loaded, name, observation, first, str(path))
            for condition in loaded.conditions:
                if (family := _family(loaded, name, observation, condition, str(path))) != usual:
                    raise InputError(
                        f"{where}: on {observation}, it is {usual} under {first} and {family} under "
                        f"{condition}, as a net without hidden layers is a table there; accepted: the same "
                        "under all conditions."
                    )
            for key, axis in variant.search.items():
                for value in axis.marks:  # which a search tries last
                    _settings(loaded, name, observation, first, str(path), {key: value})
    with _refused_in(str(path)):
        names = [load_scenario(scenario).name for scenario in loaded.scenarios]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{path}: scenarios: {twice[0]} is named twice.")
    if pair := in_either_case(names):
        raise InputError(
            f"{path}: scenarios: {' and '.join(pair)}: accepted: names that differ in more than case."
        )
    # Trials change neither scenarios nor sizes.
    conditions = [*loaded.conditions.items()][: None if loaded.search is None else 1]
    for condition, changes in conditions:
        for table, change in changes.items():
            for name in change.scenarios or ():
                if name not in names:
                    unknown_name(f"{path}: {table}.scenarios", "scenario", name, names)
        tables = [f"{table}.scenario" for table, change in changes.items() if change.scenario]
        for declared in loaded.scenarios:
            with _refused_in(f"{path}: {' with '.join(tables)}"):
                scenario = _scenario(loaded, condition, declared)
            for of_scenario, name, observation in loaded.populations_of(condition):
                if of_scenario == declared:
                    with _refused_in(f"{path}: algorithms.{name}"):
                        check_size(_run(loaded, condition, scenario, name, observation))
    return loaded


@contextmanager
def _refused_in(where: str) -> Iterator[None]:
    """Names the place in front of what is refused."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def family_of(experiment: Experiment, variant: str) -> str:
    """Returns what a variant counts as: tabular, deep or planner.

    It is what its algorithm is, but a net that has no hidden layers and learns from one-hot observations
    alone is a table: it has a row of weights for each observation.
    """
    condition, name = next(iter(experiment.conditions)), experiment.name
    forms = experiment.algorithms[variant].observations
    families = {_family(experiment, variant, observation, condition, name) for observation in forms}
    return families.pop() if len(families) == 1 else "deep"


def _family(experiment: Experiment, variant: str, observation: str, condition: str, source: str) -> str:
    """Returns what a learner counts as under a condition; checks its settings."""
    settings = _settings(experiment, variant, observation, condition, source)
    layers = dict(getattr(settings, "policy_kwargs", None) or {}).get("net_arch")
    if isinstance(layers, dict):  # of actor and critic
        layers = [each for each in layers.values() if each]
    is_linear = layers is not None and len(layers) == 0
    is_table = is_linear and ENCODINGS[observation] == "one_hot"
    return "tabular" if is_table else load_algorithm(experiment.algorithms[variant].algorithm).family


def check_size(run: RunSpecification) -> None:
    """Checks that observations, and what is recorded of a run, fit into memory.

    Raises:
      InputError: They do not.
    """
    scenario = seen_as(run.scenario, run.observation)
    every = f"evaluation_every = {run.evaluation_every}"
    if ENCODINGS[run.observation] == "one_hot":
        check_one_hot(scenario.n_observations, scenario.n_features)
    n_evaluations = -(-run.settings.budget // run.evaluation_every) + 1 if run.solved is None else 0
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
    solved = experiment.solved
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
        settings=_settings(experiment, variant, observation, condition, experiment.name),
        horizon=experiment.horizon,
        evaluation_every=evaluation_every,
        map_every=map_every,
        evaluated_from=experiment.evaluated_from,
        seed=experiment.declared_seeds(variant, condition)[0],
        solved=None if solved is None else {**solved.model_dump(mode="json"), "policy": declared.policy},
    )


def all_specifications(experiment: Experiment, seeds: Sequence[int] | None = None) -> list[RunSpecification]:
    """Lists every run of an experiment once: first seeds of all populations, then second seeds, and so on.

    An interrupted experiment therefore has runs of every population. Conditions of the default reading come
    first. A condition that changes nothing in a scenario has the same runs there as an earlier condition.

    Raises:
      InputError: There are too many.
    """
    conditions = sorted(experiment.conditions, key=lambda name: name.split("/")[0] != DEFAULT_CONDITION)
    populations = [
        (condition, *each) for condition in conditions for each in experiment.populations_of(condition)
    ]
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


def tuning_of(experiment: Experiment, variant: str, observation: str) -> Chosen | None:
    """Returns the settings that a search has chosen for a learner, and their effort; None without a search.

    Raises:
      InputError: Nothing has been chosen for this learner, or not by the search as it is declared now.
    """
    tuned_by = experiment.algorithms[variant].tuned_by
    if not tuned_by:
        return None
    source = f"{experiment.argument}: algorithms.{variant}.tuned_by = {tuned_by}"
    name, _, searched = tuned_by.rpartition(":")
    _, path = _read_search(name)
    choices, learner = read_chosen(path, source), f"{searched}, {observation}"
    if choices.search != _digest_of_search(name):
        raise InputError(
            f"{source}: {path} was made by another version of the search; run it again, with --report."
        )
    if learner not in choices.learners:
        unknown_name(source, "learner of the search", learner, choices.learners)
    return choices.learners[learner]


@lru_cache(maxsize=8)
def _read_search(name: str) -> tuple[Experiment, Path]:
    return read_experiment(name)


@lru_cache(maxsize=8)
def _digest_of_search(name: str) -> str:
    return digest_of_search(_read_search(name)[0])


def digest_of_search(search: Experiment) -> str:
    """Returns a digest of what a search depends on: what its file declares but texts, scenarios, versions."""
    content = search.model_dump(mode="json", exclude={"description", "note", "report", "grids", "solved"})
    for each in content["algorithms"].values():
        del each["title"]
        for axis in each["search"].values():
            del axis["why"]
    content["scenarios"] = [load_scenario(each).model_dump(mode="json") for each in search.scenarios]
    algorithms = [load_algorithm(each.algorithm).version for each in search.algorithms.values()]
    content["versions"] = [*algorithms, dynamic_programming.VERSION]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _check_tuning(experiment: Experiment, variant: str, path: Path) -> None:
    """Checks that a variant's scenarios, stream and seeds are not those that its settings were chosen on.

    Raises:
      InputError: They are, or `tuned_by` names no variant of a search with the same settings.
    """
    declared = experiment.algorithms[variant]
    where = f"{path}: algorithms.{variant}.tuned_by = {declared.tuned_by}"
    name, _, searched = declared.tuned_by.rpartition(":")
    if not name:
        raise InputError(f'{where}: accepted: "EXPERIMENT:VARIANT".')
    search, _ = _read_search(name)
    if search.search is None:
        raise InputError(f"{where}: {name} has no table [search]; accepted: an experiment with one.")
    if searched not in search.algorithms:
        unknown_name(where, f"variant of {name}", searched, search.algorithms)
    if (experiment.stream or experiment.name) == (search.stream or search.name):
        raise InputError(f"{where}: its stream is that of the search; accepted: another stream.")
    seen = {load_scenario(each).essence: each for each in search.scenarios}
    for condition in experiment.conditions:
        for scenario in experiment.scenarios:
            with _refused_in(where):
                essence = _scenario(experiment, condition, scenario).essence
            if other := seen.get(essence):
                reason = f"{scenario} is {other}, a scenario of the search, or its reflection"
                raise InputError(f"{where}: {reason}; accepted: other scenarios.")
        own = experiment.all_seeds(variant, condition)
        for taken in search.seeds_of_search(searched):
            if overlap(own, taken):
                reason = f"the search has used the seeds {taken.start} to {taken.stop - 1}"
                raise InputError(f"{where}: {reason}; accepted: others than {own.start} to {own.stop - 1}.")


def _settings(
    experiment: Experiment,
    variant: str,
    observation: str,
    condition: str,
    source: str,
    more: Mapping[str, Any] | None = None,
) -> LearnerSettings:
    """Returns a learner's settings under a condition, and with more changes, checked."""
    declared = experiment.algorithms[variant]
    cls = load_algorithm(declared.algorithm, f"{source}: algorithms.{variant}").settings
    for key in experiment.settings:
        if key not in cls.model_fields:
            unknown_name(f"{source}: [settings], which {variant} shares", "key", key, cls.model_fields)
    where = f"{source}: algorithms.{variant}.settings"
    if experiment.settings:
        where += " with [settings]"
    tuned = tuning_of(experiment, variant, observation)
    if tuned is not None:
        where += f" with tuned_by = {declared.tuned_by}"
    changed: dict[str, Any] = {}
    for table, change in experiment.conditions[condition].items():
        changed |= change.settings_of(variant)
        if change.settings_of(variant):
            where += f" with {table}.settings"
    given = experiment.settings | ({} if tuned is None else tuned.settings)
    own = {
        f"{key}.{name}" if name else key: each
        for key, value in declared.settings.items()
        for name, each in (value.items() if isinstance(value, dict) else [("", value)])
    }
    return parse(cls, override(given, own | changed | dict(more or {}), where), where)
