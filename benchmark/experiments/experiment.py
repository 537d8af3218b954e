"""Experiments, resolved: what a file declares, with every name looked up and every run known.

Nothing after `load_experiment` looks up a name again, or asks in which way a condition was declared.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, zip_longest
from pathlib import Path
from typing import Final

from agents import Algorithm, LearnerSettings, dynamic_programming, load_algorithm
from benchmark.experiments import choices, schema
from benchmark.experiments.run import RunSpecification
from benchmark.experiments.search import Chosen
from envs import InputError, Scenario, load_scenario, model
from envs.inputs import override, parse, unknown_name
from envs.observations import ENCODINGS

MAX_RUNS: Final = 100_000  # of an experiment: more than a day at a second each


@dataclass(frozen=True)
class Learner:
    """A variant with one form of observation."""

    variant: str
    observation: str
    declared: schema.Variant
    algorithm: Algorithm
    family: str
    """What its variant counts as, see `_learners` and `Algorithm.family`."""
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
        """Which policy counts: "greedy" or "stochastic"."""
        return self.declared.policy

    @property
    def search(self) -> str:
        """The search that its settings come from; empty if they are declared."""
        return self.declared.source[0]

    @property
    def reference_for(self) -> str:
        """The name of the learner that it is the reference implementation of; empty if it is none."""
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

    >>> title_of("Q-learning table", "offset", "tabular"), title_of("tile coding", "coordinates", "linear")
    ('Q-learning table of offsets', 'tile coding on coordinates')
    """
    observed, row = _OBSERVED.get(observation, f" on {observation}"), observation.removesuffix("_one_hot")
    return variant + (observed if family in ("linear", "deep", "other") else _ROWS.get(row, observed))


