"""What an experiment declares of a comparison, and what its sides name."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field

from benchmark.experiments import Experiment
from benchmark.studies.study import Declared
from envs import InputError
from envs.inputs import Names, Table, distinct, unknown_name
from envs.observations import is_relative

AXES: Final = ("learner", "scenario", "condition")  # columns, in the order in which a side names them
Margin = Annotated[float, Field(gt=0, le=0.2)]  # a larger difference matters
Side = Mapping[str, str]  # the columns that a side of a contrast names, with their values


class Margins(Table):
    """Differences that are too small to matter."""

    success: Margin = 0.1
    """Of success."""
    score: Margin = 0.05
    """Of the score."""


class ComparisonDeclared(Declared):
    """What a comparison decides and how, declared before its runs.

    A side of a contrast names a learner, such as "dqn, one_hot", a scenario, or a condition; two or
    three of these are joined by " @ ". What it does not name varies on both sides together.
    """

    baseline: Names = ()
    """The learners, of any family, that deep ones have to beat; empty for another question."""
    pool: Literal["scenarios", "none"] = "scenarios"
    """Whether verdicts are on means over scenarios."""
    margins: Margins = Margins()
    """Differences between x and y that are too small to matter."""
    contrasts: tuple[tuple[str, str], ...] = ()
    """Pairs x, y that are compared, with verdicts."""
    later: tuple[tuple[str, str], ...] = ()
    """Pairs that were declared when results were known; p-values are adjusted for these alone.

    Each that names no scenario is compared over all scenarios and in each.
    """
    curves: Names = ()
    """The learners in the figure of success over training; by default those that the outcome is about.

    The figure of success after training shows both.
    """


class Pair(NamedTuple):
    """The two sides of a contrast, which name the same columns."""

    x: Side
    y: Side


@dataclass(frozen=True)
class Plan:
    """What is compared, with names resolved."""

    learners: Mapping[str, str]  # the family of each, by name, without references
    baseline: Sequence[str]
    contrasts: Sequence[Pair]
    later: Sequence[Pair]
    nets: Sequence[str]  # deep learners, except baselines, that are compared with some baseline
    drawn: Sequence[str]  # learners that the outcome is about, or else those compared, or else all
    curves: Sequence[str]  # learners that are drawn over training


def side_name(side: Side) -> str:
    """Returns the name of a side in tables, such as "dqn, one_hot @ S1"."""
    return " @ ".join(side[axis] for axis in AXES if axis in side)


def knowledge(learner: str) -> str:
    """Returns what a learner of this name observes of people: cells, or offsets from the agent."""
    return "offsets" if is_relative(learner.partition(", ")[2]) else "cells"


def plan_of(experiment: Experiment, declared: ComparisonDeclared) -> Plan:
    """Resolves the declared names; if nothing is declared, nets have to beat all tables and linear learners.

    An InputError says which side of a contrast is wrong.
    """
    every = experiment.learners
    own = {name: learner.family for name, learner in every.items() if not learner.reference_for}
    baseline, contrasts = declared.baseline, declared.contrasts
    if is_by_default := not (baseline or contrasts):
        nets = [name for name, family in own.items() if family == "deep"]
        baseline = tuple(name for name, family in own.items() if nets and family in ("tabular", "linear"))
        contrasts = tuple(product(nets, baseline))
    pairs = [_pair(experiment, f"contrasts.{i}", x, y) for i, (x, y) in enumerate(contrasts)]
    is_pooled = declared.pool == "scenarios" and len(experiment.scenarios) > 1
    later = [
        _pair(experiment, f"later.{i}", x + where, y + where)
        for i, (x, y) in enumerate(declared.later)
        for where in ("", *(f" @ {name}" for name in experiment.scenarios if is_pooled and " @ " not in x))
    ]
    compared = dict.fromkeys(x for x, y in contrasts if y in baseline and x not in baseline)
    decisive = [name for name in compared if every[name].family == "deep"]
    named = {side.get("learner") for pair in pairs for side in pair}
    drawn = [*baseline, *decisive] if decisive else [name for name in every if name in named]
    drawn = [*own] if is_by_default or not drawn else drawn
    return Plan(own, baseline, pairs, later, decisive, drawn, declared.curves or drawn)


def check(experiment: Experiment, declared: ComparisonDeclared) -> None:
    """Raises an InputError if something cannot be compared, or a net is not compared with all baselines."""
    source, plan = experiment.argument, plan_of(experiment, declared)
    for population in experiment.populations:
        unit = getattr(population.first.settings, "budget_unit", "steps")
        if unit != "steps":
            where = f"algorithms.{population.learner.variant}.settings.budget_unit = {unit}"
            raise InputError(f"{source}: {where}: accepted: steps, in which a comparison counts.")
    _check_pairs(experiment, plan)
    for name in plan.curves:
        if name not in experiment.learners:
            unknown_name(f"{source}: report.curves", "learner", name, experiment.learners)
    for y in plan.baseline:
        if y not in plan.learners:
            unknown_name(f"{source}: report.baseline", "baseline", y, plan.learners)
        for x in plan.nets or ["LEARNER"]:
            if Pair({"learner": x}, {"learner": y}) not in plan.contrasts:
                why = f"{y} is a baseline, which every deep learner of these contrasts has to beat"
                one = f'one that is ["{x}", "{y}"]'
                raise InputError(f"{source}: report.contrasts: accepted: {one}, since {why}.")


def _check_pairs(experiment: Experiment, plan: Plan) -> None:
    """Refuses pairs without runs that are otherwise alike, and those named twice, either way round."""
    source = f"{experiment.argument}: report"
    names = ((each.learner.name, each.scenario.name, each.condition.name) for each in experiment.populations)
    populations = [dict(zip(AXES, name, strict=True)).items() for name in names]
    pairs = [*plan.contrasts, *plan.later]
    for pair in pairs:
        # What else names the populations of each side
        x, y = ({frozenset(p - side.items()) for p in populations if p >= side.items()} for side in pair)
        if x.isdisjoint(y):
            found = " and ".join(map(side_name, pair))
            raise InputError(f"{source}: {found}: accepted: two with runs that are otherwise alike.")
    several = [axis for axis, every in _names(experiment).items() if len(every) > 1]

    def label(pair: Pair) -> str:
        sides = ({axis: side[axis] for axis in several if axis in side} for side in pair)
        return " and ".join(sorted(map(side_name, sides)))

    try:
        distinct(tuple(map(label, pairs)), f"{source}.contrasts, later: ")
    except ValueError as error:
        raise InputError(f"{error}.") from None


def _names(experiment: Experiment) -> dict[str, Collection[str]]:
    """Returns the names on each axis."""
    names = experiment.learners, experiment.scenarios, experiment.conditions
    return dict(zip(AXES, names, strict=True))


def _pair(experiment: Experiment, key: str, x: str, y: str) -> Pair:
    where = f"{experiment.argument}: report.{key}"
    pair = Pair(_side(experiment, where, x), _side(experiment, where, y))
    if pair.x == pair.y or pair.x.keys() != pair.y.keys():
        raise InputError(f"{where} = {[x, y]}: accepted: two different names of the same kind.")
    return pair


def _side(experiment: Experiment, where: str, text: str) -> Side:
    """Returns the columns that a side names: learner, scenario and condition, joined by " @ "."""
    axes = [(axis, name) for axis, names in _names(experiment).items() for name in names]
    side = dict[str, str]()
    for part in text.split(" @ "):
        named = [axis for axis, name in axes if name == part]
        if not named:
            accepted = [f'"{name}"' for _, name in axes]
            unknown_name(where, "learner, scenario or condition", f'"{part}"', accepted)
        if len(named) > 1:
            raise InputError(f'{where} = "{text}": {part} names a scenario and a condition; rename one.')
        (axis,) = named
        if axis in side:
            raise InputError(f'{where} = "{text}": accepted: at most one {axis} on a side.')
        side[axis] = part
    return side
