"""Runs: what identifies them, and which ones an experiment has."""

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents import LearnerSettings, Schedule, dynamic_programming, load_algorithm
from benchmark.experiments.schema import DEFAULT_CONDITION, Experiment, overlap, read_experiment
from benchmark.experiments.search import Chosen, read_chosen
from envs import ACTIONS, InputError, Scenario, load_scenario, model
from envs.inputs import check_all, in_either_case, override, parse, unknown_name
from envs.observations import ENCODINGS, check_one_hot, seen_as

MOST_RUNS: Final = 500_000  # of an experiment
MOST_EVALUATIONS: Final = 100_000  # of a run
LARGEST_RECORD: Final = 100_000_000  # bytes, before compression
LARGEST_AGENT: Final = 2_000_000_000  # bytes that one setting may take


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
      InputError: A sentence for each mistake, which names file, key, value and what is accepted.
    """
    loaded, path = read_experiment(experiment)

    def of_each(check: Callable[[Experiment, str, Path], None]) -> list[Callable[[], None]]:
        return [partial(check, loaded, name, path) for name in loaded.algorithms]

    def of_all(check: Callable[[Experiment, Path], None]) -> Callable[[], None]:
        return partial(check, loaded, path)

    # The second checks depend on the first.
    check_all(*of_each(_check_observations), *of_each(_check_tuning), of_all(_check_scenarios))
    check_all(
        of_all(_check_settings),
        *of_each(_check_family),
        of_all(_check_conditions),
        *of_each(_check_seeds),
    )
    return loaded


def _check_observations(experiment: Experiment, name: str, path: Path) -> None:
    """Checks that a variant's algorithm has its observations, and the variant that it is a reference for."""
    variant, where = experiment.algorithms[name], f"{path}: algorithms.{name}"
    accepted = load_algorithm(variant.algorithm, where).observations
    of = variant.reference_for
    of_variant = experiment.algorithms[of].observations if of else accepted
    for observation in variant.observations:
        if observation not in accepted:
            unknown_name(where, f"observation for {variant.algorithm}", observation, accepted)
        if observation not in of_variant:
            reason = f"{of} does not learn from {observation}; accepted: {', '.join(of_variant)}"
            raise InputError(f"{where}.observations: {reason}.")


def _check_scenarios(experiment: Experiment, path: Path) -> None:
    """Checks that all scenarios can be loaded and differ, in their names too."""
    with _refused_in(str(path)):
        check_all(*(partial(load_scenario, scenario) for scenario in experiment.scenarios))
    scenarios = [load_scenario(scenario) for scenario in experiment.scenarios]
    names, where = [scenario.name for scenario in scenarios], f"{path}: scenarios"
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{where}: {twice[0]} is named twice.")
    if pair := in_either_case(names):
        raise InputError(f"{where}: {' and '.join(pair)}: accepted: names that differ in more than case.")
    met: dict[str, str] = {}
    for each in scenarios:
        other = met.setdefault(each.model_dump_json(exclude={"name", "description"}), each.name)
        if other != each.name:
            reason = "are the same scenario; accepted: different ones"
            raise InputError(f"{where}: {other} and {each.name} {reason}.")


class _Mistakes:
    """Collects what is refused of many learners and conditions; what several share is reported once."""

    def __init__(self) -> None:
        self.found: dict[object, str] = {}

    @contextmanager
    def noted(self, where: str = "", cause: Callable[[str], object] = str) -> Iterator[None]:
        """Notes what is refused, after the place. Sentences of equal causes are about the same mistake."""
        try:
            yield
        except InputError as error:
            for line in error.args:
                self.found.setdefault(cause(line), f"{where}{line}")

    def refuse(self) -> None:
        """Raises an InputError if there are mistakes."""
        if self.found:
            raise InputError(*self.found.values())


def _cause(experiment: Experiment, name: str, reason: str) -> tuple[str, str]:
    """Returns the cause of a mistake: of one variant if it is about a key of its own, else of all."""
    variant = experiment.algorithms[name]
    own = {*variant.settings, *(variant.model_fields_set & {"evaluation_every", "map_every"})}
    return name * any(key in reason for key in own), reason