@dataclass(frozen=True, eq=False)
class Population:
    """The runs of a learner in a scenario under a condition, which differ by seed, and perhaps pick."""

    condition: schema.Condition
    scenario: Scenario  # as it is under the condition
    learner: Learner
    firsts: tuple[RunSpecification, ...]  # a run with each pick of a search; usually one
    seeds: range  # as declared
    beside: range  # seeds of the variant that it is the reference for, else of its own

    @property
    def first(self) -> RunSpecification:
        """The run with the first seed and the first pick."""
        return self.firsts[0]

    def pick_of(self, seed: int) -> int:
        """Returns the index of a seed's run in `firsts`; a reference implementation has the same."""
        return (seed - self.beside.start) % len(self.firsts)

    def taken(self, seeds: Sequence[int] | None) -> Sequence[int]:
        """Returns the declared seeds, or a proportional share of given ones; a reference gets two or more."""
        n, n_beside = len(self.seeds), len(self.beside)
        return self.seeds if seeds is None else seeds[: max(2, len(seeds) * n // n_beside)]

    def runs(self, seeds: Iterable[int] | None = None) -> list[RunSpecification]:
        """Lists its runs, with the declared seeds or others."""
        return [self.firsts[self.pick_of(s)].with_seed(s) for s in (self.seeds if seeds is None else seeds)]


@dataclass(frozen=True, eq=False, repr=False)
class Experiment:
    """A declared set of runs: populations of every condition, scenario and learner, each with its seeds."""

    declared: schema.Declaration
    path: Path
    learners: Mapping[str, Learner]  # by name
    scenarios: Mapping[str, Scenario]  # by name, without any change
    populations: Sequence[Population]  # by condition, scenario and learner, in the order declared

    @property
    def name(self) -> str:
        """The stem of its file."""
        return self.declared.name

    @property
    def argument(self) -> str:
        """How it is given on the command line here: the name of a shipped one, else a path."""
        if self.name in schema.experiment_names() or self.declared.is_miniature:
            return self.declared.argument
        return str(self.path)

    def population(self, condition: str, scenario: str, learner: str) -> Population:
        """Returns a population by its names; the scenario may be any other, by name or path."""
        names = condition, learner
        alike = [each for each in self.populations if (each.condition.name, each.learner.name) == names]
        name = Path(scenario).stem
        if name in self.scenarios:
            return next(population for population in alike if population.scenario.name == name)
        other = load_scenario(scenario, alike[0].condition.scenario_changes(name))
        firsts = tuple(replace(first, scenario=other) for first in alike[0].firsts)
        return replace(alike[0], scenario=other, firsts=firsts)


def load_experiment(experiment: str | Path, *, smoke: bool = False) -> Experiment:
    """Reads an experiment, and checks it together with the algorithms and scenarios that it names.

    It is the name of a shipped experiment, or the path of a TOML file. With `smoke`, it is a miniature, with
    two runs of each learner and a twenty-fifth of the budget, at most 1,000. A mistake is an InputError with
    a sentence. Its report checks what it demands.
    """
    declared, path = schema.read_experiment(experiment)
    declared = declared.miniature() if smoke else declared
    for name in declared.algorithms:
        choices.check_source(declared, name, path)
    with _of_file(str(path)):
        scenarios = {Path(name).stem: load_scenario(name) for name in declared.scenarios}
    learners = {it.name: it for name in declared.algorithms for it in _learners(declared, name, path)}
    populations = [
        _population(declared, condition, scenario, learner, path)
        for condition in declared.conditions.values()
        for scenario in _scenarios(declared, condition, path)
        for learner in learners.values()
        if condition.has(learner.variant, learner.observation)
    ]
    if (n_runs := sum(len(population.seeds) for population in populations)) > MAX_RUNS:
        raise InputError(f"{path}: {n_runs:,} runs; accepted: at most {MAX_RUNS:,}.")
    for name in declared.algorithms:
        choices.check_seeds(declared, name, path)
    titles = [learner.title for learner in learners.values()]
    if len({*titles}) < len(titles):
        raise InputError(f"{path}: algorithms: accepted: learners whose titles differ.")
    # A miniature has a file of chosen settings of its own.
    return Experiment(declared, path.with_stem(declared.name), learners, scenarios, populations)


@contextmanager
def _of_file(where: str) -> Iterator[None]:
    """Says to which part of a file mistakes belong."""
    try:
        yield
    except InputError as error:
        raise InputError(*(f"{where}: {line}" for line in error.args)) from error


def _learners(declared: schema.Declaration, name: str, path: Path) -> Iterator[Learner]:
    """Yields the learners of a variant.

    A variant counts as what its algorithm is, but a net without hidden layers is linear, or a table if it
    learns from one-hot observations alone: it has a row of weights for each observation. If this differs
    between its forms of observation or its picks, the variant counts as what its algorithm is.
    """
    variant, where = declared.algorithms[name], f"{path}: algorithms.{name}"
    algorithm = load_algorithm(variant.algorithm, where)
    of = declared.algorithms.get(variant.reference_for)
    accepted = [form for form in algorithm.observations if of is None or form in of.observations]
    learners: list[Learner] = []
    for observation in variant.observations:
        if observation not in accepted:
            unknown_name(where, f"observation for {variant.algorithm}", observation, accepted)
        chosen = choices.chosen_for(declared, name, observation)
        learners.append(Learner(name, observation, variant, algorithm, algorithm.family, chosen))
    first = next(iter(declared.conditions.values()))
    families = {_family(it, own) for it in learners for own in _settings(declared, it, first, path)}
    family = families.pop() if len(families) == 1 else algorithm.family
    yield from (replace(learner, family=family) for learner in learners)


def _scenarios(declared: schema.Declaration, condition: schema.Condition, path: Path) -> Iterator[Scenario]:
    """Yields the scenarios as they are under a condition."""
    tables = [f"{table}.scenario" for table, change in condition.changes.items() if change.scenario]
    with _of_file(f"{path}: {' with '.join(tables)}"):
        for name in declared.scenarios:
            yield load_scenario(name, condition.scenario_changes(Path(name).stem))


def _population(
    declared: schema.Declaration,
    condition: schema.Condition,
    scenario: Scenario,
    learner: Learner,
    path: Path,
) -> Population:
    variant, seeds = learner.declared, declared.seeds_of(learner.variant, condition)
    if variant.tuned_by:
        choices.check_unseen(scenario, variant, path)
    picks = _settings(declared, learner, condition, path)
    evaluation_every, map_every = declared.evaluation_every, declared.map_every
    if declared.is_miniature:
        evaluation_every = max(picks[0].budget // 4, 1)
        map_every = 2 * evaluation_every
    solved = None
    if declared.solved is not None:  # the version is that of what is recorded
        solved = declared.solved.model_dump(mode="json") | {"policy": variant.policy, "version": 2}
    run = RunSpecification(
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
        settings=picks[0],
        horizon=declared.horizon,
        evaluation_every=evaluation_every,
        map_every=map_every,
        evaluated_from=declared.evaluated_from,
        seed=seeds[0],
        solved=solved,
    )
    firsts = tuple(replace(run, settings=pick) for pick in picks)
    beside = declared.seeds_of(variant.reference_for or learner.variant, condition)
    return Population(condition, scenario, learner, firsts, seeds, beside)


def _settings(
    declared: schema.Declaration, learner: Learner, condition: schema.Condition, path: Path
) -> list[LearnerSettings]:
    """Returns a learner's settings under a condition, checked; several if a search has several picks."""
    cls, found = learner.algorithm.settings, learner.chosen
    own = {
        f"{name}.{inner}" if inner else name: value
        for name, table in learner.declared.settings.items()
        for inner, value in (table.items() if isinstance(table, dict) else [("", table)])
    }
    changed = own | condition.settings_changes(learner.variant)
    where = f"{path}: algorithms.{learner.variant}.settings"
    where += f" ({condition.name})" * (condition.name != schema.DEFAULT_CONDITION)
    picks = [{}] if found is None else [pick.settings for pick in found.picks or (found,)]
    given = [override(declared.settings | pick, changed, where) for pick in picks]
    if declared.is_miniature:
        given = [_in_miniature(each, cls) for each in given]
    return [parse(cls, each, where) for each in given]


def _in_miniature(settings: dict[str, object], cls: type[LearnerSettings]) -> dict[str, object]:
    """Returns settings with a small budget, which rollouts and intervals of records divide."""
    whole = {key: value for key, value in settings.items() if isinstance(value, int)}
    declared = whole.get("budget", cls.model_fields["budget"].default)
    budget = min(max(declared // 25, 1), 1000)
    rollouts = whole.keys() & {"n_steps", "train_freq", "record_every"}
    small = {key: math.gcd(whole[key], budget) for key in rollouts} | {"budget": budget}
    return settings | small | dict.fromkeys(settings.keys() & {"n_envs"}, 1)


def _family(learner: Learner, settings: LearnerSettings) -> str:
    """Returns what a learner counts as with these settings, see `_learners`."""
    net = dict(getattr(settings, "policy_kwargs", None) or {})
    layers = net.get("net_arch")
    if layers is None or len(layers) > 0 or net.get("features_extractor_class"):
        return learner.algorithm.family
    return "tabular" if ENCODINGS[learner.observation] == "one_hot" else "linear"


def all_specifications(experiment: Experiment, seeds: Sequence[int] | None = None) -> list[RunSpecification]:
    """Lists every run of an experiment once, see `interleaved`; with stages, only those of the first."""
    populations = experiment.populations
    return interleaved([(population, population.runs(population.taken(seeds))) for population in populations])


def interleaved(listed: Iterable[tuple[Population, Sequence[RunSpecification]]]) -> list[RunSpecification]:
    """Lists runs of populations once: the first run of each, then the second of each, and so on.

    An interrupted experiment therefore has runs of every population. A condition that changes nothing in a
    scenario has the same runs there as an earlier condition.
    """
    first: dict[str, RunSpecification] = {}
    for run in chain.from_iterable(zip_longest(*(runs for _, runs in listed))):
        if run is not None:
            first.setdefault(run.digest, run)
    return [*first.values()]
