"""Experiments, resolved: what a file declares, with every name looked up and every run known.

Nothing after `load_experiment` looks up a name again, or asks in which way a condition was declared.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final

from agents import Algorithm, LearnerSettings, dynamic_programming, load_algorithm
from benchmark.experiments import choices, schema
from benchmark.experiments.run import RunSpecification
from benchmark.experiments.search import Chosen
from envs import InputError, Scenario, load_scenario, model
from envs.inputs import check_all, override, parse, unknown_name
from envs.observations import ENCODINGS, SPARSE, check_sparse, seen_as
from envs.sources import digest_of_source
from envs.tiles import check_tiles

MAX_RUNS: Final = 100_000  # of an experiment: more than a day at a second each


@dataclass(frozen=True)
class Learner:
    """A variant with one form of observation."""

    variant: str
    observation: str
    declared: schema.Variant
    algorithm: Algorithm
    family: str
    """What its variant counts as, see `_Loading.learners` and `Algorithm.family`."""
    chosen: Chosen | None
    """What its search has chosen for it, if it has one."""
    changed: tuple[str, ...] = ()
    """The chosen settings that the experiment overrides."""

    @property
    def name(self) -> str:
        """Its name in files."""
        return f"{self.variant}, {self.observation}"

    @property
    def title(self) -> str:
        """What readers call it, see `title_of`."""
        return title_of(self.declared.title or self.variant, self.observation, self.family)

    @property
    def reference_for(self) -> str:
        """The name of the learner that it is the reference implementation of; empty if it is none."""
        of = self.declared.reference_for
        return f"{of}, {self.observation}" if of else ""


_TILES: Final[dict[str, Any]] = {"n_tilings": 0, "parts": "joint"}  # settings of features, if there are any
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

    @property
    def conditions(self) -> Mapping[str, schema.Condition]:
        """All conditions, by name."""
        return self.declared.conditions

    @cached_property
    def _by_names(self) -> Mapping[tuple[str, str], Sequence[Population]]:
        """The populations of each condition and learner, by their names."""
        found = defaultdict[tuple[str, str], list[Population]](list)
        for population in self.populations:
            found[population.condition.name, population.learner.name].append(population)
        return found

    def population(self, condition: str, scenario: str, learner: str) -> Population:
        """Returns a population by its names; the scenario may be any other, by name or path."""
        alike = self._by_names[condition, learner]
        name = Path(scenario).stem
        if name in self.scenarios:
            return next(population for population in alike if population.scenario.name == name)
        other = load_scenario(scenario, alike[0].condition.scenario_changes(name))
        firsts = tuple(replace(first, scenario=other) for first in alike[0].firsts)
        for first in firsts:
            check_size(first)  # as if it were declared
        return replace(alike[0], scenario=other, firsts=firsts)


def load_experiment(experiment: str | Path, *, smoke: bool = False) -> Experiment:
    """Reads an experiment, and checks it together with the algorithms and scenarios that it names.

    It is the name of a shipped experiment, or the path of a TOML file. With `smoke`, it is a miniature, with
    two runs of each learner and a twenty-fifth of the budget. Mistakes are an InputError with a sentence for
    each. Its report checks what it demands.
    """
    declared, path = schema.read_experiment(experiment)
    loaded = _Loading(declared.miniature() if smoke else declared, path).experiment()
    code = {each for population in loaded.populations for each in population.first.code.items()}
    for name in sorted(name for name, digest in code if digest_of_source(name) != digest):
        what = f"the module {name}, or one that it imports, has changed since it was loaded"
        raise InputError(f"{loaded.path}: {what}; restart this program or the notebook's kernel.")
    return loaded


class _Loading:
    """Resolves what a file declares, and collects its mistakes."""

    def __init__(self, declared: schema.Declaration, path: Path) -> None:
        self.declared, self.path = declared, path
        self.mistakes: dict[str, str] = {}  # lines, by their distinctive part

    def experiment(self) -> Experiment:
        """Returns the experiment; raises an InputError with all mistakes at once."""
        declared, variants = self.declared, self.declared.algorithms
        if declared.most_runs > MAX_RUNS:
            found = f"up to {declared.most_runs:,} runs"
            raise InputError(f"{self.path}: {found}; accepted: at most {MAX_RUNS:,}.")
        check_all(  # everything else depends on these
            *(partial(_check_observations, declared, name, self.path) for name in variants),
            *(partial(choices.check_source, declared, name, self.path) for name in variants),
            partial(_check_scenarios, declared, self.path),
        )
        learners = {learner.name: learner for name in variants for learner in self.learners(name)}
        conditions = declared.conditions.values()
        populations = [*chain(*(self.populations(each, learners.values()) for each in conditions))]
        for name in variants:
            with self.noted():
                choices.check_seeds(declared, name, self.path)
        if self.mistakes:
            raise InputError(*self.mistakes.values())
        _check_titles(learners.values(), str(self.path))
        scenarios = {Path(name).stem: load_scenario(name) for name in declared.scenarios}
        path = self.path.with_stem(declared.name)  # a miniature has a file of chosen settings of its own
        return Experiment(declared, path, learners, scenarios, populations)

    @contextmanager
    def noted(self, prefix: str = "", common: str = "") -> Iterator[None]:
        """Collects mistakes, after a prefix; lines that differ only in a first part `common` count once."""
        try:
            yield
        except InputError as error:
            for line in error.args:
                self.mistakes.setdefault(line.removeprefix(common), prefix + line)

    def learners(self, name: str) -> Iterator[Learner]:
        """Yields the learners of a variant.

        A variant counts as what its algorithm is, but a net without hidden layers is linear, or a table if it
        learns from one-hot observations alone: it has a row of weights for each observation. If this differs
        between its forms of observation or its picks, the variant counts as what its algorithm is.
        """
        variant, first = self.declared.algorithms[name], next(iter(self.declared.conditions.values()))
        algorithm = load_algorithm(variant.algorithm)
        learners: list[Learner] = []
        families: set[str] = {algorithm.family}
        for observation in variant.observations:
            chosen = None
            with self.noted():
                chosen = choices.chosen_for(self.declared, name, observation)
            changed = tuple(choices.changed_settings(self.declared, name))
            learners.append(Learner(name, observation, variant, algorithm, algorithm.family, chosen, changed))
        with suppress(InputError):  # `populations` reports wrong settings
            families = {_family(it, own) for it in learners for own in self._settings(it, first)}
        family = families.pop() if len(families) == 1 else algorithm.family
        yield from (replace(learner, family=family) for learner in learners)

    def populations(self, condition: schema.Condition, learners: Iterable[Learner]) -> Iterator[Population]:
        """Yields the populations of a condition whose scenario, settings and sizes are accepted."""
        names = [Path(scenario).stem for scenario in self.declared.scenarios]
        for table, change in condition.changes.items():
            for name in {*(change.scenarios or ())}.difference(names):
                with self.noted():
                    unknown_name(f"{self.path}: {table}.scenarios", "scenario", name, names)
        accepted: list[tuple[Learner, list[LearnerSettings]]] = []
        for learner in learners:
            if condition.has(learner.variant, learner.observation):
                with self.noted(common=f"{self._where(learner, condition)}: "):
                    accepted.append((learner, self._settings(learner, condition)))
        tables = [f"{table}.scenario" for table, change in condition.changes.items() if change.scenario]
        for path, name in zip(self.declared.scenarios, names, strict=True):
            with self.noted(f"{self.path}: {' with '.join(tables)}: ", f"{name}: "):
                scenario = load_scenario(path, condition.scenario_changes(name))
                for learner, settings in accepted:
                    yield self._population(condition, scenario, learner, settings)

    def _population(
        self, condition: schema.Condition, scenario: Scenario, learner: Learner, picks: list[LearnerSettings]
    ) -> Population:
        """Returns a population; its size, and whether its scenario is one of a search, is checked."""
        declared, variant = self.declared, learner.declared
        seeds, settings = declared.seeds_of(learner.variant, condition), picks[0]
        evaluation_every, map_every = declared.evaluation_every, declared.map_every
        if declared.is_miniature:
            evaluation_every = max(settings.budget // 4, 1)
            map_every = 2 * evaluation_every
        solved = None
        if declared.solved is not None:  # the version is that of what is recorded
            solved = declared.solved.model_dump(mode="json")
            solved |= {"policy": variant.policy, "version": 2}
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
            settings=settings,
            horizon=declared.horizon,
            evaluation_every=evaluation_every,
            map_every=map_every,
            evaluated_from=declared.evaluated_from,
            seed=seeds[0],
            solved=solved,
        )
        where = f"{self.path}: algorithms.{learner.variant}"
        firsts = tuple(replace(run, settings=pick) for pick in picks)
        with self.noted(f"{where}: "):
            for first in firsts:
                check_size(first)
            if declared.solved and evaluation_every >= settings.budget:
                accepted = f"less than budget = {settings.budget} with [solved]"
                raise InputError(f"evaluation_every = {evaluation_every}; accepted: {accepted}.")
        if variant.tuned_by:
            with self.noted(f"{where}.tuned_by: "):
                choices.check_unseen(scenario, variant)
        beside = declared.seeds_of(variant.reference_for or learner.variant, condition)
        return Population(condition, scenario, learner, firsts, seeds, beside)

    def _settings(self, learner: Learner, condition: schema.Condition) -> list[LearnerSettings]:
        """Returns a learner's settings under a condition, checked; several if a search has several picks."""
        shared, cls = self.declared.settings, learner.algorithm.settings
        for name in shared:
            if name not in cls.model_fields:
                where = f"{self.path}: [settings], which {learner.variant} shares"
                unknown_name(where, "key", name, cls.model_fields)
        own = {
            f"{name}.{inner}" if inner else name: value
            for name, table in learner.declared.settings.items()
            for inner, value in (table.items() if isinstance(table, dict) else [("", table)])
        }
        changed = own | condition.settings_changes(learner.variant)
        found = learner.chosen
        picks = [{}] if found is None else [pick.settings for pick in found.picks or (found,)]
        where = self._where(learner, condition)
        given = [override(shared | pick, changed, where) for pick in picks]
        if self.declared.is_miniature:
            given = [_in_miniature(each, cls) for each in given]
        settings = [parse(cls, each, where) for each in given]
        budgets = {(each.budget, getattr(each, "budget_unit", "")) for each in settings}
        if len(budgets) > 1:
            accepted = "one for all picks of a search, since their runs are compared as one learner's"
            raise InputError(f"{where}: several budgets; accepted: {accepted}.")
        return settings

    def _where(self, learner: Learner, condition: schema.Condition) -> str:
        """Returns the tables that a learner's settings come from, for messages."""
        parts = [f"{self.path}: algorithms.{learner.variant}.settings"]
        parts += ["[settings]"] * bool(self.declared.settings)
        parts += [f"tuned_by = {learner.declared.tuned_by}"] * (learner.chosen is not None)
        parts += [f"{table}.settings" for table, change in condition.changes.items() if change.settings]
        parts += [f"search ({condition.name})"] * bool(condition.of_variants)
        return " with ".join(parts)