def _check_settings(experiment: Experiment, path: Path) -> None:
    """Checks the settings of all learners under all conditions, and all over what a search varies."""
    mistakes, first = _Mistakes(), next(iter(experiment.conditions))
    for name, variant in experiment.algorithms.items():
        marks = [{key: value} for key, axis in variant.search.items() for value in axis.marks]
        cases = [
            *((condition, {}) for condition in experiment.conditions),
            *((first, mark) for mark in marks),
        ]

        def cause(line: str, name: str = name) -> object:
            if experiment.search is not None:  # whose trials may all make the same mistake
                return name
            _, _, reason = line.partition(f"algorithms.{name}")
            return _cause(experiment, name, (reason or line.partition(" shares")[2]).partition(": ")[2])

        for observation in variant.observations:
            for condition, more in cases:
                with mistakes.noted(cause=cause):
                    _settings(experiment, name, observation, condition, str(path), more)
    mistakes.refuse()


def _check_family(experiment: Experiment, name: str, path: Path) -> None:
    """Checks that no condition makes a table of a net."""
    for observation in experiment.algorithms[name].observations:
        found: dict[str, str] = {}
        for condition in experiment.conditions:
            with suppress(InputError):  # of settings, which another check reports
                found.setdefault(_family(experiment, name, observation, condition, str(path)), condition)
        if len(found) > 1:
            told = " and ".join(f"{family} under {condition}" for family, condition in found.items())
            raise InputError(
                f"{path}: algorithms.{name}: on {observation}, it is {told}, as a net without hidden layers "
                "is a table there; accepted: the same under all conditions."
            )


def _check_conditions(experiment: Experiment, path: Path) -> None:
    """Checks scenarios under all conditions, and the sizes of runs whose settings are accepted."""
    mistakes, names = _Mistakes(), [Path(scenario).stem for scenario in experiment.scenarios]
    searches: dict[str, str] = {}  # and where they are named
    for name, each in experiment.algorithms.items():
        if each.tuned_by:
            where = f"{path}: algorithms.{name}.tuned_by = {each.tuned_by}: "
            searches.setdefault(each.tuned_by.rpartition(":")[0], where)

    def cause(name: str, line: str) -> object:
        return _cause(experiment, name, line.partition(" = ")[0])

    for search, where in searches.items():
        other = _read_search(search)[0]
        with mistakes.noted(where):
            if (experiment.stream or experiment.name) == (other.stream or other.name):
                raise InputError("its stream is that of the search; accepted: another stream.")
    # Trials change neither scenarios nor sizes.
    for condition in [*experiment.conditions][: None if experiment.search is None else 1]:
        changes = experiment.conditions[condition]
        for table, change in changes.items():
            for name in {*(change.scenarios or ())}.difference(names):
                with mistakes.noted():
                    unknown_name(f"{path}: {table}.scenarios", "scenario", name, names)
        tables = [f"{table}.scenario" for table, change in changes.items() if change.scenario]
        for declared in experiment.scenarios:
            scenario = None
            with mistakes.noted(f"{path}: {' with '.join(tables)}: ", lambda line: line.partition(": ")[2]):
                scenario = _scenario(experiment, condition, declared)
            if scenario is None:
                continue
            for search, where in searches.items():
                with mistakes.noted(where):
                    _check_unseen(scenario, declared, search)
            for of_scenario, name, observation in experiment.populations_of(condition):
                where = f"{path}: algorithms.{name}: "
                if of_scenario == declared:
                    with suppress(InputError):  # of settings, which are checked before
                        run = _run(experiment, condition, scenario, name, observation)
                        with mistakes.noted(where, partial(cause, name)):
                            check_size(run)
    mistakes.refuse()


def _check_unseen(scenario: Scenario, declared: str, search: str) -> None:
    """Refuses, by an InputError, a scenario of the search."""
    cheap = ("ping_limit", "rewards", "observe", "first_phase", "draw")
    for other in _scenarios_of_search(search):
        is_alike = scenario.grid.size == other.grid.size and len(scenario.places) == len(other.places)
        is_alike = is_alike and all(getattr(scenario, key) == getattr(other, key) for key in cheap)
        if is_alike and scenario.essence == other.essence:
            reason = f"{declared} is {other.name}, a scenario of the search, or its reflection"
            raise InputError(f"{reason}; accepted: other scenarios.")


