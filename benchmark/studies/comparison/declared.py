"""What an experiment declares of a comparison."""

from itertools import chain
from typing import Annotated, Literal

from pydantic import Field

from benchmark.experiments import Experiment
from benchmark.studies.study import Declared
from envs import InputError
from envs.inputs import Names, Table, unknown_name

Margin = Annotated[float, Field(gt=0, le=0.2)]  # a larger difference matters
Pair = tuple[str, str]  # the learners x and y of a contrast


class Margins(Table):
    """Differences that are too small to matter."""

    success: Margin = 0.1
    """Of success."""
    score: Margin = 0.05
    """Of the score."""


class ComparisonDeclared(Declared):
    """What a comparison decides and how, declared before its runs.

    Learners are named by variant and form of observation, such as "dqn, one_hot".
    """

    baseline: Names = ()
    """The learners, of any family, that deep ones have to beat; figures show both."""
    pool: Literal["scenarios", "none"] = "scenarios"
    """Whether verdicts are on means over scenarios."""
    margins: Margins = Margins()
    """Differences between x and y that are too small to matter."""
    contrasts: tuple[Pair, ...] = ()
    """Pairs x, y that are compared, with verdicts."""
    later: tuple[Pair, ...] = ()
    """Pairs that were declared when results were known; p-values are adjusted for these alone.

    They are compared over all scenarios and in each.
    """
    curves: Names = ()
    """The learners in the figure of success over training; by default baselines and nets.

    The figure of success after training shows both.
    """


def check(experiment: Experiment, declared: ComparisonDeclared) -> None:
    """Raises an InputError if something cannot be compared, or names a learner that there is not."""
    source, learners = experiment.argument, experiment.learners
    if len(experiment.declared.conditions) > 1:
        raise InputError(f"{source}: readings, grids: accepted in a comparison: none.")
    settings = [population.first.settings for population in experiment.populations]
    if len({each.budget for each in settings}) > 1:
        raise InputError(f"{source}: settings.budget: accepted in a comparison: the same for all learners.")
    if any(getattr(each, "budget_unit", "steps") != "steps" for each in settings):
        raise InputError(f"{source}: settings.budget_unit: accepted in a comparison: steps.")
    own = [name for name, learner in learners.items() if not learner.reference_for]
    pairs = {"contrasts": declared.contrasts, "later": declared.later}
    named = {key: [*chain(*each)] for key, each in pairs.items()} | {"curves": [*declared.curves]}
    for key, names in {**named, "baseline": declared.baseline}.items():
        accepted = own if key == "baseline" else [*learners]
        for name in names:
            if name not in accepted:
                unknown_name(f"{source}: report.{key}", "learner", name, accepted)