def _check_observations(declared: schema.Declaration, name: str, path: Path) -> None:
    variant, where = declared.algorithms[name], f"{path}: algorithms.{name}"
    accepted = load_algorithm(variant.algorithm, where).observations
    of = variant.reference_for
    of_variant = declared.algorithms[of].observations if of else accepted
    for observation in variant.observations:
        if observation not in accepted:
            unknown_name(where, f"observation for {variant.algorithm}", observation, accepted)
        if observation not in of_variant:
            reason = f"{of} does not learn from {observation}; accepted: {', '.join(of_variant)}"
            raise InputError(f"{where}.observations: {reason}.")


def _check_scenarios(declared: schema.Declaration, path: Path) -> None:
    try:
        check_all(*(partial(load_scenario, scenario) for scenario in declared.scenarios))
    except InputError as error:
        raise InputError(*(f"{path}: {line}" for line in error.args)) from error


def _check_titles(learners: Iterable[Learner], where: str) -> None:
    first: dict[str, str] = {}
    for learner in learners:
        other = first.setdefault(learner.title, learner.name)
        if other != learner.name:
            found = f'"{learner.title}" is the name of {other} and of {learner.name}'
            raise InputError(f"{where}: algorithms: {found}; accepted: titles that differ.")


def _in_miniature(settings: dict[str, object], cls: type[LearnerSettings]) -> dict[str, object]:
    """Returns settings with a small budget, which rollouts and intervals of records divide."""
    whole = {key: value for key, value in settings.items() if isinstance(value, int)}
    budget = max(whole.get("budget", cls.model_fields["budget"].default) // 25, 1)
    rollouts = whole.keys() & {"n_steps", "train_freq", "record_every"}
    small = {key: math.gcd(whole[key], budget) for key in rollouts} | {"budget": budget}
    return settings | small | dict.fromkeys(settings.keys() & {"n_envs"}, 1)


def _family(learner: Learner, settings: LearnerSettings) -> str:
    """Returns what a learner counts as with these settings, see `_Loading.learners`."""
    net = dict(getattr(settings, "policy_kwargs", None) or {})
    layers = net.get("net_arch")
    if layers is None or len(layers) > 0 or net.get("features_extractor_class"):
        return learner.algorithm.family
    return "tabular" if ENCODINGS[learner.observation] == "one_hot" else "linear"


def check_size(run: RunSpecification) -> None:
    """Refuses, by an InputError, observations and records of a run that do not fit into memory."""
    scenario = seen_as(run.scenario, run.observation)
    if ENCODINGS[run.observation] == "one_hot":
        widths = [width for _, width in scenario.observed_sizes.values()]
        check_sparse(scenario.n_observations, sum(widths))
    n_tilings, parts = (getattr(run.settings, key, default) for key, default in _TILES.items())
    check_tiles(scenario, n_tilings, parts)
    if ENCODINGS[run.observation] in SPARSE:
        for key in sorted({"n_tilings", "parts", "tile_width"} & run.settings.model_fields_set):
            found = f"{key} = {getattr(run.settings, key)} with {run.observation}, which has its own features"
            raise InputError(f"{found}; accepted: no {key}, or a form of coordinates.")


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
