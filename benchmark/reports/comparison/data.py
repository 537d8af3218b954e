"""The runs of a comparison: its learners, their populations, and what is missing."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from benchmark.analysis.population import Population, load_population
from benchmark.execution.store import Store, evaluated
from benchmark.experiments import DEFAULT_CONDITION, Experiment, RunSpecification, specifications
from benchmark.experiments.schema import Effect
from benchmark.reports.comparison.protocol import Learner, Protocol, protocol_of
from envs import InputError, Model

Values = NDArray[np.float64]

SB3: Final = "Stable-Baselines3 itself"  # what trains checks, as readers see it
_LISTED: Final = 4  # populations that a sentence on missing runs names


@dataclass(frozen=True)
class Context:
    """What the figures need in addition to the tables."""

    models: Mapping[str, Model]  # by scenario
    panels: Mapping[str, Sequence[Learner]]  # title to the learners that are drawn together, without checks
    arms: Sequence[str]  # all that are declared, in the order of their colours, without checks
    checks: Mapping[Learner, Learner]  # to the learner that each checks
    check_note: str  # what figures say of checks; empty if there are none
    protocol: Protocol | None
    tuning: Mapping[str, int]  # arm to how many settings were tried; without arms that do not say
    learners: Sequence[Learner]  # without checks


@dataclass(frozen=True, eq=False)
class Data:
    """The populations of a comparison."""

    # Of every scenario, in the order declared; a check follows the learner that it checks.
    learners: Mapping[Learner, Mapping[str, Population]]
    missing: str = ""  # which runs are missing; empty if none is
    groups: Mapping[str, str] = field(
        default_factory=dict
    )  # arm to its group; those of none are drawn with all
    checks: Mapping[Learner, Learner] = field(default_factory=dict)  # to the learner that each checks
    policies: Mapping[str, str] = field(default_factory=dict)  # arm to its policy; greedy if it is not named
    arms: Sequence[str] = ()  # all that are declared, without checks
    protocol: Protocol | None = None  # None if there is nothing to decide
    tuning: Mapping[str, int] = field(default_factory=dict)  # arm to how many settings were tried, if it says
    effects: Sequence[Effect] = ()  # as declared
    seeds_note: str = ""  # which seeds there are instead of those declared

    @property
    def populations(self) -> Iterator[tuple[Learner, str, Population]]:
        """Every learner, scenario and population."""
        for learner, by_scenario in self.learners.items():
            for scenario, population in by_scenario.items():
                yield learner, scenario, population

    @property
    def note(self) -> str:
        """What is missing or other than declared, in sentences; empty if nothing is."""
        missing = f"Partial: {self.missing}." if self.missing else ""
        return " ".join(filter(None, [missing, self.seeds_note]))

    @property
    def is_incomplete(self) -> bool:
        """Whether runs are missing."""
        return bool(self.missing)

    @property
    def facts(self) -> dict[str, object]:
        """The protocol, with all that is left open in the experiment."""
        return {"protocol": None if self.protocol is None else self.protocol.as_json()}

    @property
    def context(self) -> Context:
        """See `Context`."""
        learners = self.without_checks.learners
        everywhere = [learner for learner in learners if not self.groups.get(learner.algorithm)]
        panels: dict[str, list[Learner]] = {}
        for learner in learners:
            group = self.groups.get(learner.algorithm)
            if group:
                panels.setdefault(group, [*everywhere]).append(learner)
        first = next(iter(learners.values()))
        return Context(
            models={scenario: population.model for scenario, population in first.items()},
            panels=panels or {"all": everywhere},
            arms=self.arms or list(dict.fromkeys(learner.algorithm for learner in learners)),
            checks=self.checks,
            check_note=self._check_note,
            protocol=self.protocol,
            tuning=self.tuning,
            learners=list(learners),
        )

    @property
    def _check_note(self) -> str:
        """What figures say of checks."""
        populations = [each for check in self.checks for each in self.learners[check].values()]
        if not populations:
            return ""
        sizes = [len(each.seeds) for each in populations]
        n = f"{max(sizes)}" if min(sizes) == max(sizes) else f"{min(sizes)} to {max(sizes)}"
        nets = [each for each in populations if each.algorithm.family == "deep"]
        is_sb3 = bool(nets) and all("stable_baselines3" in each.algorithm.packages for each in nets)
        return f"hollow: checks, {n} runs{f', nets by {SB3}' if is_sb3 else ''}"

    @property
    def without_checks(self) -> Self:
        """The same without checks."""
        learners = {learner: each for learner, each in self.learners.items() if learner not in self.checks}
        return replace(self, learners=learners, checks={})

    @property
    def mapped(self) -> Iterator[tuple[Learner, str, Population]]:
        """The populations without checks in scenarios that one map shows, see `envs.Model.has_cell_maps`."""
        return (each for each in self.without_checks.populations if each[2].model.has_cell_maps)

    def policy(self, learner: Learner) -> str:
        """Returns the policy that a learner is compared by, `"greedy"` or `"stochastic"`."""
        return self.policies.get(learner.algorithm, "greedy")

    def results(self, learner: Learner, scenario: str, name: str, start: str = "start") -> Values:
        """Returns what a learner's policy is evaluated as, (N, T).

        Args:
          learner: One of `learners`.
          scenario: One of its scenarios.
          name: `"score"`, without bounds; `"clipped"`, the score clipped to [0, 1]; or a field of
            `agents.dynamic_programming.Evaluation`.
          start: Where episodes start.
        """
        population, policy = self.learners[learner][scenario], self.policy(learner)
        if name in ("score", "clipped"):
            # Rounded, so that the last digit of two optima does not decide which of them is better.
            scores = np.round(population.scores_of(policy, start), 9)
            return np.clip(scores, 0.0, 1.0) if name == "clipped" else scores
        return np.asarray(population.arrays[evaluated(name, policy, start)])


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Data:
    """Reads all runs of a comparison.

    Args:
      experiment: As loaded.
      store: Where its records are.
      seeds: Other seeds than the declared ones.
      partial: Whether to take the runs that are there if some are missing; learners with fewer than two
        seeds in all scenarios are then left out.

    Raises:
      InputError: Runs are missing, and which; or there are too few to draw anything.
    """
    statuses, ended = store.statuses(), store.ended()
    declared = {
        (Learner(arm, observation), scenario): specifications(
            experiment, DEFAULT_CONDITION, scenario, arm, observation, seeds
        )
        for scenario, arm, observation in experiment.populations
    }
    there = {key: [run for run in runs if run.digest in ended] for key, runs in declared.items()}
    missing = _missing(declared, there, statuses)
    if missing and not partial:
        raise InputError(
            f"{experiment.name}: {missing}: run the experiment first, or draw the existing runs with "
            "--partial."
        )
    place = {name: i for i, name in enumerate(dict.fromkeys(learner for learner, _ in declared))}
    checks = {
        name: Learner(experiment.algorithms[name.algorithm].check_of, name.observation)
        for name in place
        if experiment.algorithms[name.algorithm].check_of
    }
    order = place | {check: place[checked] for check, checked in checks.items()}
    names = sorted(place, key=lambda name: (order[name], name in checks))
    few = {name for name in names if len(_common_seeds(name, there)) < 2}
    few |= {check for check, checked in checks.items() if checked in few}
    learners: dict[Learner, dict[str, Population]] = {}
    for name in names:
        if name not in few:
            populations = [
                load_population(runs, store) for (learner, _), runs in there.items() if learner == name
            ]
            learners[name] = {population.scenario: population for population in populations}
    if len(learners.keys() - checks.keys()) < 2:
        raise InputError(
            f"{experiment.name}: {missing or 'too few runs'}: accepted: at least two learners that are no "
            "checks, each with two runs of every scenario."
        )
    left_out = "left out: " + ", ".join(f"`{learner}`" for learner in sorted(few)) if few else ""
    groups = {name: arm.group for name, arm in experiment.algorithms.items()}
    checks = {check: checked for check, checked in checks.items() if check in learners}
    policies = {name: arm.policy for name, arm in experiment.algorithms.items()}
    for learner, by_scenario in learners.items():
        for population in by_scenario.values():
            if not population.scores_of(policies[learner.algorithm], "start").shape[1]:
                raise InputError(
                    f"{experiment.argument}: algorithms.{learner.algorithm}.policy = "
                    f'"{policies[learner.algorithm]}": its training returns no such policy; accepted: '
                    '"greedy".'
                )
    return Data(
        learners,
        "; ".join(filter(None, [missing, left_out])),
        groups,
        checks,
        policies,
        [name for name, arm in experiment.algorithms.items() if not arm.check_of],
        protocol_of(experiment),
        {name: arm.tuning.settings for name, arm in experiment.algorithms.items() if arm.tuning is not None},
        experiment.effects,
        ""
        if seeds is None
        else f"Every learner has the seeds {min(seeds)} to {max(seeds)} instead of those declared.",
    )


def _common_seeds(name: Learner, there: Mapping[tuple[Learner, str], Sequence[RunSpecification]]) -> set[int]:
    """Returns the seeds of which a learner has a run in every scenario."""
    return set.intersection(
        *({run.seed for run in runs} for (learner, _), runs in there.items() if learner == name)
    )


def _missing(
    declared: Mapping[tuple[Learner, str], Sequence[RunSpecification]],
    there: Mapping[tuple[Learner, str], Sequence[RunSpecification]],
    statuses: Mapping[str, str],
) -> str:
    """Says which runs are missing; empty if none is."""
    lacking = [
        f"{learner} in {scenario} has {len(there[learner, scenario])} of {len(runs)}"
        for (learner, scenario), runs in declared.items()
        if len(there[learner, scenario]) < len(runs)
    ]
    if not lacking:
        return ""
    n_runs = sum(map(len, declared.values()))
    n_failed = sum(statuses.get(run.digest) == "failed" for runs in declared.values() for run in runs)
    more = f"; and {len(lacking) - _LISTED} more populations" if len(lacking) > _LISTED else ""
    failed = f", {n_failed} of them failed" if n_failed else ""
    n_missing = n_runs - sum(map(len, there.values()))
    return f"{n_missing} of {n_runs} runs are missing{failed} ({'; '.join(lacking[:_LISTED])}{more})"
