"""The runs of arms and of their checks."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.analysis.population import load_population
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, Experiment, specifications
from envs import InputError

_DIGITS: Final = 9  # of scores, so that the last digit of two optima does not make them different


class Name(NamedTuple):
    """What names a population; columns of tables are named so."""

    scenario: str
    algorithm: str  # the arm
    observation: str


@dataclass(frozen=True, eq=False)
class Runs:
    """What a population's greedy policies do from the start cell, N agents at T evaluation steps."""

    seeds: Sequence[int]  # (N,)
    steps: Sequence[int]  # (T,)
    success: NDArray[np.float64]  # (N, T) in [0, 1]
    scores: NDArray[np.float64]  # (N, T)


@dataclass(frozen=True, eq=False)
class Data:
    """The populations of all checks and of the arms that they check."""

    runs: Mapping[Name, Runs]  # in the order declared
    checks: Mapping[str, str]  # check to the arm that it checks
    note: str = ""
    is_incomplete: bool = False  # it is reported whole or not at all
    context: None = None  # figures need the tables alone

    @property
    def facts(self) -> dict[str, object]:
        """Nothing that the tables do not say."""
        return {}

    @property
    def pairs(self) -> Iterator[tuple[Name, Name]]:
        """Every population that is checked, and its check's."""
        for name in self.runs:
            if name.algorithm in self.checks:
                yield name._replace(algorithm=self.checks[name.algorithm]), name


def check(experiment: Experiment) -> None:
    """Checks that an experiment has a check, and the default condition alone.

    Raises:
      InputError: It does not.
    """
    if experiment.protocol is not None:
        raise InputError(
            f"{experiment.argument}: protocol: an equivalence takes none; accepted: in an experiment whose "
            "report is comparison or ablation."
        )
    if not any(arm.check_of for arm in experiment.algorithms.values()):
        raise InputError(
            f"{experiment.argument}: algorithms: no arm has the key check_of; accepted: at least one check."
        )
    if list(experiment.conditions) != [DEFAULT_CONDITION]:
        raise InputError(
            f"{experiment.argument}: readings, sweep: an equivalence takes the {DEFAULT_CONDITION} condition "
            "alone."
        )


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Data:
    """Reads the runs of all checks and of the arms that they check.

    Args:
      experiment: As loaded.
      store: Where its records are.
      seeds: Other seeds than the declared ones.
      partial: Refused: a verdict is given on all runs or on none.

    Raises:
      InputError: Runs are missing, and which.
    """
    if partial:
        raise InputError(
            f"--partial: {experiment.name} is reported only when all its runs are there; accepted: an "
            "experiment whose report is comparison."
        )
    checks = {name: arm.check_of for name, arm in experiment.algorithms.items() if arm.check_of}
    runs = {}
    for name in map(Name._make, experiment.populations):
        if name.algorithm in {*checks, *checks.values()}:
            population = load_population(specifications(experiment, DEFAULT_CONDITION, *name, seeds), store)
            runs[name] = Runs(
                population.seeds,
                population.evaluation_steps,
                population.arrays["success"],
                np.round(population.scores, _DIGITS),
            )
    return Data(runs, checks)
