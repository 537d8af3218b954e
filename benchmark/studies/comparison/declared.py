"""What an experiment declares of a comparison, and what follows from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, product
from typing import Annotated, Final, Literal

from pydantic import Field

from benchmark.experiments import Experiment
from benchmark.studies.study import Declared
from envs import InputError
from envs.inputs import Names, Table, distinct, unknown_name

Margin = Annotated[float, Field(gt=0, le=0.2)]  # a larger difference matters
Pair = tuple[str, str]  # the learners x and y of a contrast
_TABLES: Final = ("tabular", "linear")  # families of learners that deep ones have to beat


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
    """The learners, of any family, that deep ones have to beat; empty for another question."""
    pool: Literal["scenarios", "none"] = "scenarios"
    """Whether verdicts are on means over scenarios; there is an outcome only of these."""
    margins: Margins = Margins()
    """Differences between x and y that are too small to matter."""
    contrasts: tuple[Pair, ...] = ()
    """Pairs x, y that are compared, with verdicts; by default, all deep learners with all baselines."""
    later: tuple[Pair, ...] = ()
    """Pairs that were declared when results were known; p-values are adjusted for these alone.

    They are compared over all scenarios and in each.
    """
    curves: Names = ()
    """The learners in the figure of success over training; by default those that the outcome is about.

    The figure of success after training shows both.
    """


@dataclass(frozen=True)
class Plan:
    """What is compared; without a declaration, nets have to beat all tables and linear learners."""

    learners: Sequence[str]  # without references
    baseline: Sequence[str]
    contrasts: Sequence[Pair]
    later: Sequence[Pair]
    nets: Sequence[str]  # deep learners, except baselines, that are compared with some baseline
    drawn: Sequence[str]  # learners that the outcome is about, or else those compared, or else all
    curves: Sequence[str]  # learners that are drawn over training


def plan_of(experiment: Experiment, declared: ComparisonDeclared) -> Plan:
    """Returns what is compared."""
    every = experiment.learners
    own = {name: learner.family for name, learner in every.items() if not learner.reference_for}
    deep = [name for name, family in own.items() if family == "deep"]
    baseline, contrasts = declared.baseline, declared.contrasts
    if deep and not (baseline or contrasts):
        baseline = tuple(name for name, family in own.items() if family in _TABLES)
    contrasts = contrasts or tuple(product([name for name in deep if name not in baseline], baseline))
    compared = dict.fromkeys(x for x, y in contrasts if y in baseline and x not in baseline)
    nets = [name for name in compared if name in every and every[name].family == "deep"]
    named = {*chain(*contrasts)}
    drawn = [*baseline, *nets] if nets else [name for name in every if name in named] or [*own]
    return Plan([*own], baseline, contrasts, declared.later, nets, drawn, declared.curves or drawn)


def check(experiment: Experiment, declared: ComparisonDeclared) -> None:
    """Raises an InputError if something cannot be compared, or a net is not compared with all baselines."""
    source, plan = experiment.argument, plan_of(experiment, declared)
    if len(experiment.conditions) > 1:
        raise InputError(f"{source}: readings, grids: accepted in a comparison: none.")
    budgets = set()
    for population in experiment.populations:
        settings = population.first.settings
        unit = getattr(settings, "budget_unit", "steps")
        if unit != "steps":
            where = f"algorithms.{population.learner.variant}.settings.budget_unit = {unit}"
            raise InputError(f"{source}: {where}: accepted: steps, in which a comparison counts.")
        if population.learner.name in {*plan.baseline, *plan.nets}:
            budgets.add(settings.budget)
    if len(budgets) > 1:
        found = f"{source}: settings.budget of baselines and of deep learners"
        raise InputError(f"{found}: accepted: the same for all, not {sorted(budgets)}.")
    _check_names(experiment, plan)
    for x, y in product(plan.nets or ["LEARNER"], plan.baseline):
        if (x, y) not in plan.contrasts:
            why = f"{y} is a baseline, which every deep learner of these contrasts has to beat"
            one = f'one that is ["{x}", "{y}"]'
            raise InputError(f"{source}: report.contrasts: accepted: {one}, since {why}.")


def _check_names(experiment: Experiment, plan: Plan) -> None:
    """Refuses learners that there are not, and pairs that are named twice, either way round."""
    source = f"{experiment.argument}: report"
    pairs = [*plan.contrasts, *plan.later]
    named = {"contrasts, later": [*chain(*pairs)], "curves": plan.curves, "baseline": plan.baseline}
    for key, names in named.items():
        accepted = plan.learners if key == "baseline" else [*experiment.learners]
        for name in names:
            if name not in accepted:
                unknown_name(f"{source}.{key}", "learner", name, accepted)
    for x, y in pairs:
        if x == y:
            raise InputError(f"{source}.contrasts, later: {x}: accepted: two different learners.")
    try:
        distinct(tuple(" and ".join(sorted(pair)) for pair in pairs), f"{source}.contrasts, later: ")
    except ValueError as error:
        raise InputError(f"{error}.") from None