@contextmanager
def _refused_in(where: str) -> Iterator[None]:
    """Names the place in front of what is refused."""
    try:
        yield
    except InputError as error:
        raise InputError(*(f"{where}: {line}" for line in error.args)) from error


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
    """Checks that observations, the agent, and what is recorded of a run, fit into memory.

    Raises:
      InputError: They do not.
    """
    scenario = seen_as(run.scenario, run.observation)
    every, n_inputs = f"evaluation_every = {run.evaluation_every}", 2 * len(scenario.observe)
    if ENCODINGS[run.observation] == "one_hot":
        check_one_hot(scenario.n_observations, scenario.n_features)
        n_inputs = scenario.n_features
    for setting, size in load_algorithm(run.algorithm).memory(run.settings, n_inputs).items():
        if size > LARGEST_AGENT:
            accepted = f"at most {LARGEST_AGENT / 1e9:.0f} GB"
            raise InputError(f"{setting}: {size / 1e9:,.0f} GB of memory; accepted: {accepted}.")
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
    changed = _scenario(experiment, condition, scenario)
    return _with_seeds(experiment, _run(experiment, condition, changed, variant, observation), seeds)


def _with_seeds(
    experiment: Experiment, first: RunSpecification, seeds: Sequence[int] | None
) -> list[RunSpecification]:
    chosen = experiment.declared_seeds(first.variant, first.condition) if seeds is None else seeds
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
    every = []
    for condition in conditions:
        scenarios = {name: _scenario(experiment, condition, name) for name in experiment.scenarios}
        for scenario, *learner in experiment.populations_of(condition):
            first = _run(experiment, condition, scenarios[scenario], *learner)
            every.append(_with_seeds(experiment, first, seeds))
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
def _scenarios_of_search(name: str) -> list[Scenario]:
    return [load_scenario(each) for each in _read_search(name)[0].scenarios]


@lru_cache(maxsize=8)
def _digest_of_search(name: str) -> str:
    return digest_of_search(_read_search(name)[0])


def changed_settings(experiment: Experiment, variant: str) -> list[str]:
    """Lists the settings that a search has chosen for a variant and that the experiment changes."""
    declared = experiment.algorithms[variant]
    if not declared.tuned_by:
        return []
    name, _, searched = declared.tuned_by.rpartition(":")
    return [key for key in _read_search(name)[0].algorithms[searched].search if key in declared.settings]


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
    """Refuses, by an InputError, what does not name a variant of a search."""
    declared = experiment.algorithms[variant]
    where = f"{path}: algorithms.{variant}.tuned_by = {declared.tuned_by}"
    name, _, searched = declared.tuned_by.rpartition(":")
    if not declared.tuned_by:
        return
    if not name:
        raise InputError(f'{where}: accepted: "EXPERIMENT:VARIANT".')
    search, _ = _read_search(name)
    if search.search is None:
        raise InputError(f"{where}: {name} has no table [search]; accepted: an experiment with one.")
    if searched not in search.algorithms:
        unknown_name(where, f"variant of {name}", searched, search.algorithms)


def _check_seeds(experiment: Experiment, variant: str, path: Path) -> None:
    """Refuses, by an InputError, seeds on which a variant's settings were chosen."""
    tuned_by = experiment.algorithms[variant].tuned_by
    name, _, searched = tuned_by.rpartition(":")
    taken = _read_search(name)[0].seeds_of_search(searched) if name else ()
    for own in {experiment.all_seeds(variant, condition): None for condition in experiment.conditions}:
        if any(overlap(own, each) for each in taken):
            used = " and ".join(f"{each.start} to {each.stop - 1}" for each in taken)
            reason = f"the search has used the seeds {used}"
            accepted = f"seeds other than {own.start} to {own.stop - 1}"
            raise InputError(
                f"{path}: algorithms.{variant}.tuned_by = {tuned_by}: {reason}; accepted: {accepted}."
            )


def _settings(
    experiment: Experiment,
    variant: str,
    observation: str,
    condition: str,
    source: str,
    more: Mapping[str, Any] | None = None,
) -> LearnerSettings:
    """Returns a learner's settings under a condition, and with more changes, checked."""
    changes = {table: each.settings_of(variant) for table, each in experiment.conditions[condition].items()}
    changed = {key: value for settings in changes.values() for key, value in settings.items()}
    changed |= more or {}
    known: dict[str, LearnerSettings] = experiment.known_settings
    content = json.dumps([variant, observation, changed], default=str)
    if content in known:
        return known[content]
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
    where += "".join(f" with {table}.settings" for table, settings in changes.items() if settings)
    given = experiment.settings | ({} if tuned is None else tuned.settings)
    own = {
        f"{key}.{name}" if name else key: each
        for key, value in declared.settings.items()
        for name, each in (value.items() if isinstance(value, dict) else [("", value)])
    }
    known[content] = parse(cls, override(given, own | changed, where), where)
    return known[content]
