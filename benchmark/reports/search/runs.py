"""The runs of a search, as its report reads them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents import load_algorithm
from benchmark.analysis.intervals import Estimate, combined
from benchmark.analysis.search import Searched, searched
from benchmark.analysis.stages import stages
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, family_of
from envs import InputError

KEY: Final = {"learner": ""}  # the column that names a learner, for readers


@dataclass(frozen=True, eq=False)
class Searches:
    """What a search has found for every learner."""

    experiment: Experiment
    learners: Sequence[Searched]
    note: str = ""
    is_incomplete: bool = False

    @property
    def facts(self) -> Mapping[str, object]:
        """The effort, and what the learners are."""
        assert self.experiment.search is not None
        families = {each.name: family_of(self.experiment, each.variant) for each in self.learners}
        return {"search": self.experiment.search.model_dump(mode="json"), "families": families}


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, an experiment without a search, or with a planner in it."""
    if experiment.search is None:
        raise InputError(f"{experiment.argument}: it has no table [search], which this report needs.")
    for name, declared in experiment.algorithms.items():
        if load_algorithm(declared.algorithm).family == "planner":
            where = f"{experiment.argument}: algorithms.{name}.algorithm = {declared.algorithm}"
            raise InputError(
                f"{where}: it is a planner, which learns nothing; accepted: learning algorithms."
            )


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Searches:
    """Reads all runs of a search.

    Raises:
      InputError: Some are missing, or other seeds or a part are asked for.
    """
    if seeds is not None or partial:
        raise InputError(f"{experiment.name}: a search is reported as a whole: remove --seeds and --partial.")
    for stage, runs in enumerate(stages(experiment, store), start=1):
        if missing := len(driver.pending(runs, store)):
            raise InputError(
                f"{experiment.name}: {missing} of {len(runs)} runs of stage {stage} of 3 are missing: "
                "run the experiment first."
            )
    return Searches(experiment, searched(experiment, store))


def mean(areas: Sequence[NDArray[np.float64]]) -> Estimate:
    """Returns the mean over scenarios of means over runs, given the numbers in [0, 1] of each scenario."""
    share, means = 1 / len(areas), [float(each.mean()) for each in areas]
    return Estimate(
        float(np.mean(means)), *combined([share] * len(areas), means, [len(each) for each in areas])
    )


def gain(x: Sequence[NDArray[np.float64]], y: Sequence[NDArray[np.float64]]) -> Estimate:
    """Returns the difference of two such means, x minus y, as of independent runs.

    Scenarios in which both sides are the same runs add nothing, to the width of the interval neither.
    """
    apart = [pair for pair in zip(x, y, strict=True) if pair[0] is not pair[1]]
    sides, weights = [each for pair in apart for each in pair], [1 / len(x), -1 / len(x)] * len(apart)
    means = [float(each.mean()) for each in sides]
    if not apart:
        return Estimate(0.0, 0.0, 0.0)
    return Estimate(float(np.dot(weights, means)), *combined(weights, means, [len(each) for each in sides]))


def expected_best(areas: NDArray[np.float64], weights: NDArray[Any], most: int) -> NDArray[np.float64]:
    """Returns the expected mean area of the best of b trials, for b from 1 to `most`: (..., most).

    Trials are drawn with replacement. The best of them is that with the largest mean over half of the runs of
    each scenario, and what counts is its mean over the other half, which removes the optimism of the maximum;
    both ways are averaged.

    Args:
      areas: (trials, I, N) of all trials, N at least 2.
      weights: (..., trials) how often each trial counts.
      most: The largest b.

    >>> areas = np.array([0.2, 0.8])[:, None, None].repeat(2, axis=2)
    >>> expected_best(areas, np.ones(2), 2).round(3).tolist()  # 0.8 with probability 1/2, 3/4
    [0.5, 0.65]
    """
    half = areas.shape[2] // 2
    parts = [areas[:, :, part].mean(axis=(1, 2)) for part in (slice(half), slice(half, None))]
    b = np.arange(1, most + 1)
    found = []
    for by, counted in (parts, parts[::-1]):
        order = np.argsort(by, kind="stable")  # the worst first
        up_to = weights[..., order].cumsum(axis=-1) / weights.sum(axis=-1, keepdims=True)
        below = np.concatenate([np.zeros_like(up_to[..., :1]), up_to[..., :-1]], axis=-1)
        is_best = up_to[..., None] ** b - below[..., None] ** b  # (..., trials, most)
        found.append((is_best * counted[order][:, None]).sum(axis=-2))
    return np.asarray(np.mean(found, axis=0))
